"""The "way inside": the motion by which servos that were found outside their limits move back inside. This
module computes the speed of the motion, and tells which part of the motion needs no check for
self-collision."""

from __future__ import annotations

import numpy as np

from tci.gate.acceptance import SLOWEST
from tci.gate.bounds import Bounds
from tci.messages.frames import Array
from tci.reasons import Code, Reason

CREEP = 0.1
"""Speed at which a servo outside its limits moves inward, as a fraction of its speed limit. Assumed: slow
enough for a person to intervene, because obstacles outside the limits are unknown."""
QUICK = float(np.deg2rad(180.0))
"""Speed limit [rad/s] that replaces every larger speed limit of a servo when the speed of the way inside is
computed. Assumed: without this bound, a G1's motors would move inward with half a turn per second."""
SAGS = float(np.deg2rad(0.5))
"""A servo outside its limits may sag: it moves farther outside than the angle at which it was found. The
motion back to that angle needs no check for self-collision while the reference is at most SAGS [rad] farther
inside than that angle. Assumed: a usual deviation of servos. At a distance of 0.5 m from the joint, this
angle is a displacement of 4.4 mm, less than the default margin of the check for self-collision."""
LAGS = 5e-5
"""A servo outside its limits is led back to the angle at which it was found only if it has sagged farther
outside by more than this angle [rad]. Assumed: about the resolution of joint encoders."""
AT_LIMIT = 5e-6
"""A servo that is found outside its limits by no more than this angle [rad] starts at its limit: a joint that
rests there is measured on either side. A jump of ten times as much would exceed a finger's jerk limit."""
OUTSIDE = Reason(Code.LIMITS_EXCEEDED, "a joint outside its limits can't move inward now")
"""Reason that is reported if a servo outside its limits can't move back inside, for example because of a
coupling."""
UNPLANNED = Reason(Code.OTHER, "no motion inward was found for a joint outside its limits; it is tried again")
"""Reason that is reported if ruckig finds no motion, which is rare and usually ends in the next period."""
STILL = 1e-9
"""Angle [rad] below which a motion counts as a rounding error, so that the servo counts as at rest."""


def creeping(speed: Array, *, straight: bool) -> Array:
    """Returns the speed (n,) [rad/s] at which servos with the speed limits `speed` (n,) [rad/s] move while
    one of them is outside its limits. If `straight` is True, all speeds are reduced by one factor.

    A speed is not reduced below 0.001 rad/s, because the library ruckig refuses motions that take too long.
    """
    most = speed.max() if straight else speed
    reduced: Array = np.maximum(CREEP * np.minimum(most, QUICK), np.minimum(most, SLOWEST))
    return speed * (reduced / most)


def start_of(measured: Array, bounds: Bounds) -> Array:
    """First references (n,) [rad] of servos that are found at `measured` (n,) [rad] angles."""
    at_limit = np.clip(measured, bounds.lower, bounds.upper)
    beyond = np.abs(measured - at_limit)
    # a rounding error is left: taking it away would add to a jerk that is at its limit
    start: Array = np.where((beyond > STILL) & (beyond <= AT_LIMIT), at_limit, measured)
    return start


def sags(here: Array, bounds: Bounds, found: Array, measured: Array) -> bool:
    """Returns True if a servo has sagged: its reference is outside its limits, and its measured angle is now
    farther outside than when the servo came under command. `here` (n,) [rad] are the references, `measured`
    (n,) [rad] the measured angles, and `found` (n,) [rad] the measured angles when the servos came under
    command."""
    sagged = np.where(here < bounds.lower, found - measured, measured - found)
    outside = (here < bounds.lower) | (here > bounds.upper)
    return bool(sagged.max(initial=0.0, where=outside) > LAGS)


def was_there(back: Array, here: Array, span: Array, found: Array, measured: Array) -> bool:
    """Returns True if a stop only moves sagged servos back towards the angles at which they were found.

    The measured angle of a servo outside its limits differs from its reference, because the servo sags under
    its load. The way back to the angle at which it was found needs no check, since the robot was in this
    posture.

    Args:
        back: Velocity (n,) [rad/s] of each servo outside its limits; 0 for all other servos, which must not
            move.
        here: References (n,) [rad] before the stop.
        span: Least and largest references (2, n) [rad] of the stop.
        found: Measured angles (n,) [rad] when the servos came under command.
        measured: Measured angles (n,) [rad] now.
    """
    way = span - here
    sign = np.sign(back)
    moved = np.where(back > 0.0, way[1], way[0])
    there = sign * (measured + moved - found) <= 0.0
    little = sign * (here + moved - found) <= SAGS
    still = np.abs(way).max(axis=0) <= STILL
    return bool(np.where(back != 0.0, there & little, still).all())
