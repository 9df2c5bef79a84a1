"""The robot does not collide with itself, even if joints sag or one part comes to rest before another."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import PERIOD, Driven, position_command, reading
from tci.errors import CommandError
from tci.gate.body_guard import LOOKS, BodyGuard
from tci.gate.gate import Gate, GateSettings
from tci.gate.self_collision import MARGIN, SelfCollision
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.catalogue import load_robot
from tci.robot.clearance import Clearance
from tci.robot.joint_map import initial_position

NAO = load_robot("nao")
INDEX = {servo.name: servo.index for servo in NAO.servos}
CHEST = {"RShoulderPitch": 30.0, "RShoulderRoll": 18.0, "RElbowYaw": 0.0, "RElbowRoll": 88.0}
ASKED = position_command([INDEX[name] for name in CHEST], np.deg2rad([*CHEST.values()]))


@pytest.mark.parametrize("sag", [-2.0, -1.0, 1.0, 2.0])
def test_an_arm_that_is_not_where_it_was_told_keeps_away_from_the_chest(sag: float) -> None:
    # such a steady difference would count as contact, and the arm would go back before it is near
    alone = GateSettings(contact=None)
    gate = Gate(NAO, period=PERIOD, stale_after=0.05, settings=alone)
    angles = np.array(initial_position(NAO))
    away = np.zeros(len(angles))
    away[ASKED.servos] = np.deg2rad(sag)
    clearance, least = Clearance(NAO), np.inf
    for step in range(1500):
        safe = gate.step([ASKED], reading(angles, step * PERIOD), step * PERIOD)
        told = np.array(angles)
        told[safe.servos] = safe.position
        angles[safe.servos] = safe.position + away[safe.servos]
        if step > 50:
            least = min(least, *(clearance.gap(one, within=0.05).distance for one in (told, angles)))
    assert gate.counts.near_misses > 0
    assert np.abs(safe.velocity).max() == 0.0
    assert MARGIN - 5e-4 < least < 0.02


class Watched(SelfCollision):
    """A check for self-collision that reports every box as unsafe, and records the paths that it receives."""

    def __init__(self) -> None:
        super().__init__(NAO)
        self.ways: list[Array] = []
        self.boxes: list[Array] = []
        self.says: Reason | None = None

    def keeps_margin(self, box: Array) -> bool:
        self.boxes.append(box.copy())
        return False

    def fault(self, path: Array) -> Reason | None:
        self.ways.append(path.copy())
        return self.says


def both_arms(*, away: float = 0.0) -> tuple[Driven, Watched]:
    """Starts a long motion of one arm, and then a short motion of the other arm."""
    driven, watched = Driven(NAO, initial_position(NAO)), Watched()
    driven.gate._motion.groups.body = BodyGuard(watched, period=PERIOD)
    driven.step(position_command([INDEX["LShoulderPitch"]], [0.0]))
    for _ in range(100):
        driven.step()
    driven.step(position_command([INDEX["RElbowRoll"]], [0.8]))
    watched.ways.clear()
    driven.angles[INDEX["LShoulderPitch"]] += away
    driven.step()
    return driven, watched


def test_a_way_ends_when_the_last_part_is_at_rest() -> None:
    driven, watched = both_arms()
    driven.gate.stop("look")
    for _ in range(2000):
        driven.step()
    left, right = INDEX["LShoulderPitch"], INDEX["RElbowRoll"]
    # The right arm was checked last, after the step of the left arm. Both arms then stop as planned.
    assert watched.ways[-1][-1, [left, right]] == pytest.approx(driven.angles[[left, right]], abs=1e-9)
    assert abs(watched.ways[-1][-1, left] - watched.ways[-1][1, left]) > 0.01
    # While the left arm continues, equally many further points are checked, and no point is checked twice.
    assert len(watched.ways[-1]) == 2 * LOOKS
    assert np.all(np.diff(watched.ways[-1][1:, left]) < 0.0)


def test_a_part_that_moves_alone_is_looked_at_until_it_rests() -> None:
    driven, watched = Driven(NAO, initial_position(NAO)), Watched()
    driven.gate._motion.groups.body = BodyGuard(watched, period=PERIOD)
    driven.step(position_command([INDEX["LShoulderPitch"]], [0.0]))
    assert {len(way) for way in watched.ways} == {1 + LOOKS}


def test_all_parts_are_seen_at_the_same_time() -> None:
    driven, watched = both_arms()
    first, last = watched.ways[0], watched.ways[-1]
    assert first == pytest.approx(watched.ways[1])  # all joints are at their references
    told = driven.gate._motion.reference
    for servo, angle in zip(told.servos.tolist(), told.position.tolist(), strict=True):
        assert last[1, servo] == pytest.approx(angle, abs=1e-12)
    # The left arm is checked first, before the step of the right arm.
    right = INDEX["RElbowRoll"]
    assert (told.position[told.servos.tolist().index(right)] - first[0, right]) * (
        first[1, right] - first[0, right]
    ) > 0


def test_a_part_that_moves_later_in_a_period_stops_a_period_later() -> None:
    driven, watched = both_arms()
    chains = driven.gate._motion.groups.chains
    right = next(chain for chain in chains if INDEX["RElbowRoll"] in chain.servos)
    later = right.limiter.stop_at(np.array([PERIOD]))[0]
    assert np.abs(later - right.limiter.position).max() > 1e-9
    watched.ways.clear()
    driven.step()
    assert watched.ways[0][1, right.index] == pytest.approx(later, abs=1e-12)


def test_a_joint_that_is_off_its_reference_takes_the_room_of_its_whole_stop_there() -> None:
    driven, watched = both_arms(away=-0.03)
    chains = driven.gate._motion.groups.chains
    left = next(chain for chain in chains if INDEX["LShoulderPitch"] in chain.servos)
    place = left.servos.index(INDEX["LShoulderPitch"])
    # The right arm was checked last, after the step of the left arm.
    lowest = watched.boxes[-1][0, INDEX["LShoulderPitch"]]
    assert lowest == pytest.approx(left.limiter.span[0, place] - 0.03, abs=1e-9)


def test_the_measured_way_counts_beside_the_told_one() -> None:
    _, watched = both_arms(away=0.03)
    left = INDEX["LShoulderPitch"]
    told, measured = watched.ways[0], watched.ways[1]
    assert measured[:, left] - told[:, left] == pytest.approx(np.full(len(told), 0.03))
    others = np.delete(np.arange(told.shape[1]), left)
    assert measured[:, others] == pytest.approx(told[:, others])


def test_a_servo_joins_a_motion_only_when_its_stop_hits_nothing() -> None:
    driven, watched = both_arms()
    watched.says = Reason(Code.SELF_COLLISION, "hand would come 4.0 mm near head")
    with pytest.raises(CommandError, match="can't join the motion now: hand would come"):
        driven.gate._motion.accept(position_command([INDEX["LElbowYaw"]], [0.0]), driven.time)
    (low, high), way = watched.boxes[-1], watched.ways[-1]
    assert np.all((low <= driven.angles + 1e-12) & (driven.angles <= high + 1e-12))
    assert way[0] == pytest.approx(driven.angles)
    assert np.all((low <= way[1:].min(axis=0) + 1e-9) & (way[1:].max(axis=0) <= high + 1e-9))
    safe = driven.step()
    assert all(
        clamp.code is Code.SELF_COLLISION and str(clamp).startswith("stopped on the way: hand")
        for clamp in safe.clamped
    )
    assert driven.gate.counts.near_misses == len(safe.clamped) == 2
    assert INDEX["LElbowYaw"] not in safe.servos
