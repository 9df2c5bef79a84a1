"""Descriptions that extend another description: the file of a variant contains only additions and changes.

An element of the variant matches an element of the extended file if both elements have the same tag and the
same name (id, middleware, ...). The attributes and children of the variant's element are then added to the
matching element, or replace those that exist. If the variant's element has `removed="yes"`, the matching
element is removed. Elements of the variant without a matching element are added.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from tci.robot.xml.document import parse, read_bytes, refuse, shown
from tci.robot.xml.grammar import ROOT

ATTRIBUTE, REMOVED = "extends", "removed"
KEYS = ("id", "destination_servo_id", "name", "middleware", "of", "joint", "frame", "prefix", "via")
"""Attributes that distinguish elements with equal tags."""
MODELS = ("robot", "mujoco", "sdf")
"""Root elements of models: URDF, MJCF, SDF."""
MOST = 6
"""Largest number of files that are merged to one description. Assumed: enough for a robot, a variant of the
robot, and changes by the robot's owner."""


def read_element(file: Path) -> tuple[etree._Element, bytes]:
    """Returns the root element of a description, merged with the files that the description extends, and the
    bytes of all these files.

    Raises DescriptionError if a file can't be read or is not a description.
    """
    found = [*_files(file)]
    root = found[-1][0]
    for element, _, source in reversed(found[:-1]):
        _merge(root, element, source)
    root.attrib.pop(ATTRIBUTE, None)
    return root, b"".join(data for _, data, _ in found)


def _files(file: Path) -> Iterator[tuple[etree._Element, bytes, str]]:
    """Reads a description, then the description that it extends, and so on. Yields the root element, the
    bytes and the path of each."""
    for _ in range(MOST):
        data = read_bytes(file)
        element = parse(data, str(file))
        line = element.sourceline or 1
        if element.tag != ROOT:
            model = "; it is a model: tci new-robot writes its description" if element.tag in MODELS else ""
            raise refuse(
                str(file), line, f"the root element is {shown(str(element.tag))}; valid: <{ROOT}>{model}"
            )
        yield element, data, str(file)
        name = element.get(ATTRIBUTE)
        if name is None:
            return
        base = file.parent / name
        if Path(name).name != name or not base.is_file():
            raise refuse(
                str(file), line, f"{ATTRIBUTE} is {shown(name)}; valid: a description beside this one"
            )
        file = base
    raise refuse(str(file), 1, f"more than {MOST} descriptions extend each other; valid: at most {MOST}")


def _merge(base: etree._Element, other: etree._Element, source: str) -> None:
    """Changes the element `base` as the matching element `other` of a variant requires: adds or replaces
    attributes and children, and removes children. `source` is the path of the variant. Raises
    DescriptionError if `other` removes an element that `base` does not have."""
    changes = {
        name: value for name, value in other.attrib.items() if name != ATTRIBUTE and base.get(name) != value
    }
    text = other.text if other.text is not None and other.text.strip() else None
    base.attrib.update(changes)
    if text is not None:
        base.text = text
    if changes or text is not None:
        base.sourceline = other.sourceline  # faults in what the variant changes are on its lines
    known = {_key(child): child for child in base if isinstance(child.tag, str)}
    for child in [child for child in other if isinstance(child.tag, str)]:
        same = known.get(_key(child))
        if child.get(REMOVED) == "yes":
            if same is None:
                words = (
                    f"<{child.tag}> removes nothing; valid: the tag and the name of an element that is there"
                )
                raise refuse(source, child.sourceline or 1, words)
            base.remove(same)
        elif same is None:
            base.append(child)
        else:
            _merge(same, child, source)


def _key(element: etree._Element) -> tuple[str | None, ...]:
    """Returns the tag and the name (id, middleware, ...) of an element. Elements with equal values match."""
    name = next((element.get(key) for key in KEYS if element.get(key) is not None), None)
    return str(element.tag), name
