"""Judges whether a description maps a model's joints as a person would, with separate rules.

The judge shares no code with the program that proposes descriptions. It derives the left, upward and forward
directions from the names and positions of the joints. It moves each generic joint by a small angle in MuJoCo
and checks the direction in which the limb moves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from tci.errors import TciError
from tci.messages.frames import Array
from tci.robot.description import GenericPart, Robot
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import bare_model

WORDS = {
    "leg": r"hip(?!s)|knee|ankle|thigh|shank|calf|leg(?!o)",
    "arm": r"shoulder|elbow|wrist|arm(?!at)|gripper",
    "head": r"head|neck",
    "torso": r"waist|torso|spine|trunk|lumbar",
    "other": r"wheel|caster|finger|thumb|toe|mouth|tongue|brow",
}
"""Words in joint names, by the kind of part that they indicate."""
OWN = {"arm": {"arm"}, "hand": {"arm"}, "leg": {"leg"}, "head": {"head"}, "torso": {"torso"}}
"""Kinds of part that the joint names of each part may indicate."""
PLAIN = {"elbow_pitch": "elbow", "knee_pitch": "knee", "ankle_pitch": "ankle", "ankle_roll": "ankle"}
"""Words that the names of the servos of these generic joints must contain, if the name of any joint of the
model contains the word."""
STEP = 0.1
"""Angle [rad] of a small motion."""
ALONG = 0.6
"""Least cosine between a motion and the expected motion. Assumed: hips are slanted by 37 degrees."""
AT_REST = 0.3
"""Least cosine between the upper arm and the downward direction, and between the forearm and the forward
direction, in the initial posture."""
FAR = np.deg2rad(120.0)
"""Largest difference between a shoulder joint's angle in the initial posture and the model's zero or the
middle of its range (the nearer of the two)."""
SPREAD = 0.06
"""Largest distance between the left wrist and the mirror image of the right wrist, as a fraction of the arm's
length."""


def told_kinds(text: str) -> set[str]:
    """Returns the kinds of part that a joint's name indicates."""
    return {kind for kind, words in WORDS.items() if re.search(words, text.lower())}


def told_side(text: str) -> str | None:
    """Returns the side that a joint's name indicates; None if the name indicates no side."""
    words = (
        r"(?i:left|right)|(?<![a-zA-Z])[lLrR](?=[^a-zA-Z0-9]|[A-Z][a-z]|ARM|LEG|HIP|SHO|ELB|KNEE|ANK)|"
        r"[_ ][lLrR](?![a-zA-Z0-9])|(?<=arm)[lr](?=_)"
    )
    found = re.search(words, text)
    return None if found is None else "left" if found[0].strip("_ ").lower()[0] == "l" else "right"


def complaints(robot: Robot, told: Sequence[str] = ()) -> list[str]:
    """Returns the faults of a description, one sentence per fault. `told` are notes on the description that a
    person has read."""
    judge = _Judge(robot)
    found = [*judge.names(), *judge.missing(told)]
    try:
        for part in robot.parts:
            found += judge.motions(part)
        found += judge.mirrored()
    except TciError as error:
        found.append(str(error))
    return found


def two_arms(path_joints: Sequence[str]) -> bool:
    """Returns True if, on each side, the names of at least four joints indicate an arm."""
    sides = [told_side(name) for name in path_joints if "arm" in told_kinds(name)]
    return min(sides.count("left"), sides.count("right")) >= 4


