"""Builds arrays with the data of all taxels of one robot. Skin conditioning and the search for contacts read
these arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.messages import Site
from tci.messages.frames import Array, frozen, read_only
from tci.robot.description import GenericPart, Patch, Robot, Segment, Sensor
from tci.robot.description.sensor import along
from tci.robot.generic_arm import SEGMENTS
from tci.robot.json_file import read_json
from tci.robot.kernels.limb import limb_numbers
from tci.robot.per_robot import per_robot
from tci.robot.skin_files.calibration import (
    PatchCalibration,
    SkinCalibration,
    calibration_path,
)
from tci.skin.fill_factor import WIDTHS, fill_factors
from tci.skin.kernels.arrays import BLOCK_SIZE, CHANNEL, TAXEL, Indices, LayoutArrays, Places
from tci.skin.surfaces import Surface, surfaces_of

AXES = 3
"""Number of values of a three-axis taxel: x and y along the skin, z outward."""
CELLS_PER_FACE = 8
"""Upper bound on the number of grid cells per face. Assumed: more cells need memory and save no time."""


def normal_channels(patch: Patch, surface: Surface) -> NDArray[np.intp]:
    """Returns, for each taxel, the index (n,) in the raw frame of the value that is measured along the
    normal.

    A three-axis taxel has three successive values: x and y along the skin, and z outward.
    """
    if patch.sensor.axes == 1:
        return surface.channels
    return read_only(AXES * surface.channels + 2, np.intp)


@dataclass(frozen=True, slots=True)
class SkinPatch:
    """Static description of one patch: its sensor, geometry, limb and calibration."""

    description: Patch
    """Description of the patch."""
    surface: Surface
    part: GenericPart
    segment: Segment | None
    """Segment of an arm on which the patch is; None for patches on other parts."""
    calibration: PatchCalibration | None = None
    """Measured rest values, noise and response. None means that the values of the description are used."""

    @property
    def channels(self) -> NDArray[np.intp]:
        """Index (n,) of each taxel's value in the raw frame. Three-axis taxels have three values: the index
        is that of the value along the normal."""
        return normal_channels(self.description, self.surface)

    @property
    def nodes(self) -> Array:
        """Deviation [counts] and pressure [Pa] (2, m) at the nodes of the sensor's response curve.

        The shape is (2, 0) if the response is linear.
        """
        measured = () if self.calibration is None else self.calibration.response
        response = measured or self.description.sensor.response
        return np.array(response).T.copy() if response else np.zeros((2, 0))

    @property
    def full(self) -> float:
        """Largest deviation [counts] that the sensor can send."""
        sensor = self.description.sensor
        rises = sensor.pascal_per_count > 0.0
        return sensor.highest - sensor.rest if rises else sensor.rest - sensor.lowest

    @property
    def gain(self) -> Array:
        """Factor (n,) by which a result of `response` is multiplied to give the taxel's pressure [Pa]."""
        linear = 1.0 if self.nodes.size else abs(self.description.sensor.pascal_per_count)
        measured = () if self.calibration is None else self.calibration.gain
        return linear * np.array(measured) if measured else np.full(len(self.channels), linear)

    def response(self, counts: Array) -> Array:
        """Applies the response curve of the sensor to deviations (n,) [counts] of the pressure values. The
        result (n,), multiplied by `gain`, is the pressure [Pa].

        The curve continues linearly beyond its last point.
        """
        return along(counts, *self.nodes) if self.nodes.size else counts


