"""How a robot looks at a point: with its neck, or with its waist if it has no neck."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tci.body.retreat import Retreat
from tci.errors import CommandError
from tci.messages.frames import Array, apply, invert, read_only, rotation_rpy, transform
from tci.robot.description import GenericPart, Robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.skin.skin import Skin

PITCH, YAW = 0, 2
"""Generic joints of a head and of a torso."""
FINE = 1e-3
"""Angle [rad] at which the gaze counts as on the point."""
AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of eyes that look along x, in the torso frame: to the right, down, ahead."""
STEPS = 12
"""Newton steps; from anywhere four or five are enough, unless a limit is in the way."""
STRIDE = 0.6
"""Longest Newton step [rad]: a longer one goes past a point that is near the eyes."""

SHARES = 11
"""Postures of a motion at which distances are computed."""
ROOM = 1e-6
"""Distance [rad] from the limits at which targets stay, so that no rounding makes the gate clamp them."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """How a robot looks at a point."""

    part: str
    """Generic part that turns: a head, or a torso, which turns about its yaw axis only."""
    target: Array
    """Generic angles (n,) [rad] with which it looks there, or as nearly as its limits permit."""
    off: float
    """Angle [rad] between gaze and point now. Of a torso, the angle between their bearings."""
    left: float
    """Angle [rad] between gaze and point that is left at `target`."""


class Gaze:
    """Where one robot looks from, and what turns its gaze. The object is immutable."""

    def __init__(self, skin: Skin, retreat: Retreat) -> None:
        robot = skin.robot
        self._robot, self._skin, self._chain, self._retreat = robot, skin, skin.kinematics, retreat
        self._root = self._chain.links[0]
        at_root = {*self._chain.chain(self._root)}
        # what is between the root and a patch: the servos that move it in space
        moving = {patch.name: {*self._chain.chain(patch.link)} ^ at_root for patch in robot.patches}
        self.carried: Mapping[str, frozenset[str]] = {
            part.name: frozenset(
                name
                for name, servos in moving.items()
                if servos & {*joint_map(robot, part.name).servos.tolist()}
            )
            for part in robot.parts
        }
        """Patches that a motion of a part carries along in space, by its name."""
        limits = [one.limits for one in robot.servos]
        lower = [-np.inf if one.lower is None else one.lower + ROOM for one in limits]
        upper = [np.inf if one.upper is None else one.upper - ROOM for one in limits]
        self._limits = np.array([lower, upper])
        heads = [part for part in robot.parts if part.kind == "head"]
        self.part, self._free, self.level = _turns(robot, heads)
        """Name of the part that turns the gaze; empty if the robot has none. True if it turns only the
        bearing."""
        self._link, self._xyz, pitch = _eyes(robot, heads, self._chain)
        position = np.array(initial_position(robot))
        for part in heads:
            joints = joint_map(robot, part.name)
            position[joints.servos] = joints.to_robot(np.zeros(len(part.servos)), position)
        straight = self._chain.poses(position, [self._link])[self._link][:3, :3]
        self._forward = straight[0]
        self._T_LC = transform(straight.T @ rotation_rpy(0.0, pitch, 0.0) @ AHEAD, self._xyz)

    def eyes(self, position: Array) -> Array:
        """Pose `T_TC` (4, 4) of the eyes in the torso frame, with servo angles `position` (n_servos,) [rad].
        Axes of C: x to the right, y down, z where the robot looks."""
        pose: Array = self._chain.poses(position, [self._link])[self._link] @ self._T_LC
        return pose

    def look(self, position: Array, point: Array) -> Look:
        """How to look at `point` (3,) [m] in the torso frame, which stays where it is in space, from servo
        angles `position` (n_servos,) [rad]. Raises CommandError for a robot without neck and waist."""
        if not self.part:
            raise CommandError(f"{self._robot.name} has neither a neck nor a waist to look around with")
        if point.shape != (3,) or not np.isfinite(point).all():
            raise CommandError(f"a look at {point}; valid: a finite point (3,) [m] in the torso frame")
        p_R = apply(invert(self._chain.poses(position, [self._root])[self._root]), point)
        angles = joint_map(self._robot, self.part).to_generic(position)
        here = miss = self._miss(position, p_R)
        for _ in range(STEPS):
            if np.linalg.norm(miss) <= FINE:
                break
            stepped, place = self._step(position, p_R, angles, miss)
            better = self._miss(place, p_R)
            if np.linalg.norm(better) > np.linalg.norm(miss) - 1e-6:
                break
            angles, miss = stepped, better
        return Look(self.part, read_only(angles), float(np.linalg.norm(here)), float(np.linalg.norm(miss)))

    def nearest(self, position: Array, part: str, target: Array, point: Array) -> Array:
        """Distances (SHARES,) [m] between `point` (3,) [m], in the torso frame now and at rest in space, and
        the skin that `part` carries along, at equal steps of its motion to `target` (n,) [rad]."""
        p_R = apply(invert(self._chain.poses(position, [self._root])[self._root]), point)
        patches = [one for one in self._robot.patches if one.name in self.carried[part]]
        surfaces = [self._skin.surfaces[one.name].positions for one in patches]
        servos, way, _ = self._retreat.fastest(position, part, target)
        found = np.full(SHARES, np.inf)
        for k, share in enumerate(np.linspace(0.0, 1.0, SHARES)):
            place = position.copy()
            place[servos] += share * way
            T_TR, *poses = self._chain.pose_array(place, (self._root, *[one.link for one in patches]))
            p_T = apply(T_TR, p_R)
            for T_TL, points in zip(poses, surfaces, strict=True):
                apart = np.linalg.norm(points - apply(invert(T_TL), p_T), axis=1)
                found[k] = min(found[k], apart.min(initial=np.inf))
        return found

    def _step(self, position: Array, p_R: Array, angles: Array, miss: Array) -> tuple[Array, Array]:
        """Generic angles and servo angles after a Newton step; a joint at its limit is left out of it."""
        free = list(self._free)
        while True:
            columns = []
            for joint in free:
                turned = angles.copy()
                turned[joint] += 1e-4
                columns.append((self._miss(self._placed(position, turned), p_R) - miss) / 1e-4)
            step = np.zeros(len(angles))
            if free:
                step[free] = -np.linalg.lstsq(np.array(columns).T, miss, rcond=1e-3)[0]
            step *= min(1.0, STRIDE / max(float(np.abs(step).max()), 1e-9))
            asked = angles + step
            place = self._within(position, asked)
            there = joint_map(self._robot, self.part).to_generic(place)
            stuck = [k for k in free if abs(there[k] - asked[k]) > 1e-6 and abs(there[k] - angles[k]) < 1e-6]
            if not stuck or len(free) == len(stuck):
                return there, place
            free = [k for k in free if k not in stuck]

    def _placed(self, position: Array, angles: Array) -> Array:
        joints = joint_map(self._robot, self.part)
        place = position.copy()
        place[joints.servos] = joints.to_robot(angles, position)
        return place

    def _within(self, position: Array, angles: Array) -> Array:
        servos, way, _ = self._retreat.fastest(position, self.part, angles)
        place = position.copy()
        place[servos] = np.clip(place[servos] + way, *self._limits[:, servos])
        return place

    def _miss(self, position: Array, p_R: Array) -> Array:
        """Rotation vector (3,) [rad] in the torso frame that turns the gaze to a point (3,) in the root's
        frame."""
        T_TL, T_TR = self._chain.pose_array(position, (self._link, self._root))
        gaze, way = T_TL[:3, :3] @ self._forward, apply(T_TR, p_R) - apply(T_TL, self._xyz)
        if self.level:
            gaze[2] = way[2] = 0.0
        axis = np.cross(gaze, way)
        sine = float(np.linalg.norm(axis))
        angle = np.arctan2(sine, float(gaze @ way))
        if sine < 1e-9:
            return np.array([0.0, 0.0, angle])
        turn: Array = axis * (angle / sine)
        return turn


def _turns(robot: Robot, heads: list[GenericPart]) -> tuple[str, tuple[int, ...], bool]:
    """The part that turns the gaze, its joints that do, and whether they turn only the bearing."""
    torsos = [part for part in robot.parts if part.kind == "torso"]
    for parts, useful in ((heads, (YAW, PITCH)), (torsos, (YAW,))):
        for part in parts:
            own = tuple(k for k in useful if k < len(part.servos) and part.servos[k].servo is not None)
            if YAW in own:
                return part.name, own, useful == (YAW,)
    return "", (), False


def _eyes(robot: Robot, heads: list[GenericPart], chain: KinematicChain) -> tuple[str, Array, float]:
    """Link and point (3,) [m] from which the robot looks, and the pitch [rad] of its camera. Where the
    description doesn't tell, it is the origin of the last link that the head moves, or of the torso's."""
    for part in heads:
        if part.eyes is not None:
            return part.eyes.link, np.array(part.eyes.xyz), part.eyes.pitch
    own = {servo for part in heads for servo in joint_map(robot, part.name).servos.tolist()}
    ends = [
        link for link in chain.links if own and own <= {*chain.chain(link)} and chain.chain(link)[-1] in own
    ]
    assert robot.model is not None
    return (ends or [robot.model.torso_link])[0], np.zeros(3), 0.0
