"""Finds the fingers of a hand: chains of joints that lie side by side on a palm, identified by place and
name.

This module assumes that each finger bends in the direction in which its joints have the larger range. The
bending axis of the thumb differs from the parallel axes of the other fingers, or the thumb bends in the
opposite direction. The index finger is next to the thumb.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from tci.lab.authoring.joint_facts import JointFacts
from tci.lab.authoring.joint_tree import Joint, carried
from tci.messages.frames import Array
from tci.robot.generic_arm import Side
from tci.robot.generic_fingers import FINGERS
from tci.robot.shoulder import angle_about

PARALLEL = 0.8
"""Least cosine between the axes of joints that bend one finger. Assumed: the axes differ by at most 37
degrees, because the joints of thumbs are twisted."""
FEWEST = 3
"""Least number of finger-like chains of a hand. An end effector with fewer chains counts as a gripper."""
CLEAR = np.deg2rad(25.0)
"""Least difference [rad] between the ranges of a finger in its two directions. If the ranges differ by more
than this value, the finger bends in the direction with the larger range. Otherwise the bending direction is
in doubt."""
HARDLY = np.deg2rad(6.0)
"""Largest bend [rad] of a finger that no hand has: 360 degrees that were written in radians are read as 6.3
degrees by an MJCF without `<compiler angle="radian"/>`."""
APART = 0.1
"""For each finger, the least cosine between the bending axes of two other fingers is computed. The finger
with the largest result is the thumb, if the second largest result is smaller by more than this number.
Otherwise the thumb can only be found by its name. Assumed: fingers that fan out change the cosine by less
than this."""
BESIDE = 0.3
"""Least distance from the middle of the palm at which a thumb counts as attached on one side of the palm, as
a fraction of half the palm's width. At a smaller distance the thumb counts as attached in the middle.
Assumed: the thumb of a Dex3 hand is in the middle of the palm."""
FLEXED = np.deg2rad(30.0)
"""Angle [rad] by which each bending joint is bent to test which joint spreads the finger. With a straight
finger this test can fail, because a joint may rotate the finger about the finger's own axis."""
SIDEWAYS = 0.3
"""Least cosine between the motion of the finger's tip and the direction of spread. Assumed: a joint with a
smaller cosine does not spread the finger."""
ROUNDED = float(np.deg2rad(15.0))
"""Resolution [rad] of the thumb's opposition while all joints of the model are at zero: the angle is rounded
to a multiple of this value. Assumed: an angle derived from the geometry of links is not more accurate than
this."""
_NAMES = {
    "thumb": re.compile(r"(?i)thumb|(?<![a-z])th(?=j|\d|_|-|$)"),
    "index": re.compile(r"(?i)index|forefinger|(?<![a-z])ff(?=j|\d|_|-|$)"),
    "middle": re.compile(r"(?i)middle|(?<![a-z])mf(?=j|\d|_|-|$)"),
    "ring": re.compile(r"(?i)(?<![a-z])ring|(?<![a-z])rf(?=j|\d|_|-|$)"),
    "little": re.compile(r"(?i)little|pinky|pinkie|(?<![a-z])lf(?=j|\d|_|-|$)"),
}


class DoubtfulFingersError(Exception):
    """Fingers that can't be identified by place and names; the message lists these fingers."""

    def __init__(self, message: str, *, hardly_bends: bool = False) -> None:
        """`hardly_bends` is True if a finger's range is so small that its file may count in another unit."""
        super().__init__(message)
        self.hardly_bends = hardly_bends


@dataclass(frozen=True, slots=True, eq=False)
class Finger:
    """Indices of the joints of one finger, and directions of the finger in the frame H at the model's zero.

    Frame H lies at the model's root: x forward, y left, z up.
    """

    chain: tuple[int, ...]
    """All joints of the finger, from the palm outwards."""
    flexion: tuple[int, ...]
    """Joints that bend the finger."""
    signs: tuple[float, ...]
    """Direction (1 or -1) in which each joint of `flexion` turns to bend the finger towards the palm."""
    axis: Array
    """Axis (3,) about which the finger bends."""
    ahead: Array
    """Unit vector (3,) from the first bending joint to the tip, perpendicular to `axis`."""
    tip: Array
    """End (3,) [m] of the finger."""
    name: str = ""
    spread: int | None = None
    """Joint that spreads the finger, or opposes the thumb; None if there is none."""
    outward: float = 1.0
    """Direction (1 or -1) in which the joint `spread` turns to spread the finger, or to oppose the thumb."""
    offset: float = 0.0
    """Spread of a finger, or opposition of the thumb [rad], at the model's zero."""

    @property
    def palmar(self) -> Array:
        """Direction (3,) in which the tip moves when the finger bends."""
        return np.cross(self.axis, self.ahead)


