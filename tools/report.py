"""Report of measured figures: conditions, a table in the terminal, a table in a page, and a JSON file."""

from __future__ import annotations

import importlib
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
TABLES = ROOT / "docs" / "tables"
PACKAGES = ("tci", "numpy", "scipy", "numba", "ruckig", "mujoco")
COLOURS = {"yes": "green", "so far": "green", "no": "red", "open": "yellow"}
"""Colours of table cells that say if a target was met."""


@cache
def commit() -> str:
    """Returns the commit that is checked out in git."""
    describe = ["git", "describe", "--always", "--dirty", "--abbrev=10"]
    answer = subprocess.run(describe, capture_output=True, text=True, check=False, cwd=ROOT)
    return answer.stdout.strip() or "unknown"


def conditions() -> dict[str, Any]:
    """Returns the commit, the machine and the versions of a run."""
    return {
        "commit": commit(),
        "date": time.strftime("%Y-%m-%d"),
        "processor": processor(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "versions": {name: importlib.import_module(name).__version__ for name in PACKAGES},
    }


def processor() -> str:
    """Returns the name of the processor, which is read from a file of Linux."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def out() -> Path:
    """Returns the folder for results, which OUT (environment) names. Creates the folder if necessary."""
    folder = Path(os.environ.get("OUT", "out"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def save(name: str, figures: Mapping[str, Any]) -> None:
    """Writes the figures as JSON to the folder for results."""
    (out() / name).write_text(json.dumps(figures, indent=2) + "\n")


def show(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Prints a table."""
    table = Table(title=title)
    for name in head:
        table.add_column(name)
    for row in rows:
        table.add_row(*(f"[{COLOURS[cell]}]{cell}[/]" if cell in COLOURS else cell for cell in row))
    Console(width=None if sys.stdout.isatty() else 150).print(table)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table in Markdown."""
    lines = (f"| {' | '.join(cells)} |\n" for cells in rows)
    return f"| {' | '.join(head)} |\n{'|---' * len(head)}|\n{''.join(lines)}"


def between(page: Path, begin: str, end: str) -> str:
    """Returns the text of a page between two marks."""
    return page.read_text().split(begin)[1].split(end)[0]


def write_between(page: Path, begin: str, end: str, text: str) -> None:
    """Replaces the text of a page between two marks."""
    before, rest = page.read_text().split(begin)
    page.write_text(before + begin + text + end + rest.split(end)[1])
