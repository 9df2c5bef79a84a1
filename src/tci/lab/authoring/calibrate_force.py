"""Calibrates a patch from a recording in which a force sensor measures the load on the patch.

The bias of the force sensor and the rest values of the skin need not be known. The load is modelled as an
offset plus the sum of the taxels' forces, each multiplied by a gain. In a recording only a few places are
pressed. Therefore a penalty keeps the gain of each taxel near the gain of the whole patch. Cross-validation
chooses the penalty.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.lab.authoring.calibrate_skin import measured_counts
from tci.messages.frames import Array
from tci.robot.description import Sensor
from tci.robot.skin_files.calibration import PatchCalibration

BLOCK = 10
"""Number of consecutive frames in a block. All frames of a block are either used for the fit or held out to
test the fit. Assumed: within 0.2 s (10 frames of an iCub) a load may hardly change, so neighbouring frames
must not be in both groups."""
FEWEST = 8 * BLOCK
"""Least number of frames in a calibration. Assumed: two blocks for each of the four folds of the
cross-validation."""
REST = 0.05
"""Fraction of the frames from which rest values are computed: those frames with the least sum of pressures.
Assumed: in this fraction of the frames the patch carries nearly no load."""
PENALTIES = (np.inf, 100.0, 10.0, 1.0, 0.1, 0.01, 0.001)
"""Penalties that are tried, relative to the mean square of the taxels' forces. A penalty acts on differences
between the taxels' gains. Assumed: with the largest penalty all taxels have the same gain, and with the
smallest penalty the gains fit noise."""
DRIFT, STANDING = 0.05, 0.25
"""A patch was never unloaded if its taxels' rest values are so far from the description's that what exceeds
DRIFT, a fraction of the sensor's range, is in sum more than STANDING of the patch's range in the recording.
Assumed: healthy skins drift by 12 of 255 counts, and a standing sole rests at more than its sway."""
LEAST, MOST = 0.2, 5.0
"""Range of a taxel's gain, relative to the gain of the patch. Assumed: a taxel that is hardly pressed in the
recording must not get a gain near 0."""


@dataclass(frozen=True, slots=True, eq=False)
class ForceFit:
    """Gains of a patch's taxels, and errors on frames that were not used for the fit."""

    gains: Array
    """Factor (n,) for each taxel, by which the response in the description is to be multiplied.

    All factors are 0 if the measured load does not increase with the forces of the patch.
    """
    offset: float
    """Estimated reading [N] of the force sensor while the patch carries no load."""
    penalty: float
    """Penalty on differences between gains; infinite if all taxels have one gain."""
    held_out: float
    """Root mean square error [N] of the force on every second block of frames, after a fit to all other
    blocks."""
    held_out_one_gain: float
    """Error [N], computed in the same way as `held_out`, for a fit with one gain for all taxels."""
    held_out_raw_sum: float
    """Error [N], computed in the same way as `held_out`, of a simpler model: the load is one gain times the
    sum of all raw values, plus an offset."""


