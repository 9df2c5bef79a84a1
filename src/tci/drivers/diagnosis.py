"""What is found out about a driver: facts, and what to do about them. `tci doctor` prints them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType


class Level(Enum):
    """How bad a finding is."""

    OK = "ok"
    """As it should be."""
    NOTE = "note"
    """Worth knowing; nothing has to be done."""
    WARNING = "warning"
    """It works, but not as well as it could."""
    FAULT = "fault"
    """It can't work like this."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found out."""

    level: Level
    subject: str
    """What it is about: `connection`, `joints`, the name of a patch or of a servo."""
    what: str
    """What was found, in words."""
    advice: str = ""
    """What to do about it; empty when there is nothing to do."""
    figures: Mapping[str, float | str] = field(default_factory=lambda: MappingProxyType({}))
    """The same as numbers, for programs: names end in their unit."""

    def to_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "level": self.level.value,
            "subject": self.subject,
            "what": self.what,
            "advice": self.advice,
            "figures": dict(self.figures),
        }
