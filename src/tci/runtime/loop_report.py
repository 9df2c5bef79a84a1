"""Timing statistics of the control loop: executed and missed periods, lateness, and computing time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FINEST = 1e-6
"""Upper edge [s] of the first bin of a histogram. Assumed: every step of the loop needs more time."""
PER_DOUBLING = 16
"""Number of bins of a histogram between any time and twice this time."""
BINS = 512


class Histogram:
    """A histogram of times. Each bin is 4 % wider than the previous bin, so the histogram covers times from
    microseconds to hours.
    """

    def __init__(self) -> None:
        self.counts: NDArray[np.int64] = np.zeros(BINS, dtype=np.int64)
        """Number of recorded times (BINS,) in each bin."""
        self.largest = 0.0
        """Longest recorded time [s]."""

    def __repr__(self) -> str:
        p50, p999 = self.quantile(0.5) * 1e3, self.quantile(0.999) * 1e3
        return f"Histogram(p50={p50:.3g} ms, p99.9={p999:.3g} ms, largest={self.largest * 1e3:.3g} ms)"

    def add(self, seconds: float) -> None:
        """Records a time [s]."""
        self.largest = max(self.largest, seconds)
        share = seconds / FINEST
        place = 0 if share <= 1.0 else math.ceil(PER_DOUBLING * math.log2(share))
        self.counts[min(place, BINS - 1)] += 1

    def quantile(self, share: float) -> float:
        """Returns a quantile [s]: a fraction `share` (0..1) of all recorded times is at most as long as the
        result. The result is rounded up to the upper edge of a bin.
        """
        total = int(self.counts.sum())
        if not total:
            return 0.0
        bin_ = int(np.searchsorted(np.cumsum(self.counts), share * total))
        return float(min(FINEST * 2.0 ** (bin_ / PER_DOUBLING), self.largest))

    def to_json(self) -> dict[str, float]:
        """Returns the median, the 99 % quantile, the 99.9 % quantile and the largest time, all in [ms]."""
        quantiles = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
        figures = {name: self.quantile(share) * 1e3 for name, share in quantiles.items()}
        return {**figures, "max": self.largest * 1e3}


@dataclass(slots=True)
class LoopReport:
    """Timing statistics of a run. To read the statistics during the run, pass a report to `run`."""

    ticks: int = 0
    """Number of periods that the loop executed."""
    missed: int = 0
    """Number of periods that the loop skipped, because an earlier period lasted too long or the process did
    not run."""
    overruns: int = 0
    """Number of gaps in the sequence of executed periods. Each gap has one or more missed periods."""
    rejected: int = 0
    """Number of readings that the loop rejected because the skin frames in the reading did not fit the
    robot's description."""
    lateness: Histogram = field(default_factory=Histogram)
    """Delay [s] of each tick: time from the planned start of the tick's period to the real start."""
    work: Histogram = field(default_factory=Histogram)
    """Computing time [s] of each tick, measured on the machine's own clock."""
    ended: str = ""
    """Reason for which the loop ended. The text is empty while the loop runs."""
    cut_short: bool = False
    """True if the robot was still moving at the end of the run, so that the loop had to bring the robot to
    rest."""

    def to_json(self) -> dict[str, Any]:
        """Returns the statistics as JSON values. Times are in [ms]."""
        return {
            "ticks": self.ticks,
            "missed": self.missed,
            "overruns": self.overruns,
            "rejected": self.rejected,
            "lateness_ms": self.lateness.to_json(),
            "work_ms": self.work.to_json(),
            "ended": self.ended,
            "cut_short": self.cut_short,
        }
