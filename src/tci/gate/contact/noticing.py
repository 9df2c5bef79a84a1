"""Whether a group of servos meets something: a joint is held or bears more than a moment ago, or one that
nobody commands is bent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.gate.contact.felt import Felt
from tci.gate.contact.following import CLEAR
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.weights import MOST, SHAKEN
from tci.gate.joint_monitor import Reference
from tci.messages import JointReading
from tci.messages.frames import Array

AT_REST = 0.6
"""Fraction of `held` at which a joint counts as held once its reference has rested for `lag` and a little:
nothing lags then, so less tells more."""
EARLIER = 0.15
"""Longest time [s] by which the way back ends before the contact was seen: by then the joint was not held
yet."""
SOONER = 0.05
"""The same [s] for what is noticed within a few readings or frames: a joint bears more, or skin feels."""
SIGN = 0.2
"""Fraction of the torque that counts from which on its sign tells where somebody is: more than noise."""
PUSHES = 0.5
"""The same from which on signs of all joints together tell where it pushes: twice what dry friction is that
turned."""
TWICE = 2
"""Successive readings that must show it: a single one may be late."""


class Seen(NamedTuple):
    """What a new reading says of one group."""

    joints: JointReading
    reference: Reference
    servos: NDArray[np.intp]
    """Its servos (k,)."""
    here: Array
    """Where its joints are (k,) [rad]."""
    pull: Array
    """By how much each is behind its reference (k,) [rad]; 0 if that is little."""
    own: NDArray[np.bool_]
    """Which of them follow a reference (k,)."""
    errors: Array
    """Angle (k,) [rad] of each outside its recent references; NaN without a reference."""
    bounds: Array
    """Errors (k,) [rad] beyond which they count as held."""
    weights: Array
    """Angles (k,) [rad] by which a weight may bend them at rest."""
    place: int
    """That of the servo whose error is the largest part of what it may be. By its own bound: else a joint
    that a weight bends hides another one that somebody holds."""
    felt: Felt
    loose: Array
    """By how much each that nobody commands left its place (k,) [rad]; 0 if a weight may have bent it."""
    bears: Array
    """Torque (k,) that each bears more than a moment ago, or than before the contact, as a multiple of what
    comes from outside."""

    @property
    def references(self) -> Array:
        """References (k,) [rad]; where it has none, where the joint is."""
        whole = self.joints.position.copy()
        whole[self.reference.servos] = self.reference.position
        found: Array = whole[self.servos]
        return found

    @property
    def push(self) -> Array:
        """Where its joints push whom it meets (k,), as `bears`; as they move if torques tell nothing yet."""
        if (np.abs(self.bears) > PUSHES).any():
            return self.bears
        rates = self.rates
        found: Array = rates / max(float(np.abs(rates).max()), 1e-9)
        return found

    @property
    def rates(self) -> Array:
        """Speeds (k,) [rad/s] of its references; 0 where it has none."""
        whole = np.zeros(len(self.joints.position))
        whole[self.reference.servos] = self.reference.velocity
        found: Array = whole[self.servos]
        return found

    @property
    def fastest(self) -> float:
        """Largest speed [rad/s] of its references."""
        mine = np.isin(self.reference.servos, self.servos)
        return float(np.abs(self.reference.velocity[mine]).max(initial=0.0))

    @property
    def worst(self) -> int:
        return int(self.servos[self.place])

    @property
    def error(self) -> float:
        """By how much [rad]."""
        return float(self.errors[self.place])

    @property
    def bound(self) -> float:
        """Error [rad] beyond which it counts as held."""
        return float(self.bounds[self.place])

    @property
    def excused(self) -> float:
        """Angle [rad] by which a weight may bend it at rest."""
        return float(self.weights[self.place])

    @property
    def loosest(self) -> int:
        """The servo that nobody commands and that left its place by most."""
        return int(self.servos[np.argmax(self.loose)])

    @property
    def bent(self) -> float:
        """By how much [rad]."""
        return float(self.loose.max())


def bounds(excused: Array, settings: ContactSettings, *, rests: bool) -> Array:
    """Errors (k,) [rad] beyond which joints count as held that a weight may bend by `excused` (k,) [rad]. A
    group that `rests` has done so for so long that nothing lags any more."""
    least, shaken = (AT_REST, 1.0) if rests else (1.0, SHAKEN)
    found: Array = np.maximum(settings.held * least, np.minimum(shaken * excused, MOST))
    return found


@dataclass(slots=True)
class Noticing:
    """What successive readings of one group showed."""

    outside: int = 0
    """Successive readings that show something."""
    since: float = 0.0
    """When the first of them was measured [s]."""
    early: float = EARLIER
    """Time [s] from a contact until it is seen."""
    clear: float = -np.inf
    """When nothing held any of its joints last [s]."""
    bears: bool = False
    """A joint bears more than a moment ago, by the latest reading."""
    held: bool = False
    """A joint that follows a reference is held, by the latest reading."""

    def look(self, seen: Seen, settings: ContactSettings, *, moves: bool) -> None:
        """Notes a reading. The group `moves`, or did a moment ago."""
        self.held = seen.error > seen.bound
        if seen.error < CLEAR * settings.held:
            self.clear = seen.joints.stamp
        # somebody who moves it while the others rest does so on purpose
        bent = moves and seen.bent > settings.held
        self.bears = bool((np.abs(seen.bears) > 1.0).any())
        self.outside = self.outside + 1 if self.held or bent or self.bears else 0
        if self.outside == 1:
            self.since = seen.joints.stamp
            # a joint counts as held once its reference went on by that
            self.early = min(EARLIER, SOONER + settings.held / max(seen.fastest, 1e-9))

    def nothing(self, stamp: float) -> None:
        """Notes a reading in which every joint is near its reference."""
        self.outside, self.clear = 0, stamp

    def forget(self) -> None:
        self.outside, self.clear = 0, -np.inf

    @property
    def sure(self) -> bool:
        return self.outside >= TWICE

    def before(self, lag: float) -> float:
        """Time [s] at which nothing was met yet. A held joint may have lagged by `lag` [s] before."""
        early = SOONER if self.bears and not self.held else self.early
        return min(self.since - early, self.clear - lag * (not self.bears))