class _Judge:
    def __init__(self, robot: Robot) -> None:
        assert robot.model is not None
        self._robot = robot
        self._model = bare_model(robot.model)
        self._data = mujoco.MjData(self._model)
        self._at(np.zeros(len(robot.servos)))
        anchors = {}
        for part in self._arms():
            joints = [self._joint(part, place) for place in range(3)]
            anchors[part.side] = self._data.xanchor[joints].mean(axis=0)
        left, right = anchors["left"], anchors["right"]
        self._middle = (left + right) / 2.0
        massive = float(self._model.body_mass.sum()) > 0.0
        low = self._data.subtree_com[0] if massive else self._data.xpos[1:].mean(axis=0)
        self._left = _nearest_axis(left - right)
        upright = (self._middle - low) * (1.0 - np.abs(self._left))
        self._up = _nearest_axis(upright)
        self._ahead = np.cross(self._left, self._up)

    def names(self) -> Iterator[str]:
        """Yields joints whose names indicate another part or another side."""
        robot = self._robot
        every = " ".join(self._model.joint(joint).name for joint in range(self._model.njnt)).lower()
        for part in robot.parts:
            for generic in part.servos:
                if generic.servo is None or part.kind not in OWN:
                    continue
                name = str(robot.servos[generic.servo].joint)
                kinds = told_kinds(name)
                if kinds and not kinds & OWN[part.kind]:
                    yield f"{part.name} {generic.name}: {name} is named as a joint of {', '.join(kinds)}"
                if part.side and told_side(name) not in (None, part.side):
                    yield f"{part.name} {generic.name}: {name} is named as one of the other side"
                word = PLAIN.get(generic.name)
                if (
                    part.kind in ("arm", "leg")
                    and word
                    and word in every
                    and kinds
                    and word not in name.lower()
                ):
                    yield f"{part.name} {generic.name}: {name} is not named {word}, as others are"

    def missing(self, told: Sequence[str]) -> Iterator[str]:
        """Yields kinds of parts that the model's joint names indicate, but that neither the description nor a
        note mentions."""
        mapped = {
            str(self._robot.servos[one.servo].joint)
            for part in self._robot.parts
            for one in part.servos
            if one.servo is not None
        }
        text = " ".join(told)
        names = [self._model.joint(j).name for j in range(self._model.njnt)
                 if self._model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]  # fmt: skip
        for kind in ("leg", "head", "torso"):
            own = [name for name in names if told_kinds(name) == {kind}]
            has = any(name in mapped for name in own)
            if own and not has and not all(name in text for name in own):
                yield f"no {kind}, although the model has {', '.join(own)}, and no note says so"

    def motions(self, part: GenericPart) -> Iterator[str]:
        """Yields generic joints of a part that move the limb in another direction than their definition
        says."""
        check = {"arm": self._arm, "leg": self._leg, "hand": self._hand, "head": self._turns,
                 "torso": self._turns}.get(part.kind)  # fmt: skip
        if check is not None:
            yield from check(part)

    def mirrored(self) -> Iterator[str]:
        """Yields a fault if equal generic postures of the two arms are not mirror images of each other."""
        arms = {part.side: part for part in self._arms()}
        for posture in np.deg2rad([[10, 20, 0, 30, 0], [30, 30, 0, 60, 0], [60, 20, 20, 40, 0]]):
            ends, length = {}, 0.0
            for side, part in arms.items():
                shoulder, elbow, end = self._places(part, posture)
                ends[side] = end - self._middle
                length = float(np.linalg.norm(end - elbow) + np.linalg.norm(elbow - shoulder))
            image = ends["right"] - 2.0 * self._left * float(ends["right"] @ self._left)
            away = float(np.linalg.norm(ends["left"] - image))
            if away > SPREAD * length:
                angles = np.rad2deg(posture).round().astype(int).tolist()
                yield f"arms at {angles} degrees end {1e3 * away:.0f} mm from mirror images of each other"
                return

    def _arm(self, part: GenericPart) -> Iterator[str]:
        out = self._left if part.side == "left" else -self._left
        wanted = [
            ((0, 0, 0, 0, 0), -self._up, -self._up, "hang"),
            ((0, 0, 0, 90, 0), -self._up, self._ahead, "bend its elbow forward"),
            ((90, 0, 0, 0, 0), self._ahead, self._ahead, "point forward"),
            ((0, 90, 0, 0, 0), out, out, "point outward"),
            ((0, 0, 60, 90, 0), -self._up, 0.5 * self._ahead - 0.87 * out, "turn the forearm inward"),
        ]
        for angles, upper, fore, what in wanted:
            shoulder, elbow, end = self._places(part, np.deg2rad(angles))
            seen = _cosine(elbow - shoulder, upper), _cosine(end - elbow, fore)
            if min(seen) < ALONG:
                yield f"{part.name}: at {list(angles)} degrees it does not {what} (cosine {min(seen):.2f})"
        yield from self._initial(part)
        if part.servos[4].servo is not None:
            turn = self._turn(part, 4)
            if _cosine(turn, -self._up if part.side == "left" else self._up) < ALONG:
                yield f"{part.name} elbow_yaw: it does not turn the thumb inward"

    def _initial(self, part: GenericPart) -> Iterator[str]:
        """Yields faults of the initial posture: a forearm that does not point forward, or a joint that is far
        from its zero and from the middle of its range."""
        shoulder, elbow, end = self._places(part, np.array(part.initial_posture))
        seen = _cosine(elbow - shoulder, -self._up), _cosine(end - elbow, self._ahead)
        if min(seen) < AT_REST:
            yield f"{part.name}: the initial posture is not that of an arm that hangs with its forearm ahead"
        for generic in part.servos[:3]:
            assert generic.servo is not None
            limits = self._robot.servos[generic.servo].limits
            angle = self._data.qpos[self._model.joint(self._robot.servos[generic.servo].joint).qposadr[0]]
            rests = (0.0, ((limits.lower or 0.0) + (limits.upper or 0.0)) / 2.0)
            if min(abs(angle - rest) for rest in rests) > FAR:
                yield (
                    f"{part.name}: the initial posture turns {generic.name} by {np.rad2deg(angle):.0f} deg"
                )

    def _leg(self, part: GenericPart) -> Iterator[str]:
        out = self._left if part.side == "left" else -self._left
        wanted = {"hip_pitch": self._ahead, "hip_roll": out, "knee_pitch": -self._ahead}
        turns = {"hip_yaw": -self._up if part.side == "left" else self._up, "ankle_pitch": -self._left,
                 "ankle_roll": -self._ahead if part.side == "left" else self._ahead}  # fmt: skip
        yield from self._swings(part, wanted)
        for generic in part.servos:
            if generic.servo is None or generic.name not in turns:
                continue
            if _cosine(self._turn(part, generic.id), turns[generic.name]) < ALONG:
                yield f"{part.name} {generic.name}: it turns another way"

    def _hand(self, part: GenericPart) -> Iterator[str]:
        inward = -self._left if part.side == "left" else self._left
        yield from self._swings(part, {"flexion": inward, "deviation": self._ahead})

    def _turns(self, part: GenericPart) -> Iterator[str]:
        wanted = {"pitch": self._left, "roll": self._ahead, "yaw": self._up}
        for generic in part.servos:
            if generic.servo is None or generic.name not in wanted:
                continue
            turn = self._turn(part, generic.id)
            if part.kind == "torso" and not self._carries(
                part, generic.id, str(self._robot.model.torso_link)
            ):
                turn = -turn  # the joint moves the base, so the torso turns in the opposite direction
            if _cosine(turn, wanted[generic.name]) < ALONG:
                yield f"{part.name} {generic.name}: it turns another way"

    def _swings(self, part: GenericPart, wanted: dict[str, Array]) -> Iterator[str]:
        for generic in part.servos:
            if generic.servo is None or generic.name not in wanted:
                continue
            body = self._model.jnt_bodyid[self._joint(part, generic.id)]
            places = []
            for step in (0.0, STEP):
                self._posed({part.name: (generic.id, step)})
                places.append(self._far_end(int(body)))
            if _cosine(places[1] - places[0], wanted[generic.name]) < ALONG:
                yield f"{part.name} {generic.name}: it moves the limb another way"

    def _turn(self, part: GenericPart, place: int) -> Array:
        """Returns the rotation vector (3,) [rad] of the body that a generic joint moves, for a small rotation
        of this joint."""
        body = int(self._model.jnt_bodyid[self._joint(part, place)])
        frames = []
        for step in (0.0, STEP):
            self._posed({part.name: (place, step)})
            frames.append(self._data.xmat[body].reshape(3, 3).copy())
        R = frames[1] @ frames[0].T
        return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0

    def _posed(self, moved: dict[str, tuple[int, float]]) -> None:
        """Sets the parts to their generic zero angles, except for the joints in `moved`: part name to (joint
        index, angle [rad])."""
        position = np.zeros(len(self._robot.servos))
        for part in self._robot.parts:
            if part.kind not in ("arm", "leg", "hand", "head", "torso"):
                continue
            angles = np.zeros(len(part.servos))
            if part.name in moved:
                place, step = moved[part.name]
                angles[place] = step
            joints = joint_map(self._robot, part.name)
            position[joints.servos] = joints.to_robot(angles, position)
        self._at(position)

    def _places(self, part: GenericPart, posture: Array) -> tuple[Array, Array, Array]:
        """Returns shoulder, elbow and the arm's far end (3,) [m] at a generic posture."""
        position = np.zeros(len(self._robot.servos))
        joints = joint_map(self._robot, part.name)
        position[joints.servos] = joints.to_robot(posture, position)
        self._at(position)
        shoulder, elbow = self._joint(part, 2), self._joint(part, 3)
        along = self._data.xaxis[shoulder]
        bend = self._data.xanchor[elbow]
        # Both ends of the upper arm lie on the shoulder's third axis.
        start = self._data.xanchor[shoulder] + along * float(
            along @ (self._data.xanchor[self._joint(part, 0)] - self._data.xanchor[shoulder])
        )
        end = self._data.xanchor[shoulder] + along * float(along @ (bend - self._data.xanchor[shoulder]))
        return start, end, self._far_end(int(self._model.jnt_bodyid[elbow]))

    def _far_end(self, body: int) -> Array:
        """Returns the common centre of mass (3,) [m] of a body and all its descendants."""
        return np.array(self._data.subtree_com[body])

    def _carries(self, part: GenericPart, place: int, link: str) -> bool:
        body, carrier = self._model.body(link).id, int(self._model.jnt_bodyid[self._joint(part, place)])
        while body not in (0, carrier):
            body = int(self._model.body_parentid[body])
        return bool(body == carrier)

    def _joint(self, part: GenericPart, place: int) -> int:
        servo = part.servos[place].servo
        assert servo is not None
        return int(self._model.joint(self._robot.servos[servo].joint).id)

    def _arms(self) -> list[GenericPart]:
        return [part for part in self._robot.parts if part.kind == "arm"]

    def _at(self, position: Array) -> None:
        self._data.qpos[:] = 0.0
        for servo in self._robot.servos:
            if servo.joint:
                self._data.qpos[self._model.joint(servo.joint).qposadr[0]] = position[servo.index]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)


def _nearest_axis(vector: Array) -> Array:
    """Returns the axis (3,) of the model that is nearest to a direction."""
    axis = np.zeros(3)
    place = int(np.abs(vector).argmax())
    axis[place] = np.sign(vector[place])
    return axis


def _cosine(one: Array, other: Array) -> float:
    length = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / length if length > 1e-9 else 0.0
