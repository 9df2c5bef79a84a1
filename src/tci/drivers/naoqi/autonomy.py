"""What a NAO does by itself: motions that fight with a behaviour, and reflexes of its own.

Nothing here is switched in silence. A driver that may move refuses to while something else moves the same
joints; on request it switches that off and, at its end, on again. The robot's own reflexes stay as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

from tci.drivers.naoqi.session import answer, service
from tci.errors import DriverError

PATIENCE = 5.0
"""Longest time [s] for a switch; the end of autonomous life takes a while. Ours."""
LIFE_OFF = "disabled"
"""The state of autonomous life in which nothing moves by itself (Aldebaran's documentation)."""
LIFE = "ALAutonomousLife"
"""The service of autonomous life."""
EVERY = 1.0
"""Time [s] between two questions whether autonomous life is on. Ours."""
ENABLED = ("ALBackgroundMovement", "ALBasicAwareness")
"""Services beside autonomous life that move the robot while they are enabled."""
REFLEXES = {
    "getSmartStiffnessEnabled": "smart stiffness (lowers stiffness at rest)",
    "getFallManagerEnabled": "the fall manager (lets go when it believes to fall)",
}
"""ALMotion's questions about reflexes of the robot, and what they are."""


@dataclass(frozen=True, slots=True)
class Mover:
    """Something that moves joints by itself, in names: it outlives the session in which it was found."""

    name: str
    """What it is, in words."""
    service: str
    """Whose it is."""
    method: str
    """What switches it."""
    off: tuple[Any, ...]
    """Arguments of `method` that switch it off."""
    on: tuple[Any, ...]
    """Arguments that bring it back to where it was."""

    @property
    def switch(self) -> tuple[str, str, tuple[Any, ...]]:
        """What is the same however far it was on."""
        return self.service, self.method, self.off

    def turn(self, session: Any, arguments: tuple[Any, ...]) -> None:
        """Switch it `off` or `on`. Raises DriverError."""
        method = getattr(service(session, self.service), self.method)
        answer(method(*arguments, _async=True), f"{self.service}.{self.method}", timeout=PATIENCE)


def present(session: Any) -> list[str]:
    """The services that may move the robot by themselves, of those that it has."""
    return [name for name in (LIFE, *ENABLED) if _service(session, name) is not None]


def movers(session: Any, motion: Any, chains: list[str]) -> list[Mover]:
    """What moves joints of the robot's `chains` by itself, now. Services that a robot lacks move nothing."""
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
    """Reflexes of the robot that are on, in words."""
    return [words for question, words in REFLEXES.items() if _ask(motion, question) is True]


def switch_off(session: Any, found: list[Mover]) -> None:
    """Switch movers off; if one fails, those before are on again. Raises DriverError."""
    done: list[Mover] = []
    for mover in found:
        try:
            mover.turn(session, mover.off)
        except DriverError as error:
            left = "".join(f"; {one} stays off" for one in switch_on(session, done))
            raise DriverError(f"{mover.name} can't be switched off: {error}{left}") from error
        done.append(mover)


def switch_on(session: Any, found: list[Mover]) -> list[str]:
    """Bring movers back, the last first; returns those that could not be, with the reason."""
    left = []
    for mover in reversed(found):
        try:
            mover.turn(session, mover.on)
        except DriverError as error:
            left.append(f"{mover.name} ({error})")
    return left


class Lookout:
    """Sees that somebody switches autonomous life on. It asks now and then, and never waits for an answer."""

    def __init__(self, session: Any, *, was_off: bool) -> None:
        """`was_off`: it was off, or not there yet, and is not just ending."""
        self._session, self._was_off = session, was_off
        self._question = getattr(_service(session, LIFE), "getState", None)
        self._answer: Any = None
        self._due = -math.inf

    def look(self, now: float) -> str:
        """At `now` [s], the state that it was switched to; empty otherwise, as long as it is still ending."""
        asked, seen = self._answer, ""
        if asked is not None and asked.isFinished():
            self._answer = None
            told = None if asked.hasError() else asked.value()
            if self._question is None:
                self._question = getattr(told, "getState", None)
            else:
                self._was_off |= told == LIFE_OFF
                seen = str(told) if self._was_off and told not in (None, LIFE_OFF) else ""
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
    """An answer; None from a robot that does not know the question."""
    try:
        return answer(getattr(one, question)(*arguments, _async=True), question, timeout=PATIENCE)
    except (AttributeError, DriverError):
        return None
