"""The format of a file with a kinematic model, detected from its content."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from lxml.etree import _Element

from tci.errors import DescriptionError, Fault
from tci.robot.xml.document import parse, read_bytes
from tci.robot.xml.model import MAX_MODEL_BYTES


def model_format(path: Path) -> Literal["urdf", "mjcf"]:
    """Returns the format of a model file, detected from its first element.

    Raises DescriptionError if the file is missing, or is neither a URDF nor an MJCF file, for
    example if it is a xacro macro.
    """
    root = _root(path)
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


def unit_of_angles(path: Path) -> str | None:
    """Returns the unit in which a model file counts angles, as MJCF names it; None for an MJCF that leaves it
    to the scene that includes it. Raises DescriptionError as `model_format`."""
    if model_format(path) == "urdf":
        return "radian"
    told = [one.get("angle") for one in _root(path).iter("compiler")]
    return next((unit for unit in told if unit), None)


def _root(path: Path) -> _Element:
    if not path.is_file():
        raise DescriptionError(str(path), [Fault(0, "no such file; valid: a URDF or MJCF file")])
    return parse(read_bytes(path, limit=MAX_MODEL_BYTES), str(path))
