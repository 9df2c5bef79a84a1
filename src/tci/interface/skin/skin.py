"""The generic skin: taxels as places in space and on the limb, whatever robot they sit on (eq. 3)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, TciError, UnknownNameError
from tci.frames import Array, apply, invert, transform
from tci.interface.kernels.flat import FlatPatch
from tci.interface.kernels.flat_skin import FlatSkin
from tci.interface.kernels.whole import TAXEL
from tci.interface.part import generic_posture
from tci.interface.skin.conditioning import Conditioner, ConditioningSettings, PatchHealth
from tci.interface.skin.felt import Felt, FeltPatches
from tci.interface.skin.octet_skin import OctetSkin
from tci.interface.skin.shear import AXES, Shear, normal_channels
from tci.messages import JointReading, PatchState, Reading, SkinFrame, SkinState
from tci.model.description import GenericPart, Robot, Segment
from tci.model.generic_arm import limb_coordinates, segment_rotation
from tci.model.kinematics import Kinematics
from tci.model.skin.calibration import SkinCalibration, calibration_path, read_calibration
from tci.model.surfaces import Surface, build_surface

FrameName = Literal["link", "limb", "torso"]
"""Where positions are seen from: the patch's link, its segment's frame S, or the torso."""

RESTART = 1.0
"""A frame with a lower sequence that is this much newer [s] means that its sender restarted. Ours."""


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
        self._conditioners = {
            patch.name: Conditioner(
                patch,
                normal_channels(patch, self.surfaces[patch.name]),
                neighbours=self.surfaces[patch.name].neighbours,
                settings=conditioning,
                calibration=measured.get(patch.name),
                phase=0.5 * index / len(robot.patches),
            )
            for index, patch in enumerate(robot.patches)
        }
        self._shears = {
            patch.name: Shear(patch, self.surfaces[patch.name])
            for patch in robot.patches
            if patch.sensor.axes == AXES
        }
        self.octets = OctetSkin(
            list(self._conditioners.values()), [self.surfaces[name].areas for name in self._conditioners]
        )
        """The fast way for frames of bytes."""
        self._index = {name: p for p, name in enumerate(self._conditioners)}
        self._areas = [self.surfaces[name].areas for name in self._conditioners]
        self._felt: dict[str, Felt] = {}
        self._usual: list[tuple[str, np.dtype[Any], tuple[int, ...]]] = []
        self._taken: list[bool] = []
        self._which: list[int] = []
        self._flat: dict[str, FlatPatch] = {}
        self._flat_skin: FlatSkin | None = None
        self._flat_of: object = None
        segments = [robot.limb_segment(patch) for patch in robot.patches]
        links = [patch.link for patch in robot.patches] + [one.link for one in segments if one is not None]
        self._links = tuple(dict.fromkeys(links))
        self._late = 0
        self._joints: JointReading | None = None
        self._state = SkinState(patches=MappingProxyType({}), link_poses=MappingProxyType({}))

    @property
    def state(self) -> SkinState:
        """What `update` returned last; without patches before the first call."""
        return self._state

    @property
    def counts(self) -> dict[str, int]:
        """What was not used until now: `values_dropped` and `frames_late`."""
        dropped = sum(conditioner.dropped for conditioner in self._conditioners.values())
        return {"values_dropped": dropped, "frames_late": self._late}

    @property
    def health(self) -> dict[str, PatchHealth]:
        """How much of each patch can be trusted, by its name."""
        octets, found = self.octets, {}
        octets.catch_up()
        for p, (name, conditioner) in enumerate(self._conditioners.items()):
            health = conditioner.health
            found[name] = replace(health, saturated=octets.saturated(p)) if octets.takes[p] else health
        return found

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
        if patch not in self._conditioners:
            raise UnknownNameError("skin patch", patch, self._conditioners)
        self.octets.rezero(self._index[patch])

    def update(self, reading: Reading) -> SkinState:
        """What the skin feels now. A patch that has not sent yet is absent.

        Of frames out of order the newest stays. When nothing is new the state is the same object.
        Raises FrameError, and keeps the state as it was, when frames or joints do not fit the robot.
        """
        got, expected = reading.joints.position.shape, (len(self.robot.servos),)
        if got != expected:
            raise FrameError(f"joints of {self.robot.name}: position of shape {got}, expected {expected}")
        fresh = self._fresh(reading.skin)
        if not fresh and reading.joints is self._joints:
            return self._state
        patches = self._state.patches
        if fresh:
            self._felt = {**self._felt, **self._feel(fresh)}
            patches = FeltPatches(self._felt)
        poses = self._state.link_poses
        if reading.joints is not self._joints:
            poses = MappingProxyType(self.kinematics.poses(reading.joints.position, self._links))
            for pose in poses.values():
                pose.setflags(write=False)
        self._joints = reading.joints
        self._state = SkinState(patches=patches, link_poses=poses)
        return self._state

    def learn(self) -> None:
        """Learn from one lesson that has ended, if one has: for a period without a new frame, which has time.

        It would be learnt from at the next frame anyway, with the same result.
        """
        self.octets.learn()

    def force_now(
        self, flat: FlatSkin, state: SkinState
    ) -> tuple[Array, NDArray[np.int32], NDArray[np.int64]]:
        """Force (n,) [N] on the skin's taxels in a state, the `active` (n,) ones of each patch and how many
        (p,) they are, see `OctetSkin`; of other states than the latest -1, where nobody knows."""
        if state is self._state and len(flat.force) == len(self.octets.force):
            return self.octets.force, self.octets.active, self.octets.counts
        flat.force[:] = 0.0
        for p, site in enumerate(flat.sites):
            felt = state.patches.get(site.patch)
            if felt is not None:
                flat.force[flat.begins[p, TAXEL] :][: len(felt.force)] = felt.force
        return flat.force, self.octets.active[:0], np.full(len(flat.sites), -1, np.int64)

    def noticed(self, flat: FlatSkin) -> tuple[Array, NDArray[np.bool_]]:
        """Pressure (n,) [Pa] from which each of the skin's taxels feels something, infinite where it is not
        believed; and which (n,) are lively, so that their values never stay the same."""
        own = [self._conditioners[site.patch] for site in flat.sites]
        return np.concatenate([one.least for one in own]), np.concatenate([one.lively for one in own])

    def _fresh(self, frames: Iterable[SkinFrame]) -> list[SkinFrame]:
        """Those that are newer than what is known of their patch."""
        fresh, held = [], self._felt
        for frame in frames:
            before = held.get(frame.patch)
            if before is None or frame.sequence > before.sequence or frame.stamp > before.stamp + RESTART:
                fresh.append(frame)
            else:
                self._late += frame.sequence < before.sequence
        return fresh

    def _feel(self, frames: list[SkinFrame]) -> dict[str, Felt]:
        octets, felt = self.octets, dict[str, Felt]()
        kinds = [(frame.patch, frame.values.dtype, frame.values.shape) for frame in frames]
        quick = frames
        if kinds != self._usual or octets.takes != self._taken:
            quick, felt = self._tell_apart(frames)
            if not felt:
                self._usual, self._taken = kinds, octets.takes.copy()
                self._which = [self._index[frame.patch] for frame in frames]
        which = self._which if quick is frames else [self._index[frame.patch] for frame in quick]
        if which:
            taxels, pressure, ends, again = octets.feel(
                which, [frame.values for frame in quick], [frame.stamp for frame in quick]
            )
            begin, conditioners, areas = 0, octets.conditioners, self._areas
            for p, frame, end, same in zip(which, quick, ends[1:], again, strict=True):
                name, masked = frame.patch, conditioners[p].masked
                if same:
                    felt[name] = self._felt[name].again(frame.stamp, frame.sequence, masked)
                else:
                    felt[name] = Felt(
                        name, frame.stamp, frame.sequence, masked, taxels, pressure, begin, end, areas[p]
                    )
                begin = end
        return felt

    def _tell_apart(self, frames: list[SkinFrame]) -> tuple[list[SkinFrame], dict[str, Felt]]:
        """Those that may come the fast way, all of them if it is so; what the others make feel."""
        octets, felt, quick = self.octets, {}, []
        for frame in frames:
            p = self._index.get(frame.patch)
            if p is None:
                valid = ", ".join(self._conditioners) or "(none)"
                raise FrameError(f"{self.robot.name} has no skin patch {frame.patch!r}; valid: {valid}")
            raw = frame.values
            if octets.takes[p] and raw.dtype == np.uint8 and raw.shape == (octets.channels[p],):
                quick.append(frame)
            else:
                self._conditioners[frame.patch].check(np.asarray(raw))
                octets.retire(p)
                felt[frame.patch] = self._feel_other(p, frame)
        return (quick, felt) if felt else (frames, felt)

    def _feel_other(self, p: int, frame: SkinFrame) -> Felt:
        """A frame that does not come the fast way."""
        conditioner, held = self._conditioners[frame.patch], self._felt.get(frame.patch)
        pressure = conditioner.pressure(frame.values, frame.stamp)
        if held is not None and pressure is held.state.pressure:
            force = held.state.force
        else:
            force = pressure * self._areas[p]
            pressure.setflags(write=False)
            force.setflags(write=False)
            self.octets.put(p, force)
        shear = self._shears.get(frame.patch)
        state = PatchState(
            frame.patch, frame.stamp, frame.sequence, pressure, force, masked=conditioner.masked,
            vector=None if shear is None else shear.force(frame.values, pressure, frame.stamp),
        )  # fmt: skip
        return Felt.of(state)

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

        Raises UnknownNameError for an unknown part or segment.
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
    NAO's sleeve does not, and (u, theta) must mean the same place of the body on both.
    """
    R_MS = segment_rotation(segment.name, posture, _side(part), axial=False)
    return transform(part.R_TM @ R_MS, apply(T_TL, np.array(segment.origin)))


def _side(part: GenericPart) -> Literal["left", "right"]:
    assert part.side is not None  # Robot.limb_segment
    return part.side
