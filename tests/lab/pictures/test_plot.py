"""The figure of a recording and the film of a run contain correct numbers and visible content."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

import tci as package
from helpers.command_line import tci
from tci.capabilities.fields import default_fields
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, RecordingError, UnknownNameError
from tci.lab.pictures.film import Film
from tci.lab.pictures.plot import _draw_patch, _outline, collect, draw
from tci.recording.perceived import perceive
from tci.recording.recording import Recording
from tci.recording.yarp_log import import_yarp_log
from tci.robot.limb import generic_limb_distance


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plot") / "poke.mcap"
    tci("run", "withdrawal", "nao", "--poke", "--duration", "0.7", "--record", str(path))
    return path


def test_the_figure_says_what_the_command_says(recorded: Path, tmp_path: Path) -> None:
    told = json.loads(tci("plot", str(recorded), "--out", str(tmp_path / "a.png"), "--json"))
    assert told["part"] == "left_arm"
    assert told["periods"] == 350
    (touch,) = told["touches"]
    assert touch["patch"] == "left_forearm"
    assert 0.0 <= touch["command_ms"] < touch["motion_ms"] <= touch["lost_ms"] + 50.0
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"))
    assert picture.shape[0] > 1000
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    assert "left_forearm" in tci("plot", str(recorded), "--out", str(tmp_path / "b.svg"))
    assert (tmp_path / "b.svg").read_text().startswith("<?xml")


def test_lines_are_those_of_the_recording(recorded: Path) -> None:
    robot = package.load_robot("nao")
    periods = list(perceive(Recording(recorded), robot))
    (part,), series = collect(robot, periods, part=None)
    assert part == "left_arm"
    forces = [sum(contact.force for contact in period.perception.contacts) for period in periods]
    assert np.array_equal(series.forces["left_forearm"], forces)
    commanded = np.isfinite(series.sent[part]).all(axis=1)
    assert commanded.any()
    # The reference moves ahead of the measured angle, and the arm finally reaches the reference.
    assert np.abs(series.sent[part][-1] - series.measured[part][-1]).max() < np.deg2rad(1.0)
    (other,), right = collect(robot, periods, part="right_arm")
    assert other == "right_arm"
    assert not np.isfinite(right.sent[other]).any()
    with pytest.raises(UnknownNameError, match="tail"):
        collect(robot, periods, part="tail")
    with pytest.raises(RecordingError, match="no period"):
        collect(robot, periods, begin=5.0, part=None)


class Nod(package.Capability[int]):
    """Lowers the head when a contact begins."""

    def init(self, body: package.GenericBody) -> int:
        return 0

    def step(
        self, memory: int, perception: package.Perception, body: package.GenericBody
    ) -> tuple[tuple[package.GenericCommand, ...], int]:
        if memory or not perception.contacts:
            return (), memory
        return (package.GenericCommand("head", package.Mode.POSITION, np.deg2rad([15.0, 0.0, 0.0])),), 1


def test_a_response_of_another_part_is_drawn_and_a_contact_to_the_end_is_said(tmp_path: Path) -> None:
    path = tmp_path / "nod.mcap"
    with (
        package.connect("nao", "sim") as driver,
        package.Recorder(path, driver.robot, period=driver.period) as recorder,
    ):
        assert isinstance(driver, SimulatedDriver)
        driver.world.finger.poke("right_forearm", 150)
        package.run(
            driver,
            Nod(),
            duration=0.4,
            observe=lambda tick: recorder.tick(tick.now, tick.reading, tick.commands, tick.sent),
        )
    periods = list(perceive(Recording(path), driver.robot))
    parts, series = collect(driver.robot, periods, part=None)
    assert parts == ("right_arm", "head")
    assert np.ptp(series.measured["head"][:, 0]) > np.deg2rad(5.0)
    (touch,) = series.touches
    assert (touch.responding, touch.lasts) == ("head", True)
    said = tci("plot", str(path), "--out", str(tmp_path / "nod.svg"))
    assert "no command" not in said
    assert "(head), contact to the end (" in said
    assert "behaviour not recorded" in (tmp_path / "nod.svg").read_text()
    assert touch.to_json()["lost_ms"] is None
    assert touch.commanded is not None
    assert touch.moved is not None
    assert touch.began <= touch.commanded < touch.moved


def test_a_recording_of_a_foot_shows_the_sole_and_no_fields_of_an_arm(tmp_path: Path) -> None:
    robot = package.load_robot("icub-whole")
    patch = robot.patch("right_sole")
    log, recording = tmp_path / "data.log", tmp_path / "foot.mcap"
    raw = np.full((60, patch.channels), 240.0)
    raw[30:, 12:24] = 200.0  # one module
    log.write_text("\n".join(f"{k} {0.02 * k} {' '.join(map(str, row))}" for k, row in enumerate(raw)))
    import_yarp_log(log, recording, patch=patch.name, robot=robot)
    _, series = collect(robot, list(perceive(Recording(recording), robot)), part=None)
    draw(robot, series, tmp_path / "foot.svg", fields=default_fields(), title="foot")
    text = (tmp_path / "foot.svg").read_text()
    assert "right sole, seen from outside" in text
    assert "largest pressure [kPa]" in text
    assert "extensor" not in text
    axes = Figure().subplots()
    dots = _draw_patch(axes, robot, series, "right_leg")
    assert dots is not None
    places, pressure = np.array(dots.get_offsets()), np.array(dots.get_array())
    assert len(places) == 250
    assert np.ptp(places, axis=0).max() == pytest.approx(190.0, abs=10.0)
    assert np.ptp(places[pressure > 0.0], axis=0).max() < 30.0, "a module is in one piece"
    assert _draw_patch(axes, package.load_robot("icub"), series, "torso") is None


def test_rims_of_fields_are_where_the_field_ends() -> None:
    for field in default_fields():
        rim = _outline(field)
        away = generic_limb_distance(rim[:, 1], rim[:, 0], field.u, field.theta)
        assert np.allclose(away, field.radius)


def test_bad_formats_and_recordings_without_a_robot_are_told(recorded: Path, tmp_path: Path) -> None:
    robot = package.load_robot("nao")
    _, series = collect(robot, list(perceive(Recording(recorded), robot)), part=None)
    with pytest.raises(UnknownNameError, match="valid: png, pdf, svg"):
        draw(robot, series, tmp_path / "a.docx", fields=(), title="")
    log = tmp_path / "data.log"
    log.write_text("1 0.5 240 230\n2 0.52 240 231\n")
    tci("log", "import", str(log), str(tmp_path / "foot.mcap"))
    assert "does not name its robot" in tci("plot", str(tmp_path / "foot.mcap"), status=1)


def test_a_film_shows_the_run(tmp_path: Path) -> None:
    path = tmp_path / "run.gif"
    with SimulatedDriver(package.load_robot("nao")) as link:
        film = Film(link.world, path, fields=default_fields(), part="left_arm")
        with pytest.raises(CommandError, match="no period"):
            film.save()
        target = np.zeros(5)

        class Raise(package.Capability[int]):
            def init(self, body: package.GenericBody) -> int:
                return 0

            def step(
                self, memory: int, perception: package.Perception, body: package.GenericBody
            ) -> tuple[tuple[package.GenericCommand, ...], int]:
                return (package.GenericCommand("left_arm", package.Mode.POSITION, target),), 0

        package.run(link, Raise(), duration=0.06, observe=film.see)
        assert film.save() == 3
    with Image.open(path) as shown:
        assert shown.n_frames == 3
        shown.seek(2)
        last = np.asarray(shown.convert("RGB"), dtype=int)
        shown.seek(0)
        first = np.asarray(shown.convert("RGB"), dtype=int)
    assert first.std() > 20.0
    assert np.abs(first - last).max() > 50
    with SimulatedDriver(package.load_robot("nao")) as link:
        with pytest.raises(CommandError, match="exists"):
            Film(link.world, path, fields=(), part="left_arm")
        with pytest.raises(UnknownNameError, match="valid: gif, webp, png"):
            Film(link.world, tmp_path / "run.avi", fields=(), part="left_arm")
