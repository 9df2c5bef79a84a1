"""Simulated skin: converts contacts of the physics simulation to raw frames of all patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.messages import SkinFrame
from tci.messages.frames import Array, frozen
from tci.robot.description import Patch
from tci.simulation import sampling as at
from tci.simulation.imperfection import Imperfection, ImperfectTaxels
from tci.simulation.kernel import ROWS, width
from tci.simulation.physics import Physics, exclusive
from tci.simulation.touch import floor_sensor, skin_geom
from tci.skin.fill_factor import WIDTHS, fill_factors, is_surface
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface, tangents

_NEVER = int(np.iinfo(np.int64).max)
"""Number of the simulation step in which the next frame is due, for a world without skin. No world reaches
this number."""


class Taxels:
    """All patches of a world's skin, and the frames of these patches."""

    def __init__(
        self,
        physics: Physics,
        patches: Sequence[Patch],
        surfaces: Mapping[str, Surface],
        *,
        noise: float,
        imperfection: Imperfection | None,
        generator: np.random.Generator,
        hands: Array,
    ) -> None:
        self.worn = {patch.name: number for number, patch in enumerate(patches)}
        """Index of each patch in all arrays of this object, by the patch's name."""
        self._patches = patches
        self._physics = physics
        self._noise = noise
        self._generator = generator
        self._surfaces, self._imperfection = surfaces, imperfection
        self.noisy = noise > 0.0 or imperfection is not None
        """True if frames have noise or imperfections. The physics then pauses at each new frame, so that they
        can be added."""
        self._imperfect: list[ImperfectTaxels] = []
        self._rows = np.zeros(len(patches), at.PATCH)
        positions, taxels, channels, nodes = (
            [np.zeros((0, 3))],
            [np.zeros((0, 8))],
            [],
            [np.zeros((2, 0))],
        )
        floors = {one.name: one.adr[0] for one in map(physics.model.sensor, range(physics.model.nsensor))}
        for number, patch in enumerate(patches):
            surface, sensor = surfaces[patch.name], patch.sensor
            name, one = skin_geom(patch.name), self._rows[number]
            one["sensor"] = physics.model.sensor(name).adr[0]
            one["floor"] = floors.get(floor_sensor(patch.name), -1)
            one["body"] = physics.model.geom_bodyid[physics.model.geom(name).id]
            one["begin"] = sum(map(len, positions))
            one["end"] = one["begin"] + len(surface.positions)
            one["channel"] = sum(patch.channels for patch in patches[:number])
            one["node"] = sum(one.shape[1] for one in nodes)
            one["nodes"] = one["node"] + len(sensor.response)
            one["axes"] = sensor.axes
            x = tangents(surface.normals) if surface.tangents is None else surface.tangents
            shear = sensor.shear_pascal_per_count if sensor.axes == 3 else 1.0
            # A rigid plate distributes a force over all its taxels, at any distance.
            half = 0.5 * float(np.ptp(surface.positions, axis=0).max())
            outward = surface.normals.mean(axis=0)
            one["rest"], one["per_count"], one["shear_per_count"] = (
                sensor.rest,
                sensor.pascal_per_count,
                shear,
            )
            one["rate"], one["size"] = patch.rate * physics.step, half
            one["width"] = half if patch.rigid else width(surface.areas)
            one["outward"] = outward / max(float(np.linalg.norm(outward)), 1e-9)
            positions.append(surface.positions)
            kinds = _spread(surface), is_surface(surface)
            taxels.append(np.column_stack([x, np.cross(surface.normals, x), *kinds]))
            channels += surface.channels.tolist()
            nodes.append(np.array(sensor.response).reshape(-1, 2).T)
        count = sum(map(len, positions))
        self._lists = np.zeros((at.AROUND + at.SLOTS + 1, count), dtype=np.int64)
        for begin, end in self._rows[["begin", "end"]].tolist():
            self._lists[at.ALL, begin:end] = np.arange(end - begin)
        spots = np.full((len(patches) * (at.SLOTS + 1), 5), -np.inf)
        self._load = np.zeros((4, count))
        self._values = np.concatenate(
            [np.full(patch.channels, float(patch.sensor.rest)) for patch in patches] or [np.zeros(0)]
        )
        data = physics.data
        self.arrays = (
            physics.sensors, data.xpos, data.xmat, self._rows,
            np.concatenate(positions), np.concatenate(taxels), np.array(channels, dtype=np.int64),
            np.concatenate(nodes, axis=1), self._load, self._lists, spots,
            np.empty((ROWS + 1, max(9, count))), self._values, hands,
        )  # fmt: skip
        """Arguments of the loops in `sampling`."""
        # All frames at rest share one read-only array. A reader that recognises this array can skip its
        # values.
        self._sent = [number for number, patch in enumerate(patches) if not patch.through_joints]
        self._rest = [_raw(patch, np.full(patch.channels, patch.sensor.rest)) for patch in patches]
        self._frames: list[SkinFrame] = []
        self._latest: tuple[SkinFrame, ...] = ()
        self._until = -1

    @property
    def due(self) -> int:
        """Number of the step in which the next frame is taken. If the world has no skin, the number is the
        largest integer."""
        return int(self._rows["due"].min(initial=_NEVER))

    def reset(self) -> None:
        """Takes the first frame of each patch now. Raises TciError if a patch has more contacts at a time
        than its sensor can report."""
        self._physics.refresh()
        self._rows["count"] = -1
        for number in range(len(self._patches)):
            at.sample_now(number, self._physics.steps, self.arrays)
        if self._imperfection is not None:
            worn = (self._surfaces[patch.name] for patch in self._patches)
            self._imperfect = [ImperfectTaxels(surface, self._imperfection) for surface in worn]
        self._frames = [self._frame(number) for number in range(len(self._patches))]
        self._until = -1

    def frames(self) -> tuple[SkinFrame, ...]:
        """Returns the latest frame of every patch with taxels.

        All calls return one tuple object until a patch has a new frame. Raises TciError if a patch had more
        contacts at a time than its sensor can report.
        """
        if self._physics.steps >= self._until:
            frames = self._frames
            for number, count in enumerate(self._rows["count"].tolist()):
                if frames[number].sequence != count:
                    frames[number] = self._frame(number)
            self._latest = tuple([frames[number] for number in self._sent])
            self._until = self.due
        return self._latest

    def _frame(self, number: int) -> SkinFrame:
        """Returns the latest raw frame of the patch with index `number`."""
        patch, one = self._patches[number], self._rows[number]
        found, taken = int(one["touched"]), int(one["taken"]) * self._physics.step
        values = self._rest[number]
        if found or self.noisy:
            self._check(number, found)
            begin = int(one["channel"])
            counts = self._values[begin : begin + patch.channels].copy() if found else values.astype(float)
            if self._imperfect:
                self._distort(number, counts, taken)
            if self._noise and not patch.sensor.switch:
                counts += self._generator.normal(0.0, self._noise, len(counts))
            values = _raw(patch, counts)
        return SkinFrame(patch.name, taken, int(one["count"]), values)

    def _distort(self, number: int, counts: Array, now: float) -> None:
        """Applies the simulated imperfections of the taxels, for example creep and hysteresis, to the
        unrounded values `counts` (channels,) [counts] of one patch. The values of three-axis taxels change
        only along the normals."""
        patch = self._patches[number]
        channels, sign = (
            normal_channels(patch, self._surfaces[patch.name]),
            np.sign(patch.sensor.pascal_per_count),
        )
        pressed = sign * (counts[channels] - patch.sensor.rest)
        counts[channels] = patch.sensor.rest + sign * self._imperfect[number].signal(pressed, now)

    @exclusive
    def vectors(self, patch: str) -> Array:
        """Returns the current force (taxels, 3) [N] on each taxel of a patch.

        The components are along the taxel's own x and y axes, which are tangential to the skin, and along its
        inward normal. Raises TciError if the patch has more contacts than its sensor can report.
        """
        self._physics.refresh()
        number = self.worn[patch]
        begin, end = self._rows[["begin", "end"]][number].tolist()
        found = at.sample_now(number, -1, self.arrays)
        self._check(number, found)
        vectors = self._load[:3, : end - begin].T.copy()
        self._load[:] = 0.0
        return vectors

    @exclusive
    def unfelt(self) -> list[str]:
        """Returns the names of the patches that are touched now, but only at places without taxels."""
        self._physics.refresh()
        names = []
        for name, number in self.worn.items():
            if at.sample_now(number, -1, self.arrays) and not self._load[at.MARK].any():
                names.append(name)
            self._load[:] = 0.0
        return names

    def _check(self, number: int, found: int) -> None:
        if found > at.SLOTS:
            raise TciError(
                f"{found} contacts on {self._patches[number].name} at once; valid: up to {at.SLOTS}"
            )


@lru_cache(maxsize=64)
def _spread(surface: Surface) -> Array:
    """The area (n,) [m2] on which the force at each taxel acts: the taxel's area plus a part of the gaps
    around it."""
    column = float(np.interp(np.log(width(surface.areas)), np.log(WIDTHS), np.arange(len(WIDTHS))))
    low = min(int(column), len(WIDTHS) - 2)
    narrow, wide = fill_factors(surface)[:, low : low + 2].T
    spread: Array = surface.areas / (narrow + (column - low) * (wide - narrow))
    return spread


def _raw(patch: Patch, counts: Array) -> NDArray[np.generic]:
    """Returns the raw values (channels,) that the sensor sends: the values `counts` (channels,) [counts],
    rounded and limited to the sensor's range.
    """
    lowest, highest = patch.sensor.lowest, patch.sensor.highest
    small = 0.0 <= lowest <= highest <= 255.0
    rounded = np.minimum(np.maximum(np.rint(counts), lowest), highest)
    return frozen(rounded.astype(np.uint8 if small else np.int32))
