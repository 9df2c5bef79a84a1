"""Flat patches of skin, without a robot."""

from __future__ import annotations

import numpy as np

from tci.messages import SkinFrame, SkinState
from tci.robot.catalogue import load_robot
from tci.robot.description import Patch, Sensor
from tci.robot.skin_files.calibration import PatchCalibration
from tci.skin.conditioning import Conditioner, ConditioningSettings
from tci.skin.layout import SkinLayout, SkinPatch
from tci.skin.surfaces import Surface

NAO = load_robot("nao")
PATCH = NAO.patch("left_forearm")
PITCH = 0.01


def skin_patch(
    sensor: Sensor,
    channels: np.ndarray,
    *,
    name: str = "skin",
    width: int | None = None,
    neighbours: np.ndarray | None = None,
    rate: float = PATCH.rate,
    segment: str = "forearm",
    calibration: PatchCalibration | None = None,
) -> SkinPatch:
    """Returns a patch whose taxels lie in a row, in a frame with `width` values."""
    count = len(channels)
    description = PATCH.model_copy(
        update={
            "name": name, "sensor": sensor, "rate": rate, "segment": segment,
            "channels": (sensor.axes * (int(channels.max(initial=0)) + 1)) if width is None else width,
        }
    )  # fmt: skip
    pairs = np.zeros((0, 2), np.intp) if neighbours is None else neighbours
    place = np.arange(count, dtype=float)[:, None] * [PITCH, 0.0, 0.0]
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    surface = Surface(
        name, description.link, place, normals, np.full(count, PITCH**2), np.asarray(channels, np.intp),
        pairs, np.zeros((0, 3), np.intp),
    )  # fmt: skip
    return SkinPatch(description, surface, NAO.part(PATCH.part), None, calibration)


def dense(state: SkinState, layout: SkinLayout, p: int) -> np.ndarray:
    """Returns the pressure (n,) [Pa] on all taxels of a patch."""
    own = slice(*state.begin[p : p + 2])
    pressure = np.zeros(len(layout.patches[p].surface.areas))
    pressure[state.active[own]] = state.pressure[own]
    return pressure


class OnePatch:
    """A conditioner of a single patch, which accepts raw values."""

    def __init__(self, patch: SkinPatch, settings: ConditioningSettings | None = None) -> None:
        self.whole = Conditioner(SkinLayout.of([patch]), settings or ConditioningSettings())
        self.patch: Patch = patch.description
        self.sequence = 0
        (self.estimator,) = self.whole.estimators
        self.baseline = self.estimator.baseline

    def pressure(self, values: np.ndarray, stamp: float = 0.0) -> np.ndarray:
        self.sequence += 1
        self.whole.step([SkinFrame(self.patch.name, stamp, self.sequence, values)])
        return dense(self.whole.state, self.whole.layout, 0)

    def rezero(self) -> None:
        self.whole.rezero(self.patch.name)

    @property
    def health(self):
        return self.whole.health[self.patch.name]

    @property
    def masked(self) -> np.ndarray:
        masked = self.whole.state.masked
        return np.zeros(len(self.whole.layout.arrays.taxels), bool) if masked is None else masked

    @property
    def dropped(self) -> int:
        return self.whole.dropped
