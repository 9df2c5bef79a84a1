"""Angles to ALMotion, one period after the other, without stutter.

ALMotion comes to rest at each target unless the next one is there before (libqi issue 29). So a moving servo
is sent where it will be two of ALMotion's own periods later, at the speed that does not take it there before;
the last target is the place where it stops. If the stream breaks, the robot goes no further than that.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from tci.drivers.naoqi.words import CYCLE
from tci.frames import Array
from tci.gate.gate import SafeCommand

AHEAD = 2.0 * CYCLE
"""How far ahead [s] of its reference a servo is sent, on the way that the gate has planned. Ours."""
CATCH_UP = 0.05
"""A servo gets the speed that takes it to its target in this time [s], from where it was measured or from the
target before, whatever is farther: a little more than AHEAD, so that it is neither there before the next
target comes, nor far behind. Ours."""
LEAST = 0.02
"""Smallest share of the top speed that is sent: with none it would never arrive. Ours."""
EVERY = 0.01
"""Shortest time [s] between two targets of a servo that moves: NAO's device cycle."""
SAME = 1e-5
"""Targets closer [rad] than this are the same."""


class Stream:
    """What was sent to each servo, and what is to be sent next."""

    def __init__(self, names: list[str], lower: Array, upper: Array, fastest: Array) -> None:
        """Of each servo (n,): its name, limits [rad] and top speed [rad/s], as the robot says them."""
        self._names, self.lower, self.upper, self.fastest = names, lower, upper, fastest
        self.errors: Counter[str] = Counter()
        """What the robot answered to targets that it did not take."""
        self.forget()

    def forget(self) -> None:
        """All servos are sent their targets anew."""
        count = len(self._names)
        self._target = np.full(count, np.nan)
        self._share = np.zeros(count)
        self._sent = np.full(count, -np.inf)
        self._running: dict[int, Any] = {}

    def send(self, motion: Any, safe: SafeCommand, ahead: Array, measured: Array) -> None:
        """Send the servos (k,) of a command on their way.

        `ahead` (k,) [rad] is where they will be AHEAD later, `measured` (n,) [rad] where all servos are.
        """
        servos, now = safe.servos, safe.stamp
        target = np.clip(ahead, self.lower[servos], self.upper[servos])
        # Where it turns, the robot's own reference may still be on its way to the target before.
        way = np.fmax(np.abs(target - measured[servos]), np.abs(target - self._target[servos]))
        speed = way / CATCH_UP
        share = np.clip(speed / self.fastest[servos], LEAST, 1.0)
        known = np.abs(target - self._target[servos]) < SAME
        known &= share <= self._share[servos]
        moving = self._share[servos] > LEAST
        due = ~known & (~moving | (now - self._sent[servos] >= EVERY - 1e-4))
        alike: dict[float, list[int]] = {}
        for place in np.flatnonzero(due).tolist():
            if self._free(int(servos[place])):
                alike.setdefault(float(share[place]), []).append(place)
        for speed_share, places in sorted(alike.items(), reverse=True):  # what moves most goes first
            chosen = servos[places].tolist()
            self._target[chosen], self._share[chosen] = target[places], speed_share
            self._sent[chosen] = now
            names = [self._names[servo] for servo in chosen]
            call = motion.setAngles(names, target[places].tolist(), speed_share, _async=True)
            self._running |= dict.fromkeys(chosen, call)

    def _free(self, servo: int) -> bool:
        """Whether the robot has taken the target before; if not, this one waits: only the latest counts."""
        running = self._running.get(servo)
        if running is None:
            return True
        if not running.isFinished():
            return False
        if running.hasError():
            self.errors[f"setAngles of {self._names[servo]}: {running.error().splitlines()[0][:120]}"] += 1
        del self._running[servo]
        return True
