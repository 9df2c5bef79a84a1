"""A resting part that somebody presses gives way: its reference follows the hand.

Where no skin feels the hand, only a bent joint tells of it, and a weight bends it, too. So the reference then
goes step by step to where the joint is. What bends a joint as much after a step as before, and as much half a
second later, is a weight, or somebody who presses as a weight does, and the part holds it.
"""

from __future__ import annotations

import numpy as np

from tci.gate.contact.weights import ALIKE, COARSE
from tci.messages.frames import Array

LIGHT = 5.0
"""Force [N] on skin below which a contact is over, as a person feels it."""
UNLOADED = 1.0
"""Force [N] on skin below which nothing bends a resting joint."""
YIELDS = float(np.deg2rad(0.3))
"""Angle [rad] by which somebody bends a soft joint before its reference follows: more than encoders step, and
half of what 15 N bend a stiff arm by."""
FINE = float(np.deg2rad(0.02))
"""The same where skin feels the hand: 15 N bend an arm of stiff servos by no more."""
LASTS = 0.5
"""Time [s] for which a part still gives way after it was bent, or went a step, last."""


class Softness:
    """Whether one group gives way."""

    def __init__(self) -> None:
        self.soft = False
        """Somebody presses the resting part, and its reference follows."""
        self._led = False  # by a hand that skin feels, so nothing need be told from a weight
        self._bent: Array | None = None
        self._moved = np.nan
        self._pressed = -np.inf
        self._last: Array | None = None
        self._steady: tuple[float, Array] | None = None

    def rest(self, bent: Array, moved: float) -> None:
        """Notes angles (k,) [rad] between reference and joint when it rests unloaded, since it `moved` last
        [s]: gravity's work. What grows later is somebody's."""
        before, self._bent = self._bent, bent
        if before is not None and moved == self._moved:
            self._bent = np.where(np.abs(bent) < np.abs(before), bent, before)
        self._moved = moved

    def let_go(self, now: float) -> None:
        """Nothing presses at `now` [s], or so little that a joint hardly tells."""
        self._led = False
        if now - self._pressed > LASTS:
            self.soft, self._last = False, None

    def step(
        self,
        here: Array,
        reference: Array,
        force: float,
        *,
        most: float,
        held: float,
        moves: bool,
        moved: float,
        bent: bool,
        rests: bool,
        now: float,
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
            moved: when it moved last [s].
            bent: whether something bends a joint.
            rests: whether the reference rests for so long that nothing lags any more.
            now: time [s].
        """
        bent = bent and not moves
        if self._bent is None or (force < UNLOADED and not (moves or self.soft)):
            self.rest(np.clip(reference - here, -held, held), moved)
        assert self._bent is not None
        self._led = not moves and (force > most or (self._led and force > LIGHT))
        if bent:
            self.soft, self._pressed = True, now
        elif force > most and not moves:
            self.soft = True
        elif force <= LIGHT:
            self.let_go(now)
        off = here + self._bent - reference
        if not self.soft or np.abs(off).max() <= (FINE if self._led else YIELDS):
            return None
        return here + self._bent if self._led else self._step(here, reference, off, now, rests=rests)

    def _step(self, here: Array, reference: Array, off: Array, now: float, *, rests: bool) -> Array | None:
        """The next step, if nothing tells a weight: a hand's bend differs from that before, or changes while
        the reference rests."""
        if not rests:
            self._steady = None
            return None
        if self._last is not None and _alike(off, self._last):
            since, then = self._steady = self._steady or (now, off)
            if np.abs(off - then).max() <= COARSE:
                if now - since > LASTS:
                    self._bent, self._last = reference - here, None
                return None
        self._last, self._steady, self._pressed = off, None, now
        return reference + off


def _alike(one: Array, other: Array) -> bool:
    return bool((np.abs(one - other) <= np.maximum(ALIKE * np.abs(one), COARSE)).all())
