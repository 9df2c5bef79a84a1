"""Writes docs/tables/performance.md from one complete run; rows of earlier runs are not kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "tables" / "performance.md"
HEAD = ("what", "TCI", "cold", "peer", "time", "cold", "unit", "ratio", "spread", "target", "note")
MET = {True: ": met", False: ": missed", None: ""}


def write_page(figures: Mapping[str, Any]) -> None:
    """Writes the results of a complete run, with `figures` as in bench.json."""
    on = figures["on"]
    versions = ", ".join(f"{name} {version}" for name, version in on["versions"].items())
    about = (
        f"Measured on {on['date']} at commit `{on['commit']}`: {on['cores']} cores of {on['processor']}, "
        f"{on['system']}, Python {on['python']}, {versions}; load at the end {on['load']:.1f}."
    )
    lines = [about, "", _line(HEAD), _line(["---"] * len(HEAD)), *map(_row, figures["rows"])]
    PAGE.write_text("\n".join(lines) + "\n")


def _row(row: Mapping[str, Any]) -> str:
    return _line([
        row["name"], _number(row["ours"]), _number(row["cold"]), row["peer"], _number(row["theirs"]),
        _number(row["theirs_cold"]), row["unit"], f"{row['ratio']:.3g}",
        f"{row['ratio_min']:.3g}-{row['ratio_max']:.3g}", row["target"] + MET[row["met"]], row["note"],
    ])  # fmt: skip


def _line(cells: Any) -> str:
    return f"| {' | '.join(cells)} |"


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
