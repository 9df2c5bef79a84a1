"""Persons: how much the touches of one person differ from those of the average person."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

SPREAD = 0.42
"""Standard deviation of the logarithm of a person's pace and force. Among 18 persons the slowest and the
fastest then differ by 4.5 times, as the longest differences of median lengths in the VR gesture data set."""
SIZES = 0.12
"""The same for the size of hands. Assumed: children to large adults differ by 1.5 times."""


@dataclass(frozen=True, slots=True)
class Person:
    """Habits of one person, as factors on the values of the average person, whose factors are 1."""

    name: str = ""
    pace: float = 1.0
    """Factor on lengths and gaps; speeds and rates are divided by it."""
    force: float = 1.0
    size: float = 1.0
    """Factor on the radii of pads and on the distance of fingers."""
    repeats: float = 1.0
    """Factor on the number of pulses and passes."""
    varies: float = 0.0
    """How much this person's touches differ from one another: 0 not at all, 1 over the whole range of the
    kind."""

    @staticmethod
    def drawn(name: str, *, seed: int = 0, varies: float = 0.5) -> Person:
        """A random person, the same one for each name and seed."""
        random = np.random.default_rng([zlib.crc32(name.encode()), seed])
        pace, force, size, repeats = np.exp(random.normal(0.0, [SPREAD, SPREAD, SIZES, SPREAD])).tolist()
        return Person(name, pace, force, size, repeats, varies)


AVERAGE = Person()
"""The person who touches if no other is named."""
