"""The scoreboard in docs/reliability.md, between two marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from row import Row

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
BEGIN, END = "<!-- scoreboard -->\n", "<!-- end of the scoreboard -->\n"


def write_page(rows: Sequence[Row]) -> None:
    """Put the rows into the page, in the place of what is there."""
    lines = ["| figure | tried | measured | target | met | at |", "|---|---|---|---|---|---|"]
    for row in rows:
        cells = (row.name, row.size, row.measured, row.target, row.met, row.commit if row.tried else "")
        lines.append(f"| {' | '.join(cells)} |")
    before, rest = PAGE.read_text().split(BEGIN)
    PAGE.write_text(before + BEGIN + "\n".join(lines) + "\n" + END + rest.split(END)[1])
