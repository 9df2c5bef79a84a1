"""Writer of the scoreboard in docs/reliability.md, between two marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from row import Row

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
BEGIN, END = "<!-- scoreboard -->\n", "<!-- end of the scoreboard -->\n"
HEAD = "| figure | tried | measured | target | met | at |\n|---|---|---|---|---|---|\n"


def write_page(rows: Sequence[Row], page: Path = PAGE) -> None:
    """Writes the rows that were tried into the page; the others are kept."""
    table = page.read_text().split(BEGIN)[1].split(END)[0]
    lines = {_figure(line): line for line in table.removeprefix(HEAD).splitlines()}
    for row in rows:
        cells = (row.name, row.size, row.measured, row.target, row.met, row.commit if row.tried else "")
        if row.tried or row.name not in lines:
            lines[row.name] = f"| {' | '.join(cells)} |"
    write_between(BEGIN, END, HEAD + "".join(f"{line}\n" for line in lines.values()), page)


def write_between(begin: str, end: str, lines: str, page: Path = PAGE) -> None:
    """Replaces the lines of the page between two marks."""
    before, rest = page.read_text().split(begin)
    page.write_text(before + begin + lines + end + rest.split(end)[1])


def _figure(line: str) -> str:
    return line.split(" | ")[0].removeprefix("| ")
