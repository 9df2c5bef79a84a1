"""`make reliability`: the scoreboard of docs/reliability.md.

FULL=1 runs the full size, ROWS="limits loop" some rows only, and PAGE=1 also writes the page.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests")]

from attacks import bodies, limits
from away import moves_away
from bytes_in import descriptions, guided, heartbeats
from day import false_reflexes
from death import heartbeat
from dropped import dropped
from explore import loop
from exposure import exposure
from kills import yarp_kills
from mutation import branches, mutation
from non_finite import non_finite
from page import write_page
from plant import plant
from pool import COMMITS, commit
from recordings import killed, minute
from rich.console import Console
from rich.table import Table
from row import Row
from stream import yarp_skin
from timing import one_kilohertz
from wires import wires

ROWS: dict[str, Callable[[bool], Row]] = {
    one.__name__: one
    for one in (
        limits, plant, bodies, moves_away, non_finite, heartbeat, one_kilohertz, loop, false_reflexes,
        descriptions, guided, heartbeats, wires, dropped, killed, minute, yarp_skin, yarp_kills,
        mutation, branches, exposure,
    )
}  # fmt: skip


def main() -> int:
    """Measures, prints and writes the rows. Returns 1 if a measured row misses its target, else 0."""
    full = os.environ.get("FULL") == "1"
    names = os.environ.get("ROWS", "").split() or [*ROWS]
    if unknown := [name for name in names if name not in ROWS]:
        raise SystemExit(f"no row {', '.join(unknown)}; valid: {', '.join(ROWS)}")
    rows = [replace(ROWS[name](full), commit=COMMITS.get(name, commit())) for name in names]
    table = Table(title=f"Reliability, {'full' if full else 'CI'} size")
    for head in ("figure", "size", "measured", "target", "met"):
        table.add_column(head)
    colours = {"yes": "green", "so far": "green", "no": "red", "open": "yellow"}
    for row in rows:
        met = f"[{colours[row.met]}]{row.met}[/]"
        table.add_row(row.name, row.size, row.measured, row.target, met)
    Console().print(table)
    out = Path(os.environ.get("OUT", "out"))
    out.mkdir(parents=True, exist_ok=True)
    report = {"full": full, "rows": [row.to_json() for row in rows]}
    (out / "reliability.json").write_text(json.dumps(report, indent=2) + "\n")
    if os.environ.get("PAGE") == "1":
        write_page(rows)
    return int(any(row.met == "no" for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
