"""Measurement of times. TCI and the peer (the program for comparison) run alternately, so that a slower
machine slows both."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

ROUNDS = 7
SPAN = 0.05
"""Time [s] for which each of the two programs is called in a round."""
SHORT = 3e-4
"""Duration [s] of a run of calls. Shorter than a time slice of the operating system, which is some
milliseconds."""

Work = Callable[[], object]


@dataclass(frozen=True)
class Measured:
    """One row of the table."""

    name: str
    peer: str
    unit: str
    ours: float
    """Median value of TCI over the rounds."""
    theirs: float
    ratio: float
    """Median ratio of TCI to the peer; below 1 if TCI is faster."""
    ratio_min: float
    ratio_max: float
    rounds: int
    target: str = ""
    """Target of the ratio or of TCI's value; empty if the row has no target."""
    met: bool | None = None
    note: str = ""
    cold: float | None = None
    """Median value of TCI after 1 ms of sleep, when the caches contain other data; None if not measured."""
    theirs_cold: float | None = None


def row(
    name: str,
    peer: str,
    pairs: Sequence[tuple[float, float]],
    *,
    unit: str = "us",
    most: float | None = None,
    most_ratio: float | None = None,
    least_ratio: float | None = None,
    note: str = "",
    colds: tuple[float | None, float | None] = (None, None),
) -> Measured:
    """Returns a row from pairs (TCI, peer), one pair per round. The target is an upper bound of TCI's median
    (`most`), or a bound of the median ratio (`most_ratio`, `least_ratio`). `colds` are the values of TCI and
    the peer after 1 ms of sleep."""
    ours = statistics.median(a for a, _ in pairs)
    ratios = sorted(a / b for a, b in pairs)
    ratio = statistics.median(ratios)
    target, met = "", None
    if most is not None:
        target, met = f"<= {most:g} {unit}", ours <= most
    if most_ratio is not None:
        target, met = f"{target} <= {most_ratio:.3g} x".strip(), ratio <= most_ratio and met is not False
    if least_ratio is not None:
        target, met = f">= {least_ratio:g} x", ratio >= least_ratio
    theirs = statistics.median(b for _, b in pairs)
    return Measured(
        name, peer, unit, ours, theirs, ratio, ratios[0], ratios[-1], len(pairs), target, met, note, *colds
    )


def each(work: Work, *, calls: int, clock: Callable[[], float] = time.thread_time) -> float:
    """Returns the median time [us] of one call over short runs of calls. The default clock counts only the
    processor time of this thread. Pass `time.perf_counter` for work that waits."""
    start = clock()
    work()
    run = max(1, min(calls, int(SHORT / max(clock() - start, 1e-9))))
    times = []
    for _ in range(max(1, calls // run)):
        start = clock()
        for _ in range(run):
            work()
        times.append((clock() - start) / run)
    return statistics.median(times) * 1e6


def in_turn(ours: Work, peer: Work, *, rounds: int = ROUNDS) -> list[tuple[float, float]]:
    """Returns one pair per round: the times [us] of one call of `ours` and of one call of `peer`."""
    calls = [max(1, int(SPAN * 1e6 / max(each(work, calls=3), 0.1))) for work in (ours, peer)]
    return [(each(ours, calls=calls[0]), each(peer, calls=calls[1])) for _ in range(rounds)]


def cold(work: Work, *, calls: int = 200) -> float:
    """Returns the median time [us] of a call after 1 ms of sleep, when the caches contain other data."""
    times = []
    for _ in range(calls):
        time.sleep(0.001)
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e6
