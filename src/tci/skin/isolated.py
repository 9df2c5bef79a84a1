"""Settings that classify contacts of a single taxel as light touches or sensor defects.

The cover over the taxels spreads a touch, and whatever touches has a width of its own, which grows with its
force. Where taxels are close together, their neighbours therefore respond too. A single active taxel among
healthy ones is broken, or pressed so lightly that only time can tell.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tci.errors import TciError
from tci.frames import Array

EARLY = 1e-6
"""Time [s] that a frame may be early, for rounding of its stamp."""


@dataclass(frozen=True, slots=True)
class IsolatedSettings:
    """Conditions under which a single active taxel is a contact. All figures are assumed.

    Under a force F on one taxel, with area A, a neighbour at the distance d reads at least the fraction
    exp(-d^2 / 2 s^2) of its pressure, s^2 = cover^2 + A / 12 + (tip F^(1/3))^2 / 4: the variances, along one
    axis, of the cover's point spread, of a square taxel, and of a round contact, whose radius grows with the
    cube root of the force (Hertz 1882). If the expected pressure on a neighbour is `sure` times its
    threshold, the isolated taxel is broken.

    If it is not, or if all neighbours are on one side, the taxel is a contact once it was pressed for `wait`,
    and has changed meanwhile if taxels as noisy as it never stay constant. It is a contact at once if it is
    the rest of an ended contact, if another taxel within twice the `reach` is pressed (one touch over a gap
    in the skin), or if it has fewer than two trusted neighbours within `reach`.
    """

    cover: float = 3e-3
    """Standard deviation [m] of the Gaussian that the cover makes of a point load."""
    tip: float = 3e-3
    """Radius [m] of the contact at 1 N: a blunt pencil's. A fingertip's is 4 to 5 mm."""
    reach: float = 0.015
    """Largest distance [m] of a neighbour that is expected to respond to the same touch."""
    sure: float = 2.0
    """Factor by which the expected pressure on a neighbour must exceed its threshold."""
    wait: float = 0.2
    """Time [s] after which a light touch of a single taxel is accepted."""
    frames: int = 10
    """Least number of frames before it is accepted: noise exceeds a threshold in one frame, not in many in a
    row."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"isolated taxels: {field.name} {value}; valid: above 0 and finite")

    def waits(self, rate: Array) -> Array:
        """Returns the time (p,) [s] for which an isolated taxel must be pressed, on patches with frames at
        `rate` (p,) [Hz]."""
        waits: Array = np.maximum(self.wait, self.frames / rate) - EARLY
        return waits
