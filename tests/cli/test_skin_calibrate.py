"""`tci skin calibrate` corrects a wrong sensor response in a description, and the skin then uses the
corrected response."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from typer.testing import CliRunner

import tci.robot
from helpers.felt_skin import FeltSkin
from tci.cli.main import app
from tci.cli.session import recorder_for
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DescriptionError, TciError
from tci.messages import JointReading, Reading
from tci.recording.recorder import Recorder
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.robot.json_file import read_json
from tci.robot.skin_files.calibration import SkinCalibration
from tci.robot.xml import read_robot
from tci.simulation.world import World

NAO = Path(tci.robot.__file__).parent / "robots" / "nao"
WRONG = 1.4


@pytest.fixture
def description(tmp_path: Path) -> Path:
    """Returns a NAO whose description gives too low a sensitivity for the left sleeve."""
    shutil.copytree(NAO, tmp_path / "nao")
    path = tmp_path / "nao" / "robot.xml"
    root = etree.parse(path)
    sensor = root.find(".//patch[@name='left_forearm']/sensor")
    sensor.set("pascal_per_count", str(WRONG * float(sensor.get("pascal_per_count"))))
    root.write(path)
    return path


@pytest.fixture
def recorded(description: Path, tmp_path: Path) -> tuple[Path, Path]:
    """Returns a recording of a pressed NAO with correct sensors, and the log of a force sensor."""
    world = World(load_robot("nao"))  # the sensor measures with the true response
    driver = SimulatedDriver(read_robot(description), world=world)
    log = ["time,force"]
    with driver, recorder_for(tmp_path / "loads.mcap", driver, "sim", {}) as recorder:
        poked = -1
        for now in driver.ticks(duration=7.0):
            reading = driver.read()
            recorder.tick(now, reading)
            log.append(f"{now},{world.contact_truth('left_forearm').force}")
            turn = int(now) - 1
            if turn >= 0 and turn != poked:
                poked = turn
                world.finger.retire()
                world.finger.poke("left_forearm", 40 + 30 * turn, speed=0.2, depth=0.003 + 0.001 * turn)
    path = tmp_path / "force.csv"
    path.write_text("\n".join(log))
    return tmp_path / "loads.mcap", path


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["skin", "calibrate", *words])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


def test_weights_in_simulation_give_a_file_and_its_report(tmp_path: Path) -> None:
    out = tmp_path / "nao.skin.json"
    words = ["nao", "--patch", "left_forearm", "--out", str(out), "--frames", "30", "--json"]
    code, output = run(*words, "--weight", "2", "--weight", "4")
    assert code == 0
    told = json.loads(output)
    assert [round(row["force_N"]) for row in told["loads"]] == [2] * 4 + [4] * 4
    for row in told["loads"]:
        assert row["after_N"] == pytest.approx(row["force_N"], rel=0.1)
    written = read_json(out, SkinCalibration)
    assert written.robot == "nao"
    assert written.patches["left_forearm"].report["date"] == written.date
    # A second patch is added to the first one.
    code, _ = run(*["head" if word == "left_forearm" else word for word in words])
    assert set(read_json(out, SkinCalibration).patches) == {"left_forearm", "head"}


def test_a_force_sensor_beside_the_skin_finds_the_wrong_response(
    description: Path, recorded: tuple[Path, Path]
) -> None:
    recording, log = recorded
    words = [
        str(description),
        "--patch",
        "left_forearm",
        "--via",
        f"replay:{recording}",
        "--force-log",
        str(log),
    ]
    code, output = run(*words, "--json")
    assert code == 0
    told = json.loads(output)["report"]
    # All taxels of this sleeve have equal areas, so that one gain gives the same result as the raw sum.
    assert told["held_out_one_gain_N"] == pytest.approx(told["held_out_raw_sum_N"], rel=1e-6)
    assert told["held_out_N"] < 0.5 * told["held_out_one_gain_N"]
    assert told["offset_N"] == pytest.approx(0.0, abs=0.1)
    # With the corrected description, the skin measures newtons.
    assert felt(description) == pytest.approx(true_force(), rel=0.05)


def felt(description: Path) -> float:
    world = pressed()
    state = FeltSkin(read_robot(description)).update(Reading(world.joints(), world.frames()))
    return float(state["left_forearm"].force.sum())


def true_force() -> float:
    return pressed().contact_truth("left_forearm").force


def pressed() -> World:
    world = World(load_robot("nao"))
    world.finger.poke("left_forearm", 100, speed=0.2, depth=0.006)
    world.advance(0.5)
    return world


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "header time,force"),
        ("t,f\n1,2\n", "header time,force"),
        ("time,force\n1,2\n", "2 or more"),
        ("time,force\n0,1\n1,x\n", "line 3"),
        ("time,force\n0,1\n0,1\n", "later"),
        ("time,force\n0,1\nnan,1\n", "line 3"),
        ("time,force\n0,1\n1,2,3\n", "line 3"),
        ("time,force\n0,1\n1_0,2\n", "line 3"),
        ("time,force\n0,1\n\u0661,2\n", "line 3"),
    ],
)
def test_a_bad_log_is_one_error(text: str, words: str, tmp_path: Path) -> None:
    log = tmp_path / "force.csv"
    log.write_text(text)
    with pytest.raises(TciError, match=words):
        run("nao", "--patch", "left_forearm", "--force-log", str(log), "--out", str(tmp_path / "x.json"))
    assert not (tmp_path / "x.json").exists()


def test_bad_arguments_write_nothing(tmp_path: Path) -> None:
    out = ["--out", str(tmp_path / "x.json")]
    with pytest.raises(TciError, match="left_forearm"):
        run("nao", "--patch", "tail", *out)
    with pytest.raises(TciError, match=r"-1\.0 N"):
        run("nao", "--patch", "left_forearm", "--weight", "-1", *out)
    (tmp_path / "force.csv").write_text("time,force\n0,0\n1,1\n")
    log = ["--force-log", str(tmp_path / "force.csv")]
    with pytest.raises(TciError, match="valid: --via replay:FILE"):
        run("nao", "--patch", "left_forearm", *log, *out)
    with Recorder(tmp_path / "no-skin.mcap", load_robot("nao")) as recorder:
        angles = initial_position(load_robot("nao"))
        recorder.tick(0.0, Reading(JointReading(0.0, 0, angles, np.zeros_like(angles)), ()))
    with pytest.raises(TciError, match="left_forearm: the recording has no frame of it"):
        run("nao", "--patch", "left_forearm", "--via", f"replay:{tmp_path / 'no-skin.mcap'}", *log, *out)
    with pytest.raises(TciError, match="--weight and --force-log exclude each other"):
        run("nao", "--patch", "left_forearm", "--weight", "1", "--force-log", "x.csv", *out)
    assert not (tmp_path / "x.json").exists()


def test_a_place_where_nothing_can_be_written_is_known_before_anybody_lifts_a_weight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tci.lab.authoring.load_skin.connect", None)
    out = tmp_path / "none" / "x.json"
    with pytest.raises(TciError, match=r"x\.json can't be written; valid: --out FILE"):
        run("nao", "--patch", "left_forearm", "--weight", "1", "--out", str(out))


def test_a_damaged_calibration_beside_a_description_is_one_error(description: Path) -> None:
    (description.parent / "robot.skin.json").write_text('{"robot": "nao", "date": 5}')
    with pytest.raises(DescriptionError, match="date"):
        FeltSkin(read_robot(description))