def calibrate_to_force(
    sensor: Sensor, areas: Array, stamps: Array, values: Array, times: Array, forces: Array, *,
    when: str = "unknown",
) -> tuple[PatchCalibration, ForceFit]:  # fmt: skip
    """Returns the calibration of a patch (rest values, noise and gains), and the fit of the gains. The
    arguments are the taxels' `areas` (n,) [m2] and raw `values` (m, n) at `stamps` (m,) [s], and the measured
    `forces` (k, components) [N] at `times` (k,) [s].

    What the recording does not show stays that of the description, and `report["not_seen"]` says so: rest
    values and gains of a patch that was never unloaded, gains that explain the force no better than the sum
    of raw values, and gains of taxels that were never pressed. Raises TciError if all gains are zero.
    """
    found, rest, noise = fit_recording(sensor, areas, stamps, values, times, forces)
    sign = np.sign(sensor.pascal_per_count)
    above = sign * (rest - sensor.rest) - DRIFT * (sensor.highest - sensor.lowest)
    total = sign * values.sum(axis=1)
    gains, unseen = found.gains, list[str]()
    if not gains.any():
        raise TciError(
            "the force does not grow with what the patch reads (held-out error "
            f"{found.held_out:.3g} N, by the sum of raw values {found.held_out_raw_sum:.3g} N); valid: a "
            "recording in which this patch is loaded and unloaded"
        )
    if np.clip(above, 0.0, None).sum() > STANDING * np.ptp(total):
        rest, gains = np.full(len(rest), sensor.rest), np.ones(len(rest))
        unseen.append(
            "the patch was never unloaded, so its rest values and gains stay those of the description; "
            "valid: a recording in which it also carries nothing"
        )
    elif found.held_out >= found.held_out_raw_sum:
        gains = np.ones(len(rest))
        unseen.append(
            f"the fitted gains err by {found.held_out:.3g} N and the sum of raw values by "
            f"{found.held_out_raw_sum:.3g} N, so the gains stay those of the description; valid: a recording "
            "with more different loads"
        )
    else:
        pressed = measured_counts(sign * (values - rest), noise).any(axis=0)
        gains = np.where(pressed, gains, 1.0)
        if not pressed.all():
            unseen.append(
                f"{int((~pressed).sum())} of {len(rest)} taxels were never pressed and keep the gain of the "
                "description; valid: a recording that presses all of the patch"
            )
    calibration = PatchCalibration(
        rest=tuple(rest.tolist()), noise=tuple(noise.tolist()), gain=tuple(gains.tolist()),
        report={
            "date": when, "frames": float(len(stamps)), "offset_N": found.offset,
            "held_out_N": found.held_out, "held_out_one_gain_N": found.held_out_one_gain,
            "held_out_raw_sum_N": found.held_out_raw_sum, "not_seen": "; ".join(unseen),
        },
    )  # fmt: skip
    return calibration, found


def fit_recording(
    sensor: Sensor, areas: Array, stamps: Array, values: Array, times: Array, forces: Array
) -> tuple[ForceFit, Array, Array]:
    """Fits gains of taxels with `areas` (n,) [m2] to raw `values` (m, n) at `stamps` (m,) [s].

    The force sensor measured `forces` (k, components) [N] at `times` (k,) [s]; `stamps` and `times` are times
    on the same clock. The load is the component of the force along the direction in which the force changes
    most. The sign of the load is chosen such that the load increases with the sum of the raw values. Returns
    the fit, and rest values and noise (n,) [counts]. Raises TciError for too few frames, or for values that
    are not finite.
    """
    inside = (stamps >= times[0]) & (stamps <= times[-1])
    if inside.sum() < FEWEST:
        raise TciError(
            f"{int(inside.sum())} frames while the force was recorded: frames from {stamps.min():.3f} to "
            f"{stamps.max():.3f} s, forces from {times[0]:.3f} to {times[-1]:.3f} s; valid: {FEWEST} or "
            "more, one clock for both"
        )
    stamps, values = stamps[inside], values[inside]
    if not (np.isfinite(values).all() and np.isfinite(forces).all()):
        raise TciError("frames or forces are not all finite")
    sign = np.sign(sensor.pascal_per_count)
    counts = sign * values
    total = counts.sum(axis=1)
    load = _along(np.stack([np.interp(stamps, times, one) for one in forces.T], axis=1), total)
    rest, noise = _rest(counts), _noise(counts)
    pressed = measured_counts(counts - rest, noise)
    blocks = np.arange(len(counts)) // BLOCK
    return fit_force(sensor.pressure(pressed) * areas, load, blocks, raw=total), sign * rest, noise


def fit_force(parts: Array, load: Array, blocks: NDArray[np.intp], *, raw: Array) -> ForceFit:
    """Fits gains to a measured `load` (m,) [N]. `parts` (m, n) [N] are the taxels' forces before the gains
    are applied.

    `blocks` (m,) is the block number of each frame; the frames of a block are held out together. `raw` (m,)
    is the sum of all raw values of each frame. The result contains the error of a simpler model that uses
    only this sum.
    """
    train = blocks % 2 == 0
    test, some = ~train, blocks[train] // 2
    penalty = _choose(parts[train], load[train], some)
    errors = [
        _root_mean_square(_predict(parts[test], *fit) - load[test])
        for fit in _fit(parts[train], load[train], (penalty, np.inf))
    ]
    columns = np.column_stack([raw, np.ones(len(raw))])
    line = np.linalg.lstsq(columns[train], load[train], rcond=None)[0]
    penalty = _choose(parts, load, blocks)
    ((gains, offset),) = _fit(parts, load, (penalty,))
    return ForceFit(
        gains, offset, penalty, errors[0], errors[1], _root_mean_square(columns[test] @ line - load[test])
    )


