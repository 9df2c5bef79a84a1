"""Compares the initial postures of the left and the right side of a robot in the robot's description.

The comparison also finds a single angle in radians among angles in degrees.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tci.robot.description import GenericPart, GenericServo, Robot

UNEVEN = np.deg2rad(5.0)
"""Largest difference [rad] at which a generic limit or angle counts as equal on the left and the right side.
Assumed: larger than the differences between the two arms of real robots."""
ROUNDED = 0.06
"""An angle counts as written in radians by mistake if its value in degrees differs by less than this number
from the other side's angle in radians. Assumed: numbers may be rounded to one decimal."""
NEARLY = 0.1
"""Replaces `ROUNDED` if the two sides differ by at most 5 degrees (`UNEVEN`). The smaller of the two numbers
in the file counts as radians if it is about equal to the larger angle in radians. Their difference must be at
most this fraction of the smaller number. Assumed: more than the error of rounding to two digits."""
TINY = 0.5 * np.pi
"""Number of degrees below which an angle counts as written in radians, if the part has no other side.
Assumed: nobody turns a head or a torso by less than 1.6 degrees, or by more than 90 degrees (1.6 rad)."""


def posture_doubts(robot: Robot) -> Iterator[str]:
    """Yields a sentence for each pair of joints whose left and right initial angles differ. In a symmetric
    posture, a left and a right generic joint have equal angles with equal signs.

    For a part that exists only once, such as the head, yields a sentence for each angle that is so small that
    the file probably contains radians instead of degrees.
    """
    for left, right in pairs(robot):
        for one, other in joint_pairs(left, right):
            if one.servo is None or other.servo is None:
                continue
            angles = np.rad2deg([one.initial, other.initial])
            small, large = sorted(np.abs(angles))
            off = abs(np.deg2rad(large) - small)
            in_radians = off < ROUNDED
            if abs(one.initial - other.initial) <= UNEVEN and (small == 0.0 or off > NEARLY * small):
                continue
            words = f"; {large:.3g} degrees are {np.deg2rad(large):.3g} rad" if in_radians else ""
            yield (
                f"{left.name} and {right.name}: initial {one.name} of {angles[0]:.3g} and of {angles[1]:.3g} "
                f"degrees{words}; valid: equal on both sides"
            )
    paired = {part.name for pair in pairs(robot) for part in pair}
    for part in robot.parts:
        for one in part.servos:
            angle = float(np.rad2deg(one.initial))
            if one.servo is not None and part.name not in paired and 0.0 < abs(angle) < TINY:
                yield (
                    f"{part.name}: initial {one.name} of {angle:.3g} degrees; {np.rad2deg(angle):.3g} "
                    f"degrees are {angle:.3g} rad; valid: one unit in the whole file"
                )


def pairs(robot: Robot) -> Iterator[tuple[GenericPart, GenericPart]]:
    """Yields each pair of a left part and a right part of equal kind, such as both arms."""
    for left in robot.parts:
        for right in robot.parts:
            if left.side == "left" and right.side == "right" and left.kind == right.kind:
                yield left, right


def joint_pairs(left: GenericPart, right: GenericPart) -> Iterator[tuple[GenericServo, GenericServo]]:
    """Yields each pair of joints with equal names in two parts. Leaves out a joint that only one of the parts
    has."""
    named = {one.name: one for one in right.servos}
    for one in left.servos:
        if (other := named.get(one.name)) is not None:
            yield one, other
