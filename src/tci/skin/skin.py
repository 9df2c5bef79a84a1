"""The generic skin: taxels as places in space and on the limb, whatever robot they sit on (eq. 3)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, TciError, UnknownNameError
from tci.frames import Array, apply, invert, transform
from tci.messages import JointReading, Reading, SkinState
from tci.robot.description import GenericPart, Robot, Segment
from tci.robot.generic_arm import limb_coordinates, segment_rotation
from tci.robot.joint_map import generic_posture
from tci.robot.kinematics import Kinematics
from tci.robot.link_poses import SkinLinks
from tci.robot.skin_files.calibration import SkinCalibration, calibration_path, read_calibration
from tci.skin.conditioning import ConditioningSettings, PatchHealth
from tci.skin.felt import FeltPatches
from tci.skin.kernels.flat import FlatPatch
from tci.skin.kernels.flat_skin import FlatSkin
from tci.skin.skin_conditioner import SkinConditioner
from tci.skin.surfaces import Surface, build_surface

FrameName = Literal["link", "limb", "torso"]
"""Where positions are seen from: the patch's link, its segment's frame S, or the torso."""


class Skin:
    """The whole skin of one robot."""

    def __init__(
        self,
        robot: Robot,
        *,
        conditioning: ConditioningSettings | None = None,
        calibration: SkinCalibration | None = None,
    ) -> None:
        """Build the surface of every patch; `conditioning` says how frames become pressures, and
        `calibration` what was measured about the taxels; None: what `tci skin calibrate` wrote beside the
        description, if it did.

        Raises TciError for a calibration that does not fit the robot, and what Kinematics and build_surface
        raise.
        """
        beside = calibration_path(Path(robot.source))
        if calibration is None and beside.is_file():
            calibration = read_calibration(beside)
        measured = {} if calibration is None else calibration.patches
        if calibration is not None and calibration.robot != robot.name:
            raise TciError(f"calibration of {calibration.robot!r}; valid: {robot.name!r}")
        for name in measured:
            robot.patch(name)
        self.robot = robot
        self.kinematics = Kinematics(robot)
        self.surfaces: Mapping[str, Surface] = MappingProxyType(
            {patch.name: build_surface(robot, patch, self.kinematics) for patch in robot.patches}
        )
        """Taxels of every patch, in its link, by patch name."""
        self.conditioner = SkinConditioner(robot, self.surfaces, settings=conditioning, calibrations=measured)
        self.octets = self.conditioner.octets
        """Of the latest frames: the force on all taxels."""
        self._flat: dict[str, FlatPatch] = {}
        self._flat_skin: FlatSkin | None = None
        self._flat_of: object = None
        links = [(robot.limb_segment(patch) or patch).link for patch in robot.patches]
        both = [link for patch, limb in zip(robot.patches, links, strict=True) for link in (patch.link, limb)]
        self._links = SkinLinks(robot, self.kinematics, dict.fromkeys(both))
        self._joints: JointReading | None = None
        self._state = SkinState(patches=self.felt, link_poses=MappingProxyType({}))

    @property
    def felt(self) -> FeltPatches:
        """The patches of the latest state."""
        return self.conditioner.felt

    @property
    def state(self) -> SkinState:
        """What `update` returned last; without patches before the first call."""
        return self._state

    @property
    def counts(self) -> dict[str, int]:
        """What was not used until now: `values_dropped` and `frames_late`."""
        return {"values_dropped": self.conditioner.dropped, "frames_late": self.conditioner.late}

    @property
    def health(self) -> dict[str, PatchHealth]:
        """How much of each patch can be trusted, by its name."""
        return self.conditioner.health

    def flat(self, patch: str) -> FlatPatch:
        """A patch as the compiled loops read it. Raises KeyError for an unknown patch."""
        flat, surface = self._flat.get(patch), self.surfaces[patch]
        if flat is None or flat.surface is not surface:
            words = self.robot.patch(patch)
            segment = self.robot.limb_segment(words)
            flat = self._flat[patch] = FlatPatch.of(surface, words, self.robot.part(words.part), segment)
        return flat

    def flat_skin(self) -> FlatSkin:
        """All patches as the compiled loops read them, in the robot's order."""
        if self._flat_skin is None or self._flat_of is not self.surfaces:
            patches = [patch for patch in self.robot.patches if patch.name in self.surfaces]
            self._flat_skin = FlatSkin.of(patches, [self.flat(patch.name) for patch in patches])
            self._flat_of = self.surfaces
        return self._flat_skin

    def rezero(self, patch: str) -> None:
        """What a patch reads now is rest. Raises UnknownNameError for an unknown patch."""
        self.conditioner.rezero(patch)

    def update(self, reading: Reading) -> SkinState:
        """What the skin feels now. A patch that has not sent yet is absent.

        Of frames out of order the newest stays. When nothing is new the state is the same object.
        Raises FrameError, and keeps the state as it was, when frames or joints do not fit the robot.
        """
        joints = reading.joints
        if joints.position.shape != (len(self.robot.servos),):
            got, expected = joints.position.shape, (len(self.robot.servos),)
            raise FrameError(f"joints of {self.robot.name}: position of shape {got}, expected {expected}")
        fresh = self.conditioner.take(reading.skin)
        poses = self._state.link_poses
        if joints is not self._joints:
            poses, self._joints = self._links.poses(joints.position), joints
        elif not fresh:
            return self._state
        self._state = SkinState(self.conditioner.felt, poses)
        return self._state

    def learn(self) -> None:
        """Learn half of one lesson that has ended, if one has: for a period without a new frame.

        It would be learnt from at the next frame anyway, with the same result.
        """
        self.octets.learn()

    def is_now(self, flat: FlatSkin, state: SkinState) -> bool:
        """Whether a state is the latest, and `flat` the whole skin: it is `felt` and `octets` then."""
        return state is self._state and len(flat.force) == len(self.octets.force)

    def noticed(self, flat: FlatSkin) -> tuple[Array, NDArray[np.bool_]]:
        """Pressure (n,) [Pa] from which each of the skin's taxels feels something, infinite where it is not
        believed; and which (n,) are lively, so that their values never stay the same."""
        return self.conditioner.noticed([site.patch for site in flat.sites])

    def positions(self, patch: str, joints: JointReading, *, frame: FrameName = "link") -> Array:
        """Taxel positions (taxels, 3) [m] at the present posture (eq. 3).

        Raises UnknownNameError for an unknown patch or frame.
        """
        return apply(self._pose(patch, joints, frame), self.surfaces[patch].positions)

    def normals(self, patch: str, joints: JointReading, *, frame: FrameName = "link") -> Array:
        """Outward unit normals (taxels, 3) of the taxels at the present posture.

        Raises UnknownNameError for an unknown patch or frame.
        """
        rotation = self._pose(patch, joints, frame)[:3, :3]
        normals: Array = self.surfaces[patch].normals @ rotation.T
        return normals

    def limb(self, patch: str, joints: JointReading) -> tuple[Array, Array, Array]:
        """u, theta [rad] and r [m] (taxels,) of the taxels on their segment (eq. 3, x = u L).

        Raises UnknownNameError for an unknown patch, TciError for one that is on no limb.
        """
        points_S = self.positions(patch, joints, frame="limb")
        words = self.robot.patch(patch)
        part = self.robot.part(words.part)
        length = part.segment(words.segment).length
        u, theta = limb_coordinates(points_S, length, _side(part))
        return u, theta, np.hypot(points_S[:, 0], points_S[:, 1])

    def link_pose(self, link: str, joints: JointReading) -> Array:
        """`T_TL` (4, 4) of any link of the model. Raises UnknownNameError."""
        return self.kinematics.poses(joints.position, (link,))[link]

    def segment_pose(self, part: str, segment: str, joints: JointReading, posture: Array) -> Array:
        """`T_TS` (4, 4) of a part's segment at the generic angles `posture` (n,) [rad].

        Raises UnknownNameError for an unknown part or segment, TciError for one that is on no limb.
        """
        words = self.robot.part(part)
        place = words.segment(segment)
        return segment_pose(words, place, self.link_pose(place.link, joints), posture)

    def _pose(self, patch: str, joints: JointReading, frame: FrameName) -> Array:
        """Pose (4, 4) of the patch's link, seen from `frame`."""
        words = self.robot.patch(patch)
        if frame == "link":
            return np.eye(4)
        T_TL = self.link_pose(words.link, joints)
        if frame == "torso":
            return T_TL
        if frame != "limb":
            raise UnknownNameError("frame", frame, ("link", "limb", "torso"))
        if self.robot.limb_segment(words) is None:
            raise TciError(f"skin patch {patch!r} is on no limb; valid frames: link, torso")
        posture = generic_posture(self.robot, joints)[words.part]
        T_TS = self.segment_pose(words.part, words.segment, joints, posture)
        pose: Array = invert(T_TS) @ T_TL
        return pose


def segment_pose(part: GenericPart, segment: Segment, T_TL: Array, posture: Array) -> Array:
    """`T_TS` (4, 4) of a segment, from the pose of the link that its origin is given in.

    S does not turn with the segment's own axial rotation: iCub's forearm skin turns with pronation,
    NAO's sleeve does not, and (u, theta) must mean the same place of the body on both. Raises TciError for
    a part that is no arm.
    """
    if part.kind != "arm" or part.side is None:
        raise TciError(f"the {segment.name} of {part.name} is on no generic limb; valid: segments of an arm")
    R_MS = segment_rotation(segment.name, posture, _side(part), axial=False)
    return transform(part.R_TM @ R_MS, apply(T_TL, np.array(segment.origin)))


def _side(part: GenericPart) -> Literal["left", "right"]:
    assert part.side is not None  # Robot.limb_segment
    return part.side
