"""Benchmark of the 1 kHz loop with 4000 taxels and a moving robot. Another process runs a loop that only
sleeps, for comparison."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
from measured import Measured, row
from pipeline import TURN, Pipeline, Swinging

import tci
from tci.gate import SafeCommand
from tci.messages import SkinFrame
from tci.messages.clock import MonotonicClock
from tci.runtime.loop_report import LoopReport
from tci.testing import FakeDriver

SECONDS = float(os.environ.get("TCI_BENCH_LOOP", "60"))
RUNS = 5
BARE = """
import json, sys, time
from tci.messages.clock import MonotonicClock, ticks
from tci.runtime.loop_report import Histogram
late, clock = Histogram(), MonotonicClock()
periods = ticks(clock, 0.001, duration=float(sys.argv[1]))
start = clock.now()
for now in periods:
    late.add((now - start + 1e-9) % 0.001)
print(json.dumps([late.quantile(q) for q in (0.5, 0.99, 0.999)]))
"""


class Echo(FakeDriver):
    """Simulated robot that follows its commands exactly and sends 50 new frames per second, each in a new
    array."""

    def __init__(self, parts: Pipeline) -> None:
        super().__init__(parts.robot, clock=MonotonicClock(), rate=1000.0)
        self._raw = parts.frames
        self._shown: tuple[SkinFrame, ...] = ()

    def frames(self, now: float, sequence: int) -> tuple[SkinFrame, ...]:
        if sequence % 20 == 1:
            frame = sequence // 20
            raw = self._raw[frame % 2].items()
            self._shown = tuple(SkinFrame(name, now, frame, values.copy()) for name, values in raw)
        return self._shown

    def _send(self, safe: SafeCommand) -> None:
        self.position[safe.servos] = safe.position


def _apart(pid: int) -> None:
    """Moves the other process to other processors, because two busy loops on one processor would delay each
    other."""
    if hasattr(os, "sched_setaffinity"):
        ours = os.sched_getaffinity(0)
        if len(ours) > 1:
            ours = {max(ours)}
            os.sched_setaffinity(0, ours)
        os.sched_setaffinity(pid, set(range(os.cpu_count() or 1)) - ours or ours)


def loop() -> list[Measured]:
    """Measures the loop in five runs. The environment variable TCI_BENCH_LOOP sets their total time [s]."""
    parts, late, work, missed, ticks = Pipeline(4000, 16, 30, every=TURN), [], [], 0, 0
    capability = Swinging(parts.robot, every=TURN)
    for _ in range(RUNS):
        bare = subprocess.Popen(
            [sys.executable, "-c", BARE, str(SECONDS / RUNS)], stdout=subprocess.PIPE, text=True
        )
        _apart(bare.pid)
        report = LoopReport()
        tci.run(Echo(parts), capability, duration=SECONDS / RUNS, report=report)
        theirs = json.loads(bare.communicate()[0])
        ours = [report.lateness.quantile(q) for q in (0.5, 0.99, 0.999)]
        late.append([(1e6 * own, 1e6 * bare_s) for own, bare_s in zip(ours, theirs, strict=True)])
        work.append([1e6 * report.work.quantile(q) for q in (0.5, 0.99, 0.999)])
        missed, ticks = missed + report.missed, ticks + report.ticks
    took = [f"{name} {np.median([run[i] for run in work]):.0f} us" for i, name in enumerate(("p50", "p99"))]
    note = f"{ticks} of {1000 * SECONDS:.0f} periods executed, {missed} missed; "
    note += f"computing time of a period: {', '.join(took)}"
    name = "loop at 1 kHz, 4000 taxels, moving: delay of the wake-up,"
    return [
        row(f"{name} p50", "loop without TCI", [run[0] for run in late], most=5.0, note=note),
        row(f"{name} p99", "loop without TCI", [run[1] for run in late], most_ratio=1.5),
        row(f"{name} p99.9", "loop without TCI", [run[2] for run in late]),
    ]
