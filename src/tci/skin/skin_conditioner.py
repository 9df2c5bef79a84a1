"""From raw frames of a robot's patches to what its whole skin feels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import gt

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, UnknownNameError
from tci.frames import Array
from tci.messages import PatchState, SkinFrame
from tci.robot.description import Robot
from tci.robot.skin_files.calibration import PatchCalibration
from tci.skin.conditioning import Conditioner, ConditioningSettings, PatchHealth
from tci.skin.felt import NOBODY, FeltPatches
from tci.skin.octet_skin import OctetSkin
from tci.skin.shear import AXES, Shear, normal_channels
from tci.skin.surfaces import Surface

RESTART = 1.0
"""A frame with a lower sequence that is this much newer [s] means that its sender restarted. Ours."""


class SkinConditioner:
    """A `Conditioner` for each patch, and the fast way for those that send bytes."""

    def __init__(
        self,
        robot: Robot,
        surfaces: Mapping[str, Surface],
        *,
        settings: ConditioningSettings | None,
        calibrations: Mapping[str, PatchCalibration],
    ) -> None:
        """`surfaces` and `calibrations` by patch. Raises TciError for a calibration of another size."""
        self._robot = robot
        self.patches = {
            patch.name: Conditioner(
                patch,
                normal_channels(patch, surfaces[patch.name]),
                neighbours=surfaces[patch.name].neighbours,
                settings=settings,
                calibration=calibrations.get(patch.name),
                phase=0.5 * index / len(robot.patches),
            )
            for index, patch in enumerate(robot.patches)
        }
        """The conditioner of each patch by name."""
        self._shears = {
            patch.name: Shear(patch, surfaces[patch.name])
            for patch in robot.patches
            if patch.sensor.axes == AXES
        }
        self._places = {name: p for p, name in enumerate(self.patches)}
        self._areas = {name: surfaces[name].areas for name in self.patches}
        self.octets = OctetSkin(list(self.patches.values()), list(self._areas.values()))
        """The fast way for frames of bytes; it knows the force on all taxels."""
        self._others: Mapping[str, PatchState] = {}
        self._pressed = NOBODY
        self._known: list[str] = []
        self._arranged: tuple[list[str], list[int]] = [], []
        self.felt = FeltPatches(self._places, self._areas, {}, self.octets.masks, NOBODY, self._others)
        """What is felt now."""
        self.late = 0
        """Frames until now that came after a newer one."""

    @property
    def dropped(self) -> int:
        """Values until now that were not finite, or that a sensor can't send."""
        return sum(conditioner.dropped for conditioner in self.patches.values())

    @property
    def health(self) -> dict[str, PatchHealth]:
        """How much of each patch can be trusted, by its name."""
        octets, found = self.octets, {}
        octets.catch_up()
        for p, (name, conditioner) in enumerate(self.patches.items()):
            health = conditioner.health
            found[name] = replace(health, saturated=octets.saturated(p)) if octets.takes[p] else health
        return found

    def rezero(self, patch: str) -> None:
        """What a patch reads now is rest. Raises UnknownNameError for an unknown patch."""
        if patch not in self._places:
            raise UnknownNameError("skin patch", patch, self._places)
        self.octets.rezero(self._places[patch])

    def noticed(self, patches: Sequence[str]) -> tuple[Array, NDArray[np.bool_]]:
        """Pressure (n,) [Pa] from which each taxel of some patches feels something, infinite where it is not
        believed; and which (n,) are lively, so that their values never stay the same."""
        own = [self.patches[patch] for patch in patches]
        return np.concatenate([one.least for one in own]), np.concatenate([one.lively for one in own])

    def take(self, frames: Sequence[SkinFrame]) -> bool:
        """Feel what is newer than what is known of its patch; whether any frame is.

        Raises FrameError, and nothing has changed, for a frame that fits no patch.
        """
        names = [frame.patch for frame in frames]
        if names and names == self._known:
            before = [frame.sequence for frame in self.felt.frames.values()]
            if all(map(gt, [frame.sequence for frame in frames], before)):
                self._feel(names, frames)
                return True
        if fresh := self._newer(frames):
            self._feel([frame.patch for frame in fresh], fresh)
        return bool(fresh)

    def _newer(self, frames: Sequence[SkinFrame]) -> list[SkinFrame]:
        fresh, held = [], self.felt.frames
        for frame in frames:
            last = held.get(frame.patch)
            if last is None or frame.sequence > last.sequence or frame.stamp > last.stamp + RESTART:
                fresh.append(frame)
            else:
                self.late += frame.sequence < last.sequence
        return fresh

    def _feel(self, names: list[str], frames: Sequence[SkinFrame]) -> None:
        """Take frames of patches that have these names."""
        arranged, which = self._arranged
        if names != arranged:
            which = [self._place(name) for name in names]
            if len(set(which)) < len(which):
                for frame in frames:
                    self._feel([frame.patch], [frame])
                return
            self._arranged = names, which
        octets, quick = self.octets, frames
        slow: list[SkinFrame] = []
        if False in octets.takes:
            slow = [frame for frame, p in zip(frames, which, strict=True) if not octets.takes[p]]
            quick = [frame for frame, p in zip(frames, which, strict=True) if octets.takes[p]]
            which = [p for p in which if octets.takes[p]]
            self._check(slow)
        if which:
            pressed = octets.feel(which, [frame.values for frame in quick], [frame.stamp for frame in quick])
            if pressed is None:
                self._retire(quick)
                self._feel(names, frames)
                return
            self._pressed = pressed
        if slow:
            self._others = {**self._others, **{frame.patch: self._feel_other(frame) for frame in slow}}
        latest = dict(zip(names, frames, strict=True))
        if names != self._known:
            latest = {**self.felt.frames, **latest}
            self._known = list(latest)
        self.felt = FeltPatches(self._places, self._areas, latest, octets.masks, self._pressed, self._others)

    def _place(self, patch: str) -> int:
        place = self._places.get(patch)
        if place is None:
            valid = ", ".join(self._places) or "(none)"
            raise FrameError(f"{self._robot.name} has no skin patch {patch!r}; valid: {valid}")
        return place

    def _check(self, frames: Sequence[SkinFrame]) -> None:
        for frame in frames:
            self.patches[frame.patch].check(np.asarray(frame.values))

    def _retire(self, frames: Sequence[SkinFrame]) -> None:
        """Patches whose frames can't come the fast way go the other from now on."""
        misfits = [frame for frame in frames if not self.octets.fits(self._places[frame.patch], frame.values)]
        self._check(misfits)
        for frame in misfits:
            self.octets.retire(self._places[frame.patch])

    def _feel_other(self, frame: SkinFrame) -> PatchState:
        """A frame that does not come the fast way."""
        name = frame.patch
        conditioner, held = self.patches[name], self._others.get(name)
        pressure = conditioner.pressure(frame.values, frame.stamp)
        if held is not None and pressure is held.pressure:
            force = held.force
        else:
            force = pressure * self._areas[name]
            pressure.setflags(write=False)
            force.setflags(write=False)
        self.octets.put(self._places[name], force, frame.stamp)
        shear = self._shears.get(name)
        return PatchState(
            name, frame.stamp, frame.sequence, pressure, force, masked=conditioner.masked,
            vector=None if shear is None else shear.force(frame.values, pressure, frame.stamp),
        )  # fmt: skip
