"""Timing statistics of the loop: periods, overruns, lateness and work."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FINEST = 1e-6
"""Upper edge [s] of the first bin. Assumed: this is shorter than any step of the loop."""
PER_DOUBLING = 16
"""Number of bins after which the time has doubled."""
BINS = 512


class Histogram:
    """A histogram of times.

    Each bin is 4 % wider than the bin before, so the histogram covers microseconds to hours.
    """

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
        """Returns the time [s] that a fraction `share` 0..1 of all times do not exceed.

        The time is rounded up to the edge of its bin.
        """
        total = int(self.counts.sum())
        if not total:
            return 0.0
        bin_ = int(np.searchsorted(np.cumsum(self.counts), share * total))
        return float(min(FINEST * 2.0 ** (bin_ / PER_DOUBLING), self.largest))

    def to_json(self) -> dict[str, float]:
        """Returns the median, the 99 % and 99.9 % quantiles, and the largest time, in milliseconds."""
        quantiles = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
        figures = {name: self.quantile(share) * 1e3 for name, share in quantiles.items()}
        return {**figures, "max": self.largest * 1e3}


@dataclass(slots=True)
class LoopReport:
    """Statistics of a run. To read the statistics during the loop, pass a report to `run`."""

    ticks: int = 0
    """Number of periods that the loop executed."""
    missed: int = 0
    """Number of periods that were skipped, because an earlier period took too long or the process did not
    run."""
    overruns: int = 0
    """Number of occasions on which one or more periods were missed in a row."""
    rejected: int = 0
    """Number of readings that were rejected because their skin frames did not fit the robot."""
    lateness: Histogram = field(default_factory=Histogram)
    """Lateness [s] of each tick."""
    work: Histogram = field(default_factory=Histogram)
    """Computing time [s] of each tick, measured on the machine's own clock."""
    ended: str = ""
    """Reason why the loop ended. It is empty while the loop runs."""
    cut_short: bool = False
    """True if the robot was still moving at the end of the run and had to be brought to rest."""

    def to_json(self) -> dict[str, Any]:
        """Returns plain values for JSON. Times are in milliseconds."""
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
