"""A recording as tables for other programs: CSV, NPZ, Parquet."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import RecordingError, UnknownNameError
from tci.installed import needs
from tci.recording.cdr import decode
from tci.recording.names import distinct, inside
from tci.recording.recording import Recording
from tci.recording.schemas import DECISION, JOINTS, SKIN, to_frame

FORMATS = ("csv", "npz", "parquet")
Table = dict[str, NDArray[Any]]
"""Columns by name, all of one length."""


def tables(recording: Recording) -> dict[str, Table]:
    """`joints`, `decisions` and `skin_PATCH`, each with a column `time_s` on the link's clock: when that was
    measured or decided.

    Angles [rad], speeds [rad/s], torques [N m]; skin as raw values. Raises RecordingError.
    """
    rows: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    for _, kind, _, data in recording.messages():
        if kind is JOINTS:
            fields = decode(kind, data)
            measured = fields["sec"] + fields["nanosec"] / 1e9
            rows.setdefault("joints", []).append((measured, _joints(fields)))
        elif kind is SKIN:
            frame = to_frame(decode(kind, data))
            values = {f"raw_{channel}": value for channel, value in enumerate(frame.values)}
            row = {"sequence": frame.sequence, **values}
            rows.setdefault(f"skin_{frame.patch}", []).append((float(frame.stamp), row))
        elif kind is DECISION:
            fields = decode(kind, data)
            rows.setdefault("decisions", []).append((fields["stamp"], _decision(fields)))
    return {name: _table(name, found) for name, found in rows.items()}


def export(recording: Recording, out: Path, form: str) -> list[Path]:
    """Write the tables: a file for each in the folder `out`, or one file `out` for npz (named so); what was
    written.

    Raises UnknownNameError for a format, MissingExtraError for parquet without its library,
    RecordingError for a recording whose names could lead out of the folder.
    """
    if form not in FORMATS:
        raise UnknownNameError("format", form, FORMATS)
    found = tables(recording)
    if form == "npz":
        columns = {f"{inside(Path(), name)}.{column}": values for name, table in found.items()
                   for column, values in table.items()}  # fmt: skip
        out = out if out.suffix else out.with_suffix(".npz")
        with out.open("xb") as file:
            np.savez_compressed(file, allow_pickle=False, **columns)
        return [out]
    paths = {name: inside(out, f"{name}.{form}") for name in found}
    write = _parquet_writer() if form == "parquet" else _write_csv
    out.mkdir(parents=True, exist_ok=True)
    for name, path in paths.items():
        write(path, found[name])
    return list(paths.values())


def _joints(fields: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for what, unit in (("position", "rad"), ("velocity", "rad_s"), ("effort", "nm")):
        names = [*fields["name"], *map(str, range(len(fields["name"]), len(fields[what])))]
        row |= {f"{name}_{unit}": value for name, value in zip(distinct(names), fields[what], strict=False)}
    return row


def _decision(fields: dict[str, Any]) -> dict[str, Any]:
    row = {"state": fields["state"], "reason": fields["reason"]}
    for what, unit in (("position", "rad"), ("velocity", "rad_s"), ("torque", "nm")):
        row |= {f"servo{n}_{unit}": v for n, v in zip(fields["servos"], fields[what], strict=False)}
    return row


def _table(name: str, rows: list[tuple[float, dict[str, Any]]]) -> Table:
    """Rows as columns; what a row lacks is NaN, for servos that come under command later."""
    columns = dict.fromkeys(key for _, row in rows for key in row)
    if name.startswith("skin_") and any(len(row) != len(columns) for _, row in rows):
        raise RecordingError(f"frames of {name} have different numbers of values; valid: one number")
    table = {"time_s": np.array([stamp for stamp, _ in rows])}
    for column in columns:
        table[column] = np.array([row.get(column, np.nan) for _, row in rows])
    return table


def _write_csv(path: Path, table: Table) -> None:
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))


def _parquet_writer() -> Any:
    with needs("export to parquet", "parquet"):
        import pyarrow
        from pyarrow import parquet

    def write(path: Path, table: Table) -> None:
        with path.open("xb") as file:
            parquet.write_table(pyarrow.table(table), file)

    return write
