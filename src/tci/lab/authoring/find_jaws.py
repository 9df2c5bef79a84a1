"""Finds a gripper: two jaws that swing or slide on one link, or one jaw against a fixed one.

Each jaw is a chain of at most three joints. The first of them closes it: towards the other jaw, or towards
the shapes of the link that carries it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.lab.authoring.find_hand import LARGEST
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.joint_facts import RADIANS, JointFacts
from tci.lab.authoring.link_points import LinkPoints
from tci.messages.frames import Array, apply
from tci.robot.generic_arm import Side
from tci.support.engine import mujoco

PARALLEL = 0.97
"""Least cosine between the axes of two jaws of one gripper: 14 degrees. Assumed: real jaws are closer, and
two joints of a wrist are square to each other."""
SHORTEST_WAY = 0.005
"""Least way [m] of a jaw's tip. Assumed: a shorter one is that of a range in radians that is read in degrees,
as an MJCF without `<compiler angle="radian"/>` is."""
DEEPEST = 3
"""Most joints of one jaw. Assumed: a third one turns the pad at its tip; longer chains are fingers."""


@dataclass(frozen=True, slots=True, eq=False)
class Jaw:
    """A jaw at the model's zero, in the frame of the model's root R."""

    joints: tuple[str, ...]
    """From the palm outwards."""
    link: str
    """The last link, which carries the pad."""
    slides: bool
    """True if its first joint slides; otherwise it swings."""
    axis: Array
    """Unit vector (3,) along its first joint's axis."""
    anchor: Array
    """A point (3,) [m] on this axis: where the jaw begins."""
    tip: Array
    """Its end (3,) [m]."""
    turns: tuple[float, ...]
    """Cosine between the axis of its first joint and that of each of `joints`."""
    closes: float = 1.0
    """Sign of the first joint's motion that closes it."""

    def tip_at(self, place: float) -> Array:
        """End (3,) [m] of the jaw with its first joint at `place` [rad], or [m] if it slides."""
        if self.slides:
            return self.tip + place * self.axis
        away, axis = self.tip - self.anchor, self.axis
        turned: Array = (
            away * np.cos(place) + np.cross(axis, away) * np.sin(place)
            + axis * float(axis @ away) * (1.0 - np.cos(place))
        )  # fmt: skip
        return self.anchor + turned


@dataclass(frozen=True, slots=True, eq=False)
class Gripper:
    """The jaws of one gripper."""

    palm: str
    """Link that carries them."""
    jaws: tuple[Jaw, ...]
    """Two, or one that closes against a fixed jaw."""
    joints: tuple[str, ...]
    """All joints beyond the palm, also those of linkages."""


def find_gripper(points: LinkPoints, facts: Mapping[str, JointFacts], behind: str | None) -> Gripper | None:
    """The gripper beyond the link `behind`, or of a model that has nothing else (None); None if there is
    none. Raises DescriptionError for jaws in a closed loop."""
    model = points.compiled
    own = [body for body in _moving(model) if behind is None or _carries(model, behind, body)]
    groups: dict[int, list[tuple[int, ...]]] = {}
    for body in own:
        palm = int(model.body_weldid[model.body_parentid[body]])
        chain = _chain(model, body, own)
        if chain and not all(facts[_joint(model, one)].stuck for one in chain):
            groups.setdefault(palm, []).append(chain)
    found = [_jaws(points, chains) for chains in groups.values()]
    pairs = [one for one in found if len(one) == 2]
    alone = behind is None and len(own) <= DEEPEST and len(groups) == 1
    jaws = pairs[-1] if pairs else found[0] if found and alone and len(found[0]) == 1 else ()
    if not jaws:
        return None
    carrier = int(model.body_parentid[_body_of(model, jaws[0].joints[0])])
    if not carrier or (behind is None and _extent(points, own) > LARGEST):
        return None
    palm = int(model.body_weldid[carrier])
    joints = tuple(_joint(model, body) for body in own if _stands_on(model, palm, body))
    _check_loops(points, joints)
    bases = [points.own(carrier)] if len(jaws) == 1 else []
    fixed = [apply(points.pose(carrier), one) for one in bases]
    closed = tuple(_closing(points, jaw, jaws, facts, fixed) for jaw in jaws)
    return Gripper(model.body(carrier).name, closed, joints)


def lone_gripper(gripper: Gripper, points: LinkPoints, side: Side) -> FoundLimbs:
    """A body that is only this gripper, held by a stand. The torso frame is the model's root frame, at the
    link that carries the jaws."""
    pose = np.eye(4)
    pose[:3, :3] = points.link_pose(gripper.palm)[0].T
    return FoundLimbs(
        joints=(), arms={}, legs={}, torso_link=gripper.palm, trunk=(), trunk_below=False, head=(),
        devices=(), R_RH=np.eye(3), T_ET=pose, hand=side,
    )  # fmt: skip


def _moving(model: mujoco.MjModel) -> list[int]:
    """Bodies with one joint, which turns or slides."""
    one_axis = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    return [
        body for body in range(1, model.nbody)
        if model.body_jntnum[body] == 1 and model.jnt_type[model.body_jntadr[body]] in one_axis
    ]  # fmt: skip


def _carries(model: mujoco.MjModel, link: str, body: int) -> bool:
    above = model.body(link).id
    while body > 0 and body != above:
        body = int(model.body_parentid[body])
        if body == above:
            return True
    return False


def _stands_on(model: mujoco.MjModel, palm: int, body: int) -> bool:
    """True if `body` is beyond the links that are fixed to the body `palm`."""
    while body > 0:
        body = int(model.body_parentid[body])
        if int(model.body_weldid[body]) == palm:
            return True
    return False


