"""Follows the advice of a refusal of new-robot that names numbers of the model file, in a copy."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from lxml import etree

TORQUE = re.compile(r"(\S+): its torque of (\S+) N m .*; valid: (\S+) N m, as \S+ has")
UNITS = re.compile(
    r"\S+: its torque of .* can't move the .*; valid: .*, or links whose .* are in kg and kg m2"
)
LARGEST = 1.0
"""Largest square of a link's radius of gyration [m2]: an inertia above that is in another unit."""
GRAM_MM2 = 1e-9
"""g mm2 in kg m2, as CAD programs export it."""


def followed(file: Path, refusal: str) -> tuple[Path, str] | None:
    """A copy beside `file` in which the advice of `refusal` is followed, and what was changed. None for a
    refusal without such advice."""
    root = etree.parse(str(file))
    if torque := TORQUE.search(refusal):
        joint, ratio = torque[1], float(torque[3]) / float(torque[2])
        _torques(root, joint, lambda given: given * ratio)
        said = f"{joint} has {torque[3]} N m"
    elif UNITS.search(refusal):
        said = f"inertias of {_inertias(root)} links are read in g mm2"
    else:
        return None
    copy = file.with_name(f"tci-advised-{file.name}")
    root.write(str(copy))
    return copy, said


def _torques(root: etree._ElementTree, joint: str, change: Callable[[float], float]) -> None:
    for one in root.iter():
        if one.tag == "joint" and one.get("name") == joint and one.find("limit") is not None:
            _change(one.find("limit"), "effort", change)
        if one.get("joint") == joint:
            _change(one, "ctrlrange", change)
            _change(one, "forcerange", change)


def _inertias(root: etree._ElementTree) -> int:
    changed = 0
    for link in root.iter("inertial"):
        mass, inertia = link.find("mass"), link.find("inertia")
        if float(inertia.get("ixx")) > LARGEST * float(mass.get("value")):
            changed += 1
            for name in inertia.keys():  # noqa: SIM118 (an element iterates over its children)
                _change(inertia, name, lambda given: given * GRAM_MM2)
    return changed


def _change(one: etree._Element, name: str, change: Callable[[float], float]) -> None:
    if name in one.attrib:
        one.set(name, " ".join(f"{change(float(word)):.9g}" for word in one.get(name).split()))
