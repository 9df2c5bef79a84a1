"""Worlds that are stepped together equal worlds that are stepped alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import tci.batch
from helpers.rested import rested
from tci.batch.cpu import MujocoWorlds
from tci.errors import CommandError, TciError, UnknownNameError
from tci.messages import Reading
from tci.simulation.world import World

COUNT, POKES = 16, 20
STEP = 0.002
ROBOTS = ("nao", "icub", "g1")


@pytest.fixture(scope="module", params=ROBOTS)
def worlds(request: pytest.FixtureRequest) -> MujocoWorlds:
    made = tci.batch.make_worlds(request.param, COUNT, threads=1)
    assert isinstance(made, MujocoWorlds)
    return made


def random_pokes(worlds: MujocoWorlds, chance: np.random.Generator) -> tuple[list[str], list[int]]:
    sleeves = [one.name for one in worlds.scene.robot.patches if one.segment]
    names = [str(chance.choice(sleeves)) for _ in range(worlds.count)]
    return names, [int(chance.integers(len(worlds.scene.world.surfaces[name].positions))) for name in names]


def test_taxels_equal_those_of_a_single_world_in_the_same_state(worlds: MujocoWorlds) -> None:
    chance, one, batch = np.random.default_rng(1), World(worlds.scene.robot, step=STEP), worlds.batch
    felt = 0
    for _ in range(POKES):
        worlds.reset()
        names, taxels = random_pokes(worlds, chance)
        worlds.poke(names, taxels, depth=chance.uniform(0.004, 0.014, COUNT))
        worlds.advance(int(chance.integers(4, 9)) * 0.02)
        state = [np.array(getattr(batch, name)) for name in ("qpos", "qvel", "ctrl", "qacc_warmstart")]
        places = np.array(batch.mocap_pos), np.array(batch.mocap_quat)
        worlds.advance(STEP)  # the step in which the frames of all patches are due
        drives = one.data
        for w in range(COUNT):
            drives.qpos[:], drives.qvel[:], _, drives.qacc_warmstart[:] = (field[w] for field in state)
            drives.mocap_pos[:], drives.mocap_quat[:] = places[0][w], places[1][w]
            drives.ctrl[:] = np.array(batch.ctrl)[w]  # of the step itself
            one.touch_physics()
            alone = np.concatenate([one.taxels.vectors(name)[:, 2] for name in one.surfaces])
            felt += bool(alone.any())
            assert np.abs(worlds.force[w] - alone).max() <= 1e-12 * max(1.0, alone.max())
    assert felt > 0.7 * COUNT * POKES


def test_pokes_and_contacts_equal_those_of_single_worlds(worlds: MujocoWorlds) -> None:
    chance, scene = np.random.default_rng(2), worlds.scene
    worlds.reset()
    names, taxels = random_pokes(worlds, chance)
    depth, count = chance.uniform(0.004, 0.014, COUNT), 0
    worlds.poke(names, taxels, depth=depth)
    alone, calm = [], rested(scene)
    for w in range(COUNT):
        try:
            one = World(scene.robot, step=STEP)
            one.finger.poke(names[w], taxels[w], depth=float(depth[w]))
        except TciError:  # the batch does not look whether there is room
            continue
        alone.append((w, one, calm.copy()))
    assert len(alone) > COUNT // 2
    for frame in range(20):
        worlds.advance(frame * 0.02 + STEP - worlds.time)
        for w, one, perceiver in alone:
            one.advance(frame * 0.02)
            felt = np.concatenate([one.taxels.vectors(name)[:, 2] for name in one.surfaces])
            assert np.abs(worlds.force[w] - felt).max() <= 1e-6 * max(1.0, felt.max())
            joints = dataclasses.replace(one.joints(), stamp=10.0 + one.time)
            frames = tuple(
                dataclasses.replace(f, stamp=10.0 + f.stamp, sequence=1000 + f.sequence) for f in one.frames()
            )
            expected, found = (
                perceiver.step(Reading(joints, frames), joints.stamp).contacts,
                worlds.contacts(w),
            )
            assert [c.patch for c in found] == [c.patch for c in expected]
            for mine, its in zip(found, expected, strict=True):
                assert mine.force == pytest.approx(its.force, rel=1e-6)
                assert mine.u == pytest.approx(its.u, abs=1e-6)
                turn = np.angle(np.exp(1j * (mine.theta - its.theta)))  # pi and -pi are the same
                assert turn == pytest.approx(0.0, abs=1e-6)
                np.testing.assert_array_equal(mine.taxels, its.taxels)
                np.testing.assert_allclose(mine.f_T, its.f_T, rtol=0.0, atol=1e-6 * its.force)
                count += 1
    assert count > 5 * len(alone)


def test_only_the_worlds_that_are_meant_are_poked_and_reset(worlds: MujocoWorlds) -> None:
    worlds.reset()
    patch = next(one.name for one in worlds.scene.robot.patches if one.segment == "forearm")
    worlds.poke(patch, 40, worlds=[2, 5])
    worlds.advance(0.1)
    assert np.flatnonzero(worlds.force.any(axis=1)).tolist() == [2, 5]
    assert (worlds.finger_peak >= worlds.finger_force).all()
    assert np.flatnonzero(worlds.finger_peak).tolist() == [2, 5]
    worlds.reset([5])
    worlds.advance(0.04)
    assert np.flatnonzero(worlds.force.any(axis=1)).tolist() == [2]
    for duration in (-1.0, np.nan, np.inf):
        with pytest.raises(CommandError, match=f"advanced by {duration} s; valid: 0 or more, finite"):
            worlds.advance(duration)
    with pytest.raises(CommandError, match="valid: 0 to 15"):
        worlds.poke(patch, 0, worlds=[16])
    with pytest.raises(UnknownNameError, match="tail"):
        worlds.poke("tail", 0)


def test_what_batches_do_not_have_is_said() -> None:
    with pytest.raises(TciError, match="people"):
        tci.batch.make_worlds("nao", 2, people=1)
    with pytest.raises(UnknownNameError, match="valid: mujoco, warp"):
        tci.batch.make_worlds("nao", 2, engine="isaac")  # type: ignore[arg-type]