def _joint(model: mujoco.MjModel, body: int) -> str:
    return str(model.joint(int(model.body_jntadr[body])).name)


def _body_of(model: mujoco.MjModel, joint: str) -> int:
    return int(model.joint(joint).bodyid[0])


def _chain(model: mujoco.MjModel, first: int, own: Sequence[int]) -> tuple[int, ...]:
    """`first` and the moving bodies that follow it outwards; empty if they branch or are too many."""
    chain: list[int] = []
    after = [first]
    while len(after) == 1 and len(chain) <= DEEPEST:
        chain.append(after[0])
        top = int(model.body_weldid[chain[-1]])
        after = [one for one in own if int(model.body_weldid[model.body_parentid[one]]) == top]
    return () if after else tuple(chain)


def _jaws(points: LinkPoints, chains: Sequence[tuple[int, ...]]) -> tuple[Jaw, ...]:
    """The two farthest of the chains on one palm that move alike, or the only one; empty for others, as for
    three fingers. A linkage has more chains, shorter than the jaws."""
    every = [_jaw(points, chain) for chain in chains]
    if len(every) < 2:
        return tuple(every)
    alike = [
        pair for pair in combinations(every, 2)
        if pair[0].slides == pair[1].slides and abs(float(pair[0].axis @ pair[1].axis)) > PARALLEL
        and len(pair[0].joints) == len(pair[1].joints)
    ]  # fmt: skip
    if len(every) % 2 or not alike:
        return ()
    return max(alike, key=lambda pair: min(float(np.linalg.norm(one.tip - one.anchor)) for one in pair))


def _jaw(points: LinkPoints, chain: Sequence[int]) -> Jaw:
    model = points.compiled
    joints = [int(model.body_jntadr[body]) for body in chain]
    axes = [
        points.pose(body)[:3, :3] @ model.jnt_axis[joint] for body, joint in zip(chain, joints, strict=True)
    ]
    anchor = apply(points.pose(chain[0]), model.jnt_pos[joints[0]][None])[0]
    link = str(model.body(chain[-1]).name)
    tip = points.far_end(link, anchor)
    return Jaw(
        joints=tuple(str(model.joint(joint).name) for joint in joints), link=link,
        slides=bool(model.jnt_type[joints[0]] == mujoco.mjtJoint.mjJNT_SLIDE), axis=axes[0], anchor=anchor,
        tip=anchor if tip is None else tip, turns=tuple(float(axes[0] @ axis) for axis in axes),
    )  # fmt: skip


def _closing(
    points: LinkPoints, jaw: Jaw, jaws: Sequence[Jaw], facts: Mapping[str, JointFacts],
    fixed: Sequence[Array],
) -> Jaw:  # fmt: skip
    """The jaw with the sign with which it closes: at which end of its range its tip is nearer to the middle
    of the other jaw's way, or to the points `fixed` (n, 3) [m] of a fixed jaw."""
    ends = _range(jaw, facts)
    others = [
        np.mean([other.tip_at(place) for place in _range(other, facts)], axis=0)
        for other in jaws if other is not jaw
    ]  # fmt: skip
    targets = [np.array(others), *fixed] if others else [*fixed]
    way = float(np.linalg.norm(jaw.tip_at(ends[1]) - jaw.tip_at(ends[0])))
    if way < SHORTEST_WAY or not sum(map(len, targets)):
        name, unit = jaw.joints[0], "m" if jaw.slides else "rad"
        message = (
            f"{name}: its range of {ends[0]:.4g} to {ends[1]:.4g} {unit} opens its jaw by "
            f"{1e3 * way:.1f} mm; valid: at least {1e3 * SHORTEST_WAY:.0f} mm, and {RADIANS}"
            if way < SHORTEST_WAY
            else f"{name}: no shapes tell how its jaw closes; valid: a model with the shapes of the other jaw"
        )
        raise DescriptionError(points.source, [Fault(0, message)])
    near = np.concatenate([one for one in targets if len(one)])
    low, high = (float(np.linalg.norm(near - jaw.tip_at(place), axis=1).min()) for place in ends)
    return replace(jaw, closes=1.0 if high < low else -1.0)


def _range(jaw: Jaw, facts: Mapping[str, JointFacts]) -> tuple[float, float]:
    """Ends of the way of a jaw's first joint: its own, or those that its leader's give it."""
    one, slope, offset = facts[jaw.joints[0]], 1.0, 0.0
    if one.lower < one.upper:
        return one.lower, one.upper
    while one.follows and one.follows in facts:
        slope, offset = slope * one.multiplier, offset + slope * one.offset
        one = facts[one.follows]
    low, high = sorted((slope * one.lower + offset, slope * one.upper + offset))
    return low, high


def _extent(points: LinkPoints, own: Sequence[int]) -> float:
    places = np.array([points.pose(body)[:3, 3] for body in own])
    return float(np.ptp(places, axis=0).max())


def _check_loops(points: LinkPoints, joints: Sequence[str]) -> None:
    """Raises DescriptionError if an equality of an MJCF closes a loop through a link of the gripper."""
    model = points.compiled
    bodies = {_body_of(model, joint): joint for joint in joints}
    closing = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
    for equality in range(model.neq):
        ends = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        looped = [bodies[end] for end in ends if end in bodies]
        if (
            model.eq_type[equality] in closing
            and model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_BODY
            and looped
        ):
            message = (
                f"{' and '.join(looped)}: an equality closes a loop of links, and TCI takes trees only; "
                "valid: a model whose jaws follow their motor by joints' equalities, or by mimic in a URDF"
            )
            raise DescriptionError(points.source, [Fault(0, message)])
