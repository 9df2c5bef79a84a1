"""Finds the channels of a raw recording that are taxels, from the values alone, without a position file.

An iCub's boards send 12 values per triangular module. Two of the 12 values belong to thermal pads, not to
taxels. For a module that is not mounted, the board sends constant values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.messages.frames import Array

PER_MODULE = 12
_PAD = 0.25
"""A channel counts as a thermal pad, not as a taxel, if its range of values is below this fraction of the
median range in its module (a group of channels). Assumed: far above 0.07, the fraction for the pads on an
iCub's foot."""


def live_channels(values: Array, *, per_module: int = PER_MODULE) -> NDArray[np.bool_]:
    """Returns a mask (channels,) of the channels that are taxels, from frames (n, channels) with touches.

    A skin consists of modules, which are boards with `per_module` channels each. If no channel of a module
    ever changes, its channels are not counted as taxels. The module is then absent or sends no data; the
    values don't distinguish between these cases. The thermal pads have equal channel numbers (0 to
    `per_module` - 1) within all modules. A channel number belongs to a pad if its values vary little in most
    modules. Raises TciError for frames that do not divide into modules, that contain values that are not
    finite, or in which no value changes.
    """
    if values.ndim != 2 or values.shape[1] % per_module or not len(values):
        raise TciError(f"frames of shape {values.shape}; valid: (n, a multiple of {per_module})")
    if not np.isfinite(values).all():
        raise TciError("frames hold values that are not finite")
    spread = np.ptp(values, axis=0).reshape(-1, per_module)
    present = spread.any(axis=1)
    if not present.any():
        raise TciError("nothing changes in these frames; valid: a recording in which the skin is touched")
    typical = np.median(spread[present], axis=1)
    pads = np.median(spread[present] / np.maximum(typical, 1e-9)[:, None], axis=0) < _PAD
    result: NDArray[np.bool_] = (present[:, None] & ~pads).ravel()
    return result
