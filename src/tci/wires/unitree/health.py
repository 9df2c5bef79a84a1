"""Decides from the states that a robot sends if TCI may command the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tci.errors import DriverError
from tci.messages.frames import Array
from tci.wires.unitree.motors import MOTORS, NAMES, absent

STALE = 0.1
"""Age [s] of the last good state above which TCI sends no new targets. Assumed: shorter and therefore safer
than the vendor's own limit of 1 s. After this time, fifty states at 500 Hz are missing."""
TILT = 1.0
"""Largest tilt [rad] of the pelvis; the vendor's limit."""
SPEED = 10.0
"""Largest speed [rad/s] of a joint; the vendor's limit."""
TURN = 6.0
"""Largest angular speed [rad/s] of the pelvis about each axis; the vendor's limit."""
CASING, WINDING = 85, 120
"""Largest temperatures [C] of a motor's casing and winding; the vendor's limits. Assumed: the motors of
fingers have equal limits."""
L2, B = 1 << 5, 1 << 9
"""Bits of the buttons L2 and B in bytes 2 and 3 of the remote control's data."""


class Health:
    """Checks the states of one robot. After a lasting fault of the robot, a person must connect again."""

    def __init__(self, *, simulation: bool = False) -> None:
        """Prepares the checks. With `simulation`, states without checksum are also accepted."""
        self._simulation = simulation
        self.state: Any = None
        """Latest good state; None before the first good state."""
        self.posture: Array = np.zeros(MOTORS)
        """Latest angles (29,) [rad] of all motors; 0 for motors that this robot lacks."""
        self.wrong = 0
        """Number of states with a wrong checksum."""
        self.lasting = ""
        """Reason of a fault after which a person must connect again. The text is empty if no such fault
        occurred."""
        self._heard = -np.inf
        self._there, self._names = np.arange(MOTORS), NAMES

    def see(self, state: Any, right: bool, now: float) -> bool:
        """Checks a state that arrived at `now` [s], and stores a usable state. Returns True if the state is
        usable. `right` is True if the state's checksum is right.
        """
        if not right and not (self._simulation and state["crc"] == 0):
            self.wrong += 1
            return False
        before, self.state, self._heard = self.state, state, now
        angles = state["motor"]["q"][:MOTORS]
        self.posture = np.where(np.isfinite(angles), angles, self.posture)
        if before is None or before["mode_machine"] != state["mode_machine"]:
            if before is not None:
                changed = f"from {before['mode_machine']} to {state['mode_machine']}"
                self.lasting = self.lasting or f"mode_machine has changed {changed}"
            try:
                gone = absent(int(state["mode_machine"]), simulation=self._simulation)
                self._there = np.setdiff1d(np.arange(MOTORS), gone)
                self._names = tuple(NAMES[motor] for motor in self._there)
            except DriverError as error:
                self.lasting = self.lasting or str(error)
        self.lasting = self.lasting or self._fault(state)
        return True

    def age(self, now: float) -> float:
        """Returns the age [s] of the latest good state at `now` [s]."""
        return now - self._heard

    def passing(self, now: float) -> str:
        """Returns the reason to send no commands at `now` [s]: the latest usable state is older than 0.1 s,
        or there is none yet. The text is empty if commands may be sent."""
        if self.state is None:
            wrong = f" ({self.wrong} with a wrong checksum)" if self.wrong else ""
            return f"no usable state from the robot{wrong}"
        age = self.age(now)
        return f"the robot's last state is {age * 1e3:.0f} ms old" if age > STALE else ""

    def _fault(self, state: Any) -> str:
        keys = int(state["remote"][2]) | int(state["remote"][3]) << 8
        if keys & L2 and keys & B:
            return "L2+B on the remote"
        motors = state["motor"][self._there]
        if found := motor_fault(motors, self._names):
            return found
        if np.any(bad := np.abs(motors["dq"]) > SPEED):
            return _named(self._names, bad, f"is faster than {SPEED:g} rad/s:", motors["dq"])
        _, x, y, _ = state["quaternion"].tolist()
        if not (tilt := np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))) <= TILT:
            return f"the pelvis is tilted by {tilt:.2f} rad; valid: at most {TILT:g}"
        if not np.all(np.abs(state["gyroscope"]) <= TURN):
            return (
                f"the pelvis turns at {np.abs(state['gyroscope']).max():.1f} rad/s; valid: at most {TURN:g}"
            )
        return ""


def motor_fault(motors: Any, names: Sequence[str]) -> str:
    """Returns the name and the fault of the first motor with a fault. The text is empty if no motor has a
    fault.

    `motors` (k,) are the states of the motors, as records MOTOR_STATE.
    """
    if np.any(bad := motors["motorstate"] != 0):
        return _named(names, bad, "reports the error", motors["motorstate"])
    if not np.all(good := np.isfinite(motors["q"]) & np.isfinite(motors["dq"])):
        return _named(names, ~good, "reports the angle", motors["q"])
    for place, (what, most) in enumerate((("casing", CASING), ("winding", WINDING))):
        heat = motors["temperature"][:, place]
        if np.any(bad := heat > most):
            return _named(names, bad, f"has a {what} above {most} C:", heat)
    return ""


def _named(names: Sequence[str], bad: Any, what: str, values: Any) -> str:
    first = int(np.argmax(bad))
    return f"{names[first]} {what} {values[first]:g}"
