"""Benchmark of the Gymnasium environment: steps per second on one core, and steps while Python imports NumPy,
a measure that differs less between machines."""

from __future__ import annotations

import time

import gymnasium
import numpy as np
from measured import Measured, row
from start import seconds

import tci.learn  # noqa: F401 - registers it

EPISODES = 6
LEAST = 2500.0
"""Target [steps per second]."""
LEAST_MULTIPLE = 170.0
"""Target [steps per run time of `import numpy`]."""


def learning() -> list[Measured]:
    """Measures the rate of steps with random targets: the arm moves in every step, and each episode has a new
    poke."""
    return [*_with_rate(100.0, least_ratio=1.0, least_multiple=LEAST_MULTIPLE), *_with_rate(500.0)]


def _with_rate(
    rate: float, *, least_ratio: float | None = None, least_multiple: float | None = None
) -> list[Measured]:
    environment = gymnasium.make("tci.learn:tci/Withdrawal-v0", rate=rate)
    environment.action_space.seed(0)
    found, touched, steps = [], 0, 0
    for seed in range(EPISODES + 1):
        environment.reset(seed=seed)
        middle = np.array(environment.action_space.sample())
        start, count, over = time.thread_time(), 0, False
        while not over:
            action = 0.9 * middle + 0.1 * environment.action_space.sample()
            *_, over, info = environment.step(action)
            touched += bool(info["force"] > 0.0)
            count += 1
        found.append((count / (time.thread_time() - start), 1.0 / seconds("-c", "import numpy")))
        steps += count
    note = f"steps of 20 ms; arm touched in {touched / steps:.0%} of the steps"
    name = f"Gymnasium environment, {rate:g} commands per second: steps per second on one core"
    against_target = [(own, LEAST) for own, _ in found[1:]]
    return [
        row(name, "none: the target", against_target, unit="1/s", note=note, least_ratio=least_ratio),
        row(name, "runs of `import numpy`", found[1:], unit="1/s", least_ratio=least_multiple),
    ]
