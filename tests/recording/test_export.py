from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from pyarrow.csv import read_csv

from helpers.felt_skin import patches
from helpers.recorded import record_poke, two_parts
from tci.errors import RecordingError, UnknownNameError
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.export import export, tables
from tci.recording.names import distinct, inside
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.runtime.loop import Tick
from tci.skin.skin import Skin


@pytest.fixture(scope="module")
def poked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, list[Tick]]:
    path = tmp_path_factory.mktemp("export") / "a.mcap"
    ticks = record_poke(path, duration=0.4)
    return Recording(path), ticks


def test_skin_is_a_matrix_of_frames_and_taxels_as_it_was_felt(poked: tuple[Recording, list[Tick]]) -> None:
    recording, ticks = poked
    found = tables(recording, load_robot("nao"))
    skin = Skin(load_robot("nao"))
    felt = [patches(skin, tick.skin)["left_forearm"] for tick in ticks]
    states = {one.stamp: one for one in felt}
    skin = found["skin_left_forearm"]
    assert skin["time_s"].tolist() == sorted(states)
    assert np.array_equal(skin["force_n"], np.stack([states[stamp].force for stamp in sorted(states)]))
    assert np.array_equal(skin["pressure_pa"], np.stack([states[stamp].pressure for stamp in sorted(states)]))
    assert skin["force_n"].max() > 0.1
    assert skin["raw"].shape == (len(states), load_robot("nao").patch("left_forearm").channels)
    felt = {(c.stamp, c.identity): c.force for tick in ticks for c in tick.perception.contacts}
    contacts = found["contacts"]
    stamps = zip(contacts["time_s"].tolist(), contacts["identity"].tolist(), strict=True)
    assert dict(zip(stamps, contacts["force_n"].tolist(), strict=True)) == felt
    assert set(contacts["patch"]) == {"left_forearm"}


@pytest.mark.parametrize("form", ["csv", "npz", "parquet"])
def test_matrices_are_the_same_in_every_format(
    form: str, poked: tuple[Recording, list[Tick]], tmp_path: Path
) -> None:
    recording, _ = poked
    robot = load_robot("nao")
    expected = tables(recording, robot)["skin_left_forearm"]["force_n"]
    files = export(recording, tmp_path / "out", form, robot)
    if form == "npz":
        with np.load(files[0]) as arrays:
            assert np.array_equal(arrays["skin_left_forearm.force_n"], expected)
        return
    assert {path.stem for path in files} >= {
        "joints",
        "commands",
        "decisions",
        "contacts",
        "skin_left_forearm",
    }
    path = next(path for path in files if path.stem == "skin_left_forearm")
    table = parquet.read_table(path) if form == "parquet" else read_csv(path)
    forces = [name for name in table.column_names if name.startswith("force_n_")]
    assert forces == [f"force_n_{taxel}" for taxel in range(expected.shape[1])]
    assert np.array_equal(np.stack([table[name].to_numpy() for name in forces], axis=1), expected)


def test_a_servo_has_one_name_in_all_tables(poked: tuple[Recording, list[Tick]]) -> None:
    found = tables(poked[0])
    decided = {name for name in found["decisions"] if name.endswith("_rad")}
    assert decided
    assert decided <= found["joints"].keys()
    assert all("time_s" in table for table in found.values())


def test_a_frame_that_does_not_fit_is_felt_as_nothing_known(tmp_path: Path) -> None:
    robot = load_robot("nao")
    patch = robot.patches[0]
    rest = np.full(patch.channels, patch.sensor.rest)
    joints = JointReading(0.0, 0, np.array(initial_position(robot)), np.zeros(len(robot.servos)))
    with Recorder(tmp_path / "a.mcap", robot) as recorder:
        for number, values in enumerate((rest, np.full(patch.channels, np.nan), rest)):
            frame = SkinFrame(patch.name, 0.01 * number, number, values)
            recorder.tick(0.01 * number, Reading(joints, (frame,)))
    table = tables(Recording(tmp_path / "a.mcap"), robot)[f"skin_{patch.name}"]
    assert len(table["time_s"]) == len(table["force_n"]) == 3
    assert tables(Recording(tmp_path / "a.mcap"))[f"skin_{patch.name}"].keys() == {
        "time_s",
        "sequence",
        "raw",
    }


def test_tables_hold_what_was_recorded_in_every_format(
    poked: tuple[Recording, list[Tick]], tmp_path: Path
) -> None:
    recording, ticks = poked
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
