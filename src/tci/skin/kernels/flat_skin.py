"""All patches of a skin in the few flat arrays that the compiled loops read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array, read_only
from tci.robot.description import Patch
from tci.robot.generic_arm import SEGMENTS
from tci.skin.kernels.flat import FlatPatch, Indices
from tci.skin.kernels.whole import POSTURE


@dataclass(frozen=True, slots=True)
class Site:
    """What all contacts of a patch share."""

    patch: str
    part: str
    segment: str


@dataclass(frozen=True, slots=True, eq=False)
class FlatSkin:
    """The arrays of `FlatPatch`, one patch after the other."""

    sites: tuple[Site, ...]
    """The patches (p,)."""
    segments: NDArray[np.int64]
    """Their places (p,) in SEGMENTS; -1 for none of these."""
    patch_links: tuple[str, ...]
    """Their links."""
    begins: NDArray[np.int64]
    """Where each patch's taxels, graph, faces and cells begin (p + 1, 4)."""
    taxels: Array
    graph: Indices
    faces: Indices
    box: Array
    """(p, 7), as `FlatPatch.box`."""
    cells: Indices
    limb: Array
    """(p, 15), as `FlatPatch.limb`."""
    links: tuple[str, ...]
    """Links that the patches and their segments are on."""
    parts: tuple[str, ...]
    """Generic parts whose segments carry skin."""
    all_parts: frozenset[str]
    """Those with any skin."""
    on: NDArray[np.int64]
    """Places (p, 3) among `links` and `parts`, see `whole`; 0 for a patch on no segment."""
    work: Indices
    """Memory of the loops, not for two threads at once."""
    force: Array
    """Room for the force (n,) [N] on all taxels."""
    rates: Array
    """Frames per second (p,) of each patch."""
    counts: NDArray[np.int64]
    """Contacts (p,) of each patch in the latest frame."""

    @staticmethod
    def of(patches: Sequence[Patch], flats: Sequence[FlatPatch]) -> FlatSkin:
        sizes = [[len(flat.taxels), len(flat.graph), len(flat.faces), len(flat.cells)] for flat in flats]
        begins = np.concatenate([np.zeros((1, 4), int), np.cumsum(np.array(sizes).reshape(-1, 4), axis=0)])
        both = [link for p, flat in zip(patches, flats, strict=True) for link in (p.link, flat.link)]
        links = tuple(dict.fromkeys(both))
        limbs = [flat.limb.any() for flat in flats]
        parts = tuple(dict.fromkeys(p.part for p, limb in zip(patches, limbs, strict=True) if limb))
        on = np.array(
            [
                (links.index(p.link), links.index(flat.link), parts.index(p.part) if limb else 0)
                for p, flat, limb in zip(patches, flats, limbs, strict=True)
            ],
            np.int64,
        ).reshape(-1, POSTURE + 1)
        count = int(begins[-1, 0])

        def joined(name: str, shape: tuple[int, ...], dtype: type) -> NDArray[Any]:
            parts = [np.zeros(shape, dtype), *(getattr(flat, name) for flat in flats)]
            return read_only(np.concatenate(parts), dtype)

        return FlatSkin(
            sites=tuple(Site(patch.name, patch.part, patch.segment) for patch in patches),
            segments=segments_of([patch.segment for patch in patches]),
            patch_links=tuple(patch.link for patch in patches),
            begins=read_only(begins, np.int64),
            taxels=joined("taxels", (0, 7), np.float64),
            graph=joined("graph", (0,), np.int32),
            faces=joined("faces", (0, 3), np.int32),
            box=read_only(np.array([flat.box for flat in flats]).reshape(-1, 7)),
            cells=joined("cells", (0,), np.int32),
            limb=read_only(np.array([flat.limb for flat in flats]).reshape(-1, 15)),
            links=links,
            parts=parts,
            all_parts=frozenset(patch.part for patch in patches),
            on=read_only(on, np.int64),
            work=np.zeros(4 * count + len(patches), np.int32),
            force=np.zeros(count),
            rates=read_only([patch.rate for patch in patches]),
            counts=np.zeros(len(patches), np.int64),
        )


def segments_of(names: Sequence[str]) -> NDArray[np.int64]:
    """The place (n,) of each segment in SEGMENTS; -1 for none of these."""
    return read_only([SEGMENTS.index(name) if name in SEGMENTS else -1 for name in names], np.int64)
