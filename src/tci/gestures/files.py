"""Gestures as CSV files, which spreadsheets can open."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tci.errors import TciError
from tci.gestures.gesture import Gesture
from tci.gestures.rows import COLUMNS, read_lines, read_rows
from tci.messages.frames import read_only
from tci.robot.xml.document import refuse, shown

TIME = "time_s"
UNIT = "_deg"
MARKS = (",", ";", "\t")
"""Marks between two columns. Spreadsheets of countries with a decimal comma write the other two."""


def write_csv(gesture: Gesture, path: Path, names: dict[str, list[str]]) -> None:
    """Writes a gesture to a new file. Each row contains a time [s] and the angles [deg] in columns
    `part.joint_deg`.

    `names` lists the joints of each part. Raises FileExistsError if the file exists, and the other errors of
    `open`.
    """
    columns = [f"{part}.{joint}{UNIT}" for part in gesture.postures for joint in names[part]]
    angles = np.rad2deg(np.hstack(list(gesture.postures.values())))
    form = ",".join(["%.9g", *["%.7g"] * angles.shape[1]]) + "\r\n"
    with path.open("x", newline="", encoding="utf-8") as file:
        csv.writer(file).writerow([TIME, *columns])
        rows = np.column_stack([gesture.times, angles]).tolist()
        file.writelines(form % tuple(row) for row in rows)


def read_csv(path: Path) -> tuple[Gesture, dict[str, list[str]]]:
    """Returns the gesture in a file, and the names of the gesture's joints by part.

    Raises DescriptionError if the file is not valid. The message contains the number of the wrong line, and
    what is valid there.
    """
    source = str(path)
    lines = read_lines(path)
    try:
        first = lines[0][1] if lines else ""
        mark = next((mark for mark in MARKS if mark in first), MARKS[0])
        head = next(csv.reader([first], delimiter=mark), [])
    except csv.Error as error:
        raise refuse(source, 0, f"is no CSV: {error}") from error
    names = _names(source, [column.strip(" \t") for column in head])
    rows = lines[1:] if mark == "," else [(line, text.replace(",", ".")) for line, text in lines[1:]]
    numbers = read_rows(source, rows, len(head), mark=mark)
    postures, begin = {}, 1
    for part, joints in names.items():
        end = begin + len(joints)
        postures[part] = read_only(np.deg2rad(numbers[:, begin:end]))
        begin = end
    try:
        return Gesture(read_only(numbers[:, 0]), postures), names
    except TciError as error:
        raise refuse(source, 0, str(error)) from error


def _names(source: str, head: list[str]) -> dict[str, list[str]]:
    """Returns the names of the joints by part, read from `head`, the columns of the file's first line."""
    if head[:1] != [TIME] or not 2 <= len(head) <= COLUMNS:
        raise refuse(
            source,
            1,
            f"not the columns of a gesture; valid: {TIME},part.joint{UNIT},... of at most {COLUMNS} columns",
        )
    names: dict[str, list[str]] = {}
    last = ""
    for column in head[1:]:
        part, dot, joint = column.removesuffix(UNIT).partition(".")
        if not dot or not column.endswith(UNIT) or not column.isprintable():
            raise refuse(source, 1, f"column {shown(column)}; valid: part.joint{UNIT}")
        if part in names and part != last:
            raise refuse(source, 1, f"column {shown(column)}; valid: the columns of a part together")
        if joint in names.setdefault(part, []):
            raise refuse(source, 1, f"second column {shown(column)}; valid: each joint once")
        names[part].append(joint)
        last = part
    return names
