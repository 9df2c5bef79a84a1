"""The skin of one robot with all that changes: conditioning, the latest frames, and what is felt now."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, TciError
from tci.frames import Array
from tci.messages import JointReading, Reading, SkinState
from tci.robot.description import Robot
from tci.robot.kinematics import LinkPoses
from tci.robot.skin_files.calibration import SkinCalibration, calibration_path, read_calibration
from tci.skin.conditioning import ConditioningSettings, PatchHealth
from tci.skin.felt import FeltPatches
from tci.skin.kernels.flat import FlatPatch
from tci.skin.kernels.flat_skin import FlatSkin
from tci.skin.skin import Skin
from tci.skin.skin_conditioner import SkinConditioner


class LiveSkin(Skin):
    """Turns frames into what the skin feels. One owner: `tci.Perceiver`."""

    def __init__(
        self,
        robot: Robot,
        *,
        conditioning: ConditioningSettings | None = None,
        calibration: SkinCalibration | None = None,
        skin: Skin | None = None,
    ) -> None:
        """Takes over the surfaces of `skin`, or builds them; `conditioning` says how frames become pressures,
        and `calibration` what was measured about the taxels; None: what `tci skin calibrate` wrote beside the
        description, if it did.

        Raises TciError for a calibration that does not fit the robot, and what `Skin` raises.
        """
        beside = calibration_path(Path(robot.source))
        if calibration is None and beside.is_file():
            calibration = read_calibration(beside)
        measured = {} if calibration is None else calibration.patches
        if calibration is not None and calibration.robot != robot.name:
            raise TciError(f"calibration of {calibration.robot!r}; valid: {robot.name!r}")
        for name in measured:
            robot.patch(name)
        super().__init__(robot, surfaces=None if skin is None else skin.surfaces)
        self.conditioner = SkinConditioner(robot, self.surfaces, settings=conditioning, calibrations=measured)
        self.octets = self.conditioner.octets
        """Of the latest frames: the force on all taxels."""
        self._flat: dict[str, FlatPatch] = {}
        self._flat_skin: FlatSkin | None = None
        self._flat_of: object = None
        links = [(robot.limb_segment(patch) or patch).link for patch in robot.patches]
        both = [link for patch, limb in zip(robot.patches, links, strict=True) for link in (patch.link, limb)]
        self._links = tuple(dict.fromkeys(both))
        self._joints: JointReading | None = None
        self._state = SkinState(patches=self.felt, link_poses={})
        self._sequence = self._state.sequence
        self._masks: tuple[NDArray[np.bool_], ...] = ()
        self._all_masked: NDArray[np.bool_] | None = None

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
        if fresh:
            self._sequence = np.array([frame.sequence for frame in self.felt.frames.values()], np.int64)
        poses = self._state.link_poses
        if joints is not self._joints:
            poses, self._joints = LinkPoses(self.kinematics, self._links, joints.position), joints
        elif not fresh:
            return self._state
        self._state = SkinState(self.conditioner.felt, poses, self._masked(), self._sequence)
        return self._state

    def _masked(self) -> NDArray[np.bool_] | None:
        """Taxels (n,) of all patches that are not trusted; None if there are none."""
        masks = self.felt.masks
        if masks is not self._masks:
            self._masks = masks
            self._all_masked = np.concatenate(masks) if any(mask.any() for mask in masks) else None
        return self._all_masked

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
