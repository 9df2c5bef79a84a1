"""The base motions of the fields file withdraw the skin, for arms with the sizes, offsets and limits of both
robots.

The simulated trials check this on the models of the robots. These tests need no model and no additional
package.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from helpers.ideal_arm import COMMON_RANGE, ICUB, INITIAL, NAO, IdealArm
from tci.capabilities.fields import ReceptiveField, default_fields
from tci.messages.frames import Array, angle_between
from tci.robot.generic_arm import JOINTS, Side

FIELDS = default_fields()
SIDES: tuple[Side, ...] = ("left", "right")
GRID = [np.array(posture) for posture in product(*(np.linspace(*limits, 4) for limits in COMMON_RANGE[:4]))]
GAINS = (0.1, 0.5, 1.0)
ROBOTS = pytest.mark.parametrize("arm", [NAO, ICUB], ids=["nao", "icub"])
EACH = pytest.mark.parametrize("field", FIELDS, ids=[field.name for field in FIELDS])


def postures() -> list[Array]:
    """Returns a grid of postures. Successive postures alternate between both ends of the range of
    pronation."""
    return [np.append(posture, COMMON_RANGE[4, index % 2]) for index, posture in enumerate(GRID)]


@ROBOTS
@pytest.mark.parametrize("side", SIDES)
def test_the_skin_moves_away_from_the_stimulus(arm: IdealArm, side: Side) -> None:
    """At most 5 % of the cases may fail, each because of an active limit. The option -s prints the number."""
    excused: dict[str, int] = {}
    for field, posture, gain in product(FIELDS, postures(), GAINS):
        wanted = posture + gain * np.array(field.motion)
        target = arm.clip(wanted)
        if arm.withdrawal(field, posture, target, side) > 1e-5:
            continue
        bound = [name for name, a, b in zip(JOINTS, wanted, target, strict=True) if abs(a - b) > 1e-9]
        assert bound, f"{field.name} at {np.rad2deg(posture)} goes towards the stimulus; no limit binds"
        reason = f"{field.name}: {', '.join(bound)}"
        excused[reason] = excused.get(reason, 0) + 1
    cases = len(FIELDS) * len(GRID) * len(GAINS)
    print(f"{sum(excused.values())} of {cases} excused:", excused)
    assert sum(excused.values()) <= 0.05 * cases


@ROBOTS
@EACH
def test_the_full_motion_goes_far_enough(arm: IdealArm, field: ReceptiveField) -> None:
    """From the initial posture, the skin must withdraw by 30 mm, which is farther than a fingertip
    follows."""
    target = INITIAL + np.array(field.motion)
    np.testing.assert_array_equal(arm.clip(target), target)
    for side in SIDES:
        assert arm.withdrawal(field, INITIAL, target, side) >= 0.030


@EACH
@pytest.mark.parametrize("gain", GAINS)
def test_both_hands_go_the_same_way(field: ReceptiveField, gain: float) -> None:
    target = INITIAL + gain * np.array(field.motion)
    for side in SIDES:
        one, other = (arm.hand(target, side) - arm.hand(INITIAL, side) for arm in (NAO, ICUB))
        assert np.rad2deg(angle_between(one, other)) <= 10.0


@ROBOTS
def test_the_opposite_motion_goes_towards_the_stimulus(arm: IdealArm) -> None:
    """Shows that the test of withdrawal can fail: a motion with the opposite sign moves the skin towards the
    stimulus."""
    for field, side in product(FIELDS, SIDES):
        target = INITIAL - 0.5 * np.array(field.motion)
        assert arm.withdrawal(field, INITIAL, target, side) < -0.005


@EACH
def test_both_sides_are_mirrored(field: ReceptiveField) -> None:
    for arm, posture in product((NAO, ICUB), postures()[::16]):
        target = arm.clip(posture + np.array(field.motion))
        left, right = (arm.withdrawal(field, posture, target, side) for side in SIDES)
        assert left == pytest.approx(right, abs=1e-12)


@EACH
def test_motions_are_few_joints_and_whole_degrees(field: ReceptiveField) -> None:
    """Pronation is not used. It would move the skin on iCub sideways under the finger, and would not move the
    skin on NAO."""
    degrees = np.rad2deg(field.motion)
    np.testing.assert_allclose(degrees, np.round(degrees), atol=1e-9)
    assert np.count_nonzero(degrees) <= 3
    assert np.abs(degrees).max() <= 40.0
    assert degrees[4] == 0.0
