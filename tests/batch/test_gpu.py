"""Worlds of mujoco-warp equal those of `mujoco.batch`, on Warp's CPU device. Without mujoco-warp, in an
environment of its own (it would bring another MuJoCo), only what TCI says then is tried:
`pip install --no-deps 'mujoco-warp>=4,<5' warp-lang absl-py etils`."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest

import tci.batch
from tci.batch.cpu import MujocoWorlds
from tci.errors import ClashError, MissingExtraError
from tci.simulation.sampling import SLOTS
from tci.support.engine import mujoco

COUNT, STEP = 16, 0.002
THERE = importlib.util.find_spec("mujoco_warp") is not None


def test_another_mujoco_is_told_at_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.17.0")
    monkeypatch.delitem(sys.modules, "tci.batch.gpu", raising=False)
    with pytest.raises(ClashError, match=r"MuJoCo 3\.17\.0 lies over it.*valid: pip install"):
        tci.batch.make_worlds("nao", 1, engine="warp")


@pytest.mark.skipif(THERE, reason="mujoco-warp is there")
def test_a_missing_extra_is_told() -> None:
    with pytest.raises(MissingExtraError, match="mujoco_warp"):
        tci.batch.make_worlds("nao", 1, engine="warp")


@pytest.mark.skipif(not THERE, reason="needs mujoco-warp, in an environment of its own")
def test_pokes_equal_those_of_mujoco_batch() -> None:
    import warp as wp

    from tci.batch import feel
    from tci.batch.gpu import WarpWorlds

    scene, chance = tci.batch.batch_scene("nao", step=STEP), np.random.default_rng(5)
    both = cpu, gpu = MujocoWorlds(scene, COUNT), WarpWorlds(scene, COUNT, device="cpu")
    sleeves = [one.name for one in scene.robot.patches if one.segment]
    names = [str(chance.choice(sleeves)) for _ in range(COUNT)]
    taxels = [int(chance.integers(len(scene.world.surfaces[name].positions))) for name in names]
    depth = chance.uniform(0.004, 0.014, COUNT)
    for worlds in both:
        worlds.poke(names, taxels, depth=depth)
    whole, same = [], []
    arm = int(scene.body.joint_maps["left_arm"].servos[0])
    for frame in range(25):
        for worlds in both:
            if frame == 10:
                targets = np.full(worlds.joints.shape, np.nan)
                targets[:, arm] = worlds.joints[:, arm] + 0.3
                worlds.send(targets)
            worlds.advance(frame * 0.02 + STEP - worlds.time)
        expected = cpu.force
        loaded = expected.max(axis=1) > 0.01
        largest = expected[loaded].max(axis=1)
        whole += [*np.abs(gpu.force - expected)[loaded].max(axis=1) / largest]
        # The kernel alone, in the same state of MuJoCo.
        batch, patches, force = cpu.batch, len(scene.body.layout.sites), gpu.force_on_device
        kept = force.numpy().copy()
        force.zero_()
        turns = np.array(batch.xmat).reshape(COUNT, -1, 3, 3)
        state = [
            wp.array(np.ones(patches), dtype=int), gpu._patches, wp.array(batch.sensordata, dtype=float),
            wp.array(batch.xpos, dtype=wp.vec3), wp.array(turns, dtype=wp.mat33), gpu._positions,
            gpu._normals, force, gpu._full,
        ]  # fmt: skip
        wp.launch_tiled(feel.feel, dim=(COUNT, patches, SLOTS), block_dim=feel.LANES, inputs=state)
        same += [*np.abs(force.numpy() - expected)[loaded].max(axis=1) / largest]
        force.assign(kept)
    assert len(whole) > 200
    assert np.median(whole) <= 1e-4
    assert max(same) <= 2e-5
