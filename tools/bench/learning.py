"""Benchmark of the Gymnasium environment: steps per second on one core."""

from __future__ import annotations

import time

import gymnasium
import numpy as np
from measured import Measured, row

import tci.learn  # noqa: F401 - registers it

EPISODES = 6
LEAST = 2500.0
"""Target [steps per second]."""


def learning() -> list[Measured]:
    """Measures the rate of steps with random targets: the arm moves in every step, and each episode has a new
    poke."""
    return [_with_rate(100.0, least_ratio=1.0), _with_rate(500.0)]


def _with_rate(rate: float, **target: float) -> Measured:
    environment = gymnasium.make("tci.learn:tci/Withdrawal-v0", rate=rate)
    environment.action_space.seed(0)
    pairs, touched, steps = [], 0, 0
    for seed in range(EPISODES + 1):
        environment.reset(seed=seed)
        middle = np.array(environment.action_space.sample())
        start, count, over = time.thread_time(), 0, False
        while not over:
            action = 0.9 * middle + 0.1 * environment.action_space.sample()
            *_, over, info = environment.step(action)
            touched += bool(info["force"] > 0.0)
            count += 1
        pairs.append((count / (time.thread_time() - start), LEAST))
        steps += count
    note = f"steps of 20 ms; arm touched in {touched / steps:.0%} of the steps"
    name = f"Gymnasium environment, {rate:g} commands per second: steps per second on one core"
    return row(name, "none: the target", pairs[1:], unit="1/s", note=note, **target)
