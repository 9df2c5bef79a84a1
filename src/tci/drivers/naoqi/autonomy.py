"""Autonomous motions and reflexes of a NAO, which interfere with a behaviour.

An armed driver refuses to connect while an autonomous motion moves the joints. On request it switches these
motions off, and on again when it is closed; nothing is switched without a request. The robot's own reflexes
are not changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

from tci.drivers.naoqi.session import answer, service
from tci.errors import DriverError

PATIENCE = 5.0
"""Longest time [s] for a switch. Assumed: ending autonomous life takes a few seconds."""
LIFE_OFF = "disabled"
"""State of autonomous life in which nothing moves by itself (Aldebaran's documentation)."""
LIFE = "ALAutonomousLife"
"""Name of the service of autonomous life."""
EVERY = 1.0
"""Time [s] between two queries of the state of autonomous life. Assumed: a person switches it, so a second is
soon enough."""
ENABLED = ("ALBackgroundMovement", "ALBasicAwareness")
"""Services other than autonomous life that move the robot while they are enabled."""
REFLEXES = {
    "getSmartStiffnessEnabled": "smart stiffness (lowers stiffness at rest)",
    "getFallManagerEnabled": "the fall manager (lets go when it believes to fall)",
}
"""Methods of ALMotion that return if a reflex is on, each with a description of the reflex."""


@dataclass(frozen=True, slots=True)
class Mover:
    """An autonomous motion. The object contains only names, so it stays valid after its session has ended."""

    name: str
    """Description for messages."""
    service: str
    """Service with the methods that switch it."""
    method: str
    """Method that switches it."""
    off: tuple[Any, ...]
    """Arguments of `method` that switch it off."""
    on: tuple[Any, ...]
    """Arguments of `method` that restore its former state."""

    @property
    def switch(self) -> tuple[str, str, tuple[Any, ...]]:
        """Key of this motion, equal for every state in which the motion was on."""
        return self.service, self.method, self.off

    def turn(self, session: Any, arguments: tuple[Any, ...]) -> None:
        """Switches it with the arguments `off` or `on`. Raises DriverError."""
        method = getattr(service(session, self.service), self.method)
        answer(method(*arguments, _async=True), f"{self.service}.{self.method}", timeout=PATIENCE)


def present(session: Any) -> list[str]:
    """Returns the services that may move the robot by themselves, of those that it has."""
    return [name for name in (LIFE, *ENABLED) if _service(session, name) is not None]


def movers(session: Any, motion: Any, chains: list[str]) -> list[Mover]:
    """Returns the autonomous motions that now move joints of the robot's `chains`. Services that a robot
    lacks are skipped."""
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
    """Switches movers off; if one fails, switches the earlier ones on again. Raises DriverError."""
    done: list[Mover] = []
    for mover in found:
        try:
            mover.turn(session, mover.off)
        except DriverError as error:
            left = "".join(f"; {one} stays off" for one in switch_on(session, done))
            raise DriverError(f"{mover.name} can't be switched off: {error}{left}") from error
        done.append(mover)


def switch_on(session: Any, found: list[Mover]) -> list[str]:
    """Restores movers, the last first; returns those that failed, with the reason."""
    left = []
    for mover in reversed(found):
        try:
            mover.turn(session, mover.on)
        except DriverError as error:
            left.append(f"{mover.name} ({error})")
    return left


class Lookout:
    """Detects that a person or another program switches autonomous life on. It queries from time to time and
    never blocks."""

    def __init__(self, session: Any, *, was_off: bool) -> None:
        """Takes `was_off`, which is True if autonomous life was off or not started, and not about to end."""
        self._session, self._was_off = session, was_off
        self._question = getattr(_service(session, LIFE), "getState", None)
        self._answer: Any = None
        self._due = -math.inf

    def look(self, now: float) -> str:
        """Returns the state that it was switched to, at `now` [s]; empty otherwise, and while it is still
        ending."""
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
    """Returns an answer; None from a robot that does not have the method."""
    try:
        return answer(getattr(one, question)(*arguments, _async=True), question, timeout=PATIENCE)
    except (AttributeError, DriverError):
        return None
