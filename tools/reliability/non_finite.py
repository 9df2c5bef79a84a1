"""Feeds non-finite values to the gate."""

from __future__ import annotations

import numpy as np
from pool import Result, gather
from row import Row

from helpers.gate_checks import Driven, make_robot, position_command

CHUNK = 10_000
"""Number of values with one random seed."""


def non_finite(full: bool) -> Row:
    """Checks that the gate's output never contains NaN or infinity in a value, a speed or an angle."""
    jobs = [(seed, CHUNK) for seed in range(100 if full else 1)]
    done = gather("non_finite", _one, jobs, full=full)
    reached = sum(result["reached"] for result in done)
    return Row(
        "NaN and infinity in commands and joint data",
        sum(result["tried"] for result in done),
        1e6,
        "values",
        f"{reached} outputs of the gate contained NaN or infinity",
        "0 outputs",
        reached == 0,
    )


def _one(seed: int, count: int) -> Result:
    random = np.random.default_rng(seed)
    driven = Driven(make_robot(), [0.0] * 6)
    reached = 0
    for index in range(count):
        values, speed = random.uniform(-1.0, 1.0, 6), np.inf
        bad = random.choice([np.nan, np.inf, -np.inf])
        angles = driven.angles.copy()
        if index % 3 == 0:
            values[random.integers(6)] = bad
        elif index % 3 == 1:
            speed = np.nan
        else:
            driven.angles[random.integers(6)] = bad
        safe = driven.step(position_command(range(6), values, speed=speed))
        reached += not all(np.isfinite(part).all() for part in (safe.position, safe.velocity, safe.torque))
        driven.angles = np.where(np.isfinite(driven.angles), driven.angles, angles)
    return {"tried": count, "reached": reached}
