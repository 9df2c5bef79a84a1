"""The operator: the person beside a robot under test, who permits motions, watches and touches."""

from __future__ import annotations

from typing import Protocol

from tci.commissioning.expected_motion import ExpectedMotion


class Operator(Protocol):
    """The person beside the robot, or a program that answers for this person."""

    def may(self, what: str) -> bool:
        """Asks for permission; True if the action `what` is permitted now."""

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        """Asks if the operator saw the described motion or state; None if the operator can't say."""

    def still(self, what: str) -> bool:
        """Asks about a very small motion; True if the operator saw no motion."""

    def press(self, patch: str, taxel: int, where: str) -> bool:
        """Asks the operator to press a taxel and to keep pressing; False if the operator skips this taxel."""

    def release(self) -> None:
        """Asks the operator to release the taxel."""
