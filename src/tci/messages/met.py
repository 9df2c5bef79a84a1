"""What the gate says of contact: which part met something, and what is done about it."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from typing import Literal, get_args

Answer = Literal["told", "expected", "soft", "retreat", "stop", "waits"]
"""What the gate does about a contact: it only tells it, leaves it to the capability that expected it, gives
way, goes back, or stops the part. A part that "waits" is in no contact, but obeys nobody yet: its own was
over less than half a second ago, or it could press somebody whom another part leaves."""
DOES: dict[Answer, str] = {
    "told": "goes on", "expected": "goes on", "soft": "gives way", "retreat": "goes back", "stop": "stops",
    "waits": "waits",
}  # fmt: skip
ANSWERS: tuple[Answer, ...] = get_args(Answer)


@dataclass(frozen=True, slots=True)
class Met:
    """A part that is in contact now, or that obeys nobody yet."""

    part: str
    """The generic part; its robot's own name for servos of none. Parts that move together, such as an arm and
    its hand, each have a `Met`."""
    force: float
    """Largest force [N] on its skin; 0 where no skin feels it."""
    joint: str | None
    """Servo that does not follow its reference, or that bears more torque than a moment ago; None if none."""
    behind: float
    """Angle [rad] by which it does not follow; 0 if it does."""
    answer: Answer

    def __str__(self) -> str:
        what = ""
        if self.joint is not None and self.behind:
            what = f": {self.joint} is held {degrees(self.behind):.1f} degrees behind"
        elif self.force >= 0.5:
            what = f": {self.force:.0f} N on its skin"
        elif self.joint is not None:
            what = f": {self.joint} bears more than a moment ago"
        return f"{self.part} met something{what}; it {DOES[self.answer]}"
