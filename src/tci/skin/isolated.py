"""Settings that classify contacts of a single taxel as touches or sensor defects.

The cover over the taxels spreads a touch, so where taxels are close together, several respond. A single
active taxel is pressed lightly or by something sharp, or it is broken. Its silent neighbours do not tell
which: streams without noise hide what they read below a threshold. Time does, whatever the force, so that
more force is never felt less.
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

    It is one once it was pressed for `wait`; it must have changed meanwhile if taxels as noisy as it never
    stay constant, or if it reads the end of its range. Until then it is one if it is the rest of an ended
    contact or if another taxel within twice the `reach` is pressed (one touch over a gap in the skin). It is
    one at once if it has fewer than two trusted neighbours within `reach`.
    """

    reach: float = 0.015
    """Largest distance [m] of a neighbour that a touch may press too."""
    wait: float = 0.2
    """Time [s] after which a touch of a single taxel is accepted."""
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
