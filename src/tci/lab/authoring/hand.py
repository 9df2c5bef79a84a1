"""The description of a hand or loose sensor alone, so that everything that takes a robot takes it: recording,
viewer, calibration, plots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from tci.drivers.source_reader import PadState, SourceReader
from tci.errors import DriverError
from tci.robot.tactile_devices import FINGERS, Device, DevicePad, devices, in_rows, pads_of, place_of

PITCH = 0.003
"""Distance [m] of neighbouring taxels where no maker tells it."""
GAP = 0.006
"""Distance [m] of two pads in the description, which lie side by side as on an open hand."""
FULL = 100e3
"""Pressure [Pa] of the largest value where nobody says what a count is."""
RANGES = {"u1": (0, 255), "u2": (0, 65535), "i2": (-32768, 32767)}
"""Smallest and largest value of a type."""
THICK = 0.002
"""Of a pad [m]."""
ALONG = ("tip", "nail", "top", "middle", "pad", "proximal")
"""Pads of a finger from its end."""


def write_hand(reader: SourceReader, folder: Path, *, shapes: Mapping[str, DevicePad] | None = None) -> Path:
    """Writes `hand.xml` with its model and tables into a new folder, and returns its path.

    `shapes` are the pads as they lie; None for the table of devices. Sizes and forces come from that table;
    where it has none, a pad is a square of taxels 3 mm apart, and forces are assumed. A joint `base` that
    nothing moves is there because each description has one. Raises DriverError if a pad has not sent yet, has
    several values for each point, or if the folder exists.
    """
    silent = [pad for pad, state in reader.pads.items() if state.values is None]
    if silent:
        raise DriverError(f"{reader.name}: {', '.join(silent[:6])} did not send; valid: a hand that sends")
    if reader.source.values_per_point > 1:
        raise DriverError(f"{reader.name} gives several values for each point; valid: ,axes=z")
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise DriverError(f"{folder} exists; valid: a new folder") from error
    shapes = pads_of(reader.source.device, reader.channels) if shapes is None else shapes
    device = next((one for one in devices() if one.name == reader.source.device), None)
    points = {pad: _points(state.channels, shapes.get(pad)) for pad, state in reader.pads.items()}
    bodies, patches = [], []
    for pad, (x, y) in _places(points).items():
        place, spacing = points[pad]
        half = np.ptp(place, axis=0) / 2 + spacing / 2
        bodies.append(
            f'      <body name={quoteattr(pad)} pos="{x:.4f} {y:.4f} {THICK}">'
            f'<geom type="box" size="{half[0]:.5f} {half[1]:.5f} {THICK / 2}"/></body>'
        )
        area = spacing[0] * spacing[1]
        rows = ["channel, x [mm], y [mm], z [mm], nx, ny, nz, area [mm2]"]
        rows += [
            f"{k}, {1e3 * u:.3f}, {1e3 * v:.3f}, {500 * THICK:g}, 0, 0, 1, {1e6 * area:.3f}"
            for k, (u, v) in enumerate(place)
        ]
        (folder / f"{pad}.csv").write_text("\n".join(rows) + "\n")
        patches.append(_patch(pad, reader.pads[pad], device, area))
    (folder / "hand.mjcf.xml").write_text(MODEL.format(bodies="\n".join(bodies)))
    path = folder / "hand.xml"
    path.write_text(HAND.format(name=quoteattr(folder.name), patches="\n".join(patches)))
    return path


def _points(channels: int, shape: DevicePad | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (n, 2) [m] of a pad's values, x to the right and y away, and the spacing along both."""
    if shape is None:
        columns = math.ceil(math.sqrt(channels))
        row, column = np.divmod(np.arange(channels), columns)
        rows, spacing = math.ceil(channels / columns), np.array([PITCH, PITCH])
    else:
        rows, columns = shape.rows, shape.columns
        order = in_rows(np.arange(channels), shape).ravel().astype(int)
        row, column = np.empty(channels, int), np.empty(channels, int)
        row[order], column[order] = np.divmod(np.arange(channels), columns)
        size = shape.size or (rows * PITCH, columns * PITCH)
        spacing = np.array([size[1] / columns, size[0] / rows])
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    return (np.stack([column, row], axis=1) - middle) * spacing * (1, -1), spacing


def _places(
    points: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> dict[str, tuple[float, float]]:
    """Middle of each pad [m]: one column for each finger, from its end towards the palm, which lies below."""
    sizes = {pad: np.ptp(place, axis=0) + spacing for pad, (place, spacing) in points.items()}
    columns: dict[str, list[str]] = {}
    for pad in points:
        columns.setdefault(place_of(pad), []).append(pad)
    ordered = [one for one in (*FINGERS, *columns) if one in columns and one != "palm"]
    found, x = {}, 0.0
    for finger in dict.fromkeys(ordered):
        pads = sorted(
            columns[finger], key=lambda pad: next((k for k, one in enumerate(ALONG) if one in pad), 9)
        )
        width = max(float(sizes[pad][0]) for pad in pads)
        y = sum(float(sizes[pad][1]) + GAP for pad in pads)
        for pad in pads:
            y -= float(sizes[pad][1]) / 2
            found[pad] = x + width / 2, y
            y -= float(sizes[pad][1]) / 2 + GAP
        x += width + GAP
    y = 0.0
    for pad in columns.get("palm", ()):
        found[pad] = x / 2, y - GAP - float(sizes[pad][1]) / 2
        y -= float(sizes[pad][1]) + GAP
    return found


def _patch(pad: str, state: PadState, device: Device | None, area: float) -> str:
    assert state.values is not None  # `write_hand` looked
    low, high = RANGES.get(state.values.dtype.str[1:], (-1e6, 1e6)) if device is None else device.values
    known = device is not None and device.newton_per_count is not None
    rest = 0 if device is None else device.rest
    pascal = device.newton_per_count / area if known else FULL / (high - rest)  # type: ignore[union-attr, operator]
    return PATCH.format(
        name=quoteattr(pad), file=quoteattr(f"{pad}.csv"), rate=max(1.0, round(state.rate)),
        channels=state.channels, rest=rest, pascal=f"{pascal:.6g}", low=f"{low:g}", high=f"{high:g}",
        assumed="" if known else "    <!-- assumed: nobody says what a count is; tci skin calibrate -->\n",
    )  # fmt: skip


MODEL = """<mujoco>
  <worldbody>
    <body name="base">
      <geom size="0.005"/>
      <body name="hand"><joint name="base" axis="0 0 1"/><geom type="box" size="0.01 0.01 0.001"/>
{bodies}
      </body>
    </body>
  </worldbody>
</mujoco>
"""
HAND = """<generic_robot version="1" name={name} angle_unit="deg">
  <model format="mjcf" file="hand.mjcf.xml" torso_link="base"/>
  <robot_part name="Base">
    <servo id="0" name="base" joint="base">
      <position min="-1" max="1"/><velocity max="1"/><acceleration max="10"/><jerk max="1000"/>
    </servo>
  </robot_part>
  <generic_robot_part name="hand" robot_part="Base">
    <generic_servo_number>1</generic_servo_number>
    <generic_servo id="0" name="base"><destination_servo_id>0</destination_servo_id></generic_servo>
  </generic_robot_part>
  <skin>
{patches}
  </skin>
</generic_robot>
"""
PATCH = """{assumed}    <patch name={name} part="hand" link={name} rate="{rate:g}" channels="{channels}">
      <sensor rest="{rest}" pascal_per_count="{pascal}" min="{low}" max="{high}"/>
      <table file={file} format="csv"/>
    </patch>"""
