"""Torques of servos in torque mode, in one compiled loop that `tci.gate.torque` calls."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, reads, views, writes

LOWER, UPPER, VELOCITY, CREEP, ACCELERATION, APPROACH, TORQUE = range(7)
"""Rows of the limits (7, k) of k servos in torque mode: lower and upper angle [rad], velocity [rad/s], speed
[rad/s] at which a servo outside its limits returns (CREEP), acceleration [rad/s2], deceleration [rad/s2] that
is assumed to be available before a limit (APPROACH), and torque [N m]."""
POSITION, SPEED, SLOPE, SINCE_SPEED, SINCE_SLOPE = range(5)
"""Rows of the measurements (5, n_servos). POSITION: angle [rad]. SPEED: measured velocity [rad/s]. SLOPE:
mean speed [rad/s], computed from angles; NaN if unknown. SINCE_SPEED, SINCE_SLOPE: torque times duration [N m
s] that was sent since SPEED or SLOPE was measured."""
WANTED, RISEN, GIVEN, CALM, BEFORE = range(5)
"""Rows of an array (5, n_servos) that is kept from one period to the next:

- commanded torque [N m]
- torque [N m] that approaches the commanded torque gradually
- torque [N m] that is sent
- fraction (0 to 1) of the full braking torque that is used
- velocity [rad/s] at which this fraction was chosen
"""
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
    void(views(1, int64), reads(2), reads(2), views(1), views(1, boolean), float64, float64, writes(2))
)  # fmt: skip
def limit_torques(
    servos: NDArray[np.intp],
    measured: Array,
    limits: Array,
    trust: Array,
    halts: NDArray[np.bool_],
    late: float,
    period: float,
    memory: Array,
) -> None:
    """Computes the torques [N m] that are sent now to servos in torque mode, and writes them into the row
    GIVEN of `memory` (5, n_servos). The commanded torques are in its row WANTED.

    `servos` (k,) are the indices of these servos. The rows of `limits` (7, k), `measured` (5, n_servos) and
    `memory` are listed in this module, from `LOWER` to `BEFORE`. `trust` (k,) in their measurements, 0 to 1,
    is the fraction of each torque that is permitted. The measurements are `late` [s] old when the next
    torques are computed, one `period` [s] later. Where `halts` (n_servos,) is True, any motion is braked.
    """
    for k in range(len(servos)):
        i = servos[k]
        q, v, wanted = measured[POSITION, i], measured[SPEED, i], memory[WANTED, i]
        if not abs(v) < float("inf"):
            v = wanted = 0.0
        mean = measured[SLOPE, i] if abs(measured[SLOPE, i]) < float("inf") else v
        most, quickest = limits[TORQUE, k], limits[ACCELERATION, k]
        above, below = max(limits[UPPER, k] - q, 0.0), max(q - limits[LOWER, k], 0.0)
        inside = limits[LOWER, k] <= q <= limits[UPPER, k]
        fastest = limits[VELOCITY if inside else CREEP, k]
        # Distance left when this torque has taken effect, less that which slow speeds need to settle.
        slow = SETTLE * quickest * late
        room = max((above if v > 0.0 else below) - abs(v) * late - slow * SETTLE * late, 0.0)
        safe = 0.0 if halts[i] else min((1.0 - BAND) * fastest, np.sqrt(2.0 * limits[APPROACH, k] * room))
        braking = min(max((abs(v) - safe) / max(BAND * safe, MARGIN), 0.0), 1.0)
        # Torques given since the reading have already accelerated the joint.
        rise, risen = most * period / RISE, memory[RISEN, i]
        risen = memory[RISEN, i] = trust[k] * min(max(wanted, risen - rise), risen + rise)
        way, left = (1.0, above) if risen > 0.0 else (-1.0, below)
        ahead = max(
            way * v + quickest / most * max(way * measured[SINCE_SPEED, i], 0.0),
            way * mean + quickest / most * max(way * measured[SINCE_SLOPE, i], 0.0),
        )
        driving = min(
            abs(risen) * min(left / FADE, 1.0),
            most * max(limits[VELOCITY, k] - ahead, 0.0) / (quickest * late),
        )
        # If angles repeat, or move opposite to the velocity, braking would drive the joint.
        real = mean != 0.0 and mean * v >= -0.5 * v * v
        before, share = memory[BEFORE, i], memory[CALM, i]
        if v != before:
            turned = v * before < 0.0 and braking > 0.0
            share = min(max((CALMER if turned else BOLDER) * share, LEAST), 1.0)
        memory[BEFORE, i], memory[CALM, i] = v, share
        against = trust[k] * share * most * min(max(v / slow, -1.0), 1.0) if real else 0.0
        memory[GIVEN, i] = (1.0 - braking) * way * driving - braking * against
