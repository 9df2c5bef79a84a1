"""Updates rest values and noise of the taxels of one patch at the end of an estimation window, in compiled
loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, record, writes

ROOM = 6
"""Number of rows of the work space of `update_baseline`, which has one column per taxel."""
BESIDE = 2.0
"""Value that marks a quiet taxel beside a touched taxel. Other quiet taxels are marked by 1, and all other
taxels by 0."""
NOISE_GAIN = float(np.sqrt(6.0) * np.sqrt(2.0 / np.pi))
"""Ratio of the mean absolute second difference of a signal to the standard deviation of the signal's Gaussian
noise."""


class WindowSettings(NamedTuple):
    """Settings with which rest values and noise are updated after an estimation window."""

    threshold: float
    """A taxel is quiet if its largest deviation is below this number [standard deviations of the noise], or
    below `quiet`."""
    quiet: float
    """Deviation [counts] below which a taxel is always quiet."""
    fluctuating: float
    """A taxel whose value changes in at least this fraction of the frames fluctuates."""
    share: float
    """Least fraction of quiet taxels from which the common drift of all taxels is estimated."""
    lively: float
    """Noise [counts] from which a healthy taxel never stays constant for a whole window."""
    typical: float
    """Typical noise [counts] of the patch before this window."""
    drift: float
    """Largest common drift [counts] during this window."""
    floor: float
    """Lowest signal [counts] that the sensor can send."""
    own: float
    """Weight (0 to 1) of this window in the rest value of a quiet taxel."""
    release: float
    """Weight (0 to 1) of this window in the rest value of a taxel below rest."""
    noise: float
    """Weight (0 to 1) of this window in the noise."""


class BaselineArrays(NamedTuple):
    """Estimates of the taxels (n,) of one patch."""

    offset: Array
    """Rest value [counts] minus the rest value in the description. The sign is reversed if pressure decreases
    the raw values."""
    noise: Array
    """Standard deviation [counts] of the noise."""
    threshold: Array
    """Deviation [counts] above which a taxel is active."""
    initialised: NDArray[np.bool_]
    """True for taxels with an estimate of their noise."""
    rested: NDArray[np.bool_]
    """True for taxels that have been at rest during at least one estimation window."""
    frozen: NDArray[np.bool_]
    """True for taxels that fluctuate at rest but were constant in the latest estimation window. Windows of
    these taxels are not used for estimates."""
    followed: Array
    """Change [counts] of the rest value in the latest estimation window, without the drift that all taxels
    have in common."""


class Window(NamedTuple):
    """Statistics of one estimation window, per taxel (n,)."""

    elapsed: float
    """Length [s] of the window."""
    mean: Array
    """Mean signal [counts]."""
    peak: Array
    """Largest deviation [counts] from the rest value."""
    second_difference: Array
    """Mean absolute second difference [counts] of the signal, from which noise is estimated. Slow changes,
    for example a touch, hardly affect this value."""
    changes: Array
    """Fraction (n,) of the frames in which the taxel's value differs from its value in the frame before."""


@inlined
def median(values: Array) -> float:
    """Returns the median of finite numbers (n,), n > 0. The call changes the order of `values`."""
    upper, odd = divmod(len(values), 2)
    first, last = 0, len(values) - 1
    while first < last:
        pivot, i, j = values[upper], first, last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < upper:
            first = i
        if i > upper:
            last = j
    if odd:
        return float(values[upper])
    lower = values[0]
    for i in range(1, upper):
        lower = max(lower, values[i])
    return float(0.5 * (lower + values[upper]))


@inlined
def _typical(estimates: BaselineArrays, room: Array) -> float:
    """Returns the median noise [counts] of the taxels that have been at rest, or of all taxels if none has
    been at rest.

    `room` (n,) is work space.
    """
    found, any_rested = 0, False
    for i in range(len(room)):
        any_rested = any_rested or estimates.rested[i]
    for i in range(len(room)):
        if estimates.rested[i] or not any_rested:
            room[found] = estimates.noise[i]
            found += 1
    return float(median(room[:found]))


