"""Calibrates rest values, noise and response of a patch, from frames at rest and under known loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from tci.errors import TciError
from tci.messages.frames import Array
from tci.robot.description import Sensor
from tci.robot.skin_files.calibration import PatchCalibration
from tci.skin.baseline import BaselineSettings

NODES = 6
"""Largest number of linear pieces of a skin's response, the curve of pressure over raw value. Assumed: enough
for smooth curves. If this number would leave fewer than two loads per piece, fewer pieces are used."""
STIFF = 0.03
"""Weight of smoothness in the least-squares fit of the response, where the loads have the weight 1.
Smoothness means similar slopes of adjacent linear pieces. Assumed: so small that the loads determine the
slopes."""
FEWEST_FRAMES = 20
"""Least number of frames at rest. Assumed: a standard deviation estimated from 20 frames has an error of
about 16 percent."""


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """Frames of a patch under one known load."""

    force: float
    """Force [N] on the patch."""
    values: Array
    """Raw values (frames, taxels)."""


def calibrate(
    sensor: Sensor, areas: Array, rest: Array, loads: Sequence[Load], *, when: str = "unknown"
) -> PatchCalibration:
    """Calibrates a patch with taxels of `areas` (n,) [m2]. `rest` (frames, n) are raw frames without a load,
    and `loads` contains the frames under known loads.

    The force of a load is modelled as the sum of area times pressure over all taxels. Pressure is modelled as
    a piecewise linear function of the counts away from rest. The slopes of this function are found by
    non-negative least squares. Without loads, the response of the description is used. Raises TciError for
    data that do not determine the calibration.
    """
    _check(areas, rest, loads)
    level, noise = rest.mean(axis=0), rest.std(axis=0, ddof=1)
    report: dict[str, float | str] = {
        "date": when,
        "rest_frames": float(len(rest)),
        "loads": float(len(loads)),
    }
    response: tuple[tuple[float, float], ...] = ()
    if loads:
        response, worst = _response(sensor, areas, level, noise, loads)
        report["largest_relative_error"] = worst
        report["not_seen"] = _not_seen(sensor, level, noise, loads)
    return PatchCalibration(
        rest=tuple(level.tolist()), noise=tuple(noise.tolist()), response=response, report=report
    )


def measured_counts(counts: Array, noise: Array) -> Array:
    """Returns `counts` (frames, n), the deviations from rest, with 0 in place of values that conditioning
    would ignore.

    `noise` (n,) [counts] are standard deviations.
    """
    return np.where((counts > 0.0) & (counts >= BaselineSettings().threshold * noise), counts, 0.0)


def _not_seen(sensor: Sensor, rest: Array, noise: Array, loads: Sequence[Load]) -> str:
    sign = np.sign(sensor.pascal_per_count)
    never = ~np.any(
        [measured_counts(sign * (load.values - rest), noise).any(axis=0) for load in loads], axis=0
    )
    if not never.any():
        return ""
    return f"{int(never.sum())} of {len(rest)} taxels carried no load: their response is that of the others"


def _response(
    sensor: Sensor, areas: Array, rest: Array, noise: Array, loads: Sequence[Load]
) -> tuple[tuple[tuple[float, float], ...], float]:
    sign = np.sign(sensor.pascal_per_count)
    # The counts that conditioning drops are left out here too, so that the response compensates for these
    # counts.
    pressed = [measured_counts(sign * (load.values - rest), noise) for load in loads]
    most = max(float(counts.max()) for counts in pressed)
    if not most > 0.0:
        raise TciError("no taxel reads more under the loads than at rest")
    forces = np.array([load.force for load in loads])
    pieces = min(NODES, max(1, len(loads) // 2))
    nodes = np.linspace(0.0, most, pieces + 1)
    width = nodes[1]
    # Column k: part of each taxel's counts within piece k, times its area, summed over all taxels of a load.
    reach = [
        [np.clip(counts - low, 0.0, width).mean(axis=0) @ areas for low in nodes[:-1]] for counts in pressed
    ]
    matrix = np.array(reach) / forces[:, None]
    scale = float(np.linalg.norm(matrix, axis=0).max())
    smooth = STIFF * scale * (np.eye(pieces) - np.eye(pieces, k=1))[:-1]
    slopes, _ = nnls(
        np.vstack([matrix, smooth]), np.concatenate([np.ones(len(loads)), np.zeros(len(smooth))])
    )
    if not slopes.any():
        raise TciError("the loads do not grow with what the taxels read")
    slopes = np.maximum(slopes, 1e-6 * slopes.max())
    pressure = np.concatenate([[0.0], np.cumsum(slopes * width)])
    worst = float(np.abs(matrix @ slopes - 1.0).max())
    return tuple(zip(nodes.tolist(), pressure.tolist(), strict=True)), worst


def _check(areas: Array, rest: NDArray[np.float64], loads: Sequence[Load]) -> None:
    taxels = len(areas)
    if rest.ndim != 2 or rest.shape[1] != taxels or len(rest) < FEWEST_FRAMES:
        raise TciError(
            f"rest of shape {rest.shape}; valid: ({FEWEST_FRAMES} or more frames, {taxels} taxels)"
        )
    for load in loads:
        if load.values.ndim != 2 or load.values.shape[1] != taxels or not len(load.values):
            raise TciError(f"a load's frames have shape {load.values.shape}; valid: (frames, {taxels})")
        if not 0.0 < load.force < np.inf:
            raise TciError(f"a load of {load.force} N; valid: above 0 and finite")
        if not np.isfinite(load.values).all():
            raise TciError(f"the frames under {load.force} N are not all finite")
    if not np.isfinite(rest).all():
        raise TciError("the frames at rest are not all finite")
