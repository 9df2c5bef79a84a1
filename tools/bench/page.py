"""Put the rows of bench.json files into the table of docs/performance.md: `page.py FILE ...`.

Rows that were measured take the place of those with the same name and peer; the others stay.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
HEAD = "| what | ours | cold | peer | its | cold | unit | ratio | spread | target |"


def about(line: str) -> tuple[str, str]:
    """What a row of the page compares: its name and the peer."""
    cells = [cell.strip() for cell in line.split("|")]
    return cells[1], cells[4]


def line(row: dict[str, Any]) -> str:
    def number(value: float | None) -> str:
        if value is None:
            return ""
        return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"

    met = {True: ": met", False: ": missed", None: ""}[row["met"]]
    cells = [
        row["name"], number(row["ours"]), number(row["cold"]), row["peer"], number(row["theirs"]),
        number(row["theirs_cold"]), row["unit"],
        f"{row['ratio']:.3g}", f"{row['ratio_min']:.3g}-{row['ratio_max']:.3g}", f"{row['target']}{met}",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main() -> None:
    rows = [row for file in sys.argv[1:] for row in json.loads(Path(file).read_text())["rows"]]
    lines = PAGE.read_text().splitlines()
    start = lines.index(HEAD) + 2
    end = next(i for i in range(start, len(lines)) if not lines[i].startswith("|"))
    table = {about(old): old for old in lines[start:end]}
    table |= {about(new): new for new in map(line, rows)}
    PAGE.write_text("\n".join([*lines[:start], *table.values(), *lines[end:]]) + "\n")


if __name__ == "__main__":
    main()
