"""The scoreboard in docs/reliability.md, between two marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from row import Row

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
BEGIN, END = "<!-- scoreboard -->\n", "<!-- end of the scoreboard -->\n"
HEAD = "| figure | tried | measured | target | met | at |\n|---|---|---|---|---|---|\n"


def write_page(rows: Sequence[Row], page: Path = PAGE) -> None:
    """Put the rows that were tried into the page; the others stay as they are there."""
    before, rest = page.read_text().split(BEGIN)
    table, after = rest.split(END)
    lines = {_figure(line): line for line in table.removeprefix(HEAD).splitlines()}
    for row in rows:
        cells = (row.name, row.size, row.measured, row.target, row.met, row.commit if row.tried else "")
        if row.tried or row.name not in lines:
            lines[row.name] = f"| {' | '.join(cells)} |"
    page.write_text(before + BEGIN + HEAD + "".join(f"{line}\n" for line in lines.values()) + END + after)


def _figure(line: str) -> str:
    return line.split(" | ")[0].removeprefix("| ")
