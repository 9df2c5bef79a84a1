"""The skin of a robot without its other parts: raw frames are converted to pressure on each patch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tci.messages import Contacts, JointReading, Reading, SkinState
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.joint_map import generic_posture
from tci.robot.skin_files.calibration import SkinCalibration
from tci.skin.conditioning import Conditioner
from tci.skin.contacts import ContactFinder, ContactSettings
from tci.skin.isolated import IsolatedSettings
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin

AT_ONCE = ContactSettings(isolated=IsolatedSettings(wait=1e-9, frames=1e-9))
"""Settings that accept isolated taxels in their first frame."""


@dataclass(frozen=True, eq=False)
class PatchFelt:
    """All taxels of one patch that has sent a frame."""

    stamp: float
    sequence: int
    pressure: Array
    force: Array
    masked: np.ndarray
    vector: Array | None


class FeltSkin(Skin):
    """The skin of a robot and its conditioning."""

    def __init__(
        self,
        robot: Robot,
        *,
        calibration: SkinCalibration | None = None,
    ) -> None:
        super().__init__(robot)
        self.layout = SkinLayout.of_robot(robot, calibration)
        self.conditioner = Conditioner(self.layout)

    def update(self, reading: Reading) -> dict[str, PatchFelt]:
        self.conditioner.step(reading.skin)
        return patches(self, self.conditioner.state)


def patches(skin: Skin, state: SkinState) -> dict[str, PatchFelt]:
    """Returns the patches that have sent a frame, by name."""
    found = {}
    for p, patch in enumerate(skin.robot.patches):
        if np.isnan(state.stamp[p]):
            continue
        pressure = state.on(p)
        own, active = slice(*state.taxels[p : p + 2]), slice(*state.begin[p : p + 2])
        vector = None
        if state.vector is not None and patch.sensor.axes == 3:
            vector = np.zeros((len(pressure), 3))
            vector[state.active[active]] = state.vector[active]
        found[patch.name] = PatchFelt(
            float(state.stamp[p]),
            int(state.sequence[p]),
            pressure,
            pressure * skin.surfaces[patch.name].areas,
            np.zeros(len(pressure), bool) if state.masked is None else state.masked[own],
            vector,
        )
    return found


def skin_state(
    layout: SkinLayout, pressures: Mapping[str, Array], *, stamp: float = 0.0, sequence: int = 0
) -> SkinState:
    """Returns a skin state with these pressures (taxels,) [Pa]. Patches that are not named have sent no
    frame."""
    dense = [pressures.get(site.patch, np.zeros(0)) for site in layout.sites]
    active = [np.flatnonzero(one > 0.0) for one in dense]
    sent = np.array([site.patch in pressures for site in layout.sites])
    return SkinState(
        taxels=layout.starts,
        stamp=np.where(sent, stamp, np.nan),
        sequence=np.where(sent, sequence, -1),
        begin=np.cumsum([0, *map(len, active)]),
        active=np.concatenate([np.zeros(0), *active]).astype(np.int32),
        pressure=np.concatenate([np.zeros(0), *(one[own] for one, own in zip(dense, active, strict=True))]),
    )


def contacts_of(
    skin: FeltSkin,
    state: SkinState,
    joints: JointReading,
    *,
    settings: ContactSettings = AT_ONCE,
    finder: ContactFinder | None = None,
    posture: Mapping[str, Array] | None = None,
) -> Contacts:
    """Returns the contacts in a single state, or the next contacts of a `finder` that has seen earlier
    states."""

    def poses() -> Array:
        return skin.kinematics.pose_array(joints.position, skin.layout.links)

    finder = finder or ContactFinder(skin.layout, settings)
    posture = generic_posture(skin.robot, joints) if posture is None else posture
    return finder.find(state, skin.conditioner.estimates, poses, posture)
