"""Commands continuous motions to ALMotion by new target angles in each period.

ALMotion comes to rest at each target unless the next target arrives earlier (libqi issue 29). Therefore a
moving servo gets as target the position that is planned for two periods of ALMotion later. The sent speed is
so low that the servo does not reach this target before that time. The last target of a motion is the position
at which the servo stops. If the stream is interrupted, the robot stops at the latest target. A servo that
leaves a contact gets the end of its way at once: ALMotion takes it there also if the connection is lost next.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from tci.gate import WayBack
from tci.gate.gate import SafeCommand
from tci.messages.frames import Array
from tci.wires.naoqi.words import CYCLE

AHEAD = 2.0 * CYCLE
"""Lead time [s] of targets: each target is the position that the gate has planned for the present time plus
AHEAD. Assumed: within two periods of ALMotion the next target arrives, so that ALMotion does not come to
rest."""
CATCH_UP = 0.05
"""Time [s] in which a servo reaches its target at the sent speed. The distance to the target is counted from
the measured position or from the previous target, whichever is farther from the new target. Assumed: a little
more than the lead time of the targets, so that the servo neither arrives before the next target nor lags far
behind."""
LEAST = 0.02
"""Smallest fraction of the top speed that is sent. At speed zero, a servo would never arrive. Assumed: a
larger fraction makes slow motions jerky."""
EVERY = 0.01
"""Shortest time [s] between two targets of a moving servo. This is the cycle time of NAO's devices."""
SAME = 1e-5
"""Distance [rad] below which two targets count as equal."""

NOBODY: Mapping[int, WayBack] = MappingProxyType({})


class Stream:
    """Stores the targets sent to each servo, and decides which targets are sent next."""

    def __init__(self, names: list[str], lower: Array, upper: Array, fastest: Array) -> None:
        """Stores the joint names (n,), lower and upper limits (n,) [rad] and top speeds (n,) [rad/s] that the
        robot reports."""
        self._names, self.lower, self.upper, self.fastest = names, lower, upper, fastest
        self.errors: Counter[str] = Counter()
        """Errors with which the robot refused targets, each with its count."""
        self.forget()

    def forget(self) -> None:
        """Deletes the stored targets, so that `send` sends all targets anew."""
        count = len(self._names)
        self._target = np.full(count, np.nan)
        self._share = np.zeros(count)
        self._sent = np.full(count, -np.inf)
        self._running: dict[int, Any] = {}

    def send(
        self,
        motion: Any,
        safe: SafeCommand,
        ahead: Array,
        measured: Array,
        ways_back: Mapping[int, WayBack] = NOBODY,
    ) -> None:
        """Sends targets to the servos (k,) of a command. A target that has not changed is not sent again.

        `ahead` (k,) [rad] are the positions that the gate has planned for these servos, two periods of
        ALMotion ahead. `measured` (n,) [rad] are the measured positions of all servos. `ways_back` are the
        whole ways of servos that leave contacts.
        """
        servos, now = safe.servos, safe.stamp
        back = {place: ways_back[servo] for place, servo in enumerate(servos.tolist()) if servo in ways_back}
        ahead, whole = ahead.copy(), list(back)
        ahead[whole] = [way.end for way in back.values()]
        target = np.clip(ahead, self.lower[servos], self.upper[servos])
        # When a motion reverses, the robot's own reference may still move towards the previous target.
        way = np.fmax(np.abs(target - measured[servos]), np.abs(target - self._target[servos]))
        speed = way / CATCH_UP
        speed[whole] = [way_back.speed for way_back in back.values()]
        share = np.clip(speed / self.fastest[servos], LEAST, 1.0)
        known = np.abs(target - self._target[servos]) < SAME
        slower = share <= self._share[servos]
        slower[whole] = True
        known &= slower
        moving = self._share[servos] > LEAST
        moving[whole] = False  # whom it presses waits for no period of ALMotion
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
        """Returns True if a new target may be sent, because the robot has answered the call with the previous
        target."""
        running = self._running.get(servo)
        if running is None:
            return True
        if not running.isFinished():
            return False
        if running.hasError():
            self.errors[f"setAngles of {self._names[servo]}: {running.error().splitlines()[0][:120]}"] += 1
        del self._running[servo]
        return True
