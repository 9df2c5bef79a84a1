"""Miniatures of the episodes of others, made here and true to their schemas: what is used, and left out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from helpers.command_line import tci
from tci.datasets.teleoperation import import_teleoperation
from tci.errors import RecordingError
from tci.recording.recording import Recording
from tci.robot.catalogue import load_robot

FRAMES = 40


def everyday(folder: Path, *, pads: int = 18, **change: Any) -> Path:
    """An episode of Humanoid Everyday: pads of kind A have 3 usable readings, those of kind B have 4."""
    frames = []
    for k in range(FRAMES):
        pressed = [
            {
                "sensor_id": pad,
                "sensor_type": "A" if pad % 3 else "B",
                "usable_readings": [
                    0.0 if pad == 4 else 1e4 * pad + 10.0 * k + n for n in range(3 + (pad % 3 == 0))
                ],
            }
            for pad in range(pads)
        ]
        states = {
            "arm_state": [0.01 * k + 0.001 * n for n in range(14)],
            "leg_state": [0.002 * n for n in range(15)],
            "hand_state": [0.0] * 14,
            "imu": {"quaternion": [1.0, 0.0, 0.0, 0.0]},
            "hand_pressure_state": pressed,
        }
        frame = {
            "time": 1.7e9 + k / 30,
            "robot_type": "g1",
            "states": states | change,
            "actions": {"sol_q": [0.0] * 14},
        }
        frames.append(frame | {"image": f"color/{k}.png"})
    return written(folder, frames)


def xr(folder: Path, *, touched: bool = True) -> Path:
    """An episode of xr_teleoperate, or of its fork that stores counts."""
    folder.mkdir(parents=True)
    (folder / "tactiles").mkdir()
    frames = []
    for k in range(FRAMES):
        arms = {
            f"{side}_arm": {"qpos": [0.01 * k] * 7, "qvel": [], "torque": []} for side in ("left", "right")
        }
        hands = {f"{side}_ee": {"qpos": [0.5] * 6, "qvel": [], "torque": []} for side in ("left", "right")}
        name = f"tactiles/{k:06d}_left.npy"
        np.save(folder / name, counts(k))
        frame = {
            "idx": k, "colors": {"color_0": f"colors/{k:06d}.jpg"}, "depths": {},
            "states": arms | hands | {"body": {}}, "actions": arms, "audios": None,
            "tactiles": {"left_tactile": name} if touched else None,
        }  # fmt: skip
        frames.append(frame)
    found = {"info": {"version": "1.0.0", "image": {"fps": 30}}, "text": {"goal": "hold"}, "data": frames}
    return written(folder, found)


def counts(k: int) -> np.ndarray:
    return (np.arange(1062) + 2 * k).astype(np.uint16)


def written(folder: Path, found: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "data.json").write_text(json.dumps(found))
    return folder


def read(path: Path) -> tuple[list[Any], dict[str, list[Any]]]:
    frames: dict[str, list[Any]] = {}
    for frame in Recording(path).frames():
        frames.setdefault(frame.patch, []).append(frame)
    return list(Recording(path).ticks()), frames


def told(folder: Path, out: Path, *words: str) -> str:
    done = json.loads(tci("log", "import", str(folder), str(out), *words, "--json"))
    assert done["periods"] == FRAMES
    return " | ".join((*done["doubts"], *done["left_out"]))


def test_humanoid_everyday(tmp_path: Path) -> None:
    everyday(tmp_path / "push_a_cart" / "episode_3")
    said = told(tmp_path / "push_a_cart", tmp_path / "a.mcap", "--episode", "3")
    ticks, frames = read(tmp_path / "a.mcap")
    assert len(frames) == 18
    assert [f.values.tolist() for f in frames["pad_3"]] == [
        [3e4 + 10 * k + n for n in range(4)] for k in range(FRAMES)
    ]
    assert {f.values.size for f in frames["pad_5"]} == {3}
    assert [tick.now for tick in ticks] == pytest.approx([1.7e9 + k / 30 for k in range(FRAMES)], abs=1e-6)
    for words in (
        "pad_4: 0 in all 40 frames", "pads are counts", "all joints: to keep them, name the robot",
        "states.imu", "states.hand_state", "actions", "image",
    ):  # fmt: skip
        assert words in said


def test_humanoid_everyday_on_a_g1_keeps_its_joints(tmp_path: Path) -> None:
    arms = [0.01 * n for n in range(13)] + [float("nan")]
    folder = everyday(tmp_path / "episode_0", pads=9, arm_state=arms)
    said = told(folder, tmp_path / "a.mcap", "g1")
    names = [servo.name for servo in load_robot("g1").servos]
    angles = dict(zip(names, read(tmp_path / "a.mcap")[0][-1].reading.joints.position, strict=True))
    assert angles["left_shoulder_roll_joint"] == 0.01
    assert angles["right_elbow_joint"] == 0.10
    assert angles["right_knee_joint"] == pytest.approx(0.018)
    assert angles["waist_pitch_joint"] == pytest.approx(0.028)
    assert np.isfinite(angles["right_wrist_yaw_joint"])
    for words in (
        "9 pads, and two hands have 18: one of two hands", "pad_0: no such patch on g1",
        "never measured, at the initial posture: right_wrist_yaw",
        "that of a G1's motors is assumed",
    ):  # fmt: skip
        assert words in said


def test_the_copy_of_humanoid_everyday_in_lerobot_fills_up_with_nan(tmp_path: Path) -> None:
    """Its touch is (pads, 4): where a pad has 3 values, the fourth is NaN."""
    folder = tmp_path / "everyday"
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    info = {"codebase_version": "v2.0.1", "features": {"observation.tactile": {"dtype": "float32"}}}
    (folder / "meta/info.json").write_text(json.dumps(info))
    touch = np.arange(FRAMES * 18 * 4, dtype=np.float32).reshape(FRAMES, 18, 4)
    touch[:, 1:, 3] = np.nan
    columns = {
        "timestamp": (np.arange(FRAMES) / 30).astype(np.float32),
        "observation.tactile": touch.tolist(),
        "observation.arm_joints": [[0.01 * n for n in range(14)]] * FRAMES,
        "observation.imu.rpy": [[0.0] * 3] * FRAMES,
    }
    parquet.write_table(pa.table(columns), folder / "data/chunk-000/episode_000002.parquet")
    said = told(folder, tmp_path / "a.mcap", "--episode", "2")
    frames = read(tmp_path / "a.mcap")[1]
    assert np.array_equal([f.values for f in frames["pad_0"]], touch[:, 0])
    assert np.array_equal([f.values for f in frames["pad_17"]], touch[:, 17, :3])
    assert "pad_17: 1 of 4 values are NaN in all frames: padding, left out" in said
    assert "observation.imu.rpy" in said
    assert "pad_0" not in said
    with pytest.raises(RecordingError, match="no episode 0"):
        import_teleoperation(folder, tmp_path / "b.mcap", 0, robot=None)


def test_an_h1_of_humanoid_everyday_has_other_legs_and_no_touch(tmp_path: Path) -> None:
    folder = everyday(tmp_path / "episode_0", leg_state=[0.1] * 13, hand_pressure_state=None)
    with pytest.raises(RecordingError, match="no touch; valid: name the robot"):
        import_teleoperation(folder, tmp_path / "a.mcap", 0, robot=None)
    assert "states.leg_state: 13 values; valid: 15 joints" in told(folder, tmp_path / "a.mcap", "g1")


def test_degrees_and_times_that_stand_still_are_told(tmp_path: Path) -> None:
    folder = everyday(tmp_path / "episode_0", arm_state=[60.0] * 14)
    frames = json.loads((folder / "data.json").read_text())
    frames[7]["time"] = frames[6]["time"]
    written(folder, frames)
    done = import_teleoperation(folder, tmp_path / "a.mcap", 0, robot=load_robot("g1"))
    assert done.periods == FRAMES - 1
    said = " | ".join(done.doubts)
    assert "1 of 40 frames are no later than one before, and are left out" in said
    assert "left_elbow_joint 60.0 rad" in said
    assert "degrees? valid: radians" in said


def test_the_counts_of_two_inspire_hands(tmp_path: Path) -> None:
    folder = xr(tmp_path / "episode_0000")
    said = told(folder, tmp_path / "a.mcap", "g1-inspire")
    ticks, frames = read(tmp_path / "a.mcap")
    begins = {
        "little_tip": 0,
        "little_top": 9,
        "little_pad": 105,
        "index_tip": 555,
        "thumb_middle": 845,
        "palm": 950,
    }
    sizes = {
        "little_tip": 9,
        "little_top": 96,
        "little_pad": 80,
        "index_tip": 9,
        "thumb_middle": 9,
        "palm": 112,
    }
    assert len(frames) == 17
    for patch, begin in begins.items():
        for k, frame in enumerate(frames[f"left_{patch}"]):
            assert np.array_equal(frame.values, counts(k)[begin : begin + sizes[patch]])
    assert [tick.now for tick in ticks] == pytest.approx(np.arange(FRAMES) / 30)
    names = [servo.name for servo in load_robot("g1-inspire").servos]
    assert ticks[-1].reading.joints.position[names.index("left_elbow_joint")] == pytest.approx(0.39)
    for words in (
        "frames have no time: 30 per second are assumed", "tactiles.right_tactile: null in all frames",
        "left_palm has touch, right_palm is missing: one of two pads",
        "states.left_ee: its unit is not in the file",
        "colors", "actions",
    ):  # fmt: skip
        assert words in said


def test_xr_teleoperate_itself_has_joints_only(tmp_path: Path) -> None:
    said = told(xr(tmp_path / "episode_0000", touched=False), tmp_path / "a.mcap", "g1")
    assert "tactiles.left_tactile: null in all frames, as xr_teleoperate itself writes it" in said
    assert not read(tmp_path / "a.mcap")[1]


@pytest.mark.parametrize(
    ("found", "match"),
    [
        ("{", "is no episode of"),
        ({"data": 3}, "is no episode of"),
        ([{"time": 0.0}], "KeyError"),
        ({"data": [{"states": {}, "tactiles": {"left_tactile": "../../secret.npy"}}]}, "leads out of"),
        ({"data": [{"states": {}, "tactiles": {"left_tactile": "few.npy"}}]}, "5 counts; valid: 1062"),
        ([], "neither touch nor joints|no touch"),
    ],
)
def test_files_that_are_no_episode(found: Any, match: str, tmp_path: Path) -> None:
    folder = tmp_path / "episode_0"
    folder.mkdir()
    np.save(folder / "few.npy", np.arange(5))
    (folder / "data.json").write_text(found if isinstance(found, str) else json.dumps(found))
    for robot in (None, load_robot("g1")):
        with pytest.raises(RecordingError, match=match):
            import_teleoperation(folder, tmp_path / "a.mcap", 0, robot=robot)
    assert not list(tmp_path.glob("*.mcap"))
