"""Files that contain only rows x y z nx ny nz [m]. Row i is channel i, and a row of zeros is a channel
without a taxel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tci.robot.skin_files.layout import SkinLayout, make_layout
from tci.robot.skin_files.text import parse_row, read_lines
from tci.robot.xml.document import Faults


def read_skin_rows(path: str | Path) -> SkinLayout:
    """Reads a file with one row `x y z nx ny nz` [m] per channel. Numbers are separated by commas or spaces;
    `#` or `%` begins a comment.

    Raises DescriptionError with all faults, each with its line.
    """
    source = str(path)
    faults = Faults(source)
    rows = []
    lines = read_lines(Path(path))
    for number, line in enumerate(lines, start=1):
        words = line.split("#", 1)[0].split("%", 1)[0].replace(",", " ").split()
        if words:
            rows.append(parse_row(words, number, faults))
    if not any(any(row[:3]) for row in rows) and not faults:
        faults.add(max(len(lines), 1), "no taxels; valid: rows of x y z nx ny nz [m]")
    faults.check()
    table = np.array(rows)
    return make_layout(
        source, table[:, :3], table[:, 3:], np.any(table != 0.0, axis=-1), name=Path(source).stem
    )
