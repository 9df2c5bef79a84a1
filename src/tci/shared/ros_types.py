"""Definitions of ROS 2 message types that TCI does not know: from a folder of the user's, from the packages
of an installed ROS 2, or from the standard ones that the library rosbags has."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from tci.errors import DriverError
from tci.recording.rosmsg.cdr import NUMBERS, MessageType, item_of

FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<many>\[[^\]]*\])?\s+(?P<name>[A-Za-z]\w*)(?P<rest>.*)"
)
SAME = {"byte": "uint8", "char": "uint8", "Header": "std_msgs/Header"}
"""Other names of types."""
SIMPLE = (*NUMBERS, "string")
Fields = tuple[tuple[str, str], ...]


def message_type(name: str, folder: str = "") -> MessageType:
    """The type `package/msg/Name`, with what is nested in it.

    Args:
        name: Name of the type.
        folder: The user's definition: a file `Name.msg`, or a folder with `package/msg/Name.msg`, or with
            `Name.msg` alone.

    Raises DriverError if a definition is not found, or has something that TCI can't read.
    """
    words = name.split("/")
    if len(words) not in (2, 3) or not all(words):
        raise DriverError(f"{name!r} is no message type; valid: package/msg/Name")
    own = f"{words[0]}/{words[-1]}"
    needs: dict[str, Fields] = {}
    wanted = [own]
    while wanted:
        full = wanted.pop()
        if full in needs:
            continue
        needs[full] = fields_of(_definition(full, folder), full)
        wanted += [item for type_, _ in needs[full] if (item := item_of(type_)[0]) not in SIMPLE]
    fields = needs.pop(own)
    full_name = f"{words[0]}/msg/{words[-1]}"
    return MessageType(full_name, fields, needs=tuple(needs.items()), headed=False)


def fields_of(definition: str, name: str) -> Fields:
    """Type and name of each field of a definition in the format of ROS. `name` is `package/Name`.

    Raises DriverError for a line that is none, and for wide strings.
    """
    found = []
    for line in definition.splitlines():
        if line.startswith("====="):  # definitions of nested messages follow
            break
        text = line.partition("#")[0].strip()
        if not text:
            continue
        match = FIELD.fullmatch(text)
        if match is None or "wchar" in match["type"] or "wstring" in match["type"]:
            raise DriverError(f"{name}: {text!r} can't be read; valid: TYPE NAME, without wide strings")
        if match["rest"].lstrip().startswith("="):  # a constant
            continue
        item = SAME.get(match["type"], match["type"])
        if item not in SIMPLE and "/" not in item:
            item = f"{name.split('/')[0]}/{item}"
        many = match["many"] or ""
        found.append((f"{item}[]" if many.startswith("[<=") else f"{item}{many}", match["name"]))
    return tuple(found)


def _definition(name: str, folder: str) -> str:
    for path in _places(name, folder):
        with suppress(OSError, UnicodeDecodeError):
            return path.read_text(encoding="utf-8")
    with suppress(ImportError):
        from rosbags.typesys import Stores, get_typestore

        standard, full = get_typestore(Stores.ROS2_KILTED), name.replace("/", "/msg/")
        if full in standard.fielddefs:
            return str(standard.generate_msgdef(full, ros_version=2)[0])
    raise DriverError(
        f"no definition of {name}: install its ROS package and source its setup.bash, or give the maker's "
        f"{name.split('/')[1]}.msg with msg=FOLDER"
    )


def _places(name: str, folder: str) -> Iterator[Path]:
    """Files that may have the definition of `package/Name`, the best one first."""
    package, last = name.split("/")
    if folder:
        given = Path(folder).expanduser()
        if given.is_file():
            if given.name == f"{last}.msg":
                yield given
            given = given.parent
        yield given / package / "msg" / f"{last}.msg"
        yield given / "msg" / f"{last}.msg"
        yield given / f"{last}.msg"
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(prefix) / "share" / package / "msg" / f"{last}.msg"
