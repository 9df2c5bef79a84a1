"""The generic skin: taxels as points in space and on the generic limb, for any robot (eq. 3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from tci.errors import TciError, UnknownNameError
from tci.messages import JointReading
from tci.messages.frames import Array, apply, invert, transform
from tci.robot.description import GenericPart, Segment
from tci.robot.generic_arm import limb_coordinates, segment_rotation
from tci.robot.joint_map import generic_posture
from tci.robot.kinematics import KinematicChain
from tci.robot.like import RobotLike, as_robot
from tci.skin.surfaces import Surface, surfaces_of

FrameName = Literal["link", "limb", "torso"]
"""Reference frame of positions: "link" is the frame of the patch's link, "limb" the frame S of its segment,
"torso" the torso frame."""


class Skin:
    """The whole skin of one robot. The object is immutable. The methods have the posture as an argument."""

    def __init__(self, robot: RobotLike) -> None:
        """Builds the surface of every patch.

        Raises DescriptionError if the robot has no valid model, or if a patch does not fit the model or its
        own files. Raises UnknownNameError if the model lacks the link or a frame of a patch.
        """
        robot = as_robot(robot)
        self.robot = robot
        self.kinematics = KinematicChain(robot)
        self.surfaces: Mapping[str, Surface] = {one.patch: one for one in surfaces_of(robot)}
        """Surface of each patch, in the frame of the patch's link, by patch name."""

    def positions(self, patch: str, joints: JointReading, *, frame: FrameName = "link") -> Array:
        """Returns taxel positions (taxels, 3) [m] at the posture `joints` (eq. 3).

        Raises UnknownNameError for an unknown patch or frame.
        """
        return apply(self._pose(patch, joints, frame), self.surfaces[patch].positions)

    def normals(self, patch: str, joints: JointReading, *, frame: FrameName = "link") -> Array:
        """Returns outward unit normals (taxels, 3) at the posture `joints`.

        Raises UnknownNameError for an unknown patch or frame.
        """
        rotation = self._pose(patch, joints, frame)[:3, :3]
        normals: Array = self.surfaces[patch].normals @ rotation.T
        return normals

    def limb(self, patch: str, joints: JointReading) -> tuple[Array, Array, Array]:
        """Returns u, theta [rad] and r [m] of the taxels on their limb segment (eq. 3; u is x divided by the
        segment's length).

        Each array has the shape (taxels,). Raises UnknownNameError for an unknown patch. Raises TciError for
        a patch that is not on a limb.
        """
        points_S = self.positions(patch, joints, frame="limb")
        description = self.robot.patch(patch)
        part = self.robot.part(description.part)
        length = part.segment(description.segment).length
        u, theta = limb_coordinates(points_S, length, _side(part))
        return u, theta, np.hypot(points_S[:, 0], points_S[:, 1])

    def link_pose(self, link: str, joints: JointReading) -> Array:
        """Returns the pose `T_TL` (4, 4) of any link of the model in the torso frame. Raises UnknownNameError
        for an unknown link."""
        return self.kinematics.poses(joints.position, (link,))[link]

    def segment_pose(self, part: str, segment: str, joints: JointReading, posture: Array) -> Array:
        """Returns `T_TS` (4, 4), the pose of a part's segment in the torso frame, at the generic angles
        `posture` (n,) [rad].

        Raises UnknownNameError for an unknown part or segment. Raises TciError for a segment without a
        generic limb.
        """
        description = self.robot.part(part)
        place = description.segment(segment)
        return segment_pose(description, place, self.link_pose(place.link, joints), posture)

    def _pose(self, patch: str, joints: JointReading, frame: FrameName) -> Array:
        """Returns the pose (4, 4) of a patch's link in `frame`: in its own frame (`link`), in the frame of
        the limb segment (`limb`), or in the torso frame (`torso`)."""
        description = self.robot.patch(patch)
        if frame == "link":
            return np.eye(4)
        T_TL = self.link_pose(description.link, joints)
        if frame == "torso":
            return T_TL
        if frame != "limb":
            raise UnknownNameError("frame", frame, ("link", "limb", "torso"))
        if self.robot.limb_segment(description) is None:
            raise TciError(f"skin patch {patch!r} is on no limb; valid frames: link, torso")
        posture = generic_posture(self.robot, joints)[description.part]
        T_TS = self.segment_pose(description.part, description.segment, joints, posture)
        pose: Array = invert(T_TS) @ T_TL
        return pose


def segment_pose(part: GenericPart, segment: Segment, T_TL: Array, posture: Array) -> Array:
    """Returns the pose (4, 4) of a segment's frame S in the torso frame.

    `T_TL` is the pose of the link to which the segment's origin refers. The frame S does not turn when the
    segment rotates about its axis. The reason: iCub's forearm skin turns with pronation, but NAO's sleeve
    does not turn. With a frame S that does not turn, (u, theta) means one place of the body on both robots.
    Raises TciError if the part is not an arm.
    """
    if part.kind != "arm" or part.side is None:
        raise TciError(f"the {segment.name} of {part.name} is on no generic limb; valid: segments of an arm")
    R_MS = segment_rotation(segment.name, posture, _side(part), axial=False)
    return transform(part.R_TM @ R_MS, apply(T_TL, np.array(segment.origin)))


def _side(part: GenericPart) -> Literal["left", "right"]:
    assert part.side is not None  # `Robot.limb_segment` ensures this
    return part.side
