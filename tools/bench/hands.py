"""Processor time of a robot that feels with its hands, as a multiple of one that feels with its arms.

Own thread time of perceiving alone, and with capability, conversion and gate, over all periods, on simulated
robots that are poked at random taxels every 0.7 s: a G1 whose Inspire hands have 2124 taxels in 34 pads, at
50 Hz, beside a G1 with 1296 taxels in four sleeves, at 100 Hz. Rounds of the two take turns.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from measured import ROUNDS, Measured, row

import tci
from tci.runtime.watchdogs import frozen_garbage

SPAN, PAUSE = 3.0, 0.7
"""Simulated time [s] of a round, and time between two pokes."""
PADS = ("left_index_top", "left_ring_pad", "right_thumb_pad", "right_palm")
SLEEVES = ("left_forearm", "right_upper_arm", "right_forearm", "left_upper_arm")


def hands() -> list[Measured]:
    with frozen_garbage():
        ours = _rounds("g1-inspire", tci.FingerReflex(), PADS)
        theirs = _rounds("g1", tci.WithdrawalReflex(), SLEEVES)
        next(ours), next(theirs)  # the first touches compile and fill caches
        pairs = [(next(ours), next(theirs)) for _ in range(ROUNDS)]
    name, peer = "hands with 2124 taxels in 34 pads at 50 Hz", "G1 with 1296 taxels in 4 sleeves"
    return [
        row(f"{name}: {what}", peer, [(own[k], other[k]) for own, other in pairs], most_ratio=1.5)
        for k, what in enumerate(("what the skin costs in one period", "one period with all"))
    ]


def _rounds(
    name: str, capability: tci.Capability[Any], patches: tuple[str, ...]
) -> Iterator[tuple[float, float]]:
    """Mean thread time [us] of perceiving in one period, and of the whole period, round by round."""
    body, random = tci.GenericBody(name), np.random.default_rng(0)
    with tci.connect(name, "sim") as driver:
        perceiver, memory, finger = tci.Perceiver(body), capability.init(body), driver.world.finger
        ends, pokes, next_poke, felt, spent, count = SPAN, 0, 0.3, 0, 0, 0
        for now in driver.ticks():
            if now >= next_poke:
                finger.retire()
                pokes, next_poke = pokes + 1, now + PAUSE
                patch = patches[pokes % len(patches)]
                try:
                    finger.poke(patch, int(random.integers(0, body.robot.patch(patch).channels)))
                except tci.TciError:  # this taxel can't be reached
                    next_poke = now
            reading = driver.read()
            start = time.thread_time_ns()
            perception = perceiver.step(reading, now)
            felt += time.thread_time_ns() - start
            commands, memory = capability.step(memory, perception, body)
            orders, refused = body.to_platform(commands, reading.joints)
            safe = driver.gate.step(orders, reading.joints, now, refused=refused)
            spent, count = spent + time.thread_time_ns() - start, count + 1
            driver.write(safe)
            if now >= ends:
                yield felt / count / 1e3, spent / count / 1e3
                ends, felt, spent, count = now + SPAN, 0, 0, 0
