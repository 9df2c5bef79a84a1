"""Draws the figure of the demo, with the layout of Figure 6 in the paper.

Each row of the figure shows one robot, and each column one instant of a poke.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from tci.errors import TciError
from tci.lab.pictures.paint import PRESSURE_COLOURS, FieldLook
from tci.lab.pictures.render import background

# Sizes and colours are assumed. They change only the figure. Lengths are in pixels of the figure.
_DPI = 150
_GAP = 8
_TITLE = 54
_FOOT = 104
_INK, _PALE, _EDGE = "#1d2733", "#5b6878", "#c9d0d8"


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One of the pictures of which a figure consists, with its title."""

    image: NDArray[np.uint8]
    """Picture (h, w, 3). All panels of a figure have the same size."""
    title: str
    """Title of the panel, for example `NAO: forearm, flexor side`."""
    detail: str = ""
    """Second line of text, for example `180 ms: withdrawn 34 mm`."""
    close_up: NDArray[np.uint8] | None = None
    """Close-up (h, w, 3) that is drawn over the emptiest corner of the panel. None means no close-up."""
    spot: tuple[float, float] | None = None
    """Centre (x, y) [pixels] of a circle that marks the point shown in the close-up. None means no circle."""
    arrow: tuple[tuple[float, float], tuple[float, float]] | None = None
    """Start and end (x, y) [pixels] of an arrow that shows a displacement."""


def draw_figure(
    panels: Sequence[Panel],
    path: Path,
    *,
    columns: int = 4,
    fields: Sequence[tuple[str, FieldLook]] = (),
    full_scale: float,
    caption: str = "",
) -> None:
    """Arranges the panels in rows of `columns` panels, and writes all panels as a PNG file to `path`.

    The area below the panels shows a colour bar of the pressure up to `full_scale` [Pa], the names of the
    receptive fields in the fields' colours, and the `caption`. Every pixel of a panel becomes one pixel of
    the file. Raises TciError if there is no panel, or if the panels differ in size.
    """
    sizes = {panel.image.shape for panel in panels}
    if len(sizes) != 1 or columns < 1:
        raise TciError(f"a figure of {columns} columns with panels of sizes {sorted(sizes)}; valid: one size")
    height, width, _ = sizes.pop()
    rows = -(-len(panels) // columns)
    total_width = columns * (width + _GAP) + _GAP
    total_height = rows * (height + _TITLE) + _GAP + _FOOT
    figure = Figure(figsize=(total_width / _DPI, total_height / _DPI), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)

    def area(left: float, top: float, wide: float, high: float) -> Axes:
        """Adds axes on a rectangle [pixels]. The position is measured from the top left corner of the
        figure."""
        bottom = total_height - top - high
        return figure.add_axes(
            (left / total_width, bottom / total_height, wide / total_width, high / total_height)
        )

    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        left, top = _GAP + column * (width + _GAP), row * (height + _TITLE)
        _draw_title(area(left, top, width, _TITLE), ascii_uppercase[index % 26], panel)
        image = area(left, top + _TITLE, width, height)
        _draw_image(image, panel.image, _EDGE)
        _draw_marks(image, panel)
        if panel.close_up is not None:
            inset_height, inset_width, _ = panel.close_up.shape
            x, y = _emptiest_corner(panel.image, inset_width, inset_height)
            _draw_image(area(left + x, top + _TITLE + y, inset_width, inset_height), panel.close_up, _INK)
    foot = rows * (height + _TITLE) + _GAP
    _draw_pressure_bar(area(_GAP + 4, foot + 42, 0.22 * total_width, 14), full_scale)
    _draw_legend(area(0.26 * total_width, foot, 0.74 * total_width - _GAP, _FOOT), fields, caption)
    figure.savefig(path, dpi=_DPI, format="png")


def _draw_image(axes: Axes, image: NDArray[np.uint8], edge: str) -> None:
    height, width, _ = image.shape
    axes.imshow(image, interpolation="nearest", aspect="auto", extent=(0, width, height, 0))
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(color=edge, linewidth=0.6)


def _draw_marks(axes: Axes, panel: Panel) -> None:
    halo = [Stroke(linewidth=3.0, foreground="white"), Normal()]
    if panel.spot is not None:
        axes.add_patch(Circle(panel.spot, 22, fill=False, edgecolor=_INK, linewidth=1.0, path_effects=halo))
    if panel.arrow is not None:
        start, end = panel.arrow
        axes.add_patch(
            FancyArrowPatch(
                start, end, arrowstyle="-|>", mutation_scale=9, shrinkA=0, shrinkB=0,
                color=_INK, linewidth=1.2, path_effects=halo,
            )
        )  # fmt: skip


def _emptiest_corner(image: NDArray[np.uint8], width: int, height: int) -> tuple[int, int]:
    """Returns the top left corner (x, y) [pixels] of a picture of `width` by `height`, placed in that corner
    of `image` (h, w, 3) where it hides the least content."""
    total_height, total_width, _ = image.shape
    drawn = np.abs(image / 255.0 - background(total_height)[:, None]).max(axis=2) > 0.01
    corners = [
        (x, y) for y in (_GAP, total_height - height - _GAP) for x in (_GAP, total_width - width - _GAP)
    ]
    return min(corners, key=lambda corner: drawn[corner[1] :, corner[0] :][:height, :width].sum())


def _draw_title(axes: Axes, letter: str, panel: Panel) -> None:
    axes.set_axis_off()
    height = axes.bbox.height
    text: dict[str, Any] = {"transform": axes.transAxes, "va": "center"}
    axes.text(0.005, 34 / height, letter, size=12, weight="bold", color=_INK, **text)
    axes.text(0.065, 36 / height, panel.title, size=8.5, weight="bold", color=_INK, **text)
    axes.text(0.065, 14 / height, panel.detail, size=8, color=_PALE, **text)


def _draw_pressure_bar(axes: Axes, full_scale: float) -> None:
    colours = LinearSegmentedColormap.from_list("pressure", PRESSURE_COLOURS)
    scale = Normalize(0.0, full_scale / 1e3)
    bar = Colorbar(axes, ScalarMappable(scale, colours), orientation="horizontal", extend="max")
    bar.outline.set(linewidth=0.4, edgecolor=_PALE)
    axes.set_title("pressure on a taxel [kPa]", size=8, color=_INK, loc="left", pad=4)
    axes.tick_params(labelsize=7.5, length=2, width=0.4, colors=_PALE)


def _draw_legend(axes: Axes, fields: Sequence[tuple[str, FieldLook]], caption: str) -> None:
    axes.set_axis_off()
    width, height = axes.bbox.width, axes.bbox.height
    axes.set(xlim=(0, width), ylim=(height, 0))
    text: dict[str, Any] = {"va": "center", "color": _INK}
    axes.text(10, 24, "receptive fields", size=8, **text)
    left = 175.0
    for name, look in fields:
        axes.add_patch(
            Circle((left, 24), 9, facecolor=(*look.colour, 0.45), edgecolor=look.colour, linewidth=1.2)
        )
        label = axes.text(left + 18, 24, name, size=8, **text)
        left += 40 + label.get_window_extent().width
    axes.text(10, 66, caption, size=8, color=_PALE, va="center", linespacing=1.5)
