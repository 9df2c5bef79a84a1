"""How much of a field its skin feels is told for where the arm is now: iCub's forearm skin turns with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tci.body.generic_body import GenericBody
from tci.capabilities.fields import default_fields
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.frames import Array
from tci.messages import JointReading, Perception, Reading, SkinFrame
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import joint_map
from tci.robot.limb import generic_limb_distance

ROBOT = load_robot("icub")
PATCH = next(patch for patch in ROBOT.patches if (patch.part, patch.segment) == ("left_arm", "forearm"))
FIELD = next(field for field in default_fields() if field.name == "forearm_extensor")


def turned(pronation: float) -> Array:
    """Angles (n_servos,) [rad] of the servos with the left forearm turned by `pronation` [deg]."""
    rest = np.zeros(len(ROBOT.servos))
    arm, position = joint_map(ROBOT, "left_arm"), rest.copy()
    position[arm.servos] = arm.to_robot(np.deg2rad([25.0, 25.0, 0.0, 60.0, pronation]), rest)
    return position


class Feeling:
    """A body whose forearm flickers, and some taxels far more than the others."""

    def __init__(self, spoilt: np.ndarray) -> None:
        self.body, self.tick, self.random = GenericBody(ROBOT), 0, np.random.default_rng(3)
        self.spoilt = spoilt

    def perceive(self, pronation: float) -> Perception:
        """One frame, 0.1 s after the one before."""
        self.tick += 1
        values = np.rint(PATCH.sensor.rest + self.random.standard_normal(PATCH.channels))
        values[self.body.skin.surfaces[PATCH.name].channels[self.spoilt]] += (
            60.0 * self.random.standard_normal(len(self.spoilt))
        )
        position, now = turned(pronation), 0.1 * self.tick
        octets = np.clip(values, PATCH.sensor.lowest, PATCH.sensor.highest).astype(np.uint8)
        frame = SkinFrame(PATCH.name, now, self.tick, octets)
        joints = JointReading(now, self.tick, position, np.zeros_like(position))
        return self.body.perceive(Reading(joints, (frame,)), now)


def inside(pronation: float) -> np.ndarray:
    """Which taxels (n,) of the forearm lie in the field."""
    position = turned(pronation)
    u, theta, _ = GenericBody(ROBOT).skin.limb(
        PATCH.name, JointReading(0.0, 0, position, np.zeros_like(position))
    )
    here: np.ndarray = generic_limb_distance(u, theta, FIELD.u, FIELD.theta) < FIELD.radius
    return here


def share(seen: Perception) -> float:
    assert seen.covered is not None
    return seen.covered(PATCH.part, PATCH.segment, FIELD.u, FIELD.theta, FIELD.radius)


def test_it_is_told_for_where_the_arm_is_now() -> None:
    reflex, gone = WithdrawalReflex(), inside(60.0) & ~inside(-60.0)
    assert gone.sum() > 20
    feeling = Feeling(np.flatnonzero(gone))
    for _ in range(902):
        seen = feeling.perceive(-60.0)
    assert share(seen) == 1.0
    assert "forearm_extensor" not in reflex.fault(seen)
    for pronation in (60.0, 0.0, -60.0, 59.0):
        seen = feeling.perceive(pronation)
        field = inside(pronation)
        assert share(seen) == pytest.approx(1.0 - gone[field].mean())
    assert share(seen) < 0.5
    assert "forearm_extensor of left_arm is blind" in reflex.fault(seen)


def test_angles_that_are_no_numbers_change_nothing() -> None:
    gone = inside(60.0)
    feeling = Feeling(np.flatnonzero(gone))
    for _ in range(902):
        seen = feeling.perceive(60.0)
    coverage = feeling.body._coverage
    position = np.full(len(ROBOT.servos), np.nan)
    told = coverage.step(JointReading(91.0, 901, position, position))
    assert told is not None
    assert share(replace(seen, covered=told)) == 0.0


def test_nothing_is_worked_out_while_the_arm_stands_still_or_nothing_is_masked() -> None:
    feeling = Feeling(np.zeros(0, dtype=int))
    assert all(feeling.perceive(10.0 * tick).covered is None for tick in range(5))
    feeling = Feeling(np.flatnonzero(inside(60.0)))
    for _ in range(902):
        feeling.perceive(60.0)
    seen = feeling.perceive(60.0)  # the masks of the latest lesson
    assert feeling.perceive(60.5).covered is seen.covered
    assert feeling.perceive(62.0).covered is not seen.covered
