"""Writes pressure images as PNG files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from tci.body.tactile import PressureImage
from tci.lab.pictures.paint import FULL_SCALE, pressure_colours
from tci.messages.frames import Array


def pressure_pixels(image: PressureImage, *, full_scale: float = FULL_SCALE) -> Array:
    """Returns the colours (rows, columns, 4) of a pressure image, 0 to 1. Pixels without skin are
    transparent.

    Pressures above `full_scale` [Pa] have the colour of `full_scale`.
    """
    skin = np.isfinite(image.pressure)
    colours = pressure_colours(np.where(skin, image.pressure, 0.0), full_scale)
    result: Array = np.concatenate([colours, skin[..., None]], axis=-1)
    return result


def write_png(image: PressureImage, path: str | Path, *, full_scale: float = FULL_SCALE) -> None:
    """Writes a pressure image as a PNG file. Each pixel of the image becomes one pixel of the file."""
    pixels = np.round(255.0 * pressure_pixels(image, full_scale=full_scale)).astype(np.uint8)
    Image.fromarray(pixels, "RGBA").save(path, "PNG")
