"""Skin files made for the tests, with the names and peculiarities of genuine ones.

Licences do not allow copies of genuine files, and each source of files has a different format. Each made file
has the same numbers of channels, modules, taxels and pads as the genuine file, in the same format. Positions
are invented: flat soles, and cones covered with triangles of ten taxels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PITCH = 6.534e-3
"""Distance [m] between neighbouring taxels."""
RIPPLE = 1e-3
"""Distance [m] by which every second module lies deeper, so that no cone fits a made skin exactly."""
PADS = (6, 10)
ROW = np.sqrt(0.75)


@dataclass(frozen=True)
class Form:
    """Text format and conventions of one source of skin files."""

    decimals: int = 6
    between: str = " "
    end: str = "\n"
    pads: tuple[int, ...] = PADS
    placed: bool = False
    """True if pads have positions. Otherwise their rows are zero, like the rows of absent modules."""
    mark: int | None = -2
    """Value of a pad in taxel2Repr; None if it is the value of the pad's module."""
    normals: str = "placeholder"
    """`placeholder`: 1 0 0 for all taxels; `none`: zero; `module`: one normal for each triangle; `wrong`:
    these normals with exchanged axes; `taxel`: measured normals, which are shorter than 1."""


CAD = Form()
DOS = Form(end="\r\n")
ONE_NORMAL = Form(4, "\t", mark=-1, normals="module")
MEASURED = Form(3, "  ", placed=True, mark=None, normals="taxel")
UNMEASURED = replace(MEASURED, normals="none")
HAND = Form(4, "  ", pads=(11,), placed=True, mark=-1, normals="module")
TRAILING = Form(13, end=" \n", placed=True)
SLEEVE = Form(12, normals="module")
TURNED = replace(SLEEVE, normals="wrong")


