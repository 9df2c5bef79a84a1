"""Findings about a driver, with advice. The command `tci doctor` prints findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType


class Level(Enum):
    """Severity of a finding."""

    OK = "ok"
    """The checked property is correct."""
    NOTE = "note"
    """The finding is information and requires no action."""
    WARNING = "warning"
    """The driver works, but a change would improve the data or the motion."""
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
    """Numerical values of the finding by name, for programs. The name of a value with a unit ends in the
    unit, for example `offset_s`."""

    def to_json(self) -> dict[str, object]:
        """Returns the finding as a dictionary that can be written as JSON."""
        return {
            "level": self.level.value,
            "subject": self.subject,
            "what": self.what,
            "advice": self.advice,
            "figures": dict(self.figures),
        }
