"""A patch of skin in the few flat arrays that the compiled loops read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import int32, int64
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, writes
from tci.frames import Array, read_only
from tci.robot.description import GenericPart, Patch, Segment
from tci.robot.kernels.limb import limb_numbers
from tci.skin.surfaces import Surface

Indices = NDArray[np.int32]

_CELLS_PER_FACE = 8


@dataclass(frozen=True, slots=True, eq=False)
class FlatPatch:
    """Taxels, neighbours and faces of one patch, and the segment that it lies on."""

    surface: Surface
    """What it was made from."""
    taxels: Array
    """Position [m], normal and area [m2] (n, 7) of each taxel, in the patch's link."""
    graph: Indices
    """Where the neighbours of each taxel begin, n + 1 places, and then the neighbours."""
    faces: Indices
    """Corners (f, 3) of each face."""
    box: Array
    """Least corner (3,) [m] of the grid of cells, cells per metre, cells along x, y, z."""
    cells: Indices
    """Where the faces of each cell begin, cells + 1 places, and then the faces that reach into each."""
    limb: Array
    """The segment, see `limb_numbers`; zeros for none."""
    link: str
    """The segment's link; the patch's own where there is none."""
    work: Indices
    """Memory (4 n + 1,) of the loops, not for two threads at once."""

    @staticmethod
    def of(surface: Surface, patch: Patch, part: GenericPart, segment: Segment | None) -> FlatPatch:
        """A cell of the grid is about as wide as a face's longest edge. Without a segment: no limb."""
        taxels = np.column_stack([surface.positions, surface.normals, surface.areas])
        faces = np.ascontiguousarray(surface.faces, dtype=np.int32).reshape(-1, 3)
        box, cells = _grid(np.ascontiguousarray(surface.positions), faces)
        return FlatPatch(
            surface=surface,
            taxels=read_only(taxels),
            graph=read_only(adjacency(len(taxels), surface.neighbours), np.int32),
            faces=read_only(faces, np.int32),
            box=read_only(box),
            cells=read_only(cells, np.int32),
            limb=read_only(np.zeros(15) if segment is None else limb_numbers(part, segment)),
            link=patch.link if segment is None else segment.link,
            work=np.zeros(4 * len(taxels) + 1, np.int32),
        )


def adjacency(count: int, pairs: NDArray[np.intp]) -> Indices:
    """`FlatSurface.graph` of `count` taxels and their neighbours `pairs` (m, 2), each pair once."""
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    degrees = np.bincount(one, minlength=count)
    starts = np.concatenate([[0], np.cumsum(degrees)]) + count + 1
    neighbours = other[np.lexsort((other, one))]
    return np.concatenate([starts, neighbours]).astype(np.int32)


def _grid(positions: Array, faces: Indices) -> tuple[Array, Indices]:
    if not len(faces):
        return np.zeros(7), np.zeros(1, np.int32)
    corners = positions[faces]
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1).mean())
    while (shape := np.floor((high - low) / size) + 1.0).prod() > _CELLS_PER_FACE * len(faces) + 64:
        size *= 1.25
    box = np.concatenate([low, [1.0 / size], shape])
    return box, _fill(positions, faces, box, int(shape.prod()))


@inlined
def _span(a: float, b: float, c: float, low: float, scale: float, cells: float) -> tuple[int, int]:
    first = int((min(a, b, c) - low) * scale)
    last = int((max(a, b, c) - low) * scale)
    most = int(cells) - 1
    return min(first, most), min(last, most)


@compiled(writes(1, int32)(reads(2), reads(2, int32), reads(1), int64), allocates=True)
def _fill(positions: Array, faces: Indices, box: Array, count: int) -> Indices:
    """`FlatSurface.cells`: every face in each cell that its bounding box reaches into."""
    starts = np.zeros(count + 1, np.int64)
    ends = np.zeros(1, np.int64)
    entries = np.zeros(1, np.int32)
    for counting in (True, False):
        if not counting:
            starts[1:] = np.cumsum(starts[1:])
            starts += count + 1
            ends = starts.copy()
            entries = np.zeros(starts[count], np.int32)
            entries[: count + 1] = starts
        for f in range(len(faces)):
            a, b, c = faces[f]
            x0, x1 = _span(positions[a, 0], positions[b, 0], positions[c, 0], box[0], box[3], box[4])
            y0, y1 = _span(positions[a, 1], positions[b, 1], positions[c, 1], box[1], box[3], box[5])
            z0, z1 = _span(positions[a, 2], positions[b, 2], positions[c, 2], box[2], box[3], box[6])
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    for z in range(z0, z1 + 1):
                        cell = (x * int(box[5]) + y) * int(box[6]) + z
                        if counting:
                            starts[cell + 1] += 1
                        else:
                            entries[ends[cell]] = f
                            ends[cell] += 1
    return entries
