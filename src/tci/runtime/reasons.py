"""Reasons that come again and again: what is told of them once, and counted else."""

from __future__ import annotations

import re
from collections import Counter

MOST = 100
"""Kinds of reasons that are kept. Ours."""
OTHERS = "other reasons"
"""What all further kinds are counted as."""


def kind_of(reason: str) -> str:
    """A reason without its figures: the same one with another figure is no news. Names keep their digits."""
    return re.sub(r"\b\d[\d.]*", "", reason)


class Reasons:
    """How often each kind of reason came, by the words that came first. It never holds more than MOST + 1."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}

    def add(self, reason: str) -> bool:
        """Count a reason. Returns whether it is the first of a kind that is kept."""
        kind = kind_of(reason)
        is_new = kind not in self._first
        if is_new and len(self._first) >= MOST:
            self.counts[OTHERS] += 1
            return False
        self.counts[self._first.setdefault(kind, reason)] += 1
        return is_new
