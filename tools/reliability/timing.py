"""The loop at 1 kHz on the real clock, beside a bare sleep loop in the same process time."""

from __future__ import annotations

import threading
import time

import numpy as np
from row import Row

import tci
from tci.clock import MonotonicClock
from tci.messages import Reading
from tci.middleware.link import Link
from tci.runtime.loop import run
from tci.runtime.loop_report import Histogram, LoopReport


class Echo(Link):
    """A robot that is where it was told to be."""

    def __init__(self) -> None:
        robot = tci.load_robot("nao")
        binding = robot.binding("sim").model_copy(update={"rate": 1000.0})
        super().__init__(
            robot.model_copy(update={"bindings": (binding,)}),
            middleware="sim",
            clock=MonotonicClock(),
            armed=True,
        )
        self.angles, self.count = np.array(robot.initial_position), 0

    def _receive(self) -> Reading:
        self.count += 1
        joints = tci.JointReading(
            self.clock.now(), self.count, self.angles.copy(), np.zeros(len(self.angles))
        )
        return Reading(joints, ())

    def _send(self, safe: tci.SafeCommand) -> None:
        self.angles[safe.servos] = safe.position

    def _close(self) -> None:
        return


def one_kilohertz(full: bool) -> Row:
    """Work of a tick, and lateness of both loops."""
    seconds, bare, done = (3600.0 if full else 5.0), Histogram(), threading.Event()

    def sleeper() -> None:
        due = time.monotonic()
        while not done.is_set():
            due = max(due + 0.001, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            bare.add(max(0.0, time.monotonic() - due))

    beside = threading.Thread(target=sleeper)
    beside.start()
    report = LoopReport()
    run(Echo(), tci.WithdrawalReflex(), duration=seconds, report=report)
    done.set()
    beside.join()
    counted = report.ticks + report.missed
    work = report.work.quantile(0.999) * 1e3
    return Row(
        "1 kHz loop", f"{seconds:.0f} s",
        f"work p99.9 {work:.2f} ms; late p99.9 {report.lateness.quantile(0.999) * 1e3:.2f} ms, "
        f"bare {bare.quantile(0.999) * 1e3:.2f} ms; {report.missed} missed, all counted",
        "work p99.9 <= 0.5 ms, no unreported overrun",
        work <= 0.5 and abs(counted - round(seconds * 1000)) <= 1,
    )  # fmt: skip
