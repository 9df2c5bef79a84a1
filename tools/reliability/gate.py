"""Hostile commands and non-finite values through the gate, judged by the tests' independent checker."""

from __future__ import annotations

import numpy as np
from row import Row

from interface.gate_checks import Driven, make_robot, position_command


def hostile(full: bool) -> Row:
    """3 % of all commands are hostile; the path is checked from its angles alone."""
    cycles, random = (10_000_000 if full else 20_000), np.random.default_rng(11)
    driven = Driven(make_robot(), [0.0] * 6)
    outside = 0
    for cycle in range(cycles):
        commands = []
        if random.random() < 0.1:
            values = random.uniform(-3.0, 3.0, 6)
            if random.random() < 0.3:
                values[random.integers(6)] = random.choice([np.nan, np.inf, -np.inf, -1e300])
            commands.append(position_command(range(6), values[: random.integers(4, 7)]))
            if commands[0].values.size < 6 and random.random() < 0.5:
                commands = [position_command(range(commands[0].values.size), commands[0].values)]
        driven.step(*commands)
        if cycle % 2000 == 1999:
            try:
                driven.assert_within_limits()
            except AssertionError:
                outside += 1
            del driven.path[:-3]
    refused = driven.gate.counts.refusals
    return Row(
        "hostile commands, test robot", f"{cycles} cycles", f"{outside} outside, {refused} refused",
        "0 outside any limit", outside == 0 and refused > 0,
    )  # fmt: skip


def non_finite(full: bool) -> Row:
    """A NaN or infinity in a value, a speed or an angle; none may come out."""
    count, random = (1_000_000 if full else 10_000), np.random.default_rng(12)
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
    return Row("non-finite values at the gate", f"{count}", f"{reached} reached a link", "0", reached == 0)
