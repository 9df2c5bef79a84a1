"""Findings about a driver, with advice. The command `tci doctor` prints them."""

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
    """The driver can't work until the cause is removed."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of a diagnosis."""

    level: Level
    subject: str
    """Subject of the finding, for example `connection`, `joints`, or the name of a patch or servo."""
    what: str
    """Text of the finding."""
    advice: str = ""
    """Recommended action; empty if none is needed."""
    figures: Mapping[str, float | str] = field(default_factory=lambda: MappingProxyType({}))
    """Values of the finding by name, for programs. If a value has a unit, its name ends in the unit, as in
    `offset_s`."""

    def to_json(self) -> dict[str, object]:
        """Returns the finding as a dictionary that can be written as JSON."""
        return {
            "level": self.level.value,
            "subject": self.subject,
            "what": self.what,
            "advice": self.advice,
            "figures": dict(self.figures),
        }
