"""Reader of taxel positions from a file of any known format."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tci.errors import UnknownNameError
from tci.robot.skin_files.csv import read_skin_csv
from tci.robot.skin_files.file import read_skin_file
from tci.robot.skin_files.layout import SkinLayout
from tci.robot.skin_files.rows import read_skin_rows
from tci.robot.skin_files.urdf import read_skin_urdf

Format = Literal["rows", "icub", "csv", "urdf"]
FORMATS: tuple[Format, ...] = ("rows", "icub", "csv", "urdf")
_BY_NAME: dict[str, Format] = {".csv": "csv", ".urdf": "urdf"}


def read_layout(path: str | Path, *, form: Format | None = None, sensor: str | None = None) -> SkinLayout:
    """Reads a skin in the frame of its file.

    If `form` is None, the suffix of the file name decides: .csv is a table, .urdf is a URDF, and other files
    are skin calibration files. `sensor` is the name of a tactile sensor; it is needed if a URDF has several.
    Raises DescriptionError if the file has faults, and UnknownNameError if the format is unknown.
    """
    form = form or _BY_NAME.get(Path(path).suffix.lower(), "icub")
    if form == "icub":
        return read_skin_file(path)
    if form == "csv":
        return read_skin_csv(path)
    if form == "urdf":
        return read_skin_urdf(path, sensor=sensor)
    if form == "rows":
        return read_skin_rows(path)
    raise UnknownNameError("format of a skin file", form, FORMATS)
