"""Reads lines and rows of numbers from text files of gestures. Empty lines, spaces around numbers, and the
marks of other systems (line ends, byte order) are accepted; numbers only in the format of robot descriptions.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tci.messages.frames import Array
from tci.robot.xml.document import read_bytes, refuse, shown
from tci.robot.xml.values import NUMBER

LARGEST = 64 << 20
"""Size [bytes] of the largest file that is read. Assumed: this number bounds the memory for a damaged or
hostile file."""
MOST = 500_000
"""Largest number of rows. Assumed: an hour of motion capture at 120 Hz has 432 000 rows."""
COLUMNS = 1000
"""Largest number of values in a row. Assumed: a skeleton with all fingers has about 200 values per row."""


Lines = Sequence[tuple[int, str]]
"""Lines of a file that are not empty, each with its number in the file, from 1."""


def read_lines(path: Path) -> Lines:
    """Text that is not UTF-8 is read as Latin-1, since only names have characters other than ASCII.

    Raises DescriptionError if the file can't be read or is larger than LARGEST.
    """
    data = read_bytes(path, limit=LARGEST)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = enumerate(io.StringIO(text, newline=None), start=1)
    return [(number, line) for number, line in lines if not line.isspace()]


def read_rows(source: str, lines: Lines, columns: int, *, mark: str | None) -> Array:
    """Returns the numbers (k, columns) in the `lines`.

    `mark` is the character between two numbers, or None for spaces and tabs. Raises DescriptionError with the
    line if a row is invalid or there are too many rows.
    """
    between = "[ \t]+" if mark is None else rf"[ \t]*{re.escape(mark)}[ \t]*"
    row = re.compile(rf"[ \t]*{NUMBER}(?:{between}{NUMBER}){{{columns - 1}}}[ \t]*\n?")
    rows = []
    for line, text in lines:
        if not row.fullmatch(text):
            values = [value.strip(" \t") for value in text.removesuffix("\n").split(mark)]
            wrong = next(
                (f", not {shown(value)}" for value in values[:COLUMNS] if not re.fullmatch(NUMBER, value)), ""
            )
            valid = f"{columns} numbers such as -12.5 or 1e-3{wrong}"
            raise refuse(source, line, f"{len(values)} values; valid: {valid}")
        rows.append(text)
        if len(rows) > MOST:
            raise refuse(source, line, f"too large; valid: at most {MOST} rows")
    if not rows:
        return np.zeros((0, columns))
    numbers = np.loadtxt(rows, delimiter=mark, comments=None, ndmin=2)
    if not (finite := np.isfinite(numbers).all(axis=1)).all():
        which = int(np.argmin(finite))
        raise refuse(source, lines[which][0], f"row {which + 1} has too large a number; valid: finite ones")
    return numbers
