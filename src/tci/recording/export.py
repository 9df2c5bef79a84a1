"""Exports a recording as tables for other programs: CSV, NPZ, Parquet."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import RecordingError, UnknownNameError
from tci.messages import SkinFrame
from tci.recording.names import distinct, inside
from tci.recording.perceived import perceive
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import decode
from tci.recording.schemas import COMMAND, DECISION, JOINTS, SKIN, to_frame
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot
from tci.skin.skin import Skin
from tci.support.installed import needs

FORMATS = ("csv", "npz", "parquet")
Table = dict[str, NDArray[Any]]
"""Columns by name, with one row per instant or, in the table of contacts, per contact. A column of skin data
is a matrix with one column per channel or taxel."""
CONTACT = (
    "time_s", "sequence", "patch", "part", "segment", "identity", "began_s", "force_n", "peak_force_n",
    "area_m2", "taxels", "u", "theta_rad", "x_m", "y_m", "z_m", "force_x_n", "force_y_n", "force_z_n",
)  # fmt: skip
"""Columns of the table of contacts. Positions and forces are in the torso frame."""


def tables(recording: Recording, robot: RobotLike | None = None) -> dict[str, Table]:
    """Returns the tables `joints`, `commands`, `decisions` and one `skin_PATCH` for each patch.

    If `robot` is given, also returns `contacts`. Every table has a column `time_s`: the time of the
    measurement, command or decision on the driver's clock. The mode of a command determines the unit of its
    values; the values of a CartesianCommand are a target of its `point`. Angles are in [rad], speeds in
    [rad/s], torques in [N m]. In the table of a patch, `raw` (frames, channels) are the unchanged values.
    With a `robot`, `pressure_pa` and `force_n` (frames, taxels) are computed from the raw values. Pressures
    and forces are NaN for frames that were not used, because they do not fit the robot or came in the wrong
    order. Raises RecordingError if the recording can't be read.
    """
    robot = None if robot is None else as_robot(robot)
    rows: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    frames: dict[str, list[SkinFrame]] = {}
    names: list[str] = []
    for _, kind, _, data in recording.messages():
        if kind is JOINTS:
            fields = decode(kind, data)
            names = names or distinct(fields["name"])
            measured = fields["sec"] + fields["nanosec"] / 1e9
            if row := _joints(fields):  # empty if the recording contains only skin
                rows.setdefault("joints", []).append((measured, row))
        elif kind is SKIN:
            frame = to_frame(decode(kind, data))
            frames.setdefault(frame.patch, []).append(frame)
        elif kind.name == COMMAND.name:
            fields = decode(kind, data)
            rows.setdefault("commands", []).append(
                (fields["sec"] + fields["nanosec"] / 1e9, _command(fields))
            )
        elif kind.name == DECISION.name:
            fields = decode(kind, data)
            rows.setdefault("decisions", []).append((fields["stamp"], _decision(fields, names)))
    found = {name: _table(some) for name, some in rows.items()}
    found |= {f"skin_{patch}": _skin(patch, some) for patch, some in frames.items()}
    if robot is not None:
        perceived, contacts = _perceived_tables(recording, robot, frames)
        for patch, columns in perceived.items():
            found[f"skin_{patch}"] |= columns
        found["contacts"] = contacts
    return found


def export(recording: Recording, out: Path, form: str, robot: Robot | None = None) -> list[Path]:
    """Writes the tables, and returns the paths of the files.

    `out` is a folder for the files. For npz, `out` is the file to write. NPZ stores each matrix under one
    name, for example `skin_left_forearm.force_n` (frames, taxels). In CSV and Parquet the matrix is split
    into columns `force_n_0`, `force_n_1` and so on.

    Raises UnknownNameError for an unknown format, and MissingExtraError if the library for parquet is
    missing. Raises RecordingError if the recording has names that could lead out of the folder.
    """
    if form not in FORMATS:
        raise UnknownNameError("format", form, FORMATS)
    found = tables(recording, robot)
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
        write(path, _wide(found[name]))
    return list(paths.values())


def _joints(fields: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for what, unit in (("position", "rad"), ("velocity", "rad_s"), ("effort", "nm")):
        names = [*fields["name"], *map(str, range(len(fields["name"]), len(fields[what])))]
        row |= {f"{name}_{unit}": value for name, value in zip(distinct(names), fields[what], strict=False)}
    return row


def _command(fields: dict[str, Any]) -> dict[str, Any]:
    row = {name: fields[name] for name in ("kind", "part", "mode", "point", "nearest")}
    row["servos"] = " ".join(map(str, fields["servos"]))
    return row | {f"value_{k}": value for k, value in enumerate(fields["values"])}


def _decision(fields: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    row = {"state": fields["state"], "reason": fields["reason"]}
    known = dict(enumerate(names))
    for what, unit in (("position", "rad"), ("velocity", "rad_s"), ("torque", "nm")):
        servos = zip(fields["servos"].tolist(), fields[what], strict=False)
        row |= {f"{known.get(servo, f'servo{servo}')}_{unit}": value for servo, value in servos}
    return row


def _table(rows: list[tuple[float, dict[str, Any]]]) -> Table:
    """Converts rows, each a time [s] and its values by column name, to a table.

    Missing values are NaN, for example the values of a servo before its first command.
    """
    columns = dict.fromkeys(key for _, row in rows for key in row)
    table = {"time_s": np.array([stamp for stamp, _ in rows])}
    for column in columns:
        table[column] = np.array([row.get(column, np.nan) for _, row in rows])
    return table


def _skin(patch: str, frames: list[SkinFrame]) -> Table:
    if len({frame.values.size for frame in frames}) > 1:
        raise RecordingError(f"frames of skin_{patch} have different numbers of values; valid: one number")
    return {
        "time_s": np.array([frame.stamp for frame in frames], dtype=float),
        "sequence": np.array([frame.sequence for frame in frames]),
        "raw": np.stack([frame.values for frame in frames]),
    }


def _perceived_tables(
    recording: Recording, robot: Robot, frames: dict[str, list[SkinFrame]]
) -> tuple[dict[str, Table], Table]:
    """Returns a table of pressures and forces by patch, with a row for each of the patch's `frames`, and one
    table of all contacts in these frames."""
    row = {patch: {(f.stamp, f.sequence): k for k, f in enumerate(some)} for patch, some in frames.items()}
    perceived: dict[str, Table] = {}
    contacts: dict[tuple[str, float, int, int], tuple[Any, ...]] = {}
    skins, names = Skin(robot), [patch.name for patch in robot.patches]
    for period in perceive(recording, robot):
        skin = period.skin
        for p, patch in enumerate(names):
            k = row.get(patch, {}).get((skin.stamp[p], skin.sequence[p]))
            if k is None:
                continue  # no frame, or a repeated frame of a skin that sends frames only when values change
            pressure, areas = skin.on(p), skins.surfaces[patch].areas
            if patch not in perceived:
                shape = len(frames[patch]), pressure.size
                perceived[patch] = {name: np.full(shape, np.nan) for name in ("pressure_pa", "force_n")}
            perceived[patch]["pressure_pa"][k], perceived[patch]["force_n"][k] = pressure, pressure * areas
        for c in period.perception.contacts:
            contacts.setdefault(
                (c.patch, c.stamp, c.sequence, c.identity),
                (
                    c.stamp, c.sequence, c.patch, c.part, c.segment, c.identity, c.onset, c.force,
                    c.peak, c.area, len(c.taxels), c.u, c.theta, *c.p_T, *c.f_T,
                ),
            )  # fmt: skip
    columns = zip(*contacts.values(), strict=True) if contacts else [()] * len(CONTACT)
    return perceived, {name: np.array(values) for name, values in zip(CONTACT, columns, strict=True)}


def _wide(table: Table) -> Table:
    """Returns the table with each matrix split into columns.

    For example, `force_n` becomes `force_n_0`, `force_n_1` and so on.
    """
    wide: Table = {}
    for name, values in table.items():
        if values.ndim == 1:
            wide[name] = values
        else:
            wide |= {f"{name}_{index}": column for index, column in enumerate(values.T)}
    return wide


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
