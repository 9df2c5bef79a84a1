"""Lines of a skin calibration file: its keywords and rows, and the faults found in them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from tci.errors import DescriptionError
from tci.robot.xml.document import Faults, read_bytes, refuse, shown
from tci.robot.xml.values import InvalidValueError, decimal

MAX_BYTES = 1 << 21
"""Size [bytes] of the largest file that is read. The largest known file has 90 kB."""
MAX_ROWS = 16384
"""Largest number of rows that are read. The largest known file has 1344 rows."""
MAX_DISTANCE = 2.0
"""Largest distance [m] of a taxel from the origin of its link. Assumed: no link of a humanoid is longer than
this, so larger values are not in metres."""
PER_MODULE = 12
"""Number of rows that a file contains for each triangular module."""
PER_PATCH = 192
"""Number of rows that a file contains for each patch that has all its 16 modules."""
_BINARY = re.compile(rb"[^\t\n\r\x20-\x7e]")
_SAMPLINGS = ("taxel", "triangle")
_COLUMNS = ("x", "y", "z", "nx", "ny", "nz")


@dataclass
class SkinText:
    """Content of the lines of a file, before any check of this content."""

    name: str = ""
    sampling: str = "taxel"
    rows: list[list[float]] = field(default_factory=list)
    representative: list[int] | None = None


def read_lines(path: Path) -> list[str]:
    """Returns the lines of a text file. Raises DescriptionError if the file is no text file or too large."""
    try:
        data = read_bytes(path, limit=MAX_BYTES)
    except DescriptionError as error:
        message = error.faults[0].message.replace("an .xml file", "a skin file")
        raise refuse(str(path), 1, message) from error
    strange = _BINARY.search(data)
    if strange and strange[0] not in b"\xef\xbb\xbf" and not _in_comment(data, strange.start()):
        line = 1 + data.count(b"\n", 0, strange.start())
        raise refuse(str(path), line, f"byte {strange.start()} ({data[strange.start()]}) is no text")
    return data.decode("utf-8-sig", errors="replace").splitlines()


def _in_comment(data: bytes, place: int) -> bool:
    return b"%" in data[data.rfind(b"\n", 0, place) + 1 : place] and data[place] >= 0x80


def parse_lines(lines: list[str], faults: Faults) -> SkinText:
    text = SkinText()
    for number, line in enumerate(lines, start=1):
        words = line.split("%", 1)[0].replace("(", " ( ").replace(")", " ) ").split()
        if not words or words[0].startswith("["):
            continue
        if words[0] == "name":
            text.name = " ".join(words[1:])
        elif words[0] == "spatial_sampling":
            text.sampling = words[1] if len(words) == 2 else ""
            if text.sampling not in _SAMPLINGS:
                given = shown(" ".join(words[1:]))
                faults.add(number, f"spatial_sampling {given}; valid: {' or '.join(_SAMPLINGS)}")
        elif words[0] == "taxel2Repr":
            text.representative = _representatives(words[1:], number, faults)
        elif words[0][0].isalpha() and words[0].lower() not in ("nan", "inf", "infinity"):
            faults.add(
                number,
                f"unknown word {shown(words[0])}; valid: name, spatial_sampling, taxel2Repr, "
                "[calibration] or a row of numbers",
            )
        else:
            text.rows.append(parse_row(words, number, faults))
            if len(text.rows) > MAX_ROWS:
                raise refuse(faults.source, number, f"more than {MAX_ROWS} rows, the most that are read")
    return text


def _representatives(words: list[str], number: int, faults: Faults) -> list[int]:
    if len(words) < 2 or words[0] != "(" or words[-1] != ")":
        faults.add(number, "taxel2Repr is cut off; valid: taxel2Repr ( numbers )")
        return []
    values = []
    for word in words[1:-1]:
        if not re.fullmatch(r"-[12]|\d{1,5}", word):
            faults.add(
                number,
                f"taxel2Repr has {shown(word)}; valid: -1 (absent), -2 (pad) or the row of a representative",
            )
            break
        values.append(int(word))
    return values


def parse_row(words: list[str], number: int, faults: Faults) -> list[float]:
    """Returns the six numbers of a row. If a row has only three numbers, its normal is zero."""
    if len(words) not in (3, 6):
        faults.add(number, f"a row of {len(words)} numbers; valid: six, x y z nx ny nz [m], or three, x y z")
        return [0.0] * 6
    values = []
    for place, word in enumerate(words):
        try:
            value = decimal(word)
        except InvalidValueError:
            value = math.nan
        most = MAX_DISTANCE if place < 3 else 1.001
        if not abs(value) <= most:
            what = f"{_COLUMNS[place]} is {shown(word)}"
            unit = "m" if place < 3 else "of a unit vector"
            faults.add(number, f"{what}; valid: a number from {-most:g} to {most:g} {unit}")
            break
        values.append(value)
    return [*values, *[0.0] * 6][:6]


def check_count(text: SkinText, last: int, faults: Faults) -> None:
    """Checks that no row is missing. The number of rows must be a multiple of 12 (one module). In a file with
    a list `taxel2Repr`, it must be a multiple of 192 (one patch), or the length of this list."""
    n = len(text.rows)
    listed = text.representative
    named = max((value for value in listed or () if value >= 0), default=-1)
    live = max((row for row, value in enumerate(listed or ()) if value >= 0), default=-1)
    if n == 0 or not any(any(row[:3]) for row in text.rows):
        faults.add(max(last, 1), f"{n} rows, none with a position; valid: one row for each channel")
    elif live >= n or named >= n:
        row = max(live, named)
        faults.add(last, f"the file ends after row {n - 1}, but its taxel2Repr speaks of row {row}")
    elif n % PER_MODULE if listed is None else (n % PER_PATCH and n != len(listed)):
        valid = f"a multiple of {PER_MODULE}" if listed is None else f"a multiple of {PER_PATCH}"
        also = "" if listed is None else f", or {len(listed)} as taxel2Repr has"
        faults.add(last, f"{n} rows; valid: {valid}{also}; are some missing?")
