"""A set of Open-X-Tactile is judged by two genuine versions of zarr, and by the rules of FTP-1's reader."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from helpers.command_line import tci
from helpers.peers import peer_python
from helpers.recorded import record_poke
from tci.datasets.episodes import read_set
from tci.datasets.open_x_tactile import read_oxt, write_oxt
from tci.datasets.zarr2 import make_group, put_array
from tci.errors import RecordingError
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.robot.catalogue import load_robot

DUMP = """
import sys
import numpy, zarr
group = zarr.open_group(sys.argv[1], mode="r")
numpy.savez(sys.argv[2], **{name: group["data"][name][:] for name in group["data"].array_keys()},
            episode_ends=group["meta"]["episode_ends"][:])
print(zarr.__version__)
"""
"""What any user of zarr would write to read a set."""
FOREIGN = """
import sys
import numpy, zarr
from numcodecs import Blosc
pack = dict(compressor=Blosc("zstd", clevel=5, shuffle=Blosc.BITSHUFFLE))
root = zarr.open_group(sys.argv[1], mode="w")
data, meta = root.create_group("data"), root.create_group("meta")
frames = numpy.arange(30)
for side, scale in (("left", 1.0), ("right", 0.0)):
    tips = scale * (frames[:, None, None] + numpy.arange(10).reshape(2, 5)).astype("f4")
    tips[:, 1, 4] = numpy.nan
    data.array(side + "_tactile_data_tips", tips, chunks=(7, 2, 5), **pack)
    data.array(side + "_tactile_area_tips", numpy.tile([1, 2], (30, 1)), **pack)
    data.array(side + "_tactile_type_tips", numpy.full(30, "state"), **pack)
data.array("timestamps", frames, **pack)
data.array("left_tactile_data_eye", numpy.zeros((30, 1, 3, 32, 32), "u1"), **pack)
data.array("left_tactile_type_eye", numpy.full(30, "image"), **pack)
data.array("camera_main_rgb", numpy.zeros((30, 4, 4, 3), "u1"), **pack)
meta.array("episode_ends", numpy.array([10, 30]), compressor=None)
"""
"""A set as others write it: packed with Blosc, two areas in a group, a pad that never sent, NaN padding."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    record_poke(folder / "a.mcap", robot="nao-hands", duration=0.4)
    record_poke(folder / "b.mcap", robot="nao-hands", duration=0.6)
    return folder


def run(peer: str, script: str, *words: str) -> str:
    command = [peer_python(peer), "-I", "-c", script, *words]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout.strip()


@pytest.mark.parametrize(("peer", "version"), [("zarr2", "2.18"), ("zarr3", "3.")])
def test_zarr_reads_what_was_written(peer: str, version: str, recordings: Path, tmp_path: Path) -> None:
    files = sorted(recordings.glob("*.mcap"))
    words = ("--format", "oxt", "--task", "withdraw from the finger", "--fps", "50", "--json")
    left_out = json.loads(tci("log", "export", str(recordings), str(tmp_path / "set"), *words))["left_out"]
    assert any("stand-in" in said for said in left_out)
    assert run(peer, DUMP, str(tmp_path / "set/set.zarr"), str(tmp_path / "a.npz")).startswith(version)
    found = np.load(tmp_path / "a.npz")
    data = read_set(files, fps=50)
    blocks = [block for episode in data.episodes for block in data.blocks(episode)]
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in data.features}
    ends = found["episode_ends"]
    assert ends.tolist() == np.cumsum([episode.frames for episode in data.episodes]).tolist()
    # What FTP-1's reader asks for.
    assert {len(found[name]) for name in found.files if name != "episode_ends"} == {ends[-1]}
    assert found["camera_main_rgb"].shape[1:] == (8, 8, 3)
    assert set(found["sub_task_instruction"]) == {"withdraw from the finger"}
    assert found["timestamps"][: ends[0]] == pytest.approx(np.arange(ends[0]) / 50)
    names = data.features["observation.state"].names
    assert names is not None
    for side in ("left", "right"):
        places = [k for k, name in enumerate(names) if name.startswith(f"{side}_arm.")]
        for column, array in (("observation.state", "arm_joints"), ("action", "arm_joints_action")):
            assert np.array_equal(found[f"{side}_{array}"], columns[column][:, places])
        assert found[f"{side}_hand_joints"].shape == found[f"{side}_hand_joints_idx"].shape
    expected = {"palm": 5, "thumb_tip": 0, "index_tip": 1, "middle_tip": 2, "forearm": 21, "upper_arm": 21}
    for group, area in expected.items():
        forces = found[f"left_tactile_data_{group}"]
        assert found[f"left_tactile_type_{group}"][0] == "state"
        assert forces.dtype == np.float32
        assert np.array_equal(forces[:, 0], columns[f"observation.tactile.left_{group}"])
        assert np.all(found[f"left_tactile_area_{group}"] == area)
    assert found["left_tactile_data_forearm"].max() > 0.1
    assert np.all(found["right_tactile_area_body_head"] == 22)
    raw = found["tci_raw_left_forearm"]
    assert raw.tobytes() == columns["observation.tactile_raw.left_forearm"].tobytes()


