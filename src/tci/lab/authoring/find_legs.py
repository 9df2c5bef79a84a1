"""Finds a humanoid's legs: mirrored chains whose hip, knee and ankle bend forward and backward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tci.lab.authoring.joint_tree import Joint, ancestors
from tci.robot.generic_arm import Side

ALIKE = 0.96
"""Least cosine between the axis of a knee or ankle and the y axis. Assumed: the two axes differ by at most 16
degrees."""
SLANTED = 0.8
"""Least cosine between the axis of hip pitch and the y axis. The angle between them is then at most 37
degrees. Assumed: the hips of some humanoids are slanted by 30 degrees, and a margin is needed."""
TALL = 0.1
"""Least height of a hip above its ankle, as a fraction of the extent of all joints. Assumed: in every
humanoid the hip is higher than that."""
SEGMENT = 0.25
"""Least height between hip and knee, and between knee and ankle, as a fraction of the hip's height above the
lowest joint. Assumed: this value excludes toes and parallel linkages, whose joints are closer together."""


@dataclass(frozen=True, slots=True)
class Leg:
    """Indices of the joints of a leg."""

    chain: tuple[int, ...]
    """All joints of the leg, from the hip down."""
    hip: int
    """Joint of hip pitch."""
    knee: int
    ankle: int
    """Joint of ankle pitch."""


def find_legs(
    joints: Sequence[Joint], taken: set[int], extent: float, *, slanted: float = SLANTED
) -> dict[Side, Leg]:
    """Finds both legs, by side. Joints in `taken` belong to other limbs and are not considered.

    The result is empty for a robot that does not have exactly two legs. `extent` [m] is the longest side of
    the box around all joints. `slanted` is the least cosine between the axis of hip pitch and the y axis.
    """
    parents = {joint.parent for joint in joints}
    heights = [float(joint.anchor[2]) for joint in joints]
    found: dict[Side, Leg] = {}
    best: dict[Side, tuple[float, int]] = {}
    roots: dict[Side, set[int]] = {"left": set(), "right": set()}
    for leaf in range(len(joints)):
        if leaf in parents or leaf in taken:
            continue
        chain = [one for one in ancestors(joints, leaf)[::-1] if one not in taken]
        side: Side = "left" if joints[leaf].anchor[1] > 0.0 else "right"
        leg = _leg(joints, chain, side, slanted)
        if leg is None:
            continue
        drop = heights[leg.hip] - heights[leg.ankle]
        merit = round(drop, 3), len(leg.chain)
        if drop > TALL * extent:
            roots[side].add(leg.chain[0])
            if merit > best.get(side, (0.0, 0)):
                found[side], best[side] = leg, merit
    return dict(sorted(found.items())) if all(len(own) == 1 for own in roots.values()) else {}


def _leg(joints: Sequence[Joint], chain: Sequence[int], side: Side, slanted: float) -> Leg | None:
    """Returns the leg in `chain`, a chain of joints from the root outwards; None if the chain contains no
    leg. `slanted` is the least cosine between the axis of hip pitch and the y axis."""
    sign = 1.0 if side == "left" else -1.0
    down = [one for one in chain if abs(joints[one].axis[1]) > ALIKE]
    hips = [one for one in chain if abs(joints[one].axis[1]) > slanted]
    height = {one: float(joints[one].anchor[2]) for one in chain}
    for hip in hips:
        lowest = min(height[one] for one in chain)
        least = SEGMENT * (height[hip] - lowest)
        knee = next((one for one in down if one > hip and height[hip] - height[one] > least), None)
        if knee is None:
            continue
        ankle = next((one for one in down if one > knee and height[knee] - height[one] > least), None)
        # The ankle of a leg lies on the leg's side of the median plane; a waist joint above the leg does not.
        if ankle is None or joints[ankle].anchor[1] * sign <= 0.0:
            continue
        first = _first_aside(joints, chain, sign)
        if first is not None and first <= chain.index(hip):
            return Leg(tuple(chain[first:]), hip, knee, ankle)
    return None


def _first_aside(joints: Sequence[Joint], chain: Sequence[int], sign: float) -> int | None:
    """Returns the index in `chain` of the first joint that carries only joints of one side: the left side if
    `sign` is 1, the right side if `sign` is -1. Returns None if there is no such joint.
    """
    for place, one in enumerate(chain):
        if all(
            joints[other].anchor[1] * sign > 0.0
            for other in range(len(joints))
            if one in ancestors(joints, other)
        ):
            return place
    return None
