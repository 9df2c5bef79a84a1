"""Builds arrays with the data of all taxels of one robot. Skin conditioning and the search for contacts read
these arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
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
from tci.robot.kernels.limb import limb_record
from tci.robot.like import RobotLike, as_robot
from tci.robot.per_robot import per_robot
from tci.robot.skin_files.calibration import (
    PatchCalibration,
    SkinCalibration,
    calibration_path,
)
from tci.skin.fill_factor import WIDTHS, fill_factors
from tci.skin.kernels.arrays import PATCH, TAXEL, Indices, LayoutArrays, Places, Records
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
    def of_robot(robot: RobotLike, calibration: SkinCalibration | None = None) -> SkinLayout:
        """Builds the layout of a robot's skin with a `calibration`.

        If `calibration` is None, the file that `tci skin calibrate` wrote beside the description is used, if
        there is one. Raises TciError if the calibration does not fit the robot.
        """
        robot = as_robot(robot)
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
        arrays = _arrays(patches, links, parts)
        descriptions = [one.description for one in patches]
        return SkinLayout(
            patches=patches,
            sites=tuple(Site(one.name, one.part, one.segment) for one in descriptions),
            places=MappingProxyType({one.name: p for p, one in enumerate(descriptions)}),
            links=links,
            parts=parts,
            segments=frozen(np.array([_segment(one.segment) for one in descriptions], np.int64)),
            taxels=_slices(arrays.patches, "taxel"),
            channels=_slices(arrays.patches, "channel"),
            starts=read_only([*arrays.patches["taxel"], len(arrays.taxels)], np.int64),
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


def _arrays(patches: Sequence[SkinPatch], links: Sequence[str], parts: Sequence[str]) -> LayoutArrays:
    surfaces = [one.surface for one in patches]
    taxels = np.zeros(sum(len(one.areas) for one in surfaces), TAXEL)
    records = np.zeros(len(patches), PATCH)
    channels, neighbours, faces, sizes, entries = ([np.zeros(0, np.int64)] for _ in range(5))
    taxel = channel = node = cell = face = 0
    for record, one in zip(records, patches, strict=True):
        surface, sensor, nodes = one.surface, one.description.sensor, one.nodes.shape[1]
        count, width = len(surface.areas), one.description.channels
        own = taxels[taxel : taxel + count]
        own["position"], own["normal"], own["area"] = surface.positions, surface.normals, surface.areas
        corner, scale, shape, starts, found = _grid(surface)
        for name, value in {
            "taxel": taxel, "taxel_end": taxel + count, "channel": channel, "channel_end": channel + width,
            "node": node, "node_end": node + nodes, "cell": cell,
            "lowest": sensor.lowest, "highest": sensor.highest, "rest": sensor.rest,
            "sign": np.sign(sensor.pascal_per_count), "full": one.full, "rate": one.description.rate,
            "corner": corner, "cells_per_metre": scale, "cells": shape,
            "link": links.index(one.description.link), "limb_link": links.index(_limb_link(one)),
        }.items():  # fmt: skip
            record[name] = value
        if one.segment is not None:
            record["limb"] = limb_record(one.part, one.segment)
            record["part"] = parts.index(one.description.part)
        channels.append(one.channels + channel)
        neighbours.append((surface.neighbours + taxel).ravel())
        faces.append((surface.faces + taxel).ravel())
        sizes.append(np.diff(starts))
        entries.append(found + face)
        taxel, channel, node = taxel + count, channel + width, node + nodes
        cell, face = cell + len(starts) - 1, face + len(surface.faces)
    cells = np.cumsum([0, *np.concatenate(sizes)])
    made = LayoutArrays(
        patches=records,
        taxels=taxels,
        channel=np.concatenate(channels).astype(np.int64),
        gain=np.concatenate([np.zeros(0), *(one.gain for one in patches)]),
        nodes=np.concatenate([np.zeros((2, 0)), *(one.nodes for one in patches)], axis=1),
        fill=np.concatenate([np.zeros((0, len(WIDTHS))), *map(_fill, patches)]),
        graph=adjacency(taxel, np.concatenate(neighbours).reshape(-1, 2).astype(np.intp)),
        faces=np.concatenate(faces).reshape(-1, 3).astype(np.int32),
        cells=np.concatenate([cells + len(cells), *entries]).astype(np.int32),
    )
    return LayoutArrays(*(frozen(np.ascontiguousarray(array)) for array in made))


def _fill(one: SkinPatch) -> Array:
    """Returns the fill factor (n, w) around each taxel of a patch, for touches of w widths.

    The fill factors are 1 for a patch on which touches are detected through joint torques.
    """
    if one.description.through_joints:
        return np.ones((len(one.surface.areas), len(WIDTHS)))
    return fill_factors(one.surface)


def _slices(patches: Records, name: str) -> tuple[slice, ...]:
    bounds = zip(patches[name].tolist(), patches[name + "_end"].tolist(), strict=True)
    return tuple(slice(begin, end) for begin, end in bounds)


def _limb_link(one: SkinPatch) -> str:
    return one.description.link if one.segment is None else one.segment.link


def _segment(name: str) -> int:
    return SEGMENTS.index(name) if name in SEGMENTS else -1


def _dtype(sensors: Sequence[Sensor]) -> np.dtype[Any]:
    octets = all(one.lowest >= 0.0 and one.highest <= 255.0 for one in sensors)
    return np.dtype(np.uint8 if octets else np.float32)


def _grid(surface: Surface) -> tuple[Array, float, Places, Places, Places]:
    """Returns a grid of cells around a surface, which makes the search of the nearest face fast: its lowest
    corner (3,) [m], cells per metre, and number of cells (3,) along x, y and z; the place (cells + 1,) in the
    last array at which each cell's faces begin; and the indices of the faces, cell by cell.
    """
    if not len(surface.faces):
        none = np.zeros(0, np.int64)
        return np.zeros(3), 0.0, np.zeros(3, np.int64), np.zeros(1, np.int64), none
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
    return low, scale, cells, starts, face[np.argsort(cell, kind="stable")]
