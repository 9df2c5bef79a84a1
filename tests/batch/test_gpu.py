"""Worlds of mujoco-warp equal those of `mujoco.batch`, on Warp's CPU device. Without mujoco-warp, in an
environment of its own (it would bring another MuJoCo), only what TCI says then is tried:
`pip install --no-deps 'mujoco-warp>=4,<5' warp-lang absl-py etils`."""

from __future__ import annotations

import importlib.util
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import tci.batch
from tci.batch.cpu import MujocoWorlds
from tci.batch.worlds import Worlds
from tci.errors import ClashError, MissingExtraError, TciError
from tci.messages.contacts import Contacts
from tci.simulation.sampling import SLOTS
from tci.support.engine import mujoco

COUNT, STEP = 16, 0.002
PLACES = "p_L", "n_L", "p_T", "n_T", "limb_point"
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


needs_warp = pytest.mark.skipif(not THERE, reason="needs mujoco-warp, in an environment of its own")


@needs_warp
@pytest.mark.parametrize("name", ["nao", "icub", "g1"])
def test_contacts_of_known_forces_equal_those_of_mujoco_batch(name: str) -> None:
    """The kernels that find contacts, given the poses and the forces on taxels of the other engine."""
    import warp as wp

    from tci.batch.touches import Touches

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
    # Between two faces that are equally near the engines may choose differently: here 0.05 mm, 0.1 degrees.
    assert np.median(errors, axis=0).max() <= 1e-6
    assert np.max(errors) <= 2e-3
    assert len(errors) > 100


@needs_warp
@pytest.mark.parametrize("which", ["force", "touched"])
def test_worlds_that_were_too_full_go_on_after_a_reset(which: str) -> None:
    from tci.batch.gpu import WarpWorlds

    worlds = WarpWorlds(tci.batch.batch_scene("nao", step=STEP), 2, device="cpu")
    (worlds._full if which == "force" else worlds.contacts_on_device.full).assign([2])
    worlds.reset([0])
    with pytest.raises(TciError, match="world 1: "):
        getattr(worlds, which)
    worlds.reset()
    assert not getattr(worlds, which).any()


@needs_warp
def test_pokes_equal_those_of_mujoco_batch() -> None:
    import warp as wp

    from tci.batch import feel
    from tci.batch.gpu import WarpWorlds

    scene = tci.batch.batch_scene("nao", step=STEP)
    both = cpu, gpu = MujocoWorlds(scene, COUNT), WarpWorlds(scene, COUNT, device="cpu")
    for worlds in both:
        poke_all(worlds, np.random.default_rng(5))
    whole, same, equal = [], [], np.zeros((25, 3, COUNT), bool)
    arm = int(scene.body.joint_maps["left_arm"].servos[0])
    for frame in range(25):
        for worlds in both:
            if frame == 10:
                targets = np.full(worlds.joints.shape, np.nan)
                targets[:, arm] = worlds.joints[:, arm] + 0.3
                worlds.send(targets)
            worlds.advance(frame * 0.02 + STEP - worlds.time)
        equal[frame] = [
            cpu.touched | gpu.touched,
            [have_same_taxels(cpu.contacts(w), gpu.contacts(w)) for w in range(COUNT)],
            [have_same_forces(cpu.contacts(w), gpu.contacts(w)) for w in range(COUNT)],
        ]
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
    # All contacts are equal more than 20 ms from their onset and end. A finger that first touched in another
    # step goes as much deeper as it moves in a step, up to 0.5 mm, so it is another poke.
    touched, taxels, forces = equal.swapaxes(0, 1)
    inner = touched[2:-2] & touched[1:-3] & touched[3:-1] & touched[:-4] & touched[4:]
    assert inner.sum() >= 0.8 * touched[2:-2].sum()
    assert taxels[2:-2][inner].all()
    same_poke = np.abs(cpu._pokes["end"] - gpu._pokes.numpy()["end"]) < 1e-6
    assert same_poke.mean() >= 0.5
    assert forces[2:-2][inner & same_poke].all()


def poke_all(worlds: Worlds, chance: np.random.Generator) -> None:
    scene = worlds.scene
    sleeves = [one.name for one in scene.robot.patches if one.segment]
    names = [str(chance.choice(sleeves)) for _ in range(COUNT)]
    taxels = [int(chance.integers(len(scene.world.surfaces[name].positions))) for name in names]
    worlds.poke(names, taxels, depth=chance.uniform(0.004, 0.014, COUNT))


def have_same_taxels(one: Contacts, other: Contacts) -> bool:
    return [c.patch for c in one] == [c.patch for c in other] and all(
        np.array_equal(a.taxels, b.taxels) for a, b in zip(one, other, strict=True)
    )


def have_same_forces(one: Contacts, other: Contacts) -> bool:
    return have_same_taxels(one, other) and bool(np.all(np.abs(one.force / other.force - 1.0) <= 0.01))
