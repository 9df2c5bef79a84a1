"""Pictures in sets are what the head saw during the run; PyArrow and Pillow judge them."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pyarrow import parquet

import tci
from helpers.command_line import tci as command
from tci.datasets import read_lerobot
from tci.drivers.simulated import SimulatedDriver
from tci.lab.pictures.head_camera import HeadCamera
from tci.robot.catalogue import load_robot

RAISED = {part: [1.0, 0.1, 0.0, 0.6, 0.0] for part in ("left_arm", "right_arm")}
FPS, SIZE = 10, (24, 18)
HEAD = "observation.images.head"


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[np.ndarray]]:
    """A recording of a G1 that is poked, and what its head saw meanwhile."""
    path, live = tmp_path_factory.mktemp("seen") / "one.mcap", list[np.ndarray]()
    world = tci.World(robot := load_robot("g1"), posture=RAISED)
    eyes, due = HeadCamera(world, width=SIZE[0], height=SIZE[1]), 0.0
    with SimulatedDriver(robot, world=world) as driver, tci.Recorder(path, robot) as recorder:
        world.finger.poke("left_forearm", 40)

        def see(tick: tci.Tick) -> None:
            nonlocal due
            recorder.tick(tick.now, tick.reading, tick.commands, tick.sent, touching=world.touching())
            if tick.now >= due - 1e-9:
                due = tick.now + 1.0 / FPS
                live.append(eyes.picture(tick.reading))

        tci.run(driver, tci.WithdrawalReflex(), duration=0.35, observe=see)
    return path, live


def test_pictures_of_a_set_are_what_the_head_saw(seen: tuple[Path, list[np.ndarray]], tmp_path: Path) -> None:
    path, live = seen
    export = ("log", "export", str(path), str(tmp_path / "set"), "--format", "lerobot", "--fps", str(FPS))
    command(*export, "--picture", "x".join(map(str, SIZE)))
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    rows = [np.asarray(Image.open(io.BytesIO(row["bytes"]))) for row in table[HEAD].to_pylist()]
    assert len(rows) == len(live) + 1, "the last row is of the end"
    for own, there in zip(rows, live, strict=False):
        assert np.mean(np.abs(own.astype(int) - there) > 8) < 0.02
    assert np.abs(live[0].astype(int) - live[-1]).max() > 60, "something moved before the eyes"
    info = json.loads((tmp_path / "set/meta/info.json").read_text())["features"][HEAD]
    assert (info["dtype"], info["shape"]) == ("image", [SIZE[1], SIZE[0], 3])
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())[HEAD]
    assert np.shape(stats["mean"]) == (3, 1, 1)
    assert 0.0 <= np.min(stats["min"]) < np.max(stats["max"]) <= 1.0
    assert stats["count"] == [len(rows)]
    assert read_lerobot(tmp_path / "set").left_out == (f"{HEAD}: image is not read",)
    command(*export[:3], str(tmp_path / "oxt"), "-f", "oxt", "--fps", str(FPS), "--picture", "24x18")
    shape = json.loads((tmp_path / "oxt/oxt.zarr/data/camera_ego_rgb/.zarray").read_text())["shape"]
    assert shape == [len(rows), SIZE[1], SIZE[0], 3]
    assert not (tmp_path / "oxt/oxt.zarr/data/camera_main_rgb").exists()


@pytest.mark.parametrize("size", ["small", "0x12"])
def test_a_size_that_can_not_be_is_one_error(
    size: str, seen: tuple[Path, list[np.ndarray]], tmp_path: Path
) -> None:
    said = command(
        "log", "export", str(seen[0]), str(tmp_path / "s"), "-f", "lerobot", "--picture", size, status=1
    )
    assert "valid" in said
    assert not (tmp_path / "s").exists()
