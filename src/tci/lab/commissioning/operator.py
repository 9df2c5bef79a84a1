"""Interface to the operator, the person beside the tested robot who permits motions, watches the robot and
touches the skin."""

from __future__ import annotations

from typing import Protocol

from tci.lab.commissioning.expected_motion import ExpectedMotion


class Operator(Protocol):
    """Interface to the person beside the robot, or to a program that answers in place of this person."""

    def may(self, what: str) -> bool:
        """Asks for permission. Returns True if the action `what` is permitted now."""

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        """Asks if the operator saw the described motion or state. Returns None if the operator can't answer
        the question."""

    def still(self, what: str) -> bool:
        """Asks if anything moved visibly after a command for a motion too small to see. `what` describes this
        command. Returns True if the operator saw no motion."""

    def press(self, patch: str, taxel: int, where: str) -> bool:
        """Asks the operator to press a taxel and to keep pressing. Returns False if the operator skips this
        taxel."""

    def release(self) -> None:
        """Asks the operator to release the taxel."""
