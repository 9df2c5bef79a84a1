"""Mixtures of the same base motions for the robot's own skin, in the place of a refused one.

The reflex blends by how the middle of the generic limb moves. Near a joint, and on a thick limb, the skin
moves otherwise; there the base motions count that take the touched skin itself away.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.beside import SMALLEST
from tci.capabilities.retreat import STEEP
from tci.messages import Perception
from tci.messages.frames import Array

BEGUN = 0.1
"""Fraction of a motion at whose end its direction is taken first: a path that begins along the object is
refused. Assumed: short against the way, long against rounding."""
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Fractions of a base motion that are mixed."""
MOTIONS = 4
"""Base motions that are mixed at most, the most direct ones: an arm has four joints that move its skin."""


def on_own_skin(
    perception: Perception, body: GenericBody, part: str, motions: Array, answers: Sequence[int]
) -> Array:
    """Mixtures (k, n) [rad] of base `motions` (m, n) [rad] of `part` that take the contacts `answers` away,
    steeply at their beginning and at their end."""
    origin = perception.posture[part]

    def direct(ways: Array) -> Array:
        inwards, across = body.retreat_at_ends(perception, part, origin + ways)[:, :, answers]
        return np.asarray((inwards - STEEP * across).max(axis=1))

    inwards = body.retreat_at_ends(perception, part, origin + BEGUN * motions)[0][:, answers].max(axis=1)
    order = np.argsort(-direct(BEGUN * motions), kind="stable")
    away = motions[[one for one in order.tolist() if inwards[one] > 0.0][:MOTIONS]]
    shares = np.array([*product(SHARES, repeat=len(away))])
    shares = shares[shares.max(axis=1, initial=0.0) >= SMALLEST]
    most = np.abs(motions).max(axis=0)
    mixed = np.clip(shares @ away, -most, most)
    steep = (direct(BEGUN * mixed) >= 0.0) & (direct(mixed) >= 0.0)
    return np.asarray(mixed[steep])
