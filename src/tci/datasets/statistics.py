"""Statistics of the columns of a data set, while its rows pass by."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
KEPT = 4096
"""Rows, evenly spaced, from which quantiles are taken. Assumed: enough for the 1 % quantile; exact for sets
that are no longer."""
MEMORY = 2**23
"""Size [bytes] of these rows, at most: of wide columns, such as raw skin, fewer rows are kept."""


class Statistics:
    """Statistics of one column. Mean and variance are merged block by block (Chan et al. 1979), so that they
    do not suffer from large offsets such as times in nanoseconds."""

    def __init__(self) -> None:
        self._count = 0
        self._every = 1
        self._kept: list[NDArray[Any]] = []

    def add(self, rows: NDArray[Any]) -> None:
        """Adds rows (n, size)."""
        if not len(rows):
            return
        values = rows.astype(np.float64)
        count, mean = len(values), values.mean(axis=0)
        self._merge(count, mean, ((values - mean) ** 2).sum(axis=0), values.min(axis=0), values.max(axis=0))
        self._keep(rows[-(self._count - count) % self._every :: self._every])

    def merge(self, other: Statistics) -> None:
        """Adds the rows that `other` has seen."""
        self._merge(other._count, other._mean, other._spread, other._least, other._most)
        self._keep(np.concatenate(other._kept))

    def result(self) -> dict[str, NDArray[Any]]:
        kept = np.concatenate(self._kept).astype(np.float64)
        found = np.repeat(self._least[None], len(QUANTILES), axis=0)
        changes = self._least < self._most  # most taxels are never touched
        found[:, changes] = np.quantile(kept[:, changes], list(QUANTILES.values()), axis=0)
        return {
            "min": self._least,
            "max": self._most,
            "mean": self._mean,
            "std": np.sqrt(self._spread / self._count),
            "count": np.array([self._count]),
            **dict(zip(QUANTILES, found, strict=True)),
        }

    def _merge(self, count: int, mean: Any, spread: Any, least: Any, most: Any) -> None:
        if not self._count:
            self._count, self._mean, self._spread = count, mean, spread
            self._least, self._most = least, most
            return
        total = self._count + count
        away = mean - self._mean
        self._spread = self._spread + spread + away**2 * (self._count * count / total)
        self._mean = self._mean + away * (count / total)
        self._least, self._most = np.minimum(self._least, least), np.maximum(self._most, most)
        self._count = total

    def _keep(self, rows: NDArray[Any]) -> None:
        self._kept.append(rows.copy())
        most = min(KEPT, max(1, MEMORY // max(1, rows[:1].nbytes)))
        while sum(map(len, self._kept)) > 2 * most:
            self._kept = [np.concatenate(self._kept)[::2]]
            self._every *= 2
