"""Robots by name: the robots in the folder `robots/`, and the robots of other packages (entry points
`tci.robots`).

Each robot has a folder `robots/<name>/` with a `robot.xml`. No other file of TCI contains the name of the
robot. Every other description in the robot's folder is a variant of this robot: `nao/whole.xml` is the robot
`nao-whole`. The value of an entry point is the path of a description, or a function that returns the path.
"""

from __future__ import annotations

import os
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from tci.errors import CommandError, TciError, UnknownNameError

if TYPE_CHECKING:
    from tci.robot.description import Robot

Files = tuple[tuple[str, int, int], ...]
"""The descriptions in a robot's folder, of which one may extend another, and the files that the robot names.
For each file: its path, its size [bytes], and the time [ns] of its last change."""
GROUP = "tci.robots"
"""Entry-point group in which other packages name their robots."""
FILE = "robot.xml"
MODELS = (".urdf", ".xacro", ".mjcf", ".sdf")
"""Endings of models without a description: what the robot's joints and skin mean is not in them."""

_FOLDER = Path(__file__).with_name("robots")
_known: dict[str, tuple[Robot, Files]] = {}
"""For each name, the robot that was loaded last, and its files as they were then."""


def robot_names() -> tuple[str, ...]:
    """Returns the names that `load_robot` accepts. This function loads no robot and needs no extra
    package."""
    return tuple(sorted({*_packaged(), *_entries()}))


def check_name(name_or_path: str) -> None:
    """Raises UnknownNameError for a text that is neither a known robot's name nor a path, CommandError for a
    model. Loads no robot."""
    if name_or_path.lower().endswith(MODELS):
        raise CommandError(
            f"{name_or_path} is a model, no description of a robot; valid: the description that "
            f"tci new-robot {name_or_path} writes"
        )
    if not (_is_path(name_or_path) or name_or_path in _packaged() or name_or_path in _entries()):
        raise UnknownNameError("robot", name_or_path, [*robot_names(), "or the path of a description (.xml)"])


def load_robot(name_or_path: str | os.PathLike[str]) -> Robot:
    """Returns a robot by its name, or by the path of its description. A text is a path if it contains a slash
    or ends in .xml.

    A further call with the same name returns the same object, and reads nothing. Thus the skin and the
    collision geometry of the robot are computed only once. If the description, its model file or a skin file
    has changed, the call returns a new object.

    - Raises UnknownNameError, with the valid names, if there is no robot with this name.
    - Raises CommandError for a model, such as a URDF, in place of a description.
    - Raises DescriptionError, with all faults, if the description has faults.
    - Raises MissingExtraError if the model of the robot is in a package that is not installed.
    """
    text = os.fspath(name_or_path)
    if text.lower().endswith(MODELS):
        check_name(text)
    if not isinstance(name_or_path, str) or _is_path(text):
        return _read(text)
    packaged = _packaged()
    if text not in packaged:
        check_name(text)
    path = packaged.get(text) or _path_of(_entries()[text])
    known, files = _known.get(text, (None, ()))
    if known is not None and known.source == str(path.absolute()) and files == _named_files(known):
        return known
    robot = _read(path)
    _known[text] = robot, _named_files(robot)
    return robot


def _read(path: str | Path) -> Robot:
    from tci.robot.xml import read_robot  # not at the top of the file: shell completion needs only the names

    return read_robot(path)


def _named_files(robot: Robot) -> Files:
    """Returns path, size and time of the last change of each description in a robot's folder, and of each
    model file and skin file of the robot. Leaves out missing files."""
    model = robot.model
    named = sorted(map(str, Path(robot.source).parent.glob("*.xml")))
    named += [] if model is None else [model.path, *(one.path for one in model.attachments)]
    named += [file for patch in robot.patches if (file := getattr(patch.surface, "file", None))]
    found = []
    for path in dict.fromkeys(named):
        try:
            about = os.stat(path)
        except OSError:
            continue
        found.append((path, about.st_size, about.st_mtime_ns))
    return tuple(found)


def _is_path(text: str) -> bool:
    return text.lower().endswith(".xml") or "/" in text or os.sep in text


def _packaged() -> dict[str, Path]:
    robots = {path.parent.name: path for path in sorted(_FOLDER.glob(f"*/{FILE}"))}
    others = {path for path in _FOLDER.glob("*/*.xml") if path.suffixes == [".xml"] and path.name != FILE}
    return robots | {f"{path.parent.name}-{path.stem}": path for path in sorted(others)}


def _entries() -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=GROUP):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise TciError(
                f"two packages bring a robot named {entry.name!r}: {other.value} and {entry.value}; "
                "uninstall one, or load the description by its path"
            )
    return found


def _path_of(entry: EntryPoint) -> Path:
    """Returns the path of the robot description to which the entry point of another package refers."""
    try:
        given = entry.load()
        path = given() if callable(given) else given
    # an entry point may raise any error; the message must contain the robot's name
    except Exception as error:
        raise TciError(f"the robot {entry.name!r} ({entry.value}) can't be loaded: {error}") from error
    if not isinstance(path, str | os.PathLike):
        raise TciError(
            f"the robot {entry.name!r} ({entry.value}) gave {type(path).__name__}; "
            "valid: the path of its description"
        )
    return Path(path)
