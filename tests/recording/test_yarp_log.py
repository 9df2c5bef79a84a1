from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from helpers.command_line import tci
from helpers.skin_data import SkinData
from tci.errors import RecordingError, TciError
from tci.recording.recording import Recording
from tci.recording.yarp_log import import_yarp_log
from tci.robot.catalogue import load_robot


@pytest.mark.parametrize("number", ["01", "08"])
def test_a_log_of_an_icubs_foot_keeps_every_value_and_time(
    number: str, tmp_path: Path, skin_data: SkinData
) -> None:
    log = skin_data.file(f"recordings/icub_right_foot_raw_{number}.log")
    rows = np.loadtxt(log)
    assert import_yarp_log(log, tmp_path / "foot.mcap", patch="right_foot").periods == len(rows)
    frames = list(Recording(tmp_path / "foot.mcap").frames())
    np.testing.assert_array_equal([frame.sequence for frame in frames], rows[:, 0])
    np.testing.assert_array_equal([frame.stamp for frame in frames], rows[:, 1])
    np.testing.assert_array_equal([frame.values for frame in frames], rows[:, 2:])
    assert (tmp_path / "foot.mcap").stat().st_size < log.stat().st_size


def test_a_folder_of_the_dumper_and_a_log_that_is_no_skin(tmp_path: Path) -> None:
    (tmp_path / "data.log").write_text("1 10.5 1 2 3\n\n2 10.6 4 5 6\n")
    assert import_yarp_log(tmp_path, tmp_path / "a.mcap", patch="p").periods == 2
    for text, match in (
        ("", "empty"), ("1 2.0 ((4 5))\n", "line 1"), ("1 2.0 1\n1 nan 1\n", "line 2"), ("1\n", "line 1"),
        ("1 2.0\n", "line 1"), ("-1 2.0 1\n", "line 1"), ("1 2.0 " + "1 " * 2**20, "longer"),
    ):  # fmt: skip
        (tmp_path / "data.log").write_text(text)
        with pytest.raises(RecordingError, match=match):
            import_yarp_log(tmp_path, tmp_path / "b.mcap", patch="p")
    assert [path.name for path in tmp_path.glob("*.mcap*")] == ["a.mcap"]


def test_a_second_time_in_each_line_is_no_taxel(tmp_path: Path) -> None:
    """yarpdatadumper with the options txTime and rxTime writes both times."""
    lines = [f"{k} {1.7e9 + 0.02 * k:.6f} {1.7e9 + 0.02 * k + 0.003:.6f} {k} 240" for k in range(5)]
    (tmp_path / "data.log").write_text("\n".join(lines))
    done = import_yarp_log(tmp_path, tmp_path / "a.mcap", patch="p")
    assert done.left_out == ("the second time of each line: the dumper wrote two",)
    frames = list(Recording(tmp_path / "a.mcap").frames())
    assert [frame.values.tolist() for frame in frames] == [[k, 240] for k in range(5)]
    assert frames[4].stamp == pytest.approx(1.7e9 + 0.08, abs=1e-6)


@pytest.fixture
def pressed(tmp_path: Path) -> Path:
    """Returns a log of a NAO's sleeve at 100 Hz: 1 s of noise without touch, then 3 s in which a palm presses
    20 taxels."""
    patch = load_robot("nao").patch("left_forearm")
    random = np.random.default_rng(0)
    lines = []
    for k in range(400):
        values = patch.sensor.rest - random.integers(0, 2, patch.channels)
        values[40:60] -= 30 if k >= 100 else 0
        lines.append(f"{k} {1e9 + 0.01 * k:.2f} {' '.join(f'{value:.1f}' for value in values)}")
    path = tmp_path / "data.log"
    path.write_text("\n".join(lines))
    return path


def test_a_file_that_is_no_text_is_told_what_can_be_imported(tmp_path: Path) -> None:
    """In an earlier version the error message for a NumPy array file was about a damaged contact list."""
    np.save(tmp_path / "p.npy", np.zeros((5, 240)))
    (tmp_path / "p.h5").write_bytes(b"\x89HDF\r\n\x1a\n\0\0\0\0" + bytes(80))
    for name in ("p.npy", "p.h5"):
        told = tci("log", "import", str(tmp_path / name), str(tmp_path / "a.mcap"), "nao", status=1)
        assert f"{name} is no text" in told
        assert ".npz, .mat or .csv" in told
    assert not (tmp_path / "a.mcap").exists()


def test_a_raw_log_imported_with_a_robot_is_plotted_and_replayed(pressed: Path, tmp_path: Path) -> None:
    recording = str(tmp_path / "palm.mcap")
    told = tci("log", "import", str(pressed), recording, "nao", "--patch", "left_forearm", "--json")
    assert json.loads(told)["frames"] == 400
    plotted = json.loads(tci("plot", recording, "--json"))
    (touch,) = plotted["touches"]
    assert (touch["part"], touch["patch"]) == ("left_arm", "left_forearm")
    assert touch["began_s"] == pytest.approx(1e9 + 1.0, abs=0.05)
    # The joints in the log do not move, so the gate stops the robot when the reflex responds to the palm.
    answered = json.loads(tci("run", "withdrawal", "nao", "--via", f"replay:{recording}", "--json", status=1))
    assert list(answered["touched_N"]) == ["left_forearm"]
    forces = tmp_path / "force.csv"
    biased = [f"{1e9 + 0.01 * k},{5 - 8 * (k >= 100)}" for k in range(400)]  # against the sensor's axis
    forces.write_text("\n".join(["time,force", *biased]))
    words = ["--patch", "left_forearm", "--via", f"replay:{recording}", "--force-log", str(forces)]
    done = json.loads(
        tci("skin", "calibrate", "nao", *words, "--out", str(tmp_path / "nao.skin.json"), "--json")
    )
    assert done["report"]["offset_N"] == pytest.approx(-5.0, abs=0.1)
    assert done["report"]["held_out_N"] < 0.2


def test_a_raw_log_of_another_skin_is_refused(pressed: Path, tmp_path: Path) -> None:
    nao = load_robot("nao")
    with pytest.raises(RecordingError, match=r"240 values .*valid: the \d+ channels of head of nao"):
        import_yarp_log(pressed, tmp_path / "a.mcap", patch="head", robot=nao)
    with pytest.raises(TciError, match="skin"):
        import_yarp_log(pressed, tmp_path / "a.mcap", patch="skin", robot=nao)
    lines = pressed.read_text().splitlines()
    pressed.write_text("\n".join([lines[0], *lines]))
    with pytest.raises(RecordingError, match="later than the one before"):
        import_yarp_log(pressed, tmp_path / "a.mcap", patch="left_forearm", robot=nao)
    assert not list(tmp_path.glob("*.mcap*"))


def test_an_import_tells_what_it_used_and_what_it_assumed(tmp_path: Path) -> None:
    log = tmp_path / "data.log"
    log.write_text("".join(f"{k} {10.0 + 0.02 * k} {'240 ' * 384}\n" for k in range(5)))
    words = ["log", "import", str(log), str(tmp_path / "a.mcap")]
    told = json.loads(tci(*words, "icub", "--patch", "left_forearm", "--json"))
    assert told["used"] == ["left_forearm, 5 frames"]
    assert told["assumed"] == ["all joints of icub rest at the initial posture"]
    (tmp_path / "a.mcap").unlink()
    printed = tci(*words)
    assert "used: skin, 5 frames" in printed
    assert "assumed" not in printed
