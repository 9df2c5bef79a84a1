"""One row of the scoreboard, and the scoreboard in docs/reliability.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from report import ROOT, between, markdown, write_between

PAGE = ROOT / "docs" / "reliability.md"
BEGIN, END = "<!-- scoreboard -->\n", "<!-- end of the scoreboard -->\n"
HEAD = ("figure", "tried", "measured", "target", "met", "at")


@dataclass(frozen=True)
class Row:
    """A measured figure, its target, and the judgement whether the target was met."""

    name: str
    tried: float
    """Number of trials."""
    wanted: float
    """Number of trials that the target requires."""
    unit: str
    """Unit of the trials."""
    figure: str
    """Measured result. For a row that was not measured, the reason."""
    target: str
    sound: bool | None
    """True if all trials meet the target; None if nothing was measured."""
    commit: str = ""
    """Commit at which it was measured."""

    @property
    def size(self) -> str:
        """Number of trials, and number of required trials."""
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
        """`yes` only at the full number of trials; `so far` after fewer trials without a fault."""
        if self.sound is None or not self.tried:
            return "open"
        if not self.sound:
            return "no"
        return "yes" if self.tried >= self.wanted else "so far"

    @property
    def cells(self) -> tuple[str, ...]:
        """Cells of the table, in the order of `HEAD`."""
        at = self.commit if self.tried else ""
        return self.name, self.size, self.measured, self.target, self.met, at

    def to_json(self) -> dict[str, object]:
        """Returns the row as JSON values."""
        return {**asdict(self), "size": self.size, "met": self.met}


def write_page(rows: Sequence[Row], page: Path = PAGE) -> None:
    """Writes the rows that were measured into the page. The other rows of the page do not change."""
    table = between(page, BEGIN, END).splitlines()[2:]
    lines = {cells[0]: cells for cells in (line[2:-2].split(" | ") for line in table)}
    for row in rows:
        if row.tried or row.name not in lines:
            lines[row.name] = [*row.cells]
    write_between(page, BEGIN, END, markdown(HEAD, lines.values()))