@dataclass(frozen=True, slots=True, eq=False)
class SkinLayout:
    """Static description of all taxels of one robot, built once from its description and calibration."""

    patches: tuple[SkinPatch, ...]
    """The patches (p,), in the robot's order."""
    sites: tuple[Site, ...]
    """Names that belong to each of the p patches: the patch, its part and its segment."""
    places: Mapping[str, int]
    """Index of each patch by its name."""
    links: tuple[str, ...]
    """Links (l,) that carry patches, and links of the patches' limb segments."""
    parts: tuple[str, ...]
    """Generic parts that have skin on their limbs."""
    segments: Places
    """Segment (p,) of each patch: 0 is the upper arm, 1 the forearm, -1 any other or no segment."""
    taxels: tuple[slice, ...]
    """Slice (p,) of each patch in arrays with one element per taxel of the whole skin."""
    channels: tuple[slice, ...]
    """Slice (p,) of each patch in the buffer of raw values."""
    starts: Places
    """Index (p + 1,) of each patch's first taxel within the whole skin; the last element is the number of
    taxels."""
    dtype: np.dtype[Any]
    """Dtype of raw values: uint8 if uint8 can represent the range of every sensor, else float32."""
    arrays: LayoutArrays

    @staticmethod
    def of_robot(robot: Robot, calibration: SkinCalibration | None = None) -> SkinLayout:
        """Builds the layout of a robot's skin with a `calibration`.

        If `calibration` is None, the file that `tci skin calibrate` wrote beside the description is used, if
        there is one. Raises TciError if the calibration does not fit the robot.
        """
        beside = calibration_path(Path(robot.source))
        if calibration is None and beside.is_file():
            calibration = read_json(beside, SkinCalibration)
        measured = {} if calibration is None else calibration.patches
        if calibration is not None and calibration.robot != robot.name:
            raise TciError(f"calibration of {calibration.robot!r}; valid: {robot.name!r}")
        for name in measured:
            robot.patch(name)
        return _layout(robot, measured) if measured else _as_described(robot)

    @staticmethod
    def of(patches: Iterable[SkinPatch]) -> SkinLayout:
        """Builds the layout of `patches`.

        Raises TciError if the calibration of a patch has another number of taxels than the patch.
        """
        patches = tuple(patches)
        for one in patches:
            if one.calibration is not None:
                one.calibration.check(len(one.channels))
        links = tuple(
            dict.fromkeys(link for one in patches for link in (one.description.link, _limb_link(one)))
        )
        parts = tuple(dict.fromkeys(one.description.part for one in patches if one.segment is not None))
        on = [
            (
                links.index(one.description.link),
                links.index(_limb_link(one)),
                0 if one.segment is None else parts.index(one.description.part),
            )
            for one in patches
        ]
        arrays = _arrays(patches, np.array(on, np.int64).reshape(-1, 3))
        descriptions = [one.description for one in patches]
        return SkinLayout(
            patches=patches,
            sites=tuple(Site(one.name, one.part, one.segment) for one in descriptions),
            places=MappingProxyType({one.name: p for p, one in enumerate(descriptions)}),
            links=links,
            parts=parts,
            segments=frozen(np.array([_segment(one.segment) for one in descriptions], np.int64)),
            taxels=_slices(arrays.begin[:, TAXEL]),
            channels=_slices(arrays.begin[:, CHANNEL]),
            starts=read_only(arrays.begin[:, TAXEL], np.int64),
            dtype=_dtype([one.sensor for one in descriptions]),
            arrays=arrays,
        )

    def __deepcopy__(self, memo: object) -> SkinLayout:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return SkinLayout.of, (self.patches,)  # unpickled arrays would be writable, another type to numba


def _layout(robot: Robot, measured: Mapping[str, PatchCalibration]) -> SkinLayout:
    return SkinLayout.of(
        SkinPatch(patch, surface, robot.part(patch.part), robot.limb_segment(patch), measured.get(patch.name))
        for patch, surface in zip(robot.patches, surfaces_of(robot), strict=True)
    )


@per_robot
def _as_described(robot: Robot) -> SkinLayout:
    """Returns the constant properties of all taxels of a robot, with the description's values and without
    calibration."""
    return _layout(robot, {})


def adjacency(count: int, pairs: NDArray[np.intp]) -> Indices:
    """Returns one array with the neighbours of each of `count` taxels. The neighbours of taxel i are at the
    places from `array[i]` to `array[i + 1] - 1`. `pairs` (m, 2) are the indices of neighbouring taxels, each
    pair once."""
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    starts = np.concatenate([[0], np.cumsum(np.bincount(one, minlength=count))]) + count + 1
    return np.concatenate([starts, other[np.lexsort((other, one))]]).astype(np.int32)