@compiled(
    float64(
        record(
            BaselineArrays, writes(1), writes(1), writes(1), writes(1, boolean), writes(1, boolean),
            writes(1, boolean), writes(1),
        ),
        record(Window, float64, writes(1), writes(1), writes(1), writes(1)),
        reads(1, boolean), reads(2, int64), record(WindowSettings, *[float64] * 11), boolean, writes(2),
    )
)  # fmt: skip
def update_baseline(
    estimates: BaselineArrays, window: Window, healthy: NDArray[np.bool_],
    neighbours: NDArray[np.int64], settings: WindowSettings, afresh: bool, room: Array,
) -> float:  # fmt: skip
    """Updates rest values, noise and thresholds of the taxels of one patch from one estimation window.

    Returns the patch's typical noise [counts]. `healthy` (n,) is False for masked taxels. `neighbours` (m, 2)
    are pairs of neighbouring taxels. With `afresh`, the rest values of quiet taxels become the means of the
    window. If a taxel has stopped fluctuating, the last change of its rest value is undone, since the taxel
    may have failed before this change. `room` (6, n) is work space.
    """
    offset, noise, mean = estimates.offset, estimates.noise, window.mean
    deviation, present, ordered, quiet, touched, taught = room[0], room[1], room[2], room[3], room[4], room[5]
    found, whole = 0, 0
    for i in range(len(offset)):
        fluctuates = window.changes[i] >= settings.fluctuating
        present[i] = window.second_difference[i] / NOISE_GAIN if fluctuates else 0.0
        frozen = window.changes[i] == 0.0 and estimates.initialised[i] and noise[i] >= settings.lively
        taught[i] = healthy[i] and not frozen and not estimates.frozen[i]
        if frozen and not estimates.frozen[i]:
            offset[i] -= estimates.followed[i]
        estimates.frozen[i] = frozen
        level = max(settings.threshold * max(noise[i], present[i], settings.typical), settings.quiet)
        is_low = window.peak[i] < level
        is_quiet = taught[i] > 0.0 and is_low
        if afresh and is_quiet:
            offset[i] = mean[i]
        quiet[i], deviation[i], touched[i] = is_quiet, mean[i] - offset[i], healthy[i] and not is_low
        if is_quiet:
            ordered[found] = deviation[i]
            found += 1
        whole += healthy[i]
    drift = 0.0
    if found >= max(settings.share * whole, 1.0):
        drift = min(max(median(ordered[:found]), -settings.drift), settings.drift)
    for i in range(len(offset)):
        offset[i] += drift
        deviation[i] -= drift
        taught[i] *= touched[i]
        touched[i] *= deviation[i] > 0.0
    for k in range(len(neighbours)):  # the weak edge of a touch looks quiet
        one, other = neighbours[k, 0], neighbours[k, 1]
        if touched[one] + touched[other] == 1.0:
            beside = other if touched[one] == 1.0 else one
            quiet[beside] = min(quiet[beside], 1.0) * BESIDE
    for i in range(len(offset)):
        weight = 0.0
        if quiet[i] == 1.0:
            weight = settings.own
        elif taught[i] > 0.0 and deviation[i] < 0.0:
            weight = settings.release
        estimates.followed[i] = weight * deviation[i]
        offset[i] += estimates.followed[i]
        # Noise is cut off at the end of the range: an estimate from there may only raise it.
        cut = mean[i] - max(4.0 * noise[i], 1.0) < settings.floor
        less = cut and estimates.initialised[i] and present[i] < noise[i]
        if quiet[i] > 0.0 and window.changes[i] >= settings.fluctuating and not less:
            weight = settings.noise if estimates.initialised[i] else 1.0
            noise[i] += weight * (present[i] - noise[i])
            estimates.initialised[i] = True
        estimates.rested[i] = estimates.rested[i] or quiet[i] > 0.0
    typical = _typical(estimates, ordered)
    for i in range(len(offset)):  # a window has too few frames to show that a taxel is quieter than its patch
        estimates.threshold[i] = settings.threshold * max(noise[i], typical)
    return typical
