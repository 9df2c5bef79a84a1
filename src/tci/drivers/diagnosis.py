"""Findings about a driver, with advice. `tci doctor` prints them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType


class Level(Enum):
    """Severity of a finding."""

    OK = "ok"
    """The checked property is as it should be."""
    NOTE = "note"
    """The finding needs no action."""
    WARNING = "warning"
    """The driver works, but not as well as it could."""
    FAULT = "fault"
    """The driver can't work like this."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of a diagnosis."""

    level: Level
    subject: str
    """Subject of the finding: `connection`, `joints`, the name of a patch or of a servo."""
    what: str
    """Text of the finding."""
    advice: str = ""
    """Recommended action; empty if none is needed."""
    figures: Mapping[str, float | str] = field(default_factory=lambda: MappingProxyType({}))
    """The finding as numbers, for programs: names end in their unit."""

    def to_json(self) -> dict[str, object]:
        """Returns the finding as plain values."""
        return {
            "level": self.level.value,
            "subject": self.subject,
            "what": self.what,
            "advice": self.advice,
            "figures": dict(self.figures),
        }
