"""Measures TCI's loop at 1 kHz on the real clock. A minimal loop (`bare_loop.py`) runs on another processor
for comparison."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
import tracemalloc
from array import array
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import psutil
from pool import Result, gather
from row import Row

import tci
from tci.capabilities.fields import default_fields
from tci.errors import TciError
from tci.gate import SafeCommand
from tci.messages import Reading, SkinFrame
from tci.messages.clock import MonotonicClock
from tci.messages.frames import frozen
from tci.robot.generic_arm import SEGMENTS
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import Histogram, LoopReport
from tci.runtime.priority import real_time
from tci.skin.skin import Skin
from tci.testing import FakeDriver

BARE = Path(__file__).parent / "bare_loop.py"
PERIOD = 1e-3
"""Period [s] of the loop."""
RATE = 50.0
TOUCH = (0.5, 2.0)
"""Duration [s] of a touch, and time [s] between the beginnings of two touches."""
PIECES = 12
"""Number of runs that together last one hour; MINUTES=5 is one of these runs."""
BOUND = 0.35
"""Largest 99.9th percentile [ms] of the thread time of a period."""
TRACED = 4.0
"""Duration [s] of a run in which memory allocations are counted. Counting is slow, so this run is not
timed."""
WARM = 5.0
"""Time [s] after which memory is measured. By then the compiled code is loaded."""
TIMES = ("own", "late", "bare_own", "bare_late")
"""Names of the histograms."""


class Touched(FakeDriver):
    """A robot that follows its commands exactly and is touched repeatedly at changing places."""

    def __init__(self) -> None:
        # This loop has a processor of its own, but Linux stops a real-time thread that is busy for 95 % of a
        # second.
        clock = MonotonicClock(tail=0.5 * PERIOD)
        super().__init__("nao", clock=clock, rate=1.0 / PERIOD)
        robot, self.busy = self.robot, 0.0
        self._start, self._number = self.clock.now(), -1
        self._shown: tuple[SkinFrame, ...] = ()
        # Raw bytes, in the type that drivers of robots with 8-bit sensors return. Each frame is a new array.
        self._rest = {p.name: np.full(p.channels, p.sensor.rest, np.uint8) for p in robot.patches}
        patches = [patch for patch in robot.patches if patch.segment in SEGMENTS]
        self._touches = [self._touch(patch, number) for number, patch in enumerate(patches)]

    def _touch(self, patch: tci.robot.description.Patch, number: int) -> tuple[str, np.ndarray]:
        """Returns a frame of a patch in which the taxels nearest to one of the receptive fields are
        pressed."""
        skin = Skin(self.robot)
        joints = self.joints()
        u, theta, _ = skin.limb(patch.name, joints)
        fields = [field for field in default_fields() if field.segment == patch.segment]
        field = fields[number % len(fields)]
        turn = np.abs((theta - field.theta + np.pi) % (2 * np.pi) - np.pi)
        nearest = np.argsort(np.hypot(u - field.u, turn / np.pi))[:9]
        values = self._rest[patch.name].copy()
        pressed = skin.surfaces[patch.name].channels[nearest]
        values[pressed] = values[pressed].astype(int) + 60 * np.sign(patch.sensor.pascal_per_count)
        return patch.name, values

    def _receive(self) -> Reading:
        self.busy = time.thread_time()
        return super()._receive()

    def frames(self, now: float, sequence: int) -> tuple[SkinFrame, ...]:
        since = now - self._start
        number = int(since * RATE)
        touched, values = self._touches[int(since / TOUCH[1]) % len(self._touches)]
        pressed = since % TOUCH[1] < TOUCH[0]
        if number != self._number:
            self._number, stamp = number, self._start + number / RATE
            felt = {**self._rest, touched: values} if pressed else self._rest
            self._shown = tuple(SkinFrame(n, stamp, number, frozen(v.copy())) for n, v in felt.items())
        return self._shown

    def _send(self, safe: SafeCommand) -> None:
        self.position[safe.servos] = safe.position  # unlike a fake one, keeps nothing: memory is measured


def one_kilohertz(full: bool) -> Row:
    """Measures the thread time of a period, also as a ratio to a minimal loop that copies the same data in
    the same run; the delay of both loops, page faults, allocations and memory."""
    pieces, seconds = (PIECES, 3600.0 / PIECES) if full else (1, 15.0)
    done = gather("one_kilohertz", _run, [(piece, seconds) for piece in range(pieces)], full=full, alone=True)
    times = {name: Histogram() for name in TIMES}
    for name, whole in times.items():
        whole.largest = np.inf
        for result in done:
            whole.counts += np.array(result[name])
    median, bare_median = (times[name].quantile(0.5) * 1e3 for name in ("own", "bare_own"))
    work, late, bare_work, bare_late = (times[name].quantile(0.999) * 1e3 for name in TIMES)
    faults, usual, most, kept = (
        max((result[key] for result in done), default=0.0)
        for key in ("faults", "usual_kb", "most_kb", "kept")
    )
    slopes = [result["slope"] for result in done] or [0.0]
    # A process reserves some memory once, in its first minutes. In one piece of five minutes this looks like
    # steady growth, so the mean of all pieces counts: the growth in the whole time, per hour.
    slope = sum(slopes) / len(slopes)
    missed, unreported = (sum(result[key] for result in done) for key in ("missed", "unreported"))
    words = f", {done[0]['how']}" if done and len({result["how"] for result in done}) == 1 else ""
    moving = min((result["moving"] for result in done), default=1.0)
    return Row(
        f"control loop at 1 kHz, with a touch every 2 s{words}",
        sum(result["seconds"] for result in done),
        3600.0,
        "s",
        f"processor time of a period: p50 {median:.3f} ms, p99.9 {work:.2f} ms "
        f"({_ratio(median, bare_median)} and {_ratio(work, bare_work)} times the time of a loop without TCI "
        f"that moves equal data); delay of a period: p99.9 {late:.2f} ms (loop without TCI: {bare_late:.2f} "
        f"ms); the robot moved for {moving:.0%} of the time; {missed} periods missed, {unreported} of them "
        f"without a report; memory allocated in a period: {usual:.1f} kB (median), {most:.0f} kB (largest), "
        f"{kept:.3f} blocks kept; {faults:.2f} page faults in 1000 periods; growth of memory "
        f"{slope:+.2f} MB/h, and {max(slopes) * seconds / 3600.0:+.2f} MB in the {seconds:.0f} s with the "
        "largest growth",
        f"p99.9 of the processor time <= {BOUND} ms, every missed period reported, growth < 1 MB/h",
        work <= BOUND and not unreported and moving > 0.0 and (not full or slope < 1.0),
    )


def _ratio(work: float, bare: float) -> str:
    return f"{work / bare:.1f}" if bare else "?"


def _allocations(driver: Touched) -> tuple[float, float]:
    """Returns the largest memory [kB] that is allocated at any time within a period: median and maximum over
    the periods."""
    taken: list[float] = []
    before = 0

    def observe(tick: Tick) -> None:
        nonlocal before
        del tick
        now, peak = tracemalloc.get_traced_memory()
        taken.append((peak - before) / 1024.0)
        before = now
        tracemalloc.reset_peak()

    tracemalloc.start()
    try:
        run(driver, tci.WithdrawalReflex(), duration=TRACED, observe=observe)
    finally:
        tracemalloc.stop()
    return float(np.median(taken[1:])), max(taken[1:])


def _run(piece: int, seconds: float) -> Result:
    del piece
    driver, report, own = Touched(), LoopReport(), Histogram()
    process, moved = psutil.Process(), [0]
    # `array` objects, since the elements of lists would count as allocated memory
    served, when, memory, faults, blocks = array("q"), array("d"), array("q"), array("q"), array("q")

    def observe(tick: Tick) -> None:
        own.add(time.thread_time() - driver.busy)
        moved[0] += bool((np.abs(tick.sent.velocity) > 1e-6).any())
        if report.ticks % 1000 == 0 and report.ticks >= WARM * 1000:
            usage = resource.getrusage(resource.RUSAGE_THREAD)
            served.append(report.ticks)
            when.append(tick.now)
            memory.append(process.memory_info().rss)
            faults.append(usage.ru_minflt + usage.ru_majflt)
            blocks.append(sys.getallocatedblocks())

    processors = os.sched_getaffinity(0)
    words = (seconds, RATE, len(driver.robot.servos), *(patch.channels for patch in driver.robot.patches))
    bare = subprocess.Popen([sys.executable, BARE, *map(str, words)], stdout=subprocess.PIPE, text=True)
    with ExitStack() as stack:
        stack.callback(bare.kill)
        how = ""
        try:
            stack.enter_context(real_time(processor=max(processors)))
            how = "with real-time priority on a reserved processor"
        except TciError as error:
            print(error)
        run(driver, tci.WithdrawalReflex(), duration=seconds, report=report, observe=observe)
        beside = json.loads(bare.communicate()[0])
    usual, most = _allocations(driver)
    periods = max(served[-1] - served[0], 1)
    unreported = abs(report.ticks + report.missed - round(seconds * 1000))
    return {
        "seconds": seconds,
        "how": how,
        "own": own.counts.tolist(),
        "late": report.lateness.counts.tolist(),
        "bare_own": beside["own"],
        "bare_late": beside["late"],
        "faults": 1e3 * (faults[-1] - faults[0]) / periods,
        "kept": (blocks[-1] - blocks[0]) / periods,
        "usual_kb": usual,
        "most_kb": most,
        "slope": float(np.polyfit(when, memory, 1)[0]) * 3600.0 / 2**20,
        "moving": moved[0] / report.ticks,
        "missed": report.missed,
        "unreported": max(0, unreported - 1),
    }
