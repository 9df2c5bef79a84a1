"""Finds limbs by geometry. In a limb, three joints form a ball joint, and a fourth joint, farther out, bends
the limb.

The third axis lies along the limb. The fourth axis is perpendicular to the third one. Generic arms and human
legs have this arrangement of joints. Limits on lengths are fractions of the limb's length, so that the size
of the robot does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tci.lab.authoring.joint_tree import Joint, ancestors, carried
from tci.messages.frames import Array, read_only
from tci.robot.shoulder import SLANT, nearest_point

PARALLEL = 0.9
"""Largest cosine of the angle between successive joint axes of a ball joint. Assumed: in a ball joint these
axes differ in direction by at least 26 degrees."""
ASIDE = 0.6
"""Largest offset of the limb's axis from the centre of its ball joint, and from the bending axis, as a
fraction of the limb's length. Assumed: with a larger value other chains of joints are taken for limbs; with a
smaller value limbs with offset joints are missed."""
SHORT = 0.18
"""Least length of an upper arm or thigh, as a fraction of the reach of its chain. Assumed: with a larger
value short limbs are missed; with a smaller value links of a wrist or an ankle are taken for limbs."""
BESIDE = 0.3
"""Largest distance of the axis of pronation from the elbow, as a fraction of the upper arm's length. On the
robot Baxter this fraction is 0.22. Assumed: for the joints of a wrist the fraction is larger than BESIDE."""
LEVEL = 0.999
"""Least cosine of the angle between a lift's and an elbow's axis that count as parallel: 2.6 degrees, about
as much as SLANT. Assumed: CAD models of real arms are closer."""
STUB = 0.2
"""Least length of a forearm or shank, as a fraction of the length of the upper arm or thigh. Assumed: real
forearms are longer."""

NOWHERE = read_only(np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """An arm or a leg: indices of its joints, and three points on it."""

    ball: tuple[int, ...]
    """Joints of the shoulder or hip, from the trunk outwards: three, or the pan and the lift of an arm."""
    bend: int
    """Joint of the elbow or knee."""
    turn: int | None
    """Joint after `bend` that turns the forearm about its length (pronation); None if there is none."""
    centre: Array
    """Centre (3,) [m] of the ball joint: the point on the third axis of `ball` that is nearest to the place
    where the first two axes meet."""
    middle: Array
    """Elbow or knee (3,) [m]: the point on the third axis of `ball` that is nearest to the axis of `bend`."""
    wrist: Array
    """End (3,) [m] of the forearm or shank. If no joint is at that end, `wrist` is the elbow or knee
    (`middle`).
    """
    beside: tuple[Array, Array] = (NOWHERE, NOWHERE)
    """Ways (3,) [m] from these points to the shapes of upper arm and forearm, square to each segment: the
    links of many arms lie side by side, or have the shape of an L."""

    @property
    def length(self) -> float:
        """Length [m] of the upper arm or thigh: the distance from `centre` to `middle`."""
        return float(np.linalg.norm(self.middle - self.centre))

    @property
    def ends_nowhere(self) -> bool:
        """True if the end of the forearm or shank can't be derived from a joint."""
        return float(np.linalg.norm(self.wrist - self.middle)) < STUB * self.length


def limb_at(joints: Sequence[Joint], bend: int) -> Limb | None:
    """Returns the limb with the joint `bend` as its elbow or knee; None if the joints form no limb."""
    chain = ancestors(joints, bend)
    if len(chain) < 4:
        return None
    fourth, third, second, first = (joints[index] for index in chain[:4])
    if abs(fourth.axis @ third.axis) > SLANT:
        return None
    if max(abs(first.axis @ second.axis), abs(second.axis @ third.axis)) > PARALLEL:
        return None
    cross = nearest_point(first.anchor, second.anchor, first.axis, second.axis)
    centre = third.anchor + third.axis * float(third.axis @ (cross - third.anchor))
    middle = nearest_point(third.anchor, fourth.anchor, third.axis, fourth.axis)
    length = float(np.linalg.norm(middle - centre))
    across = np.cross(third.axis, fourth.axis)
    away = abs(float((fourth.anchor - third.anchor) @ across) / float(np.linalg.norm(across)))
    reach = max(float(np.linalg.norm(joints[index].anchor - centre)) for index in carried(joints, bend))
    if length < SHORT * reach or max(float(np.linalg.norm(cross - centre)), away) > ASIDE * length:
        return None
    turn, wrist = second_segment(joints, bend, middle, length)
    return Limb((chain[3], chain[2], chain[1]), bend, turn, centre, middle, wrist)


def two_joint_limb_at(joints: Sequence[Joint], bend: int) -> Limb | None:
    """The arm with the joint `bend` as its elbow whose shoulder has two joints, a pan and a lift: the lift's
    axis is parallel to the elbow's, and square to the pan's. None if the joints form no such arm."""
    chain = ancestors(joints, bend)
    if len(chain) < 3:
        return None
    elbow, lift, pan = (joints[index] for index in chain[:3])
    if abs(lift.axis @ elbow.axis) < LEVEL or abs(pan.axis @ lift.axis) > SLANT:
        return None
    across = np.cross(pan.axis, lift.axis)
    away = abs(float((lift.anchor - pan.anchor) @ across))
    centre = nearest_point(lift.anchor, pan.anchor, lift.axis, pan.axis)
    middle = elbow.anchor + elbow.axis * float(elbow.axis @ (centre - elbow.anchor))
    length = float(np.linalg.norm(middle - centre))
    reach = max(float(np.linalg.norm(joints[index].anchor - centre)) for index in carried(joints, bend))
    if length < SHORT * reach or away > ASIDE * length:
        return None
    turn, wrist = second_segment(joints, bend, middle, length, aside=True)
    return Limb((chain[2], chain[1]), bend, turn, centre, middle, wrist)


def second_segment(
    joints: Sequence[Joint], bend: int, middle: Array, length: float, *, aside: bool = False
) -> tuple[int | None, Array]:
    """Returns the index of the joint that turns the forearm about its length (None if there is none), and the
    forearm's end (3,) [m]. The forearm begins at the elbow `middle` (3,) [m], and `length` [m] is that of the
    upper arm. With `aside`, the forearm may lie anywhere along the axis of the elbow, and beside the upper
    arm's."""
    after = [index for index, joint in enumerate(joints) if joint.parent == bend]
    turns: list[tuple[float, int, Array]] = []
    for index in after:
        joint = joints[index]
        across = (joint.anchor - middle) - joint.axis * float(joint.axis @ (joint.anchor - middle))
        if aside:
            square = np.cross(joints[bend].axis, joint.axis)
            across = square * float(square @ (joint.anchor - joints[bend].anchor))
        beyond = [other for other in joints if other.parent == index]
        if abs(joint.axis @ joints[bend].axis) > SLANT or np.linalg.norm(across) > BESIDE * length:
            continue
        ends = [*(other.anchor for other in beyond), joint.anchor]
        along = [joint.axis * float(joint.axis @ (end - middle)) for end in ends]
        step = max(along, key=lambda one: float(np.linalg.norm(one)))
        turns.append((float(np.linalg.norm(step)), index, middle + step))
    if turns and max(turns)[0] > STUB * length:
        return max(turns)[1:]
    axis = joints[bend].axis
    ends = [joints[index].anchor for index in after]
    level = [end - axis * float(axis @ (end - middle)) for end in ends]
    return None, max(level, key=lambda end: float(np.linalg.norm(end - middle)), default=middle)
