"""A resting part that somebody presses gives way: its reference follows the hand."""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array

LIGHT = 5.0
"""Force [N] on skin below which a contact is over, as a person feels it."""
UNLOADED = 1.0
"""Force [N] on skin below which nothing bends a resting joint."""
YIELDS = float(np.deg2rad(0.3))
"""Angle [rad] by which somebody bends a soft joint before its reference follows: more than encoders step, and
half of what 15 N bend a stiff arm by."""


class Softness:
    """Whether one group gives way."""

    def __init__(self) -> None:
        self.soft = False
        """Somebody presses the resting part, and its reference follows."""
        self._bent: Array | None = None

    def rest(self, bent: Array) -> None:
        """Notes angles (k,) [rad] between reference and joint when it rests unloaded: gravity's work."""
        self._bent = bent

    def step(
        self, here: Array, reference: Array, force: float, *, most: float, held: float, moves: bool
    ) -> Array | None:
        """Where the reference (k,) [rad] goes, if at all. It stays as far from the joint as gravity alone
        bends it.

        Args:
            here: where the joints are (k,) [rad].
            reference: where they should be (k,) [rad].
            force: on the skin [N].
            most: force [N] from which on the part gives way.
            held: angle [rad] that gravity bends it by at most.
            moves: whether the part moves, or did a moment ago.
        """
        if self._bent is None or (force < UNLOADED and not moves):
            self._bent = np.clip(reference - here, -held, held)
        if force > most and not moves:
            self.soft = True
        elif force <= LIGHT:
            self.soft = False
        goal: Array = here + self._bent
        return goal if self.soft and np.abs(goal - reference).max() > YIELDS else None
