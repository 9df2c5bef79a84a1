"""A plain table of taxels: a CSV file with a header that states the units.

```text
channel, x [mm], y [mm], z [mm], nx, ny, nz, module, kind, area [mm2]
0,       12.0,   -3.5,   40.0,   1,  0,  0,  0,      taxel, 30
```

Only the columns x, y and z are required, with their unit. Columns are separated by commas, semicolons or
tabs. `#` begins a comment.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tci.robot.skin_files.layout import SkinLayout, hexagons, make_layout
from tci.robot.skin_files.text import MAX_DISTANCE, MAX_ROWS, read_lines
from tci.robot.xml.document import Faults, refuse, shown
from tci.robot.xml.node import listed, nearest
from tci.robot.xml.values import InvalidValueError, decimal

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
LENGTHS = ("x", "y", "z")
DIRECTIONS = ("nx", "ny", "nz")
TANGENTS = ("tx", "ty", "tz")
COUNTS = ("channel", "module", "representative")
COLUMNS = (*LENGTHS, *DIRECTIONS, *TANGENTS, *COUNTS, "kind", "area")
KINDS = ("taxel", "pad", "absent")
_HEAD = re.compile(r"([A-Za-z_]+)\s*(?:[\[(]\s*([A-Za-z0-9^]+)\s*[\])])?")
_COUNT = re.compile(r"[0-9]{1,6}")


@dataclass(frozen=True)
class _Row:
    """One row of a table of taxels, in metres and square metres."""

    line: int
    channel: int
    position: tuple[float, ...]
    normal: tuple[float, ...]
    tangent: tuple[float, ...]
    module: int
    representative: int | None
    kind: str
    area: float | None


def read_skin_csv(path: str | Path) -> SkinLayout:
    """Reads a table of taxels.

    The column `channel` gives the channel number of each row. Without this column, rows are numbered in
    order. A channel is absent if no row has its number in this column. If a row has no normal, the normal is
    estimated. If a row has no area, its area is that of a hexagon computed from the distance to the nearest
    taxel. Raises DescriptionError with all faults, each with its line.
    """
    source = str(path)
    faults = Faults(source)
    lines = [(number, line.split("#", 1)[0]) for number, line in enumerate(read_lines(Path(path)), start=1)]
    lines = [(number, line) for number, line in lines if line.strip()]
    if not lines:
        raise refuse(source, 1, f"an empty table; valid: a header such as x [mm], y [mm], z [mm] ({_all()})")
    if len(lines) - 1 > MAX_ROWS:
        raise refuse(source, lines[MAX_ROWS + 1][0], f"more than {MAX_ROWS} rows, the most that are read")
    number, head = lines[0]
    mark = max(",;\t", key=head.count)
    columns = _header(head.split(mark), number, faults)
    faults.check()
    rows = []
    for index, (number, line) in enumerate(lines[1:]):
        row = _row([word.strip() for word in line.split(mark)], columns, number, index, faults)
        if row is not None:
            rows.append(row)
    _check_channels(rows, faults)
    if not any(row.kind == "taxel" for row in rows) and not faults:
        faults.add(lines[-1][0], "no taxels; valid: at least one row that is no pad and not absent")
    faults.check()
    return _layout(source, rows)


def _all() -> str:
    return f"columns: {', '.join(COLUMNS)}"


def _header(cells: list[str], line: int, faults: Faults) -> dict[str, tuple[int, float]]:
    """Returns, by the name of each column in the header, the column's index and the factor that converts its
    values to SI units. Records a fault for an invalid column."""
    columns: dict[str, tuple[int, float]] = {}
    for place, cell in enumerate(cells):
        found = _HEAD.fullmatch(cell.strip())
        name = found[1].lower() if found else cell.strip()
        unit = found[2] if found else None
        if name not in COLUMNS:
            faults.add(line, f"unknown column {shown(name)}{nearest(name, COLUMNS)}")
        elif name in columns:
            faults.add(line, f"second column {name}")
        elif name in LENGTHS or name == "area":
            power = 2 if name == "area" else 1
            stated = (unit or "").replace("^", "")
            plain = stated.removesuffix("2") if power == 2 else stated
            if plain not in METRES or (power == 2) != stated.endswith("2"):
                valid = ", ".join(f"{name} [{known}{'2' if power == 2 else ''}]" for known in METRES)
                faults.add(line, f"column {name} states {shown(unit or 'no unit')}; valid: {valid}")
            else:
                columns[name] = place, METRES[plain] ** power
        else:
            columns[name] = place, 1.0
    missing = [name for name in LENGTHS if name not in columns]
    if missing and not faults:
        faults.add(line, f"the header lacks {listed(missing)}; valid: x, y and z with a unit, as x [mm]")
    for names in (DIRECTIONS, TANGENTS):
        some = [name for name in names if name in columns]
        if some and len(some) < 3:
            whole = ", ".join(names)
            faults.add(
                line, f"the header has only {listed(some)} of a vector; valid: {whole} or none of them"
            )
    return columns


def _row(
    words: list[str], columns: dict[str, tuple[int, float]], line: int, index: int, faults: Faults
) -> _Row | None:
    if len(words) != len(columns):
        faults.add(line, f"a row of {len(words)} cells; the header has {len(columns)}")
        return None
    cell = {name: words[place] for name, (place, _) in columns.items()}
    kind = cell.get("kind", "").lower() or "taxel"
    numbers: dict[str, float | None] = {}
    fine = True
    for name in (*LENGTHS, *DIRECTIONS, *TANGENTS, "area"):
        most = {"area": 1.0}.get(name, MAX_DISTANCE if name in LENGTHS else 1.001)
        least = 0.0 if name == "area" else -most
        text = cell.get(name, "")
        value = _number(text) * columns[name][1] if text else None
        if value is not None and not least <= value <= most:
            faults.add(line, f"{name} is {shown(text)}; valid: a number, {least:g} to {most:g} in SI units")
            fine = False
        numbers[name] = value
    counts: dict[str, int | None] = {}
    for name in COUNTS:
        text = cell.get(name, "")
        counts[name] = int(text) if _COUNT.fullmatch(text) else None
        if text and (counts[name] is None or int(text) >= MAX_ROWS):
            faults.add(line, f"{name} is {shown(text)}; valid: a whole number from 0 to {MAX_ROWS - 1}")
            fine = False
    if "channel" in cell and not cell["channel"]:
        faults.add(line, "no channel; valid: a whole number in each row, or no such column")
        fine = False
    if kind not in KINDS:
        faults.add(line, f"kind is {shown(kind)}; valid: {', '.join(KINDS)}")
        return None
    place = [numbers[name] for name in LENGTHS]
    if kind != "absent" and None in place and (kind == "taxel" or any(value is not None for value in place)):
        faults.add(line, "x, y or z is empty; valid: three numbers, or the kind absent")
        fine = False
    normal = [numbers[name] for name in DIRECTIONS]
    if None in normal and any(value is not None for value in normal):
        faults.add(line, "nx, ny or nz is empty; valid: all three or none, then the normal is estimated")
        fine = False
    if not fine:
        return None
    return _Row(
        line=line,
        channel=index if counts["channel"] is None else counts["channel"],
        position=() if kind == "absent" or None in place else tuple(value or 0.0 for value in place),
        normal=tuple(value or 0.0 for value in normal),
        tangent=tuple(numbers[name] or 0.0 for name in TANGENTS),
        module=counts["module"] or 0,
        representative=counts["representative"],
        kind=kind,
        area=numbers["area"],
    )


def _number(text: str) -> float:
    try:
        return decimal(text)
    except InvalidValueError:
        return math.nan


def _check_channels(rows: list[_Row], faults: Faults) -> None:
    seen: dict[int, int] = {}
    for row in rows:
        if row.channel in seen:
            faults.add(row.line, f"channel {row.channel} is on line {seen[row.channel]} already")
        seen[row.channel] = row.line
    for row in rows:
        if row.representative is not None and row.representative not in seen:
            faults.add(row.line, f"representative {row.representative} is no channel of this table")


def _layout(source: str, rows: list[_Row]) -> SkinLayout:
    n = 1 + max(row.channel for row in rows)
    positions, normals, tangents = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    areas = np.full(n, np.nan)
    valid, pads = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    modules = np.zeros(n, dtype=np.intp)
    representative = np.full(n, -1, dtype=np.intp)
    for row in rows:
        at = row.channel
        if row.position:
            positions[at], valid[at] = row.position, True
        normals[at], tangents[at], modules[at] = row.normal, row.tangent, row.module
        pads[at] = row.kind == "pad"
        areas[at] = np.nan if row.area is None else row.area
        if row.kind != "absent":
            own = at if row.representative is None else row.representative
            representative[at] = -2 if row.kind == "pad" else own
    missing = np.isnan(areas)
    return make_layout(
        source, positions, normals, valid, name=Path(source).stem, pads=pads, modules=modules,
        areas=np.where(missing, hexagons(positions, valid & ~pads), areas) if missing.any() else areas,
        representative=representative, tangents=tangents if tangents.any() else None,
    )  # fmt: skip