def find_fingers(
    joints: Sequence[Joint], arm: int | None, side: Side, facts: Mapping[str, JointFacts],
    tips: Mapping[int, Array], *, trust: str | None = None,
) -> tuple[Finger, ...]:  # fmt: skip
    """Returns the fingers that the joint `arm` carries, or all of a hand that is alone (None), in the order
    of generic fingers; the result is empty for a gripper.

    `tips` are the ends (3,) [m] of the links, by the index of the joint that moves each link. If names and
    places of fingers contradict each other, `trust` ("names" or "places") decides. Raises
    DoubtfulFingersError if the fingers can't be identified.
    """
    own = range(len(joints)) if arm is None else carried(joints, arm)
    able = [one for one in own if not facts[joints[one].name].stuck]
    best: list[tuple[int, ...]] = []
    for palm in [-1, *able] if arm is None else able:
        found = _chains_of(joints, palm, able)
        best = found if len(found) > len(best) else best
    if len(best) < FEWEST:
        return ()
    fingers = [_finger(joints, chain, facts, tips) for chain in best]
    thumb, names = _thumb(joints, fingers, trust), [_named(joints, one) for one in fingers]
    others = [one for one in range(len(fingers)) if one != thumb]
    if len(others) >= len(FINGERS):
        raise DoubtfulFingersError(f"{len(fingers)} chains of joints, and a hand has at most {len(FINGERS)}")
    palmar, radial = _across(joints, fingers, thumb, side)
    place = {one: float(radial @ _base(joints, fingers[one])) for one in others}
    others.sort(key=place.__getitem__, reverse=True)
    usual: Sequence[str] = FINGERS[1 : 1 + len(others)]
    told = [names[one] for one in others]
    if None not in told and len(set(told)) == len(told) and trust != "places":
        usual = [str(name) for name in told]
        if trust is None and sorted(usual, key=FINGERS.index) != usual:
            raise DoubtfulFingersError(f"by their places, from the thumb on, they are {', '.join(usual)}")
    named = {thumb: "thumb"} | dict(zip(others, usual, strict=True))
    made = [_spread(joints, replace(fingers[one], name=name), palmar, radial) for one, name in named.items()]
    return tuple(sorted(made, key=lambda finger: FINGERS.index(finger.name)))


def _chains_of(joints: Sequence[Joint], palm: int, able: Sequence[int]) -> list[tuple[int, ...]]:
    """The finger-like chains on a palm, moved by the joint `palm`; of a palm that folds, also those on the
    parts that its folds move. Each of these carries two fingers at least, and the palm itself one."""
    first = [one for one in able if joints[one].parent == palm]
    found = [chain for one in first if len(chain := _chain(joints, one, able)) > 1]
    for fold in first if found else ():
        carried_by = [one for one in able if joints[one].parent == fold]
        folded = [chain for one in carried_by if len(chain := _chain(joints, one, able)) > 1]
        if len(folded) > 1 and len(found) + len(folded) <= len(FINGERS):
            found += folded
    return found


def _chain(joints: Sequence[Joint], first: int, able: Sequence[int]) -> tuple[int, ...]:
    """Returns the joint `first` and all joints in `able` that follow it outwards, as indices. If the chain
    branches, as in linkages of grippers, the result is empty."""
    chain, after = [], [first]
    while len(after) == 1:
        chain.append(after[0])
        after = [one for one in able if joints[one].parent == chain[-1]]
    return () if after else tuple(chain)


def _finger(
    joints: Sequence[Joint], chain: tuple[int, ...], facts: Mapping[str, JointFacts],
    tips: Mapping[int, Array],
) -> Finger:  # fmt: skip
    """Describes a chain of joints as a finger. Its name, and the joint that spreads it, are not set yet.

    Raises DoubtfulFingersError if the joints' limits do not show in which direction the finger bends, or if
    the end of the finger is unknown.
    """
    last = joints[chain[-1]].axis
    first = next(
        i for i in range(len(chain)) if all(abs(joints[j].axis @ last) > PARALLEL for j in chain[i:])
    )
    flexion = chain[first:]
    alike = [float(np.sign(joints[one].axis @ last)) for one in flexion]
    limits = [
        sorted(sign * end for end in (facts[joints[one].name].lower, facts[joints[one].name].upper))
        for sign, one in zip(alike, flexion, strict=True)
    ]
    lower, upper = np.sum(limits, axis=0)
    if abs(upper + lower) < CLEAR:
        names = ", ".join(joints[one].name for one in flexion)
        bends = max(upper, -lower)
        if bends < HARDLY:
            message = f"the ranges of {names} bend a finger by {np.rad2deg(bends):.2g} degrees at most"
            raise DoubtfulFingersError(message, hardly_bends=True)
        raise DoubtfulFingersError(f"the limits of {names} leave open in which direction they bend a finger")
    sense = 1.0 if upper > -lower else -1.0
    axis, base = sense * last, joints[flexion[0]].anchor
    ahead = tips[chain[-1]] - base
    ahead = ahead - axis * float(axis @ ahead)
    length = float(np.linalg.norm(ahead))
    if length < 1e-6:
        raise DoubtfulFingersError(f"nothing shows the end of the finger at {joints[chain[-1]].name}")
    return Finger(chain, flexion, tuple(sense * one for one in alike), axis, ahead / length, tips[chain[-1]])


