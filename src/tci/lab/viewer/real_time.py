"""Slows a simulation down to real time, so that a person can watch the simulation."""

from __future__ import annotations

import time

AHEAD = 0.03
"""Time [s] that a simulation may run ahead of real time before it waits. Assumed: the time of one picture.
The processor needs less time if several periods are computed at once, without a wait after each period."""
LATE = 0.1
"""Largest delay [s] behind real time that a simulation makes up for by faster steps. A larger delay is not
made up for. Assumed: a person hardly sees that the simulation catches up by three pictures."""


class RealTime:
    """Waits until the wall clock reaches the simulation's time."""

    def __init__(self) -> None:
        self._zero: tuple[float, float] | None = None

    def forget(self) -> None:
        """Makes the next `wait` treat the simulation as exactly on time. Call this after a pause of the
        simulation: the simulation then does not catch up on the pause."""
        self._zero = None

    def wait(self, now: float, pace: float) -> None:
        """Waits until real time reaches `now` [s] on the simulation's clock. This clock advances `pace`
        seconds per second of real time."""
        wall = time.monotonic()
        if self._zero is None or self._zero[1] != pace:
            self._zero = (wall - now / pace, pace)
        ahead = self._zero[0] + now / pace - wall
        if ahead > AHEAD:
            time.sleep(ahead)
        elif ahead < -LATE:
            self._zero = (self._zero[0] - ahead, pace)
