"""Reasons that come again and again: what is told of them once, and counted else."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

MOST = 100
"""Kinds of reasons that are kept. Ours."""
OTHERS = "other reasons"
"""What all further kinds are counted as."""


def kind_of(reason: str) -> str:
    """A reason without its figures: the same one with another figure is no news. Names keep their digits."""
    return re.sub(r"\b\d[\d.]*", "", reason)


@dataclass(frozen=True, slots=True)
class Notice:
    """One kind of reason: words and time of the first, and the count of all."""

    words: str
    """Words of the first."""
    time: float
    """Time [s] of the first."""
    count: int
    """Number of reasons of this kind."""

    def __str__(self) -> str:
        return f"{self.count} x, first at {self.time:.3f} s: {self.words}"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {"words": self.words, "time_s": round(self.time, 4), "count": self.count}


class ReasonCounter:
    """How often each kind of reason came, by the words that came first. It never holds more than MOST + 1."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}
        self._times: dict[str, float] = {}

    def add(self, reason: str, now: float) -> bool:
        """Count a reason, which came at `now` [s]. Returns whether it is the first of a kind that is kept."""
        kind = kind_of(reason)
        is_new = kind not in self._first
        if is_new and len(self._first) >= MOST:
            words, is_new = OTHERS, False
        else:
            words = self._first.setdefault(kind, reason)
        self._times.setdefault(words, now)
        self.counts[words] += 1
        return is_new

    def notices(self) -> tuple[Notice, ...]:
        """One notice for each kind, in the order in which they first came."""
        return tuple(Notice(words, self._times[words], count) for words, count in self.counts.items())
