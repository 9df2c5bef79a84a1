"""A simulation that goes no faster than a person can watch."""

from __future__ import annotations

import time

AHEAD = 0.03
"""How far [s] a simulation may run ahead of real time before it waits: one picture. Many periods at once cost
less than each by itself. Ours."""
LATE = 0.1
"""How far [s] it may fall behind before it stops catching up. Ours."""


class RealTime:
    """Waits until a simulation's time has come."""

    def __init__(self) -> None:
        self._zero: tuple[float, float] | None = None

    def forget(self) -> None:
        """Begin anew: time stood still."""
        self._zero = None

    def wait(self, now: float, pace: float) -> None:
        """Return when `now` [s] on the simulation's clock has come, at `pace` seconds of it per second."""
        wall = time.monotonic()
        if self._zero is None or self._zero[1] != pace:
            self._zero = (wall - now / pace, pace)
        ahead = self._zero[0] + now / pace - wall
        if ahead > AHEAD:
            time.sleep(ahead)
        elif ahead < -LATE:
            self._zero = (self._zero[0] - ahead, pace)
