"""Torques of servos in torque mode, in one compiled loop that `tci.gate.torque` calls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, record, views, writes


class Limits(NamedTuple):
    """Limits of k servos in torque mode, each (k,)."""

    lower: Array
    """Least angles [rad]."""
    upper: Array
    """Largest angles [rad]."""
    velocity: Array
    """Largest speeds [rad/s]."""
    creep: Array
    """Speeds [rad/s] at which servos outside their limits return."""
    acceleration: Array
    """Largest accelerations [rad/s2]."""
    approach: Array
    """Decelerations [rad/s2] that are assumed to be available before a limit."""
    torque: Array
    """Largest torques [N m]."""


class Measured(NamedTuple):
    """What was measured of all servos, each (n_servos,)."""

    position: Array
    """Angles [rad]."""
    speed: Array
    """Measured velocities [rad/s]."""
    slope: Array
    """Mean speeds [rad/s], computed from angles; NaN if unknown."""
    since_speed: Array
    """Torque times duration [N m s] that was sent since `speed` was measured."""
    since_slope: Array
    """Torque times duration [N m s] that was sent since `slope` was measured."""


class Memory(NamedTuple):
    """What is kept of all servos from one period to the next, each (n_servos,)."""

    wanted: Array
    """Commanded torques [N m]."""
    risen: Array
    """Torques [N m] that approach the commanded torques gradually."""
    given: Array
    """Torques [N m] that are sent."""
    calm: Array
    """Fractions (0 to 1) of the full braking torque that are used."""
    before: Array
    """Velocities [rad/s] at which these fractions were chosen."""


MARGIN = 1e-6
"""Smallest speed [rad/s] by which the computation of braking torques divides, so that it never divides by
zero."""
RISE = 0.02
"""Time [s] in which a torque may rise from zero to its limit. Assumed: a sudden change of torque would jerk
the joint."""
BAND = 0.1
"""A servo that exceeds the allowed speed by at least this fraction of the allowed speed is braked with the
full braking torque. Assumed: with a smaller value, the torque chatters; with a larger value, a joint exceeds
its limit by more."""
SETTLE = 2.0
"""A servo counts as slow, and is braked by a torque proportional to its speed, if its acceleration limit
could stop it within this number times the delay of its measurements. Assumed: with full torque, a servo at
rest at a limit would tremble because of the noise of its velocity."""
CALMER, BOLDER, LEAST = 0.5, 1.5, 1.0 / 64.0
"""Three numbers that adapt the braking torque to the joint. With each new velocity, the braking torque is
multiplied by CALMER if it has reversed the joint's motion, else by BOLDER. It is never below the fraction
LEAST of the full braking torque, and never above the full braking torque. Assumed: with full braking torque,
a joint that is much lighter than its limits imply would oscillate."""
FADE = float(np.deg2rad(2.0))
"""Distance [rad] from a limit below which a torque towards the limit decreases to zero. Assumed: with a
shorter distance, joints are pushed into their limits; with a longer distance, more of their range is lost."""


@compiled(
    void(
        views(1, int64), record(Measured, *5 * [writes(1)]), record(Limits, *7 * [writes(1)]), views(1),
        views(1, boolean), float64, float64, record(Memory, *5 * [writes(1)]),
    )
)  # fmt: skip
def limit_torques(
    servos: NDArray[np.intp],
    measured: Measured,
    limits: Limits,
    trust: Array,
    halts: NDArray[np.bool_],
    late: float,
    period: float,
    memory: Memory,
) -> None:
    """Computes the torques [N m] that are sent now to servos in torque mode, and writes them into
    `memory.given`.

    Args:
        servos: Indices (k,) of these servos.
        measured: Their measurements.
        limits: Their limits.
        trust: Fraction (k,), 0 to 1, of each torque that is permitted: the trust in the measurements.
        halts: Where it is True (n_servos,), any motion is braked.
        late: Age [s] of the measurements when the next torques are computed, one `period` later.
        period: Period [s] of the control loop.
        memory: Commanded torques, and what is kept from one period to the next.
    """
    for k in range(len(servos)):
        i = servos[k]
        q, v, wanted = measured.position[i], measured.speed[i], memory.wanted[i]
        if not abs(v) < float("inf"):
            v = wanted = 0.0
        mean = measured.slope[i] if abs(measured.slope[i]) < float("inf") else v
        most, quickest = limits.torque[k], limits.acceleration[k]
        above, below = max(limits.upper[k] - q, 0.0), max(q - limits.lower[k], 0.0)
        inside = limits.lower[k] <= q <= limits.upper[k]
        fastest = limits.velocity[k] if inside else limits.creep[k]
        # Distance left when this torque has taken effect, less that which slow speeds need to settle.
        slow = SETTLE * quickest * late
        room = max((above if v > 0.0 else below) - abs(v) * late - slow * SETTLE * late, 0.0)
        safe = 0.0 if halts[i] else min((1.0 - BAND) * fastest, np.sqrt(2.0 * limits.approach[k] * room))
        braking = min(max((abs(v) - safe) / max(BAND * safe, MARGIN), 0.0), 1.0)
        # Torques given since the reading have already accelerated the joint.
        rise, risen = most * period / RISE, memory.risen[i]
        risen = memory.risen[i] = trust[k] * min(max(wanted, risen - rise), risen + rise)
        way, left = (1.0, above) if risen > 0.0 else (-1.0, below)
        ahead = max(
            way * v + quickest / most * max(way * measured.since_speed[i], 0.0),
            way * mean + quickest / most * max(way * measured.since_slope[i], 0.0),
        )
        driving = min(
            abs(risen) * min(left / FADE, 1.0),
            most * max(limits.velocity[k] - ahead, 0.0) / (quickest * late),
        )
        # If angles repeat, or move opposite to the velocity, braking would drive the joint.
        real = mean != 0.0 and mean * v >= -0.5 * v * v
        before, share = memory.before[i], memory.calm[i]
        if v != before:
            turned = v * before < 0.0 and braking > 0.0
            share = min(max((CALMER if turned else BOLDER) * share, LEAST), 1.0)
        memory.before[i], memory.calm[i] = v, share
        against = trust[k] * share * most * min(max(v / slow, -1.0), 1.0) if real else 0.0
        memory.given[i] = (1.0 - braking) * way * driving - braking * against
