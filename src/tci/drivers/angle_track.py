"""Angles that a source measured lately."""

from __future__ import annotations

from collections.abc import Mapping

KEPT = 8
"""Number of times that angles are kept: a frame is never older than its sweep."""


class AngleTrack:
    """The latest angles by joint, each with its time. One thread writes, others read."""

    def __init__(self) -> None:
        self._kept: tuple[tuple[float, Mapping[str, float]], ...] = ()

    def take(self, angles: Mapping[str, float], stamp: float) -> None:
        """`stamp` [s] is on this machine's monotonic clock. Angles that came in parts are put together."""
        last = self._kept[-1][1] if self._kept else {}
        self._kept = (*self._kept[1 - KEPT :], (stamp, {**last, **angles}))

    @property
    def latest(self) -> Mapping[str, float]:
        return self._kept[-1][1] if self._kept else {}

    def at(self, joint: str, stamp: float) -> tuple[float | None, float]:
        """Angle at `stamp`, and its change in a second; None if it was never measured.

        Between two times it is taken in proportion. A frame is newer than the last angles by up to a sweep:
        then the last change goes on, for as long as it took.
        """
        known = [(when, angles[joint]) for when, angles in self._kept if joint in angles]
        if len(known) < 2:
            return (known[0][1] if known else None), 0.0
        if stamp <= known[0][0]:
            return known[0][1], 0.0
        after = next((i for i in range(1, len(known)) if stamp <= known[i][0]), len(known) - 1)
        (begin, first), (end, second) = known[after - 1 : after + 1]
        if end <= begin:
            return second, 0.0
        speed = (second - first) / (end - begin)
        if stamp - end > end - begin:
            return second + speed * (end - begin), 0.0
        return second + speed * (stamp - end), speed
