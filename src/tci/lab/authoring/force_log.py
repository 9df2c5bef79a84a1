"""Logs of a force sensor or a force/torque sensor: CSV files, and logs of YARP's yarpdatadumper."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tci.errors import TciError
from tci.messages.frames import Array
from tci.recording.yarp_log import read_yarp_log
from tci.robot.xml.values import decimal

HEADERS = (["time", "force"], ["time", "fx", "fy", "fz"])


def read_force_log(path: Path) -> tuple[Array, Array]:
    """Reads stamps (n,) [s] on the driver's clock, and forces (n, 1) or (n, 3) [N].

    The first line of a .csv file must be one of HEADERS. Any other file is read as yarpdatadumper's log of
    a six-axis sensor; the measured moments are ignored. Raises TciError for a file that can't be used.
    """
    rows = _csv_rows(path) if path.suffix == ".csv" else _yarp_rows(path)
    if len(rows) < 2:
        raise TciError(f"{path}: {len(rows)} rows of numbers; valid: 2 or more")
    if len({len(row) for row in rows}) > 1:
        raise TciError(f"{path}: rows of different lengths; valid: the same components in each")
    values = np.array(rows)
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0.0)
    if len(late):
        raise TciError(f"{path}: time {values[late[0] + 1, 0]} s; valid: later than that of the row before")
    return values[:, 0], values[:, 1:]


def _csv_rows(path: Path) -> list[list[float]]:
    try:
        with path.open(newline="") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TciError(f"{path} can't be read: {error}") from None
    header = [cell.strip().lower() for cell in lines[0]] if lines else []
    if header not in HEADERS:
        valid = " or ".join(",".join(one) for one in HEADERS)
        raise TciError(f"{path}: line 1; valid: the header {valid} (in s and N)")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            row = [decimal(cell.strip(" ")) for cell in line]
        except ValueError:
            row = []
        if len(row) != len(header):
            raise TciError(f"{path}: line {number}: {line}; valid: {len(header)} numbers, {','.join(header)}")
        rows.append(row)
    return rows


def _yarp_rows(path: Path) -> list[list[float]]:
    try:
        frames = list(read_yarp_log(path, patch="force"))
    except OSError as error:
        raise TciError(f"{path} can't be read: {error}") from None
    for frame in frames:
        if len(frame.values) < 3:
            raise TciError(
                f"{path}: {len(frame.values)} values at {frame.stamp} s; valid: a force of three axes first"
            )
    return [[frame.stamp, *frame.values[:3].tolist()] for frame in frames]
