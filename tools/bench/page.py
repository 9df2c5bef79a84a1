"""Formats the rows of the benchmark as table cells, and writes docs/tables/performance.md after a complete
run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from report import TABLES, markdown

HEAD = ("measurement", "TCI", "TCI cold", "peer", "value of the peer", "peer cold", "unit", "ratio", "spread",
        "target", "note")  # fmt: skip
MET = {True: ": met", False: ": missed", None: ""}


def cells(row: Mapping[str, Any]) -> list[str]:
    """Returns the cells of a row, in the order of `HEAD`."""
    return [
        row["name"], _number(row["ours"]), _number(row["cold"]), row["peer"], _number(row["theirs"]),
        _number(row["theirs_cold"]), row["unit"], f"{row['ratio']:.3g}",
        f"{row['ratio_min']:.3g}-{row['ratio_max']:.3g}", row["target"] + MET[row["met"]], row["note"],
    ]  # fmt: skip


def write_page(figures: Mapping[str, Any]) -> None:
    """Writes the results of a complete run to the page. `figures` has the format of bench.json. The new rows
    replace all earlier rows."""
    on = figures["on"]
    versions = ", ".join(f"{name} {version}" for name, version in on["versions"].items())
    about = (
        f"Measured on {on['date']} at commit `{on['commit']}`: {on['cores']} cores of {on['processor']}, "
        f"{on['system']}, Python {on['python']}, {versions}; load at the end {on['load']:.1f}."
    )
    rows: Sequence[Mapping[str, Any]] = figures["rows"]
    (TABLES / "performance.md").write_text(f"{about}\n\n{markdown(HEAD, map(cells, rows))}")


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