def test_pads_with_rows_and_columns_keep_them(tmp_path: Path) -> None:
    """The 17 pads of an Inspire hand, with the areas that Open-X-Tactile's picture of a hand shows."""
    robot = load_robot("g1-inspire")
    pads = [patch for patch in robot.patches if patch.name.startswith("left_")]
    rest = np.zeros(len(robot.servos))
    with Recorder(tmp_path / "a.mcap", robot, period=0.02) as recorder:
        for k in range(4):
            frames = [SkinFrame(p.name, 0.02 * k, k, np.zeros(p.channels, np.uint16)) for p in pads]
            reading = Reading(JointReading(0.02 * k, k, rest, rest), tuple(frames))
            recorder.tick(0.02 * k, reading)
    tci("log", "export", str(tmp_path / "a.mcap"), str(tmp_path / "set"), "--format", "oxt")
    data = read_oxt(tmp_path / "set")
    fingers = ("thumb", "index", "middle", "ring", "little")
    expected = {f"{finger}_{end}": k for k, finger in enumerate(fingers) for end in ("tip", "top")}
    expected |= {f"{finger}_pad": k for k, finger in enumerate(fingers, start=6)}
    expected |= {"thumb_middle": 6, "palm": 5}
    sizes = {"tip": (3, 3), "top": (12, 8), "pad": (10, 8), "middle": (3, 3), "palm": (8, 14)}
    groups = [name for name in data.arrays if name.startswith("left_tactile_data_")]
    assert len(groups) == len(expected) == 17
    for group, area in expected.items():
        size = (12, 8) if group == "thumb_pad" else sizes[group.rpartition("_")[2]]
        assert data.arrays[f"left_tactile_data_{group}"].shape == (3, 1, *size)
        assert np.all(data.rows(f"left_tactile_area_{group}", 0) == area)
        assert set(data.rows(f"left_tactile_type_{group}", 0)) == {"matrix"}


def test_the_raw_skin_of_an_episode_comes_back_bit_for_bit(recordings: Path, tmp_path: Path) -> None:
    write_oxt(read_set(sorted(recordings.glob("*.mcap")), fps=20), tmp_path / "set")
    words = ("nao-hands", "--episode", "1", "--json")
    done = json.loads(tci("log", "import", str(tmp_path / "set"), str(tmp_path / "b.mcap"), *words))
    assert "left_arm_joints" in done["left_out"]
    for patch in ("left_forearm", "left_palm", "head"):
        sent, again = (
            [f.values.tobytes() for f in Recording(file).frames() if f.patch == patch]
            for file in (recordings / "b.mcap", tmp_path / "b.mcap")
        )
        assert len(sent) > 20
        assert sent == again
    with pytest.raises(RecordingError, match="episode 2; valid: 0 to 1"):
        read_oxt(tmp_path / "set").rows("timestamps", 2)


def test_a_set_of_others_is_read_and_what_can_not_be_is_told(tmp_path: Path) -> None:
    pytest.importorskip("numcodecs", reason="did not run: needs the extra oxt")
    run("zarr2", FOREIGN, str(tmp_path / "touch.zarr"))
    words = ("log", "import", str(tmp_path / "touch.zarr"), str(tmp_path / "a.mcap"), "--episode", "1")
    done = json.loads(tci(*words, "--json"))
    assert done["periods"] == 20
    frames = [f for f in Recording(tmp_path / "a.mcap").frames() if f.patch == "left_tips_2"]
    assert [f.values.tolist() for f in frames] == [[k + 5, k + 6, k + 7, k + 8] for k in range(10, 30)]
    told = " | ".join((*done["doubts"], *done["left_out"]))
    for said in (
        "timestamps are numbers of frames: 30 frames per second are assumed",
        "left_tips_2: 1 of 5 values are NaN in all frames: padding, left out",
        "right_tips_1: 0 in all 20 frames",
        "left_tips_1 has touch, right_tips_1 has no value but 0: one of two pads",
        "left_tactile_data_eye: pictures (1, 3, 32, 32), channels first",
        "camera_main_rgb",
    ):
        assert said in told


def test_damaged_sets_are_refused(tmp_path: Path) -> None:
    store = make_group(tmp_path / "a.zarr")
    make_group(store / "data")
    make_group(store / "meta")
    put_array(store / "meta/episode_ends", np.array([2, 5]))
    put_array(store / "data/left_tactile_data_palm", np.ones((5, 1, 4), np.float32))
    chunk = store / "data/left_tactile_data_palm/0.0.0"
    whole = chunk.read_bytes()
    rows = read_oxt(store).rows("left_tactile_data_palm", 1)
    assert rows.shape == (3, 1, 4)
    for damaged in (whole[:-4], b"", b"x" * 40):
        chunk.write_bytes(damaged)
        with pytest.raises(RecordingError, match="damaged"):
            read_oxt(store).rows("left_tactile_data_palm", 1)
    head = store / "data/left_tactile_data_palm/.zarray"
    about = json.loads(head.read_text())
    head.write_text(json.dumps(about | {"compressor": {"id": "zlib", "level": 1}}))
    with pytest.raises(RecordingError, match="packed by zlib; valid: zstd, blosc"):
        read_oxt(store).rows("left_tactile_data_palm", 1)
    for change in ({"chunks": [10**9, 1, 4]}, {"dtype": "|O"}, {"shape": [4, 1, 4]}, {"zarr_format": 3}):
        head.write_text(json.dumps(about | change))
        with pytest.raises(RecordingError):
            read_oxt(store)
