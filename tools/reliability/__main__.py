"""`make reliability`: the scoreboard of docs/reliability.md.

Environment variables: FULL=1 measures with the full number of trials, ROWS="limits loop" measures only these
rows, and PAGE=1 also writes the page.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests"), str(HERE.parent)]

from attacks import bodies, limits
from attends import attends
from away import moves_away
from bystander import bystander
from bytes_in import descriptions, guided, heartbeats
from day import false_reflexes
from death import heartbeat
from dropped import dropped
from explore import loop
from exposure import exposure
from g1 import unitree_faults, unitree_messages, unitree_motion
from g1_hostile import unitree_hostile
from g1_kills import unitree_kills
from gentles import gentles
from healthy import healthy
from kills import yarp_kills
from modes import modes
from moved_arm import moved_arm
from mutation import branches, mutation
from non_finite import non_finite
from pool import COMMITS
from recordings import killed, minute
from report import commit, save, show
from row import HEAD, Row, write_page
from squeezed import squeezed
from stream import yarp_skin
from teaches import teaches
from timing import one_kilohertz
from whole_arm import whole_arm
from without_skin import felt_nothing, felt_places, felt_reflex
from words import words

from wires import wires

ROWS: dict[str, Callable[[bool], Row]] = {
    one.__name__: one
    for one in (
        limits, modes, healthy, squeezed, bystander, attends, gentles, teaches, words, bodies,
        moves_away, whole_arm, moved_arm, non_finite, heartbeat, one_kilohertz, loop,
        false_reflexes, descriptions, guided, heartbeats, wires, dropped, killed, minute, yarp_skin,
        yarp_kills, mutation, branches, exposure, felt_places, felt_nothing, felt_reflex,
        unitree_kills, unitree_messages, unitree_hostile, unitree_faults, unitree_motion,
    )
}  # fmt: skip


def main() -> int:
    """Measures, prints and writes the rows. Returns 1 if a measured row misses its target, else 0."""
    full = os.environ.get("FULL") == "1"
    names = os.environ.get("ROWS", "").split() or [*ROWS]
    if unknown := [name for name in names if name not in ROWS]:
        raise SystemExit(f"no row {', '.join(unknown)}; valid: {', '.join(ROWS)}")
    rows = [replace(ROWS[name](full), commit=COMMITS.get(name, commit())) for name in names]
    show(f"Reliability, {'full' if full else 'CI'} size", HEAD, [row.cells for row in rows])
    save("reliability.json", {"full": full, "rows": [row.to_json() for row in rows]})
    if os.environ.get("PAGE") == "1":
        write_page(rows)
    return int(any(row.met == "no" for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