def _base(joints: Sequence[Joint], finger: Finger) -> Array:
    return joints[finger.flexion[0]].anchor


def _named(joints: Sequence[Joint], finger: Finger) -> str | None:
    """Returns the name of the finger, for example "thumb", according to the names of its joints and links;
    None if these contain no word for a finger."""
    words = [word for one in finger.chain for word in (joints[one].name, joints[one].link)]
    counts = {name: sum(bool(words_of.search(word)) for word in words) for name, words_of in _NAMES.items()}
    most = max(counts, key=counts.__getitem__)
    return most if counts[most] else None


def _thumb(joints: Sequence[Joint], fingers: Sequence[Finger], trust: str | None) -> int:
    """Returns the index of the thumb, found by its place and by its name. If these contradict each other,
    `trust` ("names" or "places") decides.

    Raises DoubtfulFingersError if there is no thumb, or if the contradiction is left open (`trust` is None).
    """

    def alike(without: int) -> float:
        rest = [finger.axis for one, finger in enumerate(fingers) if one != without]
        return min(float(one @ other) for one, other in combinations(rest, 2))

    order = sorted(range(len(fingers)), key=alike, reverse=True)
    clear = alike(order[0]) - alike(order[1]) > APART
    place = order[0] if clear else None
    named = [one for one, finger in enumerate(fingers) if _named(joints, finger) == "thumb"]
    name = named[0] if len(named) == 1 else None
    if trust == "names" or (trust is None and place is None):
        place = name if name is not None else place
    if place is None or (trust is None and name not in (None, place)):
        which = (
            "no finger bends against the others"
            if place is None
            else (
                f"{joints[fingers[place].chain[0]].name} bends as a thumb does, and the name of "
                f"{joints[fingers[named[0]].chain[0]].name} is that of a thumb"
            )
        )
        raise DoubtfulFingersError(which)
    return place


def _across(
    joints: Sequence[Joint], fingers: Sequence[Finger], thumb: int, side: Side
) -> tuple[Array, Array]:
    """Returns two unit vectors (3,): out of the palm, and along the palm towards the thumb.

    If the thumb is in the middle of the palm, the second vector points to the side on which a human hand has
    its thumb.
    """
    others = [finger for one, finger in enumerate(fingers) if one != thumb]
    palmar, ahead = (
        np.mean(vectors, axis=0) for vectors in zip(*((f.palmar, f.ahead) for f in others), strict=True)
    )
    radial = np.cross(palmar, ahead) if side == "left" else np.cross(ahead, palmar)
    radial, palmar = (vector / np.linalg.norm(vector) for vector in (radial, palmar))
    places = np.array([float(radial @ _base(joints, finger)) for finger in others])
    points = [*(joints[one].anchor for one in fingers[thumb].chain), fingers[thumb].tip]
    aside = float(np.mean(points, axis=0) @ radial) - (places.max() + places.min()) / 2.0
    if abs(aside) > BESIDE * float(np.ptp(places)) / 2.0:
        radial = radial * float(np.sign(aside))
    return palmar, radial


def _spread(joints: Sequence[Joint], finger: Finger, palmar: Array, radial: Array) -> Finger:
    """Returns `finger` with the joint that spreads it, if there is one. `palmar` and `radial` are unit
    vectors (3,) out of the palm and along the palm towards the thumb."""
    free = finger.chain[: -len(finger.flexion)]
    if not free:
        return finger
    thumb, tip = finger.name == "thumb", finger.tip
    for one, sign in zip(finger.flexion[::-1], finger.signs[::-1], strict=True):
        tip = joints[one].anchor + _turned(tip - joints[one].anchor, sign * joints[one].axis, FLEXED)
    away = palmar - radial if thumb else radial if finger.name in ("index", "middle") else -radial
    away = away / np.linalg.norm(away)
    # Any of a thumb's first joints may oppose the thumb; in other fingers, a joint that arches the palm may
    # precede the joint that spreads the finger.
    near = free if thumb else free[-1:]
    motions = {one: np.cross(joints[one].axis, tip - joints[one].anchor) for one in near}
    spread = max(motions, key=lambda one: abs(float(motions[one] @ away)))
    along = float(motions[spread] @ away)
    if abs(along) < SIDEWAYS * float(np.linalg.norm(motions[spread])):
        return finger
    joint, outward = joints[spread], float(np.sign(along))
    offset = 0.0
    if thumb:
        turn = angle_about(outward * joint.axis, radial, tip - joint.anchor)
        offset = ROUNDED * round(turn / ROUNDED)
    return replace(finger, spread=spread, outward=outward, offset=offset)


def _turned(vector: Array, axis: Array, angle: float) -> Array:
    """Returns a vector (3,) turned about a unit axis (3,) by an angle [rad] (Rodrigues' formula)."""
    turned: Array = (
        vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle)
        + axis * float(axis @ vector) * (1.0 - np.cos(angle))
    )  # fmt: skip
    return turned
