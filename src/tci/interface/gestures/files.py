"""Gestures as files: CSV, which a spreadsheet opens."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tci.errors import DescriptionError, Fault, TciError
from tci.frames import read_only
from tci.interface.gestures.gesture import Gesture
from tci.model.xml.document import read_bytes

LARGEST = 64 << 20
"""Largest file [bytes]."""
TIME = "time_s"
UNIT = "_deg"


def write_csv(gesture: Gesture, path: Path, names: dict[str, list[str]]) -> None:
    """One row per instant: time [s], then the angles [degrees] in columns `part.joint_deg`.

    `names` are those of the joints, by part. Raises FileExistsError, and what else opening a file does.
    """
    columns = [f"{part}.{joint}{UNIT}" for part in gesture.postures for joint in names[part]]
    angles = np.rad2deg(np.hstack(list(gesture.postures.values())))
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([TIME, *columns])
        for time, row in zip(gesture.times, angles, strict=True):
            writer.writerow([f"{time:.9g}", *(f"{angle:.7g}" for angle in row)])


def read_csv(path: Path) -> tuple[Gesture, dict[str, list[str]]]:
    """The gesture of a file, and its joints' names by part.

    Raises DescriptionError with the line and what would be valid.
    """
    source = str(path)
    try:
        text = read_bytes(path, limit=LARGEST).decode("utf-8-sig")
        rows = [(line, row) for line, row in enumerate(csv.reader(text.splitlines()), start=1) if row]
    except UnicodeDecodeError as error:
        raise DescriptionError(source, [Fault(0, f"is not UTF-8: {error.reason}")]) from error
    except csv.Error as error:
        raise DescriptionError(source, [Fault(0, f"is no CSV: {error}")]) from error
    head = rows[0][1] if rows else []
    if not head or head[0] != TIME or len(head) < 2:
        raise DescriptionError(source, [Fault(1, f"the first line is {TIME},part.joint{UNIT},...")])
    names: dict[str, list[str]] = {}
    for column in head[1:]:
        part, dot, joint = column.removesuffix(UNIT).partition(".")
        if not dot or not column.endswith(UNIT) or (names and part in names and part != list(names)[-1]):
            fault = f"column {column!r}; valid: part.joint{UNIT}, those of a part together"
            raise DescriptionError(source, [Fault(1, fault)])
        names.setdefault(part, []).append(joint)
    numbers = np.zeros((len(rows) - 1, len(head)))
    for number, (line, row) in enumerate(rows[1:]):
        try:
            if len(row) != len(head):
                raise ValueError
            numbers[number] = [float(value) for value in row]
        except ValueError:
            fault = f"{len(row)} values; valid: {len(head)} numbers"
            raise DescriptionError(source, [Fault(line, fault)]) from None
    postures, begin = {}, 1
    for part, joints in names.items():
        end = begin + len(joints)
        postures[part] = read_only(np.deg2rad(numbers[:, begin:end]))
        begin = end
    try:
        return Gesture(read_only(numbers[:, 0]), postures), names
    except TciError as error:
        raise DescriptionError(source, [Fault(0, str(error))]) from error
