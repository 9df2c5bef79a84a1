"""The format of a file with a kinematic model, detected from its content."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tci.errors import DescriptionError, Fault
from tci.robot.xml.document import parse, read_bytes
from tci.robot.xml.model import MAX_MODEL_BYTES


def model_format(path: Path) -> Literal["urdf", "mjcf"]:
    """Returns the format of a model file, detected from its first element.

    Raises DescriptionError if the file is missing, or is neither a URDF nor an MJCF file, for
    example if it is a xacro macro.
    """
    if not path.is_file():
        raise DescriptionError(str(path), [Fault(0, "no such file; valid: a URDF or MJCF file")])
    root = parse(read_bytes(path, limit=MAX_MODEL_BYTES), str(path))
    if any("xacro" in str(space) for space in root.nsmap.values()) and (
        path.suffix == ".xacro" or next(root.iter("{*}macro", "{*}include", "{*}property"), None) is not None
    ):
        message = "a macro, not a model; valid: the URDF that `xacro FILE.xacro > robot.urdf` makes of it"
        raise DescriptionError(str(path), [Fault(0, message)])
    formats: dict[str, Literal["urdf", "mjcf"]] = {"robot": "urdf", "mujoco": "mjcf"}
    if root.tag not in formats:
        message = (
            f"starts with <{root.tag}>; valid: a URDF, which starts with <robot>, or an MJCF, with <mujoco>"
        )
        raise DescriptionError(str(path), [Fault(0, message)])
    return formats[root.tag]
