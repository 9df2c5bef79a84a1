"""When the gate takes steps: one per period, however its caller keeps time."""

from __future__ import annotations

import logging
import math

EARLY = 0.05
"""Fraction of a period by which a call of `step` may come before the planned time of the step. Assumed:
larger than the jitter of timers."""
CATCH_UP = 0.5
"""After a late call of `step`, the next call may come sooner than one period later, by up to this fraction of
a period. Assumed: larger than the jitter of timers, and small enough to prevent several steps at once."""
STEADY = 0.1
"""Largest relative difference at which two successive intervals between calls of `step` count as equal. If
two equal intervals are too long, the gate reports that the loop runs at another rate. Assumed: on a busy
machine, two long intervals differ more."""
_log = logging.getLogger("tci")


class Pace:
    """Calls of a gate's `step` over time."""

    def __init__(self, robot: str, period: float) -> None:
        """`robot` is its name, for the log; `period` [s] is the time of one step."""
        self._robot, self._period = robot, period
        self._credit, self._before = 1.0, -math.inf
        self._delay: float | None = 0.0  # the latest of a loop that was never on time [periods]

    def went_back(self, now: float) -> float:
        """Time [s] by which the clock went back, if it did by more than a period; else 0. Later calls count
        from `now` [s] on."""
        if not -math.inf < now < self._before - self._period:
            return 0.0
        back, self._before = self._before - now, now - self._period
        return back

    def is_due(self, now: float) -> bool:
        """Returns True if a step is due at `now` [s]: at most one step per period, and never several steps at
        once after a delay."""
        if not math.isfinite(now):
            return False
        if self._before > -math.inf:
            passed = max(0.0, now - self._before) / self._period
            if self._delay is not None:
                self._look_at_rate(passed)
            self._credit = min(self._credit + passed, 1.0 + CATCH_UP)
        self._before = max(self._before, now)
        if self._credit < 1.0 - EARLY:
            return False
        self._credit -= 1.0
        return True

    def _look_at_rate(self, passed: float) -> None:
        """Logs a warning if the control loop runs at a lower rate than the gate's: if two successive calls
        are late by nearly equal times.

        `passed` [periods] is the time since the last call. After the first call on time, no warning is logged
        here any more.
        """
        if passed <= 1.0 + CATCH_UP or self._delay is None:
            self._delay = None
        elif abs(passed - self._delay) <= STEADY * passed:
            self._delay = None
            rate = 1.0 / (passed * self._period)
            _log.warning(
                f"{self._robot}: gate.step is called every {1e3 / rate:.4g} ms and plans for "
                f"{1e3 * self._period:.4g} ms: motions take {passed:.3g} times as long; valid: a step in "
                f"each of driver.ticks(), or connect to 'sim' with rate={rate:.4g}; other drivers have the "
                "rate of their binding in the robot's description"
            )
        else:
            self._delay = passed
