"""Worlds of mujoco-warp equal those of `mujoco.batch`, on Warp's CPU device. `test_gpu.py` runs this file
with the mujoco-warp of `.peers/warp`. By hand, also on a GPU: `python tools/both_engines.py`."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import tci.batch
from helpers.both_engines import compare_pokes, compare_withdrawals, poke_all
from tci.batch import feel
from tci.batch.cpu import MujocoWorlds
from tci.batch.gpu import WarpWorlds
from tci.batch.touches import Touches
from tci.errors import TciError
from tci.messages.contacts import Contacts
from tci.simulation.sampling import SLOTS

wp.config.optimization_level = 0  # the kernels run for a moment, and compile for minutes at level 2
COUNT, STEP = 16, 0.002
PLACES = "p_L", "n_L", "p_T", "n_T", "limb_point"


@pytest.mark.parametrize("name", ["nao", "icub", "g1"])
def test_contacts_of_known_forces_equal_those_of_mujoco_batch(name: str) -> None:
    """The kernels that find contacts, given the poses and the forces on taxels of the other engine."""
    scene, chance = tci.batch.batch_scene(name, step=STEP), np.random.default_rng(6)
    worlds = MujocoWorlds(scene, COUNT, threads=1)
    batch, errors = worlds.batch, []
    with wp.ScopedDevice("cpu"):
        touches = Touches(scene, COUNT)
        due = wp.array(np.ones(len(scene.body.layout.sites)), dtype=int)
        poke_all(worlds, chance)
        arm = np.asarray(scene.body.joint_maps["left_arm"].servos)
        for frame in range(15):
            targets = np.full(worlds.joints.shape, np.nan)
            targets[:, arm] = worlds.joints[:, arm] + chance.uniform(-0.3, 0.3, (COUNT, len(arm)))
            worlds.send(targets)
            worlds.advance(frame * 0.02 - worlds.time)
            qpos, states = np.array(batch.qpos), np.zeros((*worlds.joints.shape, 3))
            states[:, :, 0] = worlds._asked["target"]
            worlds.advance(STEP)
            turns = np.array(batch.xmat).reshape(COUNT, -1, 3, 3)
            data = SimpleNamespace(
                xpos=wp.array(batch.xpos, dtype=wp.vec3), xmat=wp.array(turns, dtype=wp.mat33)
            )
            force, held = wp.array(worlds.force, dtype=float), wp.array(states, dtype=wp.vec3)
            touches.launch(due, force, held, wp.array(qpos, dtype=float), data)
            touches.renew()
            for w in range(COUNT):
                made = touches.contacts(w)
                found = Contacts(scene.body.layout.sites, *worlds._latest(), *made)
                expected = worlds.contacts(w)
                assert [c.patch for c in found] == [c.patch for c in expected]
                np.testing.assert_allclose(found.taxel_force, expected.taxel_force, rtol=1e-5)
                np.testing.assert_allclose(found.taxel_point, expected.taxel_point, rtol=0.0, atol=1e-5)
                for mine, its in zip(found, expected, strict=True):
                    np.testing.assert_array_equal(mine.taxels, its.taxels)
                    for what in ("force", "peak", "area"):
                        assert getattr(mine, what) == pytest.approx(getattr(its, what), rel=1e-5)
                    turn = np.angle(np.exp(1j * (mine.theta - its.theta)))  # pi and -pi are the same
                    away = [np.abs(getattr(mine, what) - getattr(its, what)).max() for what in PLACES]
                    errors.append([*away, abs(mine.u - its.u), abs(turn)])
                    np.testing.assert_allclose(mine.f_T, -mine.force * mine.n_T, rtol=0.0, atol=1e-6)
    assert np.median(errors, axis=0).max() <= 1e-6
    assert np.max(errors) <= 5e-5
    assert len(errors) > 100


@pytest.mark.parametrize("which", ["force", "touched"])
def test_worlds_that_were_too_full_go_on_after_a_reset(which: str) -> None:
    worlds = WarpWorlds(tci.batch.batch_scene("nao", step=STEP), 2, device="cpu")
    (worlds._full if which == "force" else worlds.contacts_on_device.full).assign([2])
    worlds.reset([0])
    with pytest.raises(TciError, match="world 1: "):
        getattr(worlds, which)
    worlds.reset()
    assert not getattr(worlds, which).any()


def test_pokes_equal_those_of_mujoco_batch() -> None:
    found = compare_pokes(tci.batch.batch_scene("nao", step=STEP), COUNT, "cpu", seed=5)
    assert len(found.differences) > 200
    assert np.median(found.differences) <= 1e-4
    assert found.inner >= 0.8 * found.touched
    assert found.same_taxels == found.inner
    assert found.same_forces == found.inner
    assert found.same_begin == COUNT


def test_first_targets_of_the_reflex_equal_those_on_mujoco_batch() -> None:
    scene = tci.batch.batch_scene("nao", step=STEP, period=0.02)
    found = compare_withdrawals(scene, COUNT, "cpu", seed=5, seconds=0.3)
    assert found.begun == (found.together, found.together)
    assert found.together >= COUNT - 2  # some places are out of reach of the finger, or have no way out
    assert found.first.max() <= 1e-6


def test_taxels_of_the_same_state_equal_those_of_mujoco_batch() -> None:
    scene = tci.batch.batch_scene("nao", step=STEP)
    cpu, gpu = MujocoWorlds(scene, COUNT), WarpWorlds(scene, COUNT, device="cpu")
    batch, patches, force = cpu.batch, len(scene.body.layout.sites), gpu.force_on_device
    poke_all(cpu, np.random.default_rng(5))
    same: list[float] = []
    for frame in range(25):
        cpu.advance(frame * 0.02 + STEP - cpu.time)
        force.zero_()
        turns = np.array(batch.xmat).reshape(COUNT, -1, 3, 3)
        state = [
            wp.array(np.ones(patches), dtype=int), gpu._patches, wp.array(batch.sensordata, dtype=float),
            wp.array(batch.xpos, dtype=wp.vec3), wp.array(turns, dtype=wp.mat33), gpu._positions,
            gpu._normals, force, gpu._full,
        ]  # fmt: skip
        wp.launch_tiled(feel.feel, dim=(COUNT, patches, SLOTS), block_dim=feel.LANES, inputs=state)
        loaded = cpu.force.max(axis=1) > 0.01
        errors = np.abs(force.numpy() - cpu.force)[loaded].max(axis=1)
        same += [*errors / cpu.force[loaded].max(axis=1)]
    assert len(same) > 200
    assert max(same) <= 2e-5
