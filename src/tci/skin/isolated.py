"""Settings that classify contacts of a single taxel as touches or sensor defects.

The cover over the taxels spreads a touch, so several taxels respond if they are close together. A single
active taxel is therefore pressed lightly, pressed by a sharp object, or broken. Its inactive neighbours do
not show which, because a stream without noise contains no values below a threshold. So the duration decides,
for every force: a stronger touch must not be detected later than a lighter one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tci.errors import TciError
from tci.frames import Array

EARLY = 1e-6
"""Time [s] by which a frame may be early, to allow for rounding of its stamp."""


@dataclass(frozen=True, slots=True)
class IsolatedSettings:
    """Conditions under which a single active taxel is a contact. All figures are assumed.

    The taxel becomes a contact after it has been pressed for `wait`. If its noise is so high that its value
    should not stay constant, or if it reads the end of its range, its value must also have changed during
    this time. The taxel is a contact immediately in three cases: it is what remains of a contact; another
    pressed taxel is within twice the `reach` (one touch across a gap in the skin); or it has fewer than two
    trusted neighbours within `reach`.
    """

    reach: float = 0.015
    """Largest distance [m] between two taxels that one touch presses."""
    wait: float = 0.2
    """Time [s] after which a touch of a single taxel is accepted."""
    frames: int = 10
    """Least number of frames before a single taxel is accepted, because noise exceeds a threshold in single
    frames only."""

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
