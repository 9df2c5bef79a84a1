"""Who stands beside a robot while it is checked: permits, looks and touches."""

from __future__ import annotations

from typing import Protocol

from tci.commissioning.expected_motion import ExpectedMotion


class Operator(Protocol):
    """Who stands beside the robot."""

    def may(self, what: str) -> bool:
        """Whether that may be done now."""

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        """Whether that is what happened, or what is; None when it can't be told."""

    def still(self, what: str) -> bool:
        """Whether nothing moved that could be seen."""

    def press(self, patch: str, taxel: int, where: str) -> bool:
        """Asked to press a taxel and hold it; False: not this one."""

    def release(self) -> None:
        """Asked to let go."""
