"""`make reliability`: the scoreboard of docs/reliability.md; FULL=1 for the full size."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests")]

from attacks import bodies, limits  # noqa: E402
from bytes_in import descriptions, guided, heartbeats  # noqa: E402
from day import false_reflexes  # noqa: E402
from death import heartbeat  # noqa: E402
from explore import loop  # noqa: E402
from gate import non_finite  # noqa: E402
from recordings import killed, minute  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402
from row import Row  # noqa: E402
from timing import one_kilohertz  # noqa: E402

OPEN = (
    Row(
        "dropped link while moving, per link",
        "",
        "open: a simulation in another process",
        "1000 at rest",
        None,
    ),
    Row("mutation score of gate and loop", "", "open: mutmut configuration", ">= 95 %", None),
)


def main() -> int:
    """Measure, print, write; 1 when a measured row misses its target."""
    full = os.environ.get("FULL") == "1"
    rows = [
        measure(full)
        for measure in (
            limits,
            bodies,
            non_finite,
            heartbeat,
            one_kilohertz,
            loop,
            false_reflexes,
            descriptions,
            guided,
            heartbeats,
            killed,
            minute,
        )
    ]
    rows += OPEN
    table = Table(title=f"Reliability, {'full' if full else 'CI'} size")
    for head in ("figure", "size", "measured", "target", "met"):
        table.add_column(head)
    for row in rows:
        met = {True: "[green]yes[/]", False: "[red]no[/]", None: "[yellow]open[/]"}[row.met]
        table.add_row(row.name, row.size, row.figure, row.target, met)
    Console().print(table)
    out = Path(os.environ.get("OUT", "out"))
    out.mkdir(parents=True, exist_ok=True)
    (out / "reliability.json").write_text(
        json.dumps({"full": full, "rows": [asdict(row) for row in rows]}, indent=2) + "\n"
    )
    return int(any(row.met is False for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
