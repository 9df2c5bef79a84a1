"""Benchmark of TCI: each part of TCI is timed in the same run as a comparable program (the peer).

python tools/bench [CASE ...]

Each case runs in a process of its own. The results are a table, and out/bench.json ($OUT) for programs. A
complete run also writes docs/tables/performance.md.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # with threads, OpenBLAS is slower for small matrices
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests"), str(HERE.parent)]

from page import HEAD, cells, write_page
from report import conditions, save, show
from rich.progress import track

CASES = {
    "pipeline": "pipeline:pipeline",
    "scale": "pipeline:scale",
    "whole_body": "whole_body:whole_body",
    "loop": "loop:loop",
    "real_time_factor": "touch:real_time_factor",
    "ticks": "ticks:ticks",
    "hands": "hands:hands",
    "learning": "learning:learning",
    "start": "start:start",
    "demo": "start:demo",
    "memory": "start:memory",
    "kernel_230": "frame:kernel_230",
    "kernel_4000": "frame:kernel_4000",
    "kernel_100000": "frame:kernel_100000",
    "kernel_1000000": "frame:kernel_1000000",
    "events": "pipeline:events",
    "contacts": "parts:contacts",
    "gate": "parts:gate",
    "kinematics": "parts:kinematics",
    "inverse": "parts:inverse",
    "touch": "touch:touch",
    "touch_hand": "touch:touch_hand",
    "people": "touch:people",
    "worlds": "touch:worlds",
    "drivers": "wires:wires",
    "networks": "wires:networks",
    "viewer": "looked_at:viewer",
}
"""Module and function of each case; the function returns rows."""
MARK = "bench rows: "


def child(case: str) -> None:
    """Measures a case in this process, and prints the rows for the parent."""
    module, function = CASES[case].split(":")
    rows = getattr(importlib.import_module(module), function)()
    print(MARK + json.dumps([asdict(row) for row in rows]), flush=True)


def measure(case: str) -> list[dict[str, Any]]:
    """Returns the rows of a case, measured in a process of its own; None if it failed."""
    command = [sys.executable, str(HERE), "--child", case]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = [line for line in answer.stdout.splitlines() if line.startswith(MARK)]
    if answer.returncode or not lines:
        print(f"case {case} failed:\n{answer.stdout}{answer.stderr}", file=sys.stderr)
        return []
    rows: list[dict[str, Any]] = json.loads(lines[-1].removeprefix(MARK))
    return [{"case": case, **row} for row in rows]


def main() -> None:
    cases = sys.argv[1:] or list(CASES)
    unknown = [case for case in cases if case not in CASES]
    if unknown:
        raise SystemExit(f"no case {', '.join(unknown)}; valid: {', '.join(CASES)}")
    found = {case: measure(case) for case in track(cases, "measuring", disable=None)}
    rows = [row for case in cases for row in found[case]]
    on = conditions()
    show(
        f"Beside peers, in the same run ({on['processor']}): median, and spread of the ratio over all rounds",
        HEAD[:-1],
        [cells(row)[:-1] for row in rows],
    )
    for row in rows:
        if row["note"]:
            print(f"{row['name']}: {row['note']}")
    failed = [case for case in cases if not found[case]]
    figures = {"on": on, "rows": rows}
    save("bench.json", figures)
    if not sys.argv[1:] and not failed:
        write_page(figures)
    if failed:
        raise SystemExit(f"not measured: {', '.join(failed)}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2])
    else:
        main()
