"""Measurement of times: TCI and the peer in turn, so that a slower machine slows both."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

ROUNDS = 7
SPAN = 0.05
"""Time [s] for which a round calls one of the two."""
SHORT = 3e-4
"""Duration [s] of a run of calls. Shorter than a time slice of the system, which is some milliseconds."""

Work = Callable[[], object]


@dataclass(frozen=True)
class Measured:
    """One row of the table."""

    name: str
    peer: str
    unit: str
    ours: float
    """Median of TCI over the rounds."""
    theirs: float
    ratio: float
    """Median of the ratios of the rounds; below 1 if TCI takes less."""
    ratio_min: float
    ratio_max: float
    rounds: int
    target: str = ""
    """Target of the ratio or of TCI's figure; empty if there is none."""
    met: bool | None = None
    note: str = ""
    cold: float | None = None
    """Median of TCI after 1 ms of sleep, when the caches hold other data; None if not measured."""
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
    """Returns a row of pairs (TCI, peer), one per round, with its target: the largest median of TCI, or
    the most or least that the median ratio may be; `colds`: both after 1 ms of sleep."""
    ours = statistics.median(a for a, _ in pairs)
    ratios = sorted(a / b for a, b in pairs)
    ratio = statistics.median(ratios)
    target, met = "", None
    if most is not None:
        target, met = f"<= {most:g} {unit}", ours <= most
    if most_ratio is not None:
        target, met = f"{target} <= {most_ratio:g} x".strip(), ratio <= most_ratio and met is not False
    if least_ratio is not None:
        target, met = f">= {least_ratio:g} x", ratio >= least_ratio
    theirs = statistics.median(b for _, b in pairs)
    return Measured(
        name, peer, unit, ours, theirs, ratio, ratios[0], ratios[-1], len(pairs), target, met, note, *colds
    )


def each(work: Work, *, calls: int, clock: Callable[[], float] = time.thread_time) -> float:
    """Returns the time [us] of one call: the median over short runs of calls, on the clock of this thread,
    which stands still while others have the processor. Work that waits needs `time.perf_counter`."""
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
    """Returns the times [us] of one call of each of the two, per round."""
    calls = [max(1, int(SPAN * 1e6 / max(each(work, calls=3), 0.1))) for work in (ours, peer)]
    return [(each(ours, calls=calls[0]), each(peer, calls=calls[1])) for _ in range(rounds)]


def cold(work: Work, *, calls: int = 200) -> float:
    """Returns the median time [us] of a call after 1 ms of sleep, when the caches hold other data."""
    times = []
    for _ in range(calls):
        time.sleep(0.001)
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e6
