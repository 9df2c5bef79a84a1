"""Settings that classify contacts of a single taxel as light touches or sensor defects.

A touch is as wide as the cover over the taxels makes it, and what touches is wide itself, the wider the
harder it presses. Where taxels are near, their neighbours feel it too; a taxel alone beside healthy ones that
feel nothing is broken, or pressed so lightly that only time tells.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tci.errors import TciError
from tci.frames import Array

EARLY = 1e-6
"""Time [s] that a frame may be early by rounding."""


@dataclass(frozen=True, slots=True)
class IsolatedSettings:
    """Conditions under which a taxel that is pressed all alone is a touch. All figures are assumed.

    Under a force F on one taxel, with area A, a neighbour at the distance d feels at least the share
    exp(-d^2 / 2 s^2) of its pressure, s^2 = cover^2 + A / 12 + (tip F^(1/3))^2 / 4: the variances, along one
    side, of what the cover makes of a point, of a square taxel, and of a round contact, whose radius grows
    with the cube root of the force (Hertz 1882). Where a neighbour should feel `sure` times what it would
    notice, the isolated taxel is broken. Where it need not, or where all neighbours are on one side, the
    taxel is a touch once it was pressed for `wait` (and has changed meanwhile, if noise lets no taxel like
    it stay constant), and until then if it is what is left of a touch, or if another taxel within twice the
    `reach` is pressed: one touch, over a gap in the skin. One with fewer than two trusted neighbours within
    `reach` is always a touch.
    """

    cover: float = 3e-3
    """Width [m] of the Gaussian that the cover over the taxels makes of a point."""
    tip: float = 3e-3
    """Radius [m] of the contact at 1 N: a blunt pencil. A fingertip's is 4 to 5 mm."""
    reach: float = 0.015
    """Distance [m] up to which a neighbour can be expected to feel the same touch."""
    sure: float = 2.0
    """Factor by which the expected pressure on a neighbour must exceed what it notices."""
    wait: float = 0.2
    """Time [s] for which a light touch of a single taxel is not accepted yet."""
    frames: int = 10
    """Least number of frames likewise: noise passes a threshold in one, not in many at a stretch."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"isolated taxels: {field.name} {value}; valid: above 0 and finite")

    def waits(self, rate: Array) -> Array:
        """Time (p,) [s] for which an isolated taxel must be pressed, on patches with frames at `rate` (p,)
        [Hz]."""
        waits: Array = np.maximum(self.wait, self.frames / rate) - EARLY
        return waits
