"""Distinguishes arms from legs by their place and by their names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

from tci.lab.authoring.joint_tree import Joint, carried
from tci.lab.authoring.limb import Limb

Pair = Mapping[str, Limb]
"""A left and a right limb, by side."""
Vote = Literal["arm", "leg"] | None
"""Kind of a pair of limbs; None if the kind can't be determined."""

CLEAR = 0.05
"""Least vertical distance between the limbs' roots and the robot's centre of mass, as a fraction of the
length of upper arm or thigh. At a smaller distance, height does not decide between arms and legs.

Assumed: larger than the asymmetry of a torso that ends at its shoulders, smaller than the distance between
real shoulders and hips.
"""
_NAMES = {
    "arm": re.compile(r"(?i)shoulder|(?<![a-z])sho(?![a-z])|arm|elbow|wrist|hand(?!le)|gripper"),
    "leg": re.compile(r"(?i)hip|(?<![a-z])leg|knee|ank(le|el)?(?![a-z])|foot|thigh|shank|calf"),
    "head": re.compile(r"(?i)head|neck"),
    "torso": re.compile(r"(?i)torso|waist|spine|trunk|lumbar"),
}


def named_side(name: str) -> str | None:
    """Returns the first side that a joint's name contains; None if it contains no side.

    For example, `LARM_SHOULDER_R` and `arml_sho1` are on the left.
    """
    found = re.search(
        r"(?i)(?<![a-z])(left|right|[lr](?=arm|leg|hip|sho|[^a-z]|$))|(?<=arm|leg)[lr](?![a-z])", name
    )
    return None if found is None else {"l": "left", "r": "right"}[found[0][0].lower()]


def is_named_so(joints: Sequence[Joint], pair: Pair) -> bool:
    """Returns False if the name of a limb's first joint contains the opposite side, for example `right` for
    the left limb. Exception: returns True if both limbs are named as right, such as `_r0` and `_r1`, or both
    as left, because such letters do not tell the limbs apart."""
    named = {side: named_side(joints[limb.ball[0]].name) for side, limb in pair.items()}
    return len(set(named.values())) == 1 or all(told in (None, side) for side, told in named.items())


def hangs_as(pair: Pair, centre_of_mass: float | None) -> Vote:
    """Returns the kind of a pair of limbs from `centre_of_mass`: the height [m] of the centre of mass of all
    bodies that the pair does not move.

    Arms begin above the centre of mass, legs below it. Returns None if the limbs begin near this height, or
    if `centre_of_mass` is None.
    """
    if centre_of_mass is None:
        return None
    height = sum(float(limb.centre[2]) for limb in pair.values()) / 2.0
    clear = CLEAR * max(limb.length for limb in pair.values())
    if abs(height - centre_of_mass) < clear:
        return None
    return "arm" if height > centre_of_mass else "leg"


def named_as(joints: Sequence[Joint], pair: Pair) -> Vote:
    """Returns "arm" or "leg", the kind that more names of the pair's joints and links suggest; None if
    equally many names suggest each kind."""
    names = [
        name
        for limb in pair.values()
        for index in {*limb.ball, *carried(joints, limb.ball[0])}
        for name in (joints[index].name, joints[index].link)
    ]
    counts = {kind: sum(is_named_as(kind, name) for name in names) for kind in ("arm", "leg")}
    if counts["arm"] == counts["leg"]:
        return None
    return "arm" if counts["arm"] > counts["leg"] else "leg"


def is_named_as(kind: str, name: str) -> bool:
    """Returns True if a name contains a word for a `kind` of part: arm, leg, head or torso."""
    return bool(_NAMES[kind].search(name))


def listed(joints: Sequence[Joint], pairs: Iterable[Pair]) -> str:
    """Returns, for each pair of limbs, the name of the left limb's first joint and of the right limb's first
    joint, in the format of the option --arms."""
    names = [",".join(joints[pair[side].ball[0]].name for side in ("left", "right")) for pair in pairs]
    return " or ".join(names)
