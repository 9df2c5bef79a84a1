"""Settings that decide if a contact of a single taxel is a touch or a sensor defect.

The cover over the taxels spreads a touch, so several taxels respond if the taxels are close together. A
single active taxel is therefore pressed lightly, pressed by a sharp object, or broken. The values of its
neighbours do not distinguish these cases: if a sensor reports nothing below a threshold, a neighbour that is
pressed lightly looks as if it is not pressed. So the duration of the touch decides. The force has no effect:
if only strong touches had to last, a stronger touch would be detected later than a lighter one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tci.errors import TciError
from tci.messages.frames import Array

EARLY = 1e-6
"""Time [s] that is subtracted from the time for which an isolated taxel must be pressed to be a contact. This
tolerance allows for rounding of the frame's stamp."""


@dataclass(frozen=True, slots=True)
class IsolatedSettings:
    """Conditions under which a single active taxel is a contact. All figures are assumed.

    The taxel becomes a contact after it has been pressed for `wait`. Some taxels must also change their
    value during this time: a taxel with so much noise that its value should not stay constant, and a taxel
    at the end of its range. The taxel is a contact immediately in three cases:
    - It is the last taxel that remains of a contact.
    - Another pressed taxel is within twice the `reach`: one touch may press both across a gap in the skin.
    - It has fewer than two trusted neighbours within `reach`.
    """

    reach: float = 0.015
    """Largest distance [m] between two pressed taxels at which they may belong to one touch."""
    wait: float = 0.2
    """Time [s] after which a single active taxel is accepted as a touch."""
    frames: int = 10
    """Least number of frames for which a single taxel must be active before it is accepted as a touch.
    Noise exceeds a threshold in single frames only."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"isolated taxels: {field.name} {value}; valid: above 0 and finite")

    def waits(self, rate: Array) -> Array:
        """Returns the time (p,) [s] for which an isolated taxel of each patch must be pressed.

        `rate` (p,) [Hz] is the frame rate of the patches.
        """
        waits: Array = np.maximum(self.wait, self.frames / rate) - EARLY
        return waits
