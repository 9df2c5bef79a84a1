"""Distances between links agree with the contacts of the simulation, and lever lengths bound the change of
distances."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tci.errors import CommandError, DescriptionError
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.clearance import Clearance
from tci.robot.collisions import LEFT, RIGHT
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.simulation.world import World

ROBOTS = {name: load_robot(name) for name in ("nao", "icub")}
CLEARANCES = {name: Clearance(robot) for name, robot in ROBOTS.items()}
WITHIN = 0.3


def posture(robot: Robot, rng: np.random.Generator) -> Array:
    """Returns random angles (n_servos,) [rad] within the limits."""
    lower = [0.0 if s.limits.lower is None else s.limits.lower for s in robot.servos]
    upper = [0.0 if s.limits.upper is None else s.limits.upper for s in robot.servos]
    return rng.uniform(lower, upper)


def simulated_contact(world: World, position: Array) -> float:
    """Returns the deepest penetration [m] between arm and body at a posture in the simulation; infinite if
    there is none."""
    for servo in world.robot.servos:
        if servo.joint is not None:
            world.data.qpos[world.model.joint(servo.joint).qposadr] = position[servo.index]
    mujoco.mj_forward(world.model, world.data)
    depths = [np.inf]
    for contact in world.data.contact[: world.data.ncon]:
        bits = world.model.geom_contype[contact.geom] | world.model.geom_conaffinity[contact.geom]
        if all(bit & (LEFT | RIGHT) for bit in bits):
            depths.append(contact.dist)
    return min(depths)


@pytest.mark.parametrize("name", ROBOTS)
def test_agrees_with_the_simulations_contacts(name: str) -> None:
    robot, clearance = ROBOTS[name], CLEARANCES[name]
    world = World(robot, skin=False)
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(200):
        position = posture(robot, rng)
        depth = simulated_contact(world, position)
        gap = clearance.gap(position, within=WITHIN)
        assert (gap.distance <= 0.0) == (depth <= 0.0)
        hits += depth <= 0.0
    assert 5 <= hits <= 150


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-3, 0.5))
def test_no_servo_changes_a_distance_by_more_than_its_lever(name: str, seed: int, size: float) -> None:
    robot, clearance = ROBOTS[name], CLEARANCES[name]
    rng = np.random.default_rng(seed)
    here = posture(robot, rng)
    there = here + size * rng.normal(size=here.shape)
    moved = np.abs(there - here) @ clearance.levers
    before, after = clearance.gaps(here, within=5.0), clearance.gaps(there, within=5.0)
    assert np.all(np.abs(after - before) <= moved + 1e-5)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_nearest_of_all_pairs(name: str) -> None:
    robot, clearance = ROBOTS[name], CLEARANCES[name]
    rng = np.random.default_rng(3)
    for _ in range(50):
        position = posture(robot, rng)
        gap = clearance.gap(position, within=WITHIN)
        gaps = clearance.gaps(position, within=WITHIN)
        assert gap.distance == pytest.approx(gaps.min(), abs=1e-6)
        if gap.distance < WITHIN:
            names = [clearance.names(int(pair)) for pair in np.flatnonzero(gaps < gaps.min() + 1e-6)]
            assert (gap.first, gap.second) in names


def test_far_apart_is_told_as_the_distance_looked_at() -> None:
    gap = CLEARANCES["nao"].gap(initial_position(ROBOTS["nao"]), within=0.001)
    assert (gap.distance, gap.first, gap.second) == (0.001, "", "")


def test_another_shape_is_refused() -> None:
    with pytest.raises(CommandError, match=r"position of shape \(3,\); the robot has"):
        CLEARANCES["nao"].gap(np.zeros(3), within=0.1)


def test_a_robot_without_a_model_is_refused() -> None:
    with pytest.raises(DescriptionError, match="self-collision need a URDF or MJCF"):
        Clearance(ROBOTS["nao"].model_copy(update={"model": None}))
