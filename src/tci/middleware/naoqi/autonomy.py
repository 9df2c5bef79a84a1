"""What a NAO does by itself: motions that fight with a behaviour, and reflexes of its own.

Nothing here is switched in silence. A link that may move refuses to while something else moves the same
joints; on request it switches that off and, at its end, on again. The robot's own reflexes stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tci.errors import LinkError
from tci.middleware.naoqi.session import answer

PATIENCE = 5.0
"""Longest time [s] for a switch; the end of autonomous life takes a while. Ours."""
LIFE_OFF = "disabled"
"""The state of autonomous life in which nothing moves by itself (Aldebaran's documentation)."""
REFLEXES = {
    "getSmartStiffnessEnabled": "smart stiffness (lowers stiffness at rest)",
    "getFallManagerEnabled": "the fall manager (lets go when it believes to fall)",
}
"""ALMotion's questions about reflexes of the robot, and what they are."""


@dataclass(frozen=True, slots=True)
class Mover:
    """Something that moves joints by itself."""

    name: str
    """What it is, in words."""
    off: Callable[[], None]
    """Switches it off."""
    on: Callable[[], None]
    """Brings it back to where it was."""


def movers(session: Any, motion: Any, chains: list[str]) -> list[Mover]:
    """What moves joints of the robot's `chains` by itself, now. Services that a robot lacks move nothing."""
    found = []
    life = _service(session, "ALAutonomousLife")
    state = _ask(life, "getState")
    if life is not None and isinstance(state, str) and state != LIFE_OFF:
        found.append(Mover(f"autonomous life ({state})", _call(life, "setState", LIFE_OFF),
                           _call(life, "setState", state)))  # fmt: skip
    for name in ("ALBackgroundMovement", "ALBasicAwareness"):
        one = _service(session, name)
        if one is not None and _ask(one, "isEnabled") is True:
            found.append(Mover(name, _call(one, "setEnabled", False), _call(one, "setEnabled", True)))
    for what in ("Breath", "IdlePosture"):
        for chain in chains:
            if _ask(motion, f"get{what}Enabled", chain) is True:
                switch = f"set{what}Enabled"
                found.append(Mover(f"{what} of {chain}", _call(motion, switch, chain, False),
                                   _call(motion, switch, chain, True)))  # fmt: skip
    return found


def reflexes(motion: Any) -> list[str]:
    """Reflexes of the robot that are on, in words."""
    return [words for question, words in REFLEXES.items() if _ask(motion, question) is True]


def switch_off(found: list[Mover]) -> None:
    """Switch movers off; if one fails, those before are on again. Raises LinkError."""
    done: list[Mover] = []
    for mover in found:
        try:
            mover.off()
        except LinkError as error:
            switch_on(done)
            raise LinkError(f"{mover.name} can't be switched off: {error}") from error
        done.append(mover)


def switch_on(found: list[Mover]) -> None:
    """Bring movers back, the last first, as far as the robot still answers."""
    for mover in reversed(found):
        with suppress(LinkError):
            mover.on()


def _service(session: Any, name: str) -> Any:
    try:
        return session.service(name)
    except RuntimeError:
        return None


def _ask(service: Any, question: str, *arguments: Any) -> Any:
    """An answer; None from a robot that does not know the question."""
    try:
        return answer(getattr(service, question)(*arguments, _async=True), question, timeout=PATIENCE)
    except (AttributeError, LinkError):
        return None


def _call(service: Any, name: str, *arguments: Any) -> Callable[[], None]:
    def call() -> None:
        answer(getattr(service, name)(*arguments, _async=True), name, timeout=PATIENCE)

    return call
