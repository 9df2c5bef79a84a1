"""Reads rows of numbers from text files of gestures. Accepts only the number format of robot descriptions."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from tci.messages.frames import Array
from tci.robot.xml.document import refuse, shown
from tci.robot.xml.values import NUMBER

LARGEST = 64 << 20
"""Size [bytes] of the largest file that is read. Assumed: this number bounds the memory for a damaged or
hostile file."""
MOST = 500_000
"""Largest number of rows. Assumed: an hour of motion capture at 120 Hz has 432 000 rows."""
COLUMNS = 1000
"""Largest number of values in a row. Assumed: a skeleton with all fingers has about 200 values per row."""


def read_rows(source: str, lines: Sequence[str], begin: int, columns: int, *, mark: str | None) -> Array:
    """Returns the numbers (k, columns) in `lines[begin:]`. Skips empty lines.

    `mark` is the character between two numbers, or None for spaces and tabs. Raises DescriptionError with the
    line if a row is invalid or there are too many rows.
    """
    between = "[ \\t]+" if mark is None else re.escape(mark)
    around = "[ \\t]*" if mark is None else ""
    row = re.compile(rf"{around}{NUMBER}(?:{between}{NUMBER}){{{columns - 1}}}{around}\n?")
    rows = []
    for line, text in enumerate(lines[begin:], start=begin + 1):
        if row.fullmatch(text):
            rows.append(text)
        elif not text.isspace():
            values = text.removesuffix("\n").split(mark)
            wrong = next(
                (f", not {shown(value)}" for value in values[:COLUMNS] if not re.fullmatch(NUMBER, value)), ""
            )
            valid = f"{columns} numbers such as -12.5 or 1e-3{wrong}"
            raise refuse(source, line, f"{len(values)} values; valid: {valid}")
        if len(rows) > MOST:
            raise refuse(source, line, f"too large; valid: at most {MOST} rows")
    if not rows:
        return np.zeros((0, columns))
    numbers = np.loadtxt(rows, delimiter=mark, comments=None, ndmin=2)
    if not (finite := np.isfinite(numbers).all(axis=1)).all():
        which = int(np.argmin(finite)) + 1
        raise refuse(source, begin + 1, f"row {which} has too large a number; valid: finite ones")
    return numbers
