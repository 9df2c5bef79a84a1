"""Skin as TCI exports it: `tci skin export NAME --to json`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FORMAT = "tci.skin/1"
G1 = Path(__file__).with_name("g1.json")
"""Sleeves of the Unitree G1's arms."""
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Patch:
    """One patch, in the frame of its link."""

    name: str
    link: str
    width: float
    """Over which a contact is spread [m]."""
    positions: Array
    """(n, 3) [m] of its taxels."""
    normals: Array
    """(n, 3), outward."""
    solid: Array
    """Points (k, 3) [m] whose convex hull is touched."""


def read_skin(path: str | Path) -> tuple[Patch, ...]:
    """Raises ValueError for a file of another format."""
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"{path} is no {FORMAT}; valid: a file of `tci skin export NAME --to json`")
    return tuple(
        Patch(
            one["name"], one["link"], one["width"],
            *(np.array(one[field], dtype=float) for field in ("positions", "normals", "solid")),
        )
        for one in content["patches"]
    )  # fmt: skip