def _fit(parts: Array, load: Array, penalties: Sequence[float]) -> list[tuple[Array, float]]:
    """Fits a measured `load` (m,) [N] by gains of the taxels' forces `parts` (m, n) [N] plus an offset.
    Returns the gains (n,) and the offset [N] for each of `penalties`; a larger penalty makes the gains more
    alike.

    All gains are 0 if the load does not increase with the forces of the patch.
    """
    fits = []
    for factors in _factors(parts, load, penalties):
        total = parts @ factors
        spread = total - total.mean()
        square = float(spread @ spread)
        gain = max(0.0, float(spread @ load) / square) if square > 0.0 else 0.0
        fits.append((gain * factors, float(load.mean() - gain * total.mean())))
    return fits


def _factors(parts: Array, load: Array, penalties: Sequence[float]) -> Iterator[Array]:
    """Yields, for each of `penalties`, the gains (n,) of the taxels divided by the gain of the whole patch.

    A larger penalty makes the gains more alike.
    """
    same = np.ones(parts.shape[1])
    U, S, Vt = np.linalg.svd(parts - parts.mean(axis=0), full_matrices=False)
    total, rest = S * (Vt @ same), U.T @ (load - load.mean())
    for penalty in penalties:
        weights = np.zeros(len(S))
        if np.isfinite(penalty) and S.any():
            weights = 1.0 / (S**2 + penalty * float(S @ S) / len(load))
        along = float(total @ (weights * rest))
        if not along > 0.0:
            yield same
            continue
        one = along / float(total @ (weights * total))
        yield np.clip(same + Vt.T @ (S * weights * (rest - one * total)) / one, LEAST, MOST)


def _choose(parts: Array, load: Array, blocks: NDArray[np.intp], folds: int = 4) -> float:
    """Returns the penalty on differences between the taxels' gains with which the fit best predicts frames
    that it does not use. Frames with the same number in `blocks` (m,) are left out together."""
    squares = np.zeros(len(PENALTIES))
    for fold in range(folds):
        out = blocks % folds == fold
        for k, fit in enumerate(_fit(parts[~out], load[~out], PENALTIES)):
            squares[k] += float(np.sum((_predict(parts[out], *fit) - load[out]) ** 2))
    return PENALTIES[int(np.argmin(squares))]


def _predict(parts: Array, gains: Array, offset: float) -> Array:
    predicted: Array = parts @ gains + offset
    return predicted


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _along(forces: Array, total: Array) -> Array:
    """Returns the load (m,) [N]: the component of the measured `forces` (m, components) [N] along the
    direction in which they change most.

    The sign of the load is chosen such that the load increases with `total` (m,), the sum of the raw values
    of each frame.
    """
    away = forces - forces.mean(axis=0)
    load: Array = forces @ np.linalg.svd(away, full_matrices=False)[2][0]
    return load if (load - load.mean()) @ (total - total.mean()) >= 0.0 else -load


def _rest(counts: Array) -> Array:
    """Returns the rest value (n,) [counts] of each taxel: its median over those frames of `counts` (m, n) in
    which the sum over all taxels is least."""
    least = np.argsort(counts.sum(axis=1), kind="stable")[: max(BLOCK, int(REST * len(counts)))]
    rest: Array = np.median(counts[least], axis=0)
    return rest


def _noise(counts: Array) -> Array:
    """Returns the noise (n,) [counts] of each taxel: the median of its standard deviations within groups of
    10 successive frames of `counts` (m, n).
    """
    whole = counts[: len(counts) // BLOCK * BLOCK].reshape(-1, BLOCK, counts.shape[1])
    noise: Array = np.median(whole.std(axis=1, ddof=1), axis=0)
    return noise
