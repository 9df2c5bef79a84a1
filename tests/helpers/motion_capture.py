"""Motion capture of a person, written by the test itself in the dialects of ten programs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from tci.messages.frames import Array, rotation_x
from tci.robot.generic_arm import Side, forearm_rotation, upper_arm_rotation

FILE_FROM_TORSO = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Axes of the made BVH file: x left, y up, z forward, as in most BVH files."""


@dataclass(frozen=True)
class Convention:
    """Names and axes of an arm's joints in the motion capture of one manufacturer."""

    collar: str
    arm: tuple[str, str, str]
    """Names of the joints; {side} stands for Left or Right, {s} and {S} for its first letter."""
    order: str = "ZXY"
    places: str = ""
    """What position channels of all joints mean beside OFFSET: `added` to it, `instead` of it, or `alone`
    where it is zero. Empty if only the root has such channels."""
    along_x: bool = False
    """True if each bone is along the x axis of its own joint, so that zero angles are no pose of a person."""


CONVENTIONS = {
    "Mixamo": Convention("mixamorig:{side}Shoulder", ("mixamorig:{side}Arm", "mixamorig:{side}ForeArm",
                                                     "mixamorig:{side}Hand")),
    "CMU": Convention("{side}Shoulder", ("{side}Arm", "{side}ForeArm", "{side}Hand"), order="ZYX"),
    "Perception Neuron": Convention("Robot_{side}Shoulder", ("Robot_{side}Arm", "Robot_{side}ForeArm",
                                                            "Robot_{side}Hand"), order="YXZ", places="added"),
    "Biovision": Convention("{side}Collar", ("{side}Shoulder", "{side}Elbow", "{side}Wrist")),
    "Poser": Convention("{s}Collar", ("{s}Shldr", "{s}ForeArm", "{s}Hand"), order="XZY"),
    "Blender": Convention("shoulder.{S}", ("upper_arm.{S}", "forearm.{S}", "hand.{S}"), places="instead"),
    "Unreal": Convention("clavicle_{s}", ("upperarm_{s}", "lowerarm_{s}", "hand_{s}"), places="alone"),
    "3ds Max": Convention("Bip {S} Clavicle", ("Bip {S} UpperArm", "Bip {S} Forearm", "Bip {S} Hand")),
    "Kinect": Convention("Clavicle{side}", ("Shoulder{side}", "Elbow{side}", "Wrist{side}")),
    "short": Convention("Shoulder_{S}", ("Arm_{S}", "LowerArm_{S}", "Hand_{S}")),
}  # fmt: skip


def bvh(angles: Array, *, rest: float, convention: Convention = CONVENTIONS["Mixamo"]) -> str:
    """Returns motion capture of a person whose arms have the generic angles `angles` (k, 5) [rad].

    In the rest pose the arms are raised by `rest` [rad] from hanging.
    """
    order, kind = convention.order, convention.places
    turning = " ".join(f"{axis}rotation" for axis in order)
    six = f"CHANNELS 6 Xposition Yposition Zposition {turning}"
    own = six if kind else f"CHANNELS 3 {turning}"
    sides: dict[Side, float] = {"left": 1.0, "right": -1.0}
    size = {"": 1.0, "added": 1.0, "instead": -1.3, "alone": 0.0}[kind]

    def axes(direction: ArrayLike) -> Array:
        """Rotation of a joint whose bone points in this direction."""
        turn = Rotation.align_vectors([direction], [[1.0, 0.0, 0.0]])[0] if convention.along_x else None
        return np.eye(3) if turn is None else turn.as_matrix()

    def text(offset: Array) -> str:
        return "OFFSET " + " ".join(f"{x:.9f}" for x in offset)

    up = axes([0.0, 1.0, 0.0])
    spine = up.T @ [0.0, 40.0, 0.0]
    lines = ["HIERARCHY", "ROOT Hips", "{", "OFFSET 0 90 0", six, "JOINT Spine", "{", text(size * spine), own]
    arms = {}
    for side, sign in sides.items():
        limb = FILE_FROM_TORSO @ rotation_x(sign * rest) @ [0.0, 0.0, -1.0]
        places = [[sign * 4.0, 6.0, 0.0], [sign * 14.0, 2.0, 0.0], 28.0 * limb, 25.0 * limb, 8.0 * limb]
        frames = [up, *map(axes, places[1:])]
        offsets = [frame.T @ place for frame, place in zip(frames, places, strict=True)]
        names = [
            name.format(side=side.title(), s=side[0], S=side[0].upper())
            for name in (convention.collar, *convention.arm)
        ]
        for bone, offset in zip(names, offsets, strict=False):
            lines += [f"JOINT {bone}", "{", text(size * offset), own]
        lines += ["End Site", "{", text(offsets[-1]), *"}}}}}"]
        arms[side] = (frames, offsets)
    lines += ["}", "}", "MOTION", f"Frames: {len(angles)}", "Frame Time: 0.05"]
    for index, posture in enumerate(angles):
        lean = Rotation.from_euler("ZXY", [3.0 * index, 10.0, -2.0 * index], degrees=True).as_matrix()

        def values(turn: Array, offset: ArrayLike) -> list[float]:
            place = np.asarray(offset, np.float64) * (kind != "added")
            euler = Rotation.from_matrix(turn).as_euler(order, degrees=True)
            return [*(place if kind else []), *euler]

        row = [1.0 * index, 90.0, 5.0, *Rotation.from_matrix(lean @ up).as_euler(order, degrees=True)]
        row += values(np.eye(3), spine)
        for side, (frames, offsets) in arms.items():
            zero = np.array([0.0, rest, 0.0, 0.0, 0.0])
            turns = [np.eye(3)] * 2 + [
                FILE_FROM_TORSO
                @ turned(posture, side, axial=axial)
                @ turned(zero, side, axial=axial).T
                @ FILE_FROM_TORSO.T
                for turned, axial in (
                    (upper_arm_rotation, True),
                    (forearm_rotation, False),
                    (forearm_rotation, True),
                )
            ]
            whole = [turn @ frame for turn, frame in zip(turns, frames, strict=True)]
            for before, after, offset in zip(whole, whole[1:], offsets, strict=False):
                row += values(before.T @ after, offset)
        lines.append(" ".join(f"{value:.9f}" for value in row))
    return "\n".join(lines)
