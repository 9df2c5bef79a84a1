"""Which hand of the people in a world does which planned touch, and the path that it follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tci.robot.description import Robot
from tci.simulation.hand_model import SIDES, PersonModel
from tci.simulation.hand_path import APPROACH, HandPath
from tci.touches.laid import SIGMA
from tci.touches.planned_touch import PlannedTouch

FINGERTIP = 0.0125
"""Radius [m] of pads up to which a fingertip touches, beyond it the palm. Assumed: a thumb's tip is wider."""
LEAVES = 0.02
"""Time [s] between two touches of a hand, beyond its flights: their lengths are rounded to steps."""
_GRIPPING = ("thumb", "index", "middle", "ring")
_FINGERS = ("index", "middle", "ring", "little", "thumb")


def hands_of(planned: Sequence[PlannedTouch]) -> list[tuple[int, PlannedTouch]]:
    """The hand that does each touch, as an index: two for each person, the left one first. A touch with both
    hands has the index of one of them; the other hand of the person helps."""
    free: dict[int, float] = {}
    found = []
    for one in sorted(planned, key=lambda one: one.onset):
        begins, both = one.onset - APPROACH, one.touch.hand == "both"
        wanted = 0 if one.touch.hand == "left" else 1
        for number in _in_order(wanted):
            used = (number, number ^ 1) if both else (number,)
            if all(free.get(hand, -np.inf) <= begins + 1e-9 for hand in used):
                break
        free |= dict.fromkeys(used, one.end + APPROACH + LEAVES)
        found.append((number, one))
    return found


def people_for(*sequences: Sequence[PlannedTouch]) -> list[PersonModel]:
    """Those whom a world needs for any of these sequences, with the hands that they use: a hand that only
    waits makes the simulation slower, too."""
    used = {
        number ^ helps
        for planned in sequences
        for number, one in hands_of(planned)
        for helps in ((0, 1) if one.touch.hand == "both" else (0,))
    }
    return [
        PersonModel(
            name=f"person{person + 1}",
            hands=[side for k, side in enumerate(SIDES) if 2 * person + k in used] or SIDES,
        )
        for person in range(1 + max(used) // 2 if used else 0)
    ]


def paths_of(robot: Robot, one: PlannedTouch) -> list[HandPath]:
    """One path for each hand of a touch."""
    count = one.force.shape[1]
    hands = 2 if one.touch.hand == "both" else 1
    return [
        HandPath(
            link=robot.patch(one.patch).link,
            times=one.times - one.times[0],
            points=one.centre[:, own],
            normals=one.normal[:, own],
            forces=one.force[:, own],
            pads=_pads(one, count // hands),
            spread=SIGMA * float(one.radius[0]),
        )
        for own in (slice(k * count // hands, (k + 1) * count // hands) for k in range(hands))
    ]


def _in_order(wanted: int) -> Iterator[int]:
    person = 0
    while True:
        yield from (2 * person + wanted, 2 * person + 1 - wanted)
        person += 1


def _pads(one: PlannedTouch, count: int) -> tuple[str, ...]:
    if count == 1:
        return ("index",) if one.radius[0] <= FINGERTIP else ("palm",)
    return (_GRIPPING if one.kind.hand == "grip" else _FINGERS)[:count]
