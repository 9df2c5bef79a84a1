"""How fast TCI is, each part beside a peer in the same run.

    python tools/bench [CASE ...]

Each case runs in a process of its own. A table for people, and out/bench.json ($OUT) for machines.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # it threads small matrices, to no good
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests")]

from rich.console import Console
from rich.progress import track
from rich.table import Table

CASES = {
    "kernel_30": "frame:kernel_30",
    "kernel_230": "frame:kernel_230",
    "kernel_768": "frame:kernel_768",
    "kernel_4000": "frame:kernel_4000",
    "kernel_10000": "frame:kernel_10000",
    "kernel_100000": "frame:kernel_100000",
    "kernel_1000000": "frame:kernel_1000000",
    "pipeline": "pipeline:pipeline",
    "pipeline_1000000": "pipeline:pipeline_1000000",
    "own_skin": "own_skin:own_skin",
    "events": "pipeline:events",
    "contacts": "parts:contacts",
    "gate": "parts:gate",
    "kinematics": "parts:kinematics",
    "inverse": "parts:inverse",
    "touch": "touch:touch",
    "touch_hand": "touch:touch_hand",
    "real_time_factor": "touch:real_time_factor",
    "worlds": "touch:worlds",
    "loop": "loop:loop",
    "drivers": "wires:wires",
    "networks": "networks:networks",
    "start": "start:start",
    "viewer": "looked_at:viewer",
}
"""Module and function of each case; a function returns rows."""
MARK = "bench rows: "


def child(case: str) -> None:
    """Measure here, and print the rows for the parent."""
    module, function = CASES[case].split(":")
    rows = getattr(importlib.import_module(module), function)()
    print(MARK + json.dumps([asdict(row) for row in rows]), flush=True)


def measure(case: str) -> list[dict[str, Any]]:
    """The rows of a case, from a process of its own; none where it failed."""
    command = [sys.executable, str(HERE), "--child", case]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = [line for line in answer.stdout.splitlines() if line.startswith(MARK)]
    if answer.returncode or not lines:
        print(f"case {case} failed:\n{answer.stdout}{answer.stderr}", file=sys.stderr)
        return []
    rows: list[dict[str, Any]] = json.loads(lines[-1].removeprefix(MARK))
    return [{"case": case, **row} for row in rows]


def show(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Beside peers, in the same run: median, and spread of the ratio over all rounds")
    for head in ("what", "ours", "cold", "peer", "its", "cold", "unit", "ratio", "spread", "target", "met"):
        table.add_column(head, justify="left" if head in ("what", "peer", "target") else "right")
    for row in rows:
        table.add_row(
            row["name"], f"{row['ours']:.4g}", _cold(row["cold"]), row["peer"], f"{row['theirs']:.4g}",
            _cold(row["theirs_cold"]), row["unit"],
            f"{row['ratio']:.2f}", f"{row['ratio_min']:.2f}-{row['ratio_max']:.2f}", row["target"],
            {True: "[green]yes[/]", False: "[red]no[/]", None: ""}[row["met"]],
        )  # fmt: skip
    console = Console(width=None if sys.stdout.isatty() else 150)
    console.print(table)
    for row in rows:
        if row["note"]:
            console.print(f"{row['name']}: {row['note']}", highlight=False)


def _cold(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def main() -> None:
    cases = sys.argv[1:] or list(CASES)
    unknown = [case for case in cases if case not in CASES]
    if unknown:
        raise SystemExit(f"no case {', '.join(unknown)}; valid: {', '.join(CASES)}")
    found = {case: measure(case) for case in track(cases, "measuring", disable=None)}
    rows = [row for case in cases for row in found[case]]
    show(rows)
    out = Path(os.environ.get("OUT", "out"))
    out.mkdir(parents=True, exist_ok=True)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    machine = {
        "load": load,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
    }
    (out / "bench.json").write_text(json.dumps({"on": machine, "rows": rows}, indent=2) + "\n")
    if failed := [case for case in cases if not found[case]]:
        raise SystemExit(f"not measured: {', '.join(failed)}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2])
    else:
        main()
