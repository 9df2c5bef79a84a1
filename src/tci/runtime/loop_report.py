"""Timing statistics of the loop: periods, overruns, lateness and work."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FINEST = 1e-6
"""Upper edge [s] of the first bin. Assumed: shorter than any step of the loop."""
PER_DOUBLING = 16
"""Number of bins per doubling of the time."""
BINS = 512


class Histogram:
    """A histogram of times with bins that grow by 4 %, so that it covers microseconds to hours."""

    def __init__(self) -> None:
        self.counts: NDArray[np.int64] = np.zeros(BINS, dtype=np.int64)
        """Number of times (BINS,) in each bin."""
        self.largest = 0.0
        """The longest time [s]."""

    def add(self, seconds: float) -> None:
        """Adds a time [s]."""
        self.largest = max(self.largest, seconds)
        share = seconds / FINEST
        place = 0 if share <= 1.0 else math.ceil(PER_DOUBLING * math.log2(share))
        self.counts[min(place, BINS - 1)] += 1

    def quantile(self, share: float) -> float:
        """Returns the time [s] that a fraction `share` 0..1 of all do not exceed, rounded up to the edge of
        its bin."""
        total = int(self.counts.sum())
        if not total:
            return 0.0
        bin_ = int(np.searchsorted(np.cumsum(self.counts), share * total))
        return float(min(FINEST * 2.0 ** (bin_ / PER_DOUBLING), self.largest))

    def to_json(self) -> dict[str, float]:
        """Returns the usual quantiles in milliseconds."""
        quantiles = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
        figures = {name: self.quantile(share) * 1e3 for name, share in quantiles.items()}
        return {**figures, "max": self.largest * 1e3}


@dataclass(slots=True)
class LoopReport:
    """Statistics of a run. Pass one to `run` to read it during the loop and after it."""

    ticks: int = 0
    """Number of periods with a tick."""
    missed: int = 0
    """Number of periods that were skipped because an earlier one took too long or the process slept."""
    overruns: int = 0
    """Number of interruptions by missed periods."""
    rejected: int = 0
    """Number of readings whose skin did not fit the robot."""
    lateness: Histogram = field(default_factory=Histogram)
    """Lateness [s] of each tick."""
    work: Histogram = field(default_factory=Histogram)
    """Computing time [s] of each tick, on the machine's own clock."""
    ended: str = ""
    """Reason why the loop ended; empty while it runs."""
    cut_short: bool = False
    """True if the robot was still moving at the end of the run, and was brought to rest."""

    def to_json(self) -> dict[str, Any]:
        """Returns plain values; times in milliseconds."""
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
