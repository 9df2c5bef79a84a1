"""One row of the scoreboard."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A figure, its target, and whether it was met at this size."""

    name: str
    size: str
    """How much was tried."""
    figure: str
    """What was measured; why there is nothing, for an open row."""
    target: str
    met: bool | None
    """None: not measured, since a part is missing."""
