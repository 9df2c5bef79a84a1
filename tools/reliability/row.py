"""One row of the scoreboard."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Row:
    """A figure, its target, and whether it was met."""

    name: str
    tried: float
    """Number of trials."""
    wanted: float
    """Number of trials that the target requires."""
    unit: str
    """Unit of the trials."""
    figure: str
    """Measured result; for an open row the reason why there is none."""
    target: str
    sound: bool | None
    """True if all trials meet the target; None if nothing was measured."""
    commit: str = ""
    """Commit at which it was measured."""

    @property
    def size(self) -> str:
        """Number of trials, and of the required ones."""
        if self.sound is None:
            return ""
        if self.tried >= self.wanted:
            return f"{self.tried:.9g} {self.unit}"
        return f"{self.tried:.9g} of {self.wanted:.9g} {self.unit}"

    @property
    def measured(self) -> str:
        """Measured result; empty for a row that was not run."""
        return self.figure if self.tried or self.sound is None else "not run"

    @property
    def met(self) -> str:
        """`yes` only at the full size of the target; `so far` after fewer trials without a fault."""
        if self.sound is None or not self.tried:
            return "open"
        if not self.sound:
            return "no"
        return "yes" if self.tried >= self.wanted else "so far"

    def to_json(self) -> dict[str, object]:
        """Returns the row as JSON values."""
        return {**asdict(self), "size": self.size, "met": self.met}
