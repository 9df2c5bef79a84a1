from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from recording.recorded import record_poke, two_parts
from tci.errors import RecordingError, UnknownNameError
from tci.messages import JointReading, Reading, SkinFrame
from tci.model.catalogue import load_robot
from tci.recording.export import export, tables
from tci.recording.names import distinct, inside
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording


def test_tables_hold_what_was_recorded_in_every_format(tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", duration=0.4)
    recording = Recording(tmp_path / "a.mcap")
    where = 5
    column = f"{load_robot('nao').servos[where].name}_rad"
    angles = [tick.reading.joints.position[where] for tick in ticks]
    export(recording, tmp_path / "csv", "csv")
    with (tmp_path / "csv" / "joints.csv").open() as file:
        assert [float(row[column]) for row in csv.DictReader(file)] == angles
    export(recording, tmp_path / "a.npz", "npz")
    with np.load(tmp_path / "a.npz") as found:
        assert found[f"joints.{column}"].tolist() == angles
        assert {name.split(".")[0] for name in found} >= {"joints", "decisions", "skin_left_forearm"}
    export(recording, tmp_path / "parquet", "parquet")
    assert parquet.read_table(tmp_path / "parquet" / "joints.parquet")[column].to_pylist() == angles
    with pytest.raises(UnknownNameError, match="csv"):
        export(recording, tmp_path / "x", "xls")


@pytest.mark.parametrize("form", ["csv", "npz", "parquet"])
def test_servos_of_equal_names_have_a_column_each(form: str, tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", two_parts(tmp_path)) as recorder:
        recorder.tick(0.0, Reading(JointReading(0.0, 0, np.array([1.0, 2.0, 3.0]), np.zeros(3)), ()))
    (path,) = export(Recording(tmp_path / "a.mcap"), tmp_path / "out", form)
    found: dict[str, float]
    if form == "npz":
        with np.load(path) as columns:
            found = {name.removeprefix("joints."): float(columns[name][0]) for name in columns}
    elif form == "parquet":
        found = parquet.read_table(path).to_pylist()[0]
    else:
        with path.open() as file:
            found = {name: float(value) for name, value in next(csv.DictReader(file)).items()}
    angles = {name: value for name, value in found.items() if name.endswith("_rad")}
    assert angles == {"one.servo0_rad": 1.0, "two.servo0_rad": 2.0, "servo1_rad": 3.0}


def test_the_time_of_joints_is_when_they_were_measured(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", None) as recorder:
        for now, measured in ((1.0, 0.991), (1.01, 1.002)):
            frame = SkinFrame("p", measured, 0, np.zeros(1))
            recorder.tick(now, Reading(JointReading(measured, 0, np.zeros(1), np.zeros(1)), (frame,)))
    found = tables(Recording(tmp_path / "a.mcap"))
    for table in ("joints", "skin_p"):
        np.testing.assert_allclose(found[table]["time_s"], [0.991, 1.002], atol=2e-9)


def test_equal_names_in_the_file_of_a_stranger_have_a_column_each(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", None) as recorder:
        recorder._names = ["x", "x", "3"]
        recorder.tick(0.0, Reading(JointReading(0.0, 0, np.arange(4.0), np.zeros(4)), ()))
    (path,) = export(Recording(tmp_path / "a.mcap"), tmp_path / "out", "csv")
    with path.open() as file:
        row = next(csv.DictReader(file))
    assert [float(value) for name, value in row.items() if name.endswith("_rad")] == [0.0, 1.0, 2.0, 3.0]
    assert distinct(["a", "b"]) == ["a", "b"]


@pytest.mark.parametrize("patch", ["../../etc/passwd", "/etc/passwd", "a/b", "a\\b", "c:x", "x\0", "a" * 200])
def test_56_a_name_in_a_recording_leads_nowhere_else(patch: str, tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", None) as recorder:
        joints = JointReading(0.0, 0, np.zeros(0), np.zeros(0))
        frame = SkinFrame(patch, 0.0, 0, np.zeros(3))
        recorder.tick(0.0, Reading(joints, (frame,)))
    before = sorted(tmp_path.rglob("*"))
    recording = Recording(tmp_path / "a.mcap")
    for form in ("csv", "npz"):
        with pytest.raises(RecordingError, match="valid: letters"):
            export(recording, tmp_path / "out", form)
    assert [path for path in sorted(tmp_path.rglob("*")) if path.is_file()] == before


@pytest.mark.parametrize("name", ["", ".", "..", ".hidden", "a/b", "..\\x", "x\n"])
def test_56_names_that_could_lead_elsewhere_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no file may be named"):
        inside(tmp_path, name)
    assert inside(tmp_path, "touch-1.mcap") == tmp_path / "touch-1.mcap"
