"""Finds and switches autonomous motions of a NAO, which disturb the motions of a behaviour.

An armed driver refuses to connect while an autonomous motion moves the joints. If the address contains
`?life=off`, the driver switches these motions off, and switches these motions on again when the driver is
closed. Without this option, the driver switches no motion on or off. The driver does not change the robot's
own reflexes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

from tci.errors import DriverError
from tci.wires.naoqi.session import answer, service

PATIENCE = 5.0
"""Longest time [s] for switching a motion on or off. Assumed: ending autonomous life takes a few seconds."""
LIFE_OFF = "disabled"
"""State of autonomous life in which the robot moves no joints by itself (Aldebaran's documentation)."""
LIFE = "ALAutonomousLife"
"""NAOqi's name of its service for autonomous life."""
EVERY = 1.0
"""Time [s] between two queries of the state of autonomous life. Assumed: a person switches autonomous life on
or off, so a delay of a second is acceptable."""
ENABLED = ("ALBackgroundMovement", "ALBasicAwareness")
"""Services other than autonomous life that move the robot while they are enabled."""
REFLEXES = {
    "getSmartStiffnessEnabled": "smart stiffness (lowers stiffness at rest)",
    "getFallManagerEnabled": "the fall manager (lets go when it believes to fall)",
}
"""Methods of ALMotion that return True if a reflex of the robot is on, each with a description of this
reflex."""


@dataclass(frozen=True, slots=True)
class Mover:
    """An autonomous motion. The object contains only names, so a driver can use the object also in a later
    session."""

    name: str
    """Description of the motion, for messages to the user."""
    service: str
    """Service with the method that switches the motion."""
    method: str
    """Method that switches the motion on and off."""
    off: tuple[Any, ...]
    """Arguments of `method` that switch the motion off."""
    on: tuple[Any, ...]
    """Arguments of `method` that restore the motion's former state."""

    @property
    def switch(self) -> tuple[str, str, tuple[Any, ...]]:
        """Key that identifies this motion. The key does not depend on the motion's former state."""
        return self.service, self.method, self.off

    def turn(self, session: Any, arguments: tuple[Any, ...]) -> None:
        """Switches the motion off if `arguments` is the attribute `off`, and on if it is the attribute `on`.
        Raises DriverError if the call fails."""
        method = getattr(service(session, self.service), self.method)
        answer(method(*arguments, _async=True), f"{self.service}.{self.method}", timeout=PATIENCE)


def present(session: Any) -> list[str]:
    """Returns the services of this robot that can start autonomous motions."""
    return [name for name in (LIFE, *ENABLED) if _service(session, name) is not None]


def movers(session: Any, motion: Any, chains: list[str]) -> list[Mover]:
    """Returns the autonomous motions that are on now, for the whole robot or for one of its `chains` (groups
    of joints). Services that the robot lacks are skipped."""
    found = []
    state = _ask(_service(session, LIFE), "getState")
    if isinstance(state, str) and state != LIFE_OFF:
        words = f"autonomous life ({state})"
        found.append(Mover(words, LIFE, "setState", (LIFE_OFF,), (state,)))
    for name in ENABLED:
        if _ask(_service(session, name), "isEnabled") is True:
            found.append(Mover(name, name, "setEnabled", (False,), (True,)))
    for what in ("Breath", "IdlePosture"):
        for chain in chains:
            if _ask(motion, f"get{what}Enabled", chain) is True:
                switch, words = f"set{what}Enabled", f"{what} of {chain}"
                found.append(Mover(words, "ALMotion", switch, (chain, False), (chain, True)))
    return found


def reflexes(motion: Any) -> list[str]:
    """Returns descriptions of the robot's reflexes that are on."""
    return [words for question, words in REFLEXES.items() if _ask(motion, question) is True]


def switch_off(session: Any, found: list[Mover]) -> None:
    """Switches autonomous motions off. If one of them can't be switched off, switches the others on again and
    raises DriverError."""
    done: list[Mover] = []
    for mover in found:
        try:
            mover.turn(session, mover.off)
        except DriverError as error:
            left = "".join(f"; {one} stays off" for one in switch_on(session, done))
            raise DriverError(f"{mover.name} can't be switched off: {error}{left}") from error
        done.append(mover)


def switch_on(session: Any, found: list[Mover]) -> list[str]:
    """Switches autonomous motions on again, in reverse order. Returns the name of each motion that could not
    be switched on, with the reason."""
    left = []
    for mover in reversed(found):
        try:
            mover.turn(session, mover.on)
        except DriverError as error:
            left.append(f"{mover.name} ({error})")
    return left


class Lookout:
    """Detects that a person or another program switches autonomous life on. Queries the state in the
    background, at most once a second."""

    def __init__(self, session: Any, *, was_off: bool) -> None:
        """Prepares the queries of the state of autonomous life. `was_off` is True if autonomous life was off
        or not started, and False if autonomous life was on and may still be ending."""
        self._session, self._was_off = session, was_off
        self._question = getattr(_service(session, LIFE), "getState", None)
        self._answer: Any = None
        self._due = -math.inf

    def look(self, now: float) -> str:
        """Returns the present state of autonomous life if a person or program has switched it on. Returns an
        empty text if autonomous life is off or still ending. `now` [s] is the present time."""
        asked, seen = self._answer, ""
        if asked is not None and asked.isFinished():
            self._answer = None
            state = None if asked.hasError() else asked.value()
            if self._question is None:
                self._question = getattr(state, "getState", None)
            else:
                self._was_off |= state == LIFE_OFF
                seen = str(state) if self._was_off and state not in (None, LIFE_OFF) else ""
        if self._answer is None and now >= self._due:
            ask = self._question or partial(self._session.service, LIFE)
            self._answer, self._due = ask(_async=True), now + EVERY
        return seen


def _service(session: Any, name: str) -> Any:
    try:
        return answer(session.service(name, _async=True), name, timeout=PATIENCE)
    except DriverError:
        return None


def _ask(one: Any, question: str, *arguments: Any) -> Any:
    """Calls the method `question` of the service `one` of the robot and returns the result; None if the
    service lacks the method or the call fails."""
    try:
        return answer(getattr(one, question)(*arguments, _async=True), question, timeout=PATIENCE)
    except (AttributeError, DriverError):
        return None
