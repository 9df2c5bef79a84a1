"""Continuous motion with ALMotion: new target angles in each period.

ALMotion comes to rest at each target unless the next one arrives earlier (libqi issue 29). Therefore the
target of a moving servo is its planned position two of ALMotion's periods later, with a speed that does not
reach it earlier. The last target is the position at which the servo stops. If the stream is interrupted, the
robot stops at the latest target.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from tci.drivers.naoqi.words import CYCLE
from tci.frames import Array
from tci.gate.gate import SafeCommand

AHEAD = 2.0 * CYCLE
"""Time [s] ahead of its reference for which a servo's position is sent, on the path that the gate has
planned. Assumed: two of ALMotion's periods."""
CATCH_UP = 0.05
"""Time [s] in which a servo reaches its target at the sent speed, from its measured position or from the
previous target, whichever is farther. Assumed: a little more than AHEAD, so that the servo neither arrives
before the next target nor lags far behind."""
LEAST = 0.02
"""Smallest fraction of the top speed that is sent, since at zero a servo would never arrive. Assumed: a
larger fraction makes slow motions jerky."""
EVERY = 0.01
"""Shortest time [s] between two targets of a moving servo: NAO's device cycle."""
SAME = 1e-5
"""Distance [rad] below which two targets count as equal."""


class Stream:
    """The targets sent to each servo, and the rule for the next ones."""

    def __init__(self, names: list[str], lower: Array, upper: Array, fastest: Array) -> None:
        """Takes for each servo (n,) its name, limits [rad] and top speed [rad/s], as the robot gives them."""
        self._names, self.lower, self.upper, self.fastest = names, lower, upper, fastest
        self.errors: Counter[str] = Counter()
        """Errors that the robot returned for targets it refused, with their counts."""
        self.forget()

    def forget(self) -> None:
        """Makes `send` send all targets anew."""
        count = len(self._names)
        self._target = np.full(count, np.nan)
        self._share = np.zeros(count)
        self._sent = np.full(count, -np.inf)
        self._running: dict[int, Any] = {}

    def send(self, motion: Any, safe: SafeCommand, ahead: Array, measured: Array) -> None:
        """Sends the targets of the servos (k,) of a command.

        `ahead` (k,) [rad] are their positions AHEAD later, `measured` (n,) [rad] the positions of all servos.
        """
        servos, now = safe.servos, safe.stamp
        target = np.clip(ahead, self.lower[servos], self.upper[servos])
        # At a reversal the robot's own reference may still be on its way to the previous target.
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
        for speed_share, places in sorted(alike.items(), reverse=True):  # the largest motions first
            chosen = servos[places].tolist()
            self._target[chosen], self._share[chosen] = target[places], speed_share
            self._sent[chosen] = now
            names = [self._names[servo] for servo in chosen]
            call = motion.setAngles(names, target[places].tolist(), speed_share, _async=True)
            self._running |= dict.fromkeys(chosen, call)

    def _free(self, servo: int) -> bool:
        """Returns True if the robot has accepted the previous target. Otherwise the new target waits, and
        only the latest one is sent."""
        running = self._running.get(servo)
        if running is None:
            return True
        if not running.isFinished():
            return False
        if running.hasError():
            self.errors[f"setAngles of {self._names[servo]}: {running.error().splitlines()[0][:120]}"] += 1
        del self._running[servo]
        return True
