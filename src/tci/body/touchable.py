"""Where a robot can be touched so that it feels it, and which of its parts have no skin."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tci.body.places import Place, find_place
from tci.errors import TciError
from tci.messages import JointReading, LimbPlace
from tci.robot.description import GenericPart, Robot
from tci.robot.generic_arm import SEGMENTS
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True, eq=False)
class Touchable:
    """A place on the skin of a robot at which it can be touched."""

    part: str
    """Generic part that feels the touch."""
    place: Place
    site: int | None = None
    """Index of the limb place that was asked for; None for the middle of a patch."""


def touchable(
    skin: Skin, joints: JointReading, sites: Sequence[LimbPlace] = (), *, parts: Sequence[str] = ()
) -> Iterator[Touchable]:
    """Touches what exists: yields `sites` on each arm, the left one first, wherever there is skin, and then
    the middle of each patch on which no site lies.

    Args:
        skin: Skin of the robot.
        joints: Posture of the robot.
        sites: Places on a limb.
        parts: Kinds or names of generic parts; none for all parts.

    Another body may be in the finger's way, so take the next place if a poke finds no room.
    """
    robot = skin.robot
    own = [part for part in robot.parts if not parts or part.kind in parts or part.name in parts]
    used = set()
    for part in sorted((part for part in own if part.kind == "arm"), key=lambda part: part.side != "left"):
        for number, site in enumerate(sites):
            with suppress(TciError):  # no skin there
                place = find_place(skin, part.name, site.segment, site.u, site.theta, joints)
                used.add(place.patch)
                yield Touchable(part.name, place, number)
    names = {part.name for part in own}
    for patch in robot.patches:
        if patch.part in names and patch.name not in used:
            yield Touchable(patch.part, middle_of(skin, patch.name))


def middle_of(skin: Skin, patch: str) -> Place:
    """The taxel in the middle of a patch."""
    surface = skin.surfaces[patch]
    middle = (surface.positions.min(axis=0) + surface.positions.max(axis=0)) / 2.0
    taxel = int(np.linalg.norm(surface.positions - middle, axis=1).argmin())
    return Place(patch, surface.positions[taxel], surface.normals[taxel])


def without_skin(robot: Robot) -> tuple[str, ...]:
    """The generic parts without skin, and the bare limbs of the other arms: `upper arm of left_arm`."""
    places = {(patch.part, patch.segment) for patch in robot.patches}
    worn = {patch.part for patch in robot.patches}
    fingers = {part.side: part.name for part in robot.parts if part.kind == "fingers"}

    def bare(part: GenericPart) -> Iterator[str]:
        if part.name not in worn:
            if part.kind != "hand" or (fingers.get(part.side), "palm") not in places:
                yield part.name
        elif part.kind == "arm":
            limbs = [one for one in SEGMENTS if (part.name, one) not in places]
            if limbs:
                yield f"{' and '.join(limb.replace('_', ' ') for limb in limbs)} of {part.name}"

    return tuple(words for part in robot.parts for words in bare(part))
