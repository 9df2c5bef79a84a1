"""Files of other programs with a wrong format are refused with a one-sentence message."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from tci.errors import DescriptionError, RecordingError
from tci.recording.arrays import import_arrays
from tci.recording.contact_list import import_contact_list
from tci.recording.recording import Recording
from tci.recording.yarp_log import import_yarp_log
from tci.robot.catalogue import load_robot

REST = np.full((3, 240), 240)
CSV = "t,p,q\n0,1,2\n1,1,2\n"


def skin(*names: str) -> str:
    """Returns the part of a mapping that assigns these values to patches."""
    sides = ("left_forearm", "right_forearm")
    return "".join(f'[skin.{side}]\nvalues = "{name}"\n' for side, name in zip(sides, names, strict=False))


def refused(folder: Path, file: str, words: str, match: str, robot: str | None = None) -> None:
    mapping = folder / "map.toml"
    mapping.write_text(words)
    with pytest.raises((DescriptionError, RecordingError), match=match):
        import_arrays(folder / file, folder / "a.mcap", mapping, robot=robot and load_robot(robot))
    assert not list(folder.glob("*.mcap*"))


@pytest.mark.parametrize("robot", [None, "nao"])
@pytest.mark.parametrize(
    ("values", "times", "match"),
    [
        (np.zeros((0, 240)), [], "empty; valid: at least one frame"),
        (np.zeros((3, 0)), [0.0, 1.0, 2.0], "0 values at 0.0 s"),
        (REST, [0.0, 2.0, 1.0], "1.0 s after one at 2.0 s; valid: later"),
        (REST, [0.0, 1.0, 1.0], "1.0 s after one at 1.0 s; valid: later"),
        (REST, [1.7e12, 1.7e12 + 10.0, 1.7e12 + 20.0], "1.7e[+]?12|1700000000000.*valid: .*seconds"),
        (REST.astype(np.longdouble), [0.0, 1.0, 2.0], "p is (float128|longdouble)"),
    ],
    ids=["no frames", "no values", "unsorted", "twice", "milliseconds", "long"],
)  # fmt: skip
def test_frames_that_are_none(
    values: np.ndarray, times: list[float], match: str, robot: str | None, tmp_path: Path
) -> None:
    np.savez(tmp_path / "a.npz", p=values, t=np.array(times))
    refused(tmp_path, "a.npz", 'time = "t"\n' + skin("p"), match, robot)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ('time = "t"\n' + skin("t:q"), "t is in the columns of time and of skin.left_forearm"),
        ('rate = 1.0\n' + skin("p:q", "q"), "q is in the columns of skin.left_forearm and of skin.right_for"),
        ('time = "t:p"\n' + skin("q"), "time = 't:p'; valid: one column"),
    ],
)  # fmt: skip
def test_a_column_has_one_meaning(words: str, match: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV)
    refused(tmp_path, "a.csv", words, match)


def test_an_array_has_one_meaning(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", p=REST)
    refused(tmp_path, "a.npz", "rate = 1.0\n" + skin("p", "p"), "'p' .* twice; valid: each once")


def test_suffixes_in_capitals_are_those_files(tmp_path: Path) -> None:
    (tmp_path / "A.CSV").write_text(CSV)
    (tmp_path / "map.toml").write_text('time = "t"\n' + skin("p:q"))
    assert import_arrays(tmp_path / "A.CSV", tmp_path / "a.mcap", tmp_path / "map.toml").periods == 2


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("0 1.0 1 2\n1 0.5 1 2\n", "later"),
        ("0 1.0 1 2\n1 2.0 1 2 3\n", "3 values at 2.0 s; valid: the 2"),
        ("0 1.0 1_0 2\n", "'0 1.0 1_0 2'"),
    ],
)
def test_a_raw_log_has_one_clock_and_one_size(text: str, match: str, tmp_path: Path) -> None:
    (tmp_path / "data.log").write_text(text)
    with pytest.raises(RecordingError, match=match):
        import_yarp_log(tmp_path, tmp_path / "a.mcap", patch="skin")


def contact(taxels: str) -> str:
    return f"((1 4 4 2) (0 0 0) (0 0 0) (0 0 0) (0.1 0.2 0.3) (0 0 1) ({taxels}) 20)"


def test_a_contact_list_has_one_clock(tmp_path: Path) -> None:
    (tmp_path / "data.log").write_text(f"0 1.0 {contact('1 2')}\n1 1.0\n2 0.5\n")
    with pytest.raises(RecordingError, match="valid: not earlier"):
        import_contact_list(tmp_path, tmp_path / "a.mcap", load_robot("icub"))
    (tmp_path / "data.log").write_text("\n")
    with pytest.raises(RecordingError, match="empty"):
        import_contact_list(tmp_path, tmp_path / "a.mcap", load_robot("icub"))


def test_a_contact_without_taxels_is_left_out_and_a_blank_line_skipped(tmp_path: Path) -> None:
    (tmp_path / "data.log").write_text(f"0 1.0 {contact('')}\n\n1 1.02 {contact('1 2')}\n\n2 1.02\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        done = import_contact_list(tmp_path, tmp_path / "a.mcap", load_robot("icub"))
    assert (done.periods, done.left_out, done.parts[0].verdict) == (3, 1, "wrong")
    assert len(list(Recording(tmp_path / "a.mcap").ticks())) == 3, "two lists with one time"


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_what_is_left_out_and_what_can_hardly_be_is_told(suffix: str, tmp_path: Path) -> None:
    touch = np.column_stack([np.arange(4.0), [1.0, 2.0, np.nan, 3.0]])
    if suffix == "npz":
        np.savez(tmp_path / "a.npz", p=touch, q=np.zeros((4, 2)), t=np.arange(4.0), heart=np.zeros(4))
        words = 'time = "t"\n' + skin("p", "q")
    else:
        rows = [f"{k},{a},{'nan' if np.isnan(b) else b},0,0,7" for k, (a, b) in enumerate(touch)]
        (tmp_path / "a.csv").write_text("\n".join(["t,p0,p1,q0,q1,heart", *rows]))
        words = 'time = "t"\n' + skin("p0:p1", "q0:q1")
    (tmp_path / "map.toml").write_text(words)
    done = import_arrays(tmp_path / f"a.{suffix}", tmp_path / "a.mcap", tmp_path / "map.toml")
    assert done.left_out == ("heart",)
    assert done.doubts == (
        "left_forearm: values are NaN in 1 of 4 frames",
        "right_forearm: 0 in all 4 frames; was it connected?",
        "left_forearm has touch, right_forearm has no value but 0: one of two pads",
    )
