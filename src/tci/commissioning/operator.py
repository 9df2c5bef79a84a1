"""The operator: the person beside a robot under test, who permits motions, watches and touches."""

from __future__ import annotations

from typing import Protocol

from tci.commissioning.expected_motion import ExpectedMotion


class Operator(Protocol):
    """The person beside the robot."""

    def may(self, what: str) -> bool:
        """True if the action is permitted now."""

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        """True if the operator saw the described motion or state; None if it can't be told."""

    def still(self, what: str) -> bool:
        """True if no visible motion happened."""

    def press(self, patch: str, taxel: int, where: str) -> bool:
        """Asks to press a taxel and hold it; False if the operator skips it."""

    def release(self) -> None:
        """Asks to release the taxel."""