@dataclass(frozen=True)
class Made:
    """Skin of one file: `modules` triangles around the z axis, `around` of them per ring."""

    form: Form
    channels: int
    modules: int
    r1: float
    """Radius [m] at z = 0; infinite for a sole."""
    r2: float
    """Radius [m] at z = LENGTH."""
    around: int = 6
    lost: tuple[int, int] = (0, 0)
    """Number of taxels and of pads that lack a position in otherwise complete modules."""
    gap: int = 7
    """Index modulo 8 of the modules that are absent."""

    def present(self) -> list[int]:
        every = [module for module in range(self.channels // 12) if module % 8 != self.gap]
        return every[: self.modules]


LENGTH = 0.1
ARM, LEG = (0.045, 0.036), (0.075, 0.062)
FOREARM = Made(ONE_NORMAL, 384, 24, 0.043, 0.035)
SOLE = Made(CAD, 384, 25, np.inf, np.inf, around=4)
ONE_SIDE = {
    "icub/positions/left_forearm_V2": FOREARM,
    "icub/positions/left_forearm_mesh": replace(FOREARM, form=MEASURED, modules=23),
    "icub/positions/left_forearm_nomesh": replace(FOREARM, form=UNMEASURED, modules=23, lost=(1, 0)),
    "icub/positions/left_arm": Made(CAD, 768, 35, *ARM, around=8, gap=0),
    "icub/positions/left_arm_mesh": Made(MEASURED, 768, 38, *ARM, around=8, lost=(19, 2), gap=0),
    "icub/positions/left_hand_V2_1": Made(HAND, 192, 4, np.inf, np.inf, around=2, gap=0),
    "icub/positions/torso": Made(TRAILING, 768, 44, 0.09, 0.08, around=12, gap=0),
    "icub/positions/left_leg_upper": Made(DOS, 1344, 68, *LEG, around=14),
    "icub/positions/left_leg_lower": Made(DOS, 768, 38, *LEG, around=10),
    "icub/positions/left_foot": SOLE,
    "icub/positions_pycub/left_forearm": replace(FOREARM, form=CAD, channels=768),
    "icub/positions_pycub/left_arm": Made(CAD, 768, 35, *ARM, around=8, gap=0),
    "icub/positions_pycub/left_hand": Made(
        replace(HAND, normals="wrong"), 192, 4, np.inf, np.inf, around=2, gap=0
    ),
    "icub/positions_pycub/torso": Made(CAD, 768, 43, 0.09, 0.08, around=12, gap=0),
    "icub/positions_pycub/left_leg_upper": Made(CAD, 1344, 68, *LEG, around=14),
    "icub/positions_pycub/left_leg_lower": Made(CAD, 768, 38, *LEG, around=10),
    "icub/positions_pycub/left_foot": SOLE,
    "nao/positions/nao_left_hand": Made(TURNED, 384, 24, 0.037, 0.043),
    "nao/positions/nao_head": Made(TURNED, 384, 24, 0.06, 0.05),
    "nao/positions/nao_torso": Made(SLEEVE, 384, 25, 0.07, 0.06),
}
SKINS = {name.replace("left", side): made for name, made in ONE_SIDE.items() for side in ("left", "right")}


def write_skins(folder: Path) -> None:
    """Writes every file of SKINS."""
    for name, made in SKINS.items():
        path = folder / f"{name}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text_of(made, path.stem, mirrored="right" in name), newline="")


def text_of(made: Made, name: str, *, mirrored: bool) -> str:
    form = made.form
    positions, normals = places(made, mirrored=mirrored)
    numbers = np.hstack([positions, normals])
    rows = [form.between.join(f"{value:.{form.decimals}f}" for value in row) for row in numbers]
    listed = " ".join(map(str, _representatives(made)))
    head = [f"name\t{name}", "spatial_sampling\ttaxel", f"taxel2Repr ( {listed} )", "[calibration]"]
    return form.end.join([*head, *rows, ""])


def places(made: Made, *, mirrored: bool = False) -> tuple[Array, Array]:
    """Returns positions (channels, 3) [m] and normals (channels, 3) as written in the file. Rows of absent
    modules are zero."""
    form, positions, normals = made.form, np.zeros((made.channels, 3)), np.zeros((made.channels, 3))
    for number, module in enumerate(made.present()):
        strip, place = divmod(number, made.around)
        flat = _triangle(down=number % 2 == 1) + np.array([5 * (place // 2), 4 * strip])
        rows = np.flatnonzero(~np.isin(np.arange(12), () if form.placed else form.pads)) + 12 * module
        found = _on_surface(made, flat[rows % 12], farther_in=RIPPLE * (number % 2))
        positions[rows], normals[rows] = found
    taxels, pads = made.lost
    for place, count in ((0, taxels), (form.pads[0], pads)):
        positions[[12 * module + place for module in made.present()[:count]]] = 0.0
    there = positions.any(axis=1)
    middle = normals[np.arange(made.channels) // 12 * 12 + 1]
    normals = {
        "placeholder": np.tile([1.0, 0.0, 0.0], (made.channels, 1)),
        "none": np.zeros_like(normals),
        "module": middle,
        "wrong": middle[:, [1, 2, 0]],
        "taxel": normals * (0.7 + 0.3 * (np.arange(made.channels) % 2))[:, None],
    }[form.normals]
    if mirrored:
        positions, normals = positions * [1.0, -1.0, 1.0], normals * [1.0, -1.0, 1.0]
    positions, normals = np.where(there[:, None], (positions, normals), 0.0).round(form.decimals)
    return positions, normals


def _triangle(*, down: bool) -> Array:
    """Returns the positions (12, 2) of a module's ten taxels and two pads, in steps of an oblique lattice."""
    taxels = [(i, j) for j in range(4) for i in range(4 - j)]
    if down:
        taxels = [(4 - i, 3 - j) for i, j in taxels]
    own = dict(zip((place for place in range(12) if place not in PADS), taxels, strict=True))
    middle = np.mean(taxels, axis=0)
    return np.array([own.get(place, middle + (place - 8) / 8) for place in range(12)], dtype=float)


def _on_surface(made: Made, flat: Array, *, farther_in: float) -> tuple[Array, Array]:
    """Returns positions [m] and outward normals (n, 3) on the surface for lattice points (n, 2)."""
    along = (flat[:, 0] + 0.5 * (flat[:, 1] % 4)) * PITCH
    z = flat[:, 1] * ROW * PITCH + PITCH
    if np.isinf(made.r1):
        sole = np.column_stack([z, along - 0.03, np.full(len(z), 0.0075)])
        return sole, np.tile([0.0, 0.0, -1.0], (len(z), 1))
    slope = (made.r2 - made.r1) / LENGTH
    radius = made.r1 + slope * z - farther_in
    theta = along / min(made.r1, made.r2)
    out = np.column_stack([np.cos(theta), np.sin(theta), np.full(len(z), -slope)])
    positions = np.column_stack([radius * np.cos(theta), radius * np.sin(theta), z])
    return positions, out / np.linalg.norm(out, axis=1, keepdims=True)


def _representatives(made: Made) -> list[int]:
    listed = np.full(made.channels, -1)
    for module in made.present():
        listed[12 * module : 12 * module + 12] = 12 * module + 3
        if made.form.mark is not None:
            listed[[12 * module + pad for pad in made.form.pads]] = made.form.mark
    return [int(value) for value in listed]
