"""One row of the scoreboard."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Row:
    """A figure, its target, and whether it was met."""

    name: str
    tried: float
    """How much was tried."""
    wanted: float
    """How much the target asks for."""
    unit: str
    """What is counted."""
    figure: str
    """What was measured; why there is nothing, for an open row."""
    target: str
    sound: bool | None
    """Whether all that was tried is as the target wants it; None: nothing was measured."""
    commit: str = ""
    """Of what it was measured."""

    @property
    def size(self) -> str:
        """How much was tried, of how much."""
        if self.sound is None:
            return ""
        if self.tried >= self.wanted:
            return f"{self.tried:.9g} {self.unit}"
        return f"{self.tried:.9g} of {self.wanted:.9g} {self.unit}"

    @property
    def measured(self) -> str:
        """What was measured; nothing of what was not run."""
        return self.figure if self.tried or self.sound is None else "not run"

    @property
    def met(self) -> str:
        """`yes` only at the whole size of the target; `so far` where less was tried and nothing was wrong."""
        if self.sound is None or not self.tried:
            return "open"
        if not self.sound:
            return "no"
        return "yes" if self.tried >= self.wanted else "so far"

    def to_json(self) -> dict[str, object]:
        """All of it."""
        return {**asdict(self), "size": self.size, "met": self.met}
