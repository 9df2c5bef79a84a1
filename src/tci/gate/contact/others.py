"""Several persons: a way back from the first must not press a second."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tci.gate.contact.noticing import SIGN, TWICE, Seen
from tci.gate.contact.weights import COARSE
from tci.messages.frames import Array

FELT_LATE = 0.2
"""Time [s] by which skin feels later whom a joint already told: frames of 50 Hz, conditioned."""
ROOM = 0.2
"""Fraction of the way to the first person by which a part leaves a second one, whom it met on its way back:
at 0.5 it pressed the first again where they stand 5 mm apart, at 0 the second."""
STEPS = 4
"""So often it leaves the second by as much, while they bend a joint: once more, and it is at the first."""

HIDES = float(np.deg2rad(0.4))
"""Longest such way [rad] that ends a way back: a servo that dry friction bends by less still turns."""


class First:
    """Whom a group met first, so that whoever else it meets on its way back is told from them."""

    def __init__(
        self,
        contacts: Mapping[int, Array],
        seen: Seen,
        now: float,
        *,
        away: Array | None = None,
        between: bool = False,
    ) -> None:
        """Notes whom it met.

        Args:
            contacts: normals (3,) of those that it met, by their identity; empty if only joints told of them,
                until skin feels them, too.
            seen: what the reading says.
            now: time [s].
            away: way (k,) [rad] from them towards whom it met before; None if there is nobody.
            between: skin feels both.
        """
        self._contacts, self._begun = contacts, now
        self._there, self._pull = seen.here, seen.pull
        self._pressed = seen.pull != 0.0
        # what only torques tell of does not bend a joint yet
        self._bore = np.where(np.abs(seen.bears) > SIGN, seen.bears, 0.0)
        self._away = away
        self.between = between
        """It leaves both, as far as skin tells."""
        self.frame: Mapping[int, float] = {}
        """Forces [N] by which it did last."""
        self.steps = 0 if away is None or between else STEPS
        """How often it may still go towards whom it met before."""
        self._behind, self._eases = 0, STEPS
        self._loose = None if away is None else seen.loose

    def meets_another(
        self, seen: Seen, goal: Array, side: Array, *, held: float, felt: float, now: float
    ) -> bool:
        """True if the way back to `goal` (k,) [rad] loads somebody else: with more than `felt` [N] and more
        than the first still bears, or so that a joint is held, by `held` [rad], where it goes. `side`
        (n_servos,) is where each joint pushes."""
        where = seen.reference.servos == seen.worst
        mine = seen.servos == seen.worst
        way = goal[mine] - seen.reference.position[where]
        goes = float(seen.reference.velocity[where][0])
        # not while it brakes
        ahead = goes * side[seen.worst] > 0.0 and goes * float(way[0]) > 0.0
        self._pressed &= seen.pull * self._pull > 0.0
        self._bore[seen.pull * self._bore < 0.0] = 0.0
        ahead = ahead and not (self._pressed | (self._bore != 0.0))[mine].any()
        self._behind = self._behind + 1 if ahead and seen.error > max(held, seen.excused) else 0
        if not self._contacts and now - self._begun < FELT_LATE:
            self._contacts = seen.felt.of(())
        first, another = seen.felt.other_than(self._contacts)
        return self._behind >= TWICE or another > max(felt, first)

    def presses_another(self, seen: Seen, held: float) -> bool:
        """True if, after a way back, a joint is held, by `held` [rad], on the far side from the first: its
        reference ran on against somebody else while it braked."""
        towards = (self._there - seen.here)[seen.place]
        pull = seen.pull[seen.place]
        fresh = self._away is None and pull * self._pull[seen.place] <= 0.0
        return bool(fresh and pull * towards < 0.0) and seen.error > max(held, seen.excused)

    def bends_more(self, seen: Seen, held: float) -> bool:
        """True if the latest way back, which is over, bent a joint that nobody commands further, by `held`
        [rad]."""
        before, self._loose = self._loose, seen.loose
        return before is not None and bool((seen.loose > before + held).any())

    @property
    def may_turn(self) -> bool:
        """True if it may go, or go on, towards whom it met first."""
        return self._away is None or self.steps > 0

    def pushed(self, way: Array) -> bool:
        """True if its joints pushed that `way` (k,) [rad] when it met them."""
        return float(way @ self._pull) > 0.0

    def next(self, seen: Seen, now: float, *, between: bool = False) -> First:
        """Another, whom it meets on its way back, or (`between`) together with the first."""
        away = ROOM * (self._there - seen.here)
        return First(seen.felt.of(()), seen, now, away=away, between=between)

    def room(self, here: Array) -> Array:
        """Where the group goes from a second person, a little towards the first (k,) [rad]."""
        assert self._away is not None
        self.steps -= 1
        return here + self._away

    def may_press(self, pull: Array) -> bool:
        """True if a joint still pulls, by `pull` (k,) [rad], towards the second, whom it left. By so little,
        dry friction may hold it."""
        away = self._away
        return away is not None and self.steps > 0 and bool((pull * np.sign(away) < -COARSE).any())

    @property
    def may_ease(self) -> bool:
        """True if it may ease once more."""
        return self._eases > 0

    def eased(self, seen: Seen) -> Array:
        """Where it goes (k,) [rad] from somebody whom its joints bear: to where they are, and as far again,
        if no weight bent them so."""
        self._eases -= 1
        return seen.here - np.clip(seen.references - seen.here, -HIDES, HIDES)

    def last(self, here: Array) -> Array:
        """Where it goes (k,) [rad] when the second seems free, and may not be."""
        way = self.room(here) - here
        self.steps = 0
        return here + way * min(1.0, HIDES / max(float(np.abs(way).max()), 1e-9))