def _arrays(patches: Sequence[SkinPatch], on: Places) -> LayoutArrays:
    surfaces = [one.surface for one in patches]
    grids = [_grid(surface) for surface in surfaces]
    counts = [
        (
            len(surface.areas),
            one.description.channels,
            -(-len(surface.areas) // BLOCK_SIZE),
            len(grid[1]) - 1,
            one.nodes.shape[1],
        )
        for one, surface, grid in zip(patches, surfaces, grids, strict=True)
    ]
    begin = np.concatenate([np.zeros((1, 5), np.int64), np.cumsum(np.reshape(counts, (-1, 5)), axis=0)])
    starts = begin[:-1, TAXEL]
    neighbours = [surface.neighbours + start for surface, start in zip(surfaces, starts, strict=True)]
    faces = [surface.faces.reshape(-1, 3) + start for surface, start in zip(surfaces, starts, strict=True)]
    firsts = np.cumsum([0, *(len(one) for one in faces)])
    entries = [one[2] + first for one, first in zip(grids, firsts[:-1], strict=True)]
    cells = np.cumsum([0, *_joined([np.diff(one[1]) for one in grids], 0)])
    channels = [one.channels + start for one, start in zip(patches, begin[:-1, CHANNEL], strict=True)]
    made = LayoutArrays(
        begin=begin.astype(np.int64),
        sensor=np.array([_sensor(one) for one in patches], np.float32).reshape(-1, 5),
        rate=np.array([one.description.rate for one in patches], np.float64),
        channel=_joined(channels, 0).astype(np.int64),
        span=np.array([span for own in channels for span in _spans(own)], np.int64).reshape(-1, 3),
        gain=_joined([one.gain for one in patches], 0),
        nodes=np.concatenate([np.zeros((2, 0)), *(one.nodes for one in patches)], axis=1),
        taxel=_joined([np.column_stack([s.positions, s.normals, s.areas]) for s in surfaces], (0, 7)),
        fill=_joined([_fill(one) for one in patches], (0, len(WIDTHS))),
        graph=adjacency(int(begin[-1, TAXEL]), _joined(neighbours, (0, 2)).astype(np.intp)),
        faces=_joined(faces, (0, 3)).astype(np.int32),
        box=np.array([one[0] for one in grids], np.float64).reshape(-1, 7),
        cells=np.concatenate([cells + len(cells), _joined(entries, 0)]).astype(np.int32),
        limb=np.array(
            [np.zeros(15) if p.segment is None else limb_numbers(p.part, p.segment) for p in patches]
        ).reshape(-1, 15),
        on=on,
    )
    return LayoutArrays(*(frozen(np.ascontiguousarray(array)) for array in made))


def _fill(one: SkinPatch) -> Array:
    """Returns the fill factor (n, w) around each taxel of a patch, for touches of w widths.

    The fill factors are 1 for a patch on which touches are detected through joint torques.
    """
    if one.description.through_joints:
        return np.ones((len(one.surface.areas), len(WIDTHS)))
    return fill_factors(one.surface)


def _joined(arrays: Sequence[NDArray[Any]], shape: int | tuple[int, ...]) -> NDArray[Any]:
    """Concatenates arrays. Without arrays, returns an empty array of `shape`."""
    return np.concatenate(arrays) if len(arrays) else np.zeros(shape)


def _slices(bounds: Places) -> tuple[slice, ...]:
    return tuple(slice(begin, end) for begin, end in pairwise(bounds.tolist()))


def _limb_link(one: SkinPatch) -> str:
    return one.description.link if one.segment is None else one.segment.link


def _segment(name: str) -> int:
    return SEGMENTS.index(name) if name in SEGMENTS else -1


def _dtype(sensors: Sequence[Sensor]) -> np.dtype[Any]:
    octets = all(one.lowest >= 0.0 and one.highest <= 255.0 for one in sensors)
    return np.dtype(np.uint8 if octets else np.float32)


def _sensor(patch: SkinPatch) -> tuple[float, float, float, float, float]:
    """Returns the properties of a patch's sensor: lowest and highest raw value, rest value, polarity (-1 if
    pressure decreases the raw values, else 1), and largest deviation [counts]."""
    one = patch.description.sensor
    return one.lowest, one.highest, one.rest, float(np.sign(one.pascal_per_count)), patch.full


def _spans(channels: NDArray[np.intp]) -> list[tuple[int, int, bool]]:
    """Returns for each block of up to 64 taxels of a patch: smallest channel, largest channel + 1, and True
    if the channels of successive taxels are consecutive."""
    blocks = [channels[first : first + BLOCK_SIZE] for first in range(0, len(channels), BLOCK_SIZE)]
    return [
        (int(own.min()), int(own.max()) + 1, np.array_equal(own, own[0] + np.arange(len(own))))
        for own in blocks
    ]


def _grid(surface: Surface) -> tuple[Array, Places, Places]:
    """Returns a grid of cells around a surface, which makes the search of the nearest face fast.

    The result consists of three arrays: lowest corner [m], cells per metre, and number of cells along x, y
    and z (7,); the place (cells + 1,) in the third array at which each cell's faces begin; and the indices of
    the faces, cell by cell.
    """
    if not len(surface.faces):
        return np.zeros(7), np.zeros(1, np.int64), np.zeros(0, np.int64)
    corners = surface.positions[surface.faces]
    low, high = surface.positions.min(axis=0), surface.positions.max(axis=0)
    # A cell is about as wide as a face's longest edge.
    size = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1).mean())
    while (shape := np.floor((high - low) / size) + 1.0).prod() > CELLS_PER_FACE * len(corners) + 64:
        size *= 1.25
    scale, cells = 1.0 / size, shape.astype(np.int64)
    first, last = (
        np.minimum(((ends - low) * scale).astype(np.int64), cells - 1)
        for ends in (corners.min(axis=1), corners.max(axis=1))
    )
    # Each face lies in all cells that its bounding box reaches into.
    extent = last - first + 1
    counts = extent.prod(axis=1)
    face = np.repeat(np.arange(len(corners)), counts)
    step = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    _, wide, deep = extent[face].T
    x, y, z = first[face].T + np.array([step // (wide * deep), step // deep % wide, step % deep])
    cell = (x * cells[1] + y) * cells[2] + z
    starts = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=int(cells.prod())))])
    return np.concatenate([low, [scale], shape]), starts, face[np.argsort(cell, kind="stable")]
