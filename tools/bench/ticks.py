"""Benchmark of the ticks of a touch, as multiples of ticks that carry a new skin frame and no contact.

Own thread time of perceiving, reflex, conversion and gate, on simulated robots whose forearms are poked at
random taxels. Counted are the ticks from the first contact to the first command that carry a new frame or
the command. Python's garbage collector passes over what was there before, as in `tci.run`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from measured import Measured, row

import tci
from tci.runtime.watchdogs import frozen_garbage

ROBOTS = ("nao", "icub", "g1")
SPAN, PAUSE = 60.0, 0.7
"""Simulated time [s] on each robot, and time between two pokes."""
ARMS = "left_forearm", "right_forearm"


@dataclass
class _Ticks:
    """Thread times [ns]."""

    idle: list[int] = field(default_factory=list)
    touched: list[int] = field(default_factory=list)
    first: int = 0
    """Time of the first tick with a command."""


def ticks() -> list[Measured]:
    """Rows of each robot, and the tick with the process's first command as a multiple of the median one."""
    rows, first = [], None
    for name in ROBOTS:
        found = _of(name)
        idle = float(np.median(found.idle))
        if first is None:
            found.touched.remove(found.first)
            first = found.first / 1e3, float(np.median(found.touched)) / 1e3
        times = np.array(found.touched) / 1e3
        for what, value, most in (
            ("median", float(np.median(times)), 4.0),
            ("p99", float(np.percentile(times, 99)), 8.0),
        ):
            label = f"{name}: ticks of a touch up to the command, {what} of {len(times)}"
            peer = "median tick with a new frame and no contact"
            rows.append(row(label, peer, [(value, idle / 1e3)], most_ratio=most))
    assert first is not None
    return [
        *rows,
        row("the process's first command: its tick", "median tick of a touch", [first], most_ratio=1.5),
    ]


def _of(name: str) -> _Ticks:
    robot, reflex, random = tci.load_robot(name), tci.WithdrawalReflex(), np.random.default_rng(0)
    body = tci.GenericBody(robot)
    found, pending, pokes = _Ticks(), list[int](), 0
    begin, before, answered = 0.3, None, True
    with tci.connect(robot, "sim") as driver, frozen_garbage():
        perceiver, memory, finger = tci.Perceiver(body), reflex.init(body), driver.world.finger
        for now in driver.ticks(duration=SPAN):
            if now >= begin:
                finger.retire()
                pokes, begin, answered, pending = pokes + 1, now + PAUSE, False, []
                try:
                    finger.poke(ARMS[pokes % 2], int(random.integers(0, 200)))
                except tci.TciError:  # this taxel can't be reached
                    answered = True
            reading = driver.read()
            frames = tuple(frame.sequence for frame in reading.skin)
            fresh, before = frames != before, frames
            start = time.thread_time_ns()
            perception = perceiver.step(reading, now)
            commands, memory = reflex.step(memory, perception, body)
            orders, refused = body.to_platform(commands, reading.joints)
            safe = driver.gate.step(orders, reading.joints, now, refused=refused)
            took = time.thread_time_ns() - start
            driver.write(safe)
            if not len(perception.contacts):
                if fresh and not commands:
                    found.idle.append(took)
            elif not answered:
                pending += [took] if fresh or commands else []
                if commands:
                    found.touched += pending
                    found.first = found.first or took
                    answered = True
    return found
