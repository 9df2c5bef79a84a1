"""Paths on which a robot would collide with itself are reported before they are executed."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.hostile_commands import Attack
from helpers.robot_groups import two_armed
from helpers.self_collision_oracle import Oracle
from tci.errors import TciError
from tci.gate.body_guard import BodyGuard
from tci.gate.self_collision import WIDEST, SelfCollision
from tci.messages import CONTROL_MODES, Mode
from tci.messages.frames import Array
from tci.reasons import Reason
from tci.robot.catalogue import load_robot
from tci.robot.clearance import Clearance
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position

NAO = load_robot("nao")
PATHS = 3000 if os.environ.get("TCI_SOAK") else 60
CLEARANCE = Clearance(NAO)
GUARD = SelfCollision(NAO)
INDEX = {servo.name: servo.index for servo in NAO.servos}


def moved(**angles: float) -> Array:
    """Returns the initial posture with other angles [degrees] of some joints."""
    position = initial_position(NAO).copy()
    for name, angle in angles.items():
        position[INDEX[name]] = np.deg2rad(angle)
    return position


INTO_THE_CHEST = moved(RShoulderPitch=30.0, RShoulderRoll=18.0, RElbowYaw=0.0, RElbowRoll=88.0)


def test_an_arm_that_would_hit_the_chest_is_named() -> None:
    assert CLEARANCE.gap(INTO_THE_CHEST, within=0.1).distance < 0.0
    fault = SelfCollision(NAO).fault(np.array([initial_position(NAO), INTO_THE_CHEST]))
    assert "mm near" in str(fault)
    assert "valid: at least 5 mm" in str(fault)


def test_a_distance_does_not_read_as_the_margin_that_it_misses() -> None:
    begin, near, far = initial_position(NAO), 0.0, 1.0
    for _ in range(30):  # to a posture whose links are 4.97 mm apart
        share = (near + far) / 2.0
        posture = begin + share * (INTO_THE_CHEST - begin)
        near, far = (share, far) if CLEARANCE.gap(posture, within=0.1).distance > 0.00497 else (near, share)
    words = str(SelfCollision(NAO).fault(np.array([begin, posture])))
    assert "would come 4.97 mm near" in words, words


def test_the_way_counts_and_not_only_its_end() -> None:
    across = np.array([initial_position(NAO), INTO_THE_CHEST, initial_position(NAO)])
    assert SelfCollision(NAO).fault(across)


def test_a_free_way_is_free() -> None:
    assert SelfCollision(NAO).fault(np.array([initial_position(NAO), moved(RShoulderRoll=-60.0)])) is None


def test_out_of_a_collision_is_allowed_and_deeper_is_not() -> None:
    deep, way_out = INTO_THE_CHEST, initial_position(NAO) - INTO_THE_CHEST
    shares = np.linspace(0.0, 0.2, 20)
    gaps = [CLEARANCE.gap(deep + share * way_out, within=0.1).distance for share in shares]
    assert gaps[0] < gaps[10] < gaps[-1]
    inside = deep + shares[10] * way_out
    assert SelfCollision(NAO).fault(np.array([inside, deep + shares[-1] * way_out])) is None
    assert SelfCollision(NAO).fault(np.array([inside, deep]))


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_let_pass_keeps_the_margin_at_every_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lower = np.array([servo.limits.lower or 0.0 for servo in NAO.servos])
    upper = np.array([servo.limits.upper or 0.0 for servo in NAO.servos])
    start = initial_position(NAO)
    path = start + np.linspace(0.0, 1.0, 6)[:, None] * (rng.uniform(lower, upper) - start)
    fine = start + np.linspace(0.0, 1.0, 200)[:, None] * (path[-1] - start)
    least = min(CLEARANCE.gap(point, within=0.1).distance for point in fine)
    fault = GUARD.fault(path)
    assert fault == SelfCollision(NAO).fault(path)  # results of earlier checks do not change this result
    assert same(fault, Oracle(NAO).fault(path))
    if fault:
        assert least < GUARD.margin + 0.002
    else:
        assert least > GUARD.margin - 0.002


@pytest.mark.parametrize("margin", [-0.001, WIDEST, float("nan")])
def test_a_margin_that_makes_no_sense_is_refused(margin: float) -> None:
    with pytest.raises(TciError, match="valid: 0 to 0"):
        SelfCollision(NAO, margin=margin)


def limits(robot: Robot) -> tuple[Array, Array]:
    """Returns lower and upper limits (n_servos,) [rad]; 0 for servos without limits."""
    lower = np.array([servo.limits.lower or 0.0 for servo in robot.servos])
    return lower, np.array([servo.limits.upper or 0.0 for servo in robot.servos])


def same(one: Reason | None, other: Reason | None) -> bool:
    """Whether both name the same links, or both let pass; texts may differ in their last digit."""
    return (one and (one.code, one.names)) == (other and (other.code, other.names))


@pytest.mark.parametrize("name", [*two_armed(), "franka"])
def test_random_paths_are_judged_as_by_measuring_everything(name: str) -> None:
    robot = load_robot(name)
    guard, oracle, rng = SelfCollision(robot), Oracle(robot), np.random.default_rng(11)
    lower, upper = limits(robot)
    here = start = initial_position(robot)
    for index in range(PATHS):
        if index % 10 == 0:  # also if the path starts inside another link
            here = start + rng.uniform() * (rng.uniform(lower, upper) - start)
        some = rng.random(len(lower)) < 0.6
        span = rng.choice([0.02, 0.1, 0.4]) * (rng.uniform(lower, upper) - here) * some
        path = here + np.linspace(0.0, 1.0, 17)[:, None] ** 0.7 * span
        fault = guard.fault(path)
        assert same(fault, oracle.fault(path))
        if not fault:
            here = path[-1]


class Both:
    """Runs the gate's check for self-collision and the reference implementation on the same paths."""

    def __init__(self, robot: Robot) -> None:
        self.guard, self.oracle, self.clearance = SelfCollision(robot), Oracle(robot), Clearance(robot)
        self.random = np.random.default_rng(3)
        self.paths = self.boxes = 0

    def keeps_margin(self, box: Array) -> bool:
        """Checks that boxes which are reported as free contain no collision. For half of the boxes, also
        checks the path."""
        kept = self.guard.keeps_margin(box)
        if kept and self.random.random() < 0.5:
            self.boxes += 1
            posture = self.random.uniform(*box)
            assert self.clearance.gap(posture, within=0.1).distance > self.guard.margin
            return bool(self.random.random() < 0.5)
        return kept

    def fault(self, path: Array) -> Reason | None:
        self.paths += 1
        fault = self.guard.fault(path)
        assert same(fault, self.oracle.fault(path))
        return fault


@pytest.mark.parametrize("name", [*two_armed(), "franka"])
def test_hostile_commands_are_judged_as_by_measuring_everything(name: str) -> None:
    robot = load_robot(name)
    modes = tuple(mode for mode in CONTROL_MODES if mode is not Mode.TORQUE)
    attack = Attack(robot, 5, modes=modes)
    both = Both(robot)
    attack.gate._motion.groups.body = BodyGuard(both, period=attack.period)
    for _ in range(PATHS * 5):
        attack.step()
    assert not attack.judge.faults
    assert both.paths > 20
    assert both.boxes > 20
