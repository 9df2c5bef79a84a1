"""Mixtures of the same base motions for the robot's own skin, in the place of a refused one.

The reflex blends by how the middle of the generic limb moves. Near a joint, and on a thick limb, the skin
moves otherwise; there the base motions count that take the touched skin itself away. Into those of an upper
arm a turn about itself is mixed: where the axes of a shoulder don't meet, or accelerate differently, a lift
also drags the skin around, and the turn undoes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.beside import SMALLEST
from tci.capabilities.retreat import BEGUN, STEEP
from tci.messages import Perception
from tci.messages.frames import Array
from tci.robot.generic_arm import JOINTS

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Fractions of a base motion that are mixed."""
MOTIONS = 4
"""Base motions that are mixed at most, the most direct ones: an arm has four joints that move its skin."""
TURN = JOINTS.index("shoulder_yaw")
TURNS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Turns of an upper arm about itself, as fractions of the largest base motion of a joint."""
BAND = float(np.deg2rad(5.0))
"""Mixtures whose joints differ from the refused motion by up to so many [rad] more are tried later, so that
the answers to neighbouring places stay alike."""


def on_own_skin(
    perception: Perception,
    body: GenericBody,
    part: str,
    motions: Array,
    answers: Sequence[int],
    *,
    refused: Array,
    turns: bool,
) -> Iterator[Array]:
    """Mixtures (k, n) [rad] of base motions that take the touched skin away, steeply at their beginning and
    at their end; those nearest to the `refused` motion (n,) first.

    Args:
        perception: What is felt at this instant.
        body: The generic body.
        part: The touched arm.
        motions: Its base motions (m, n) [rad].
        answers: The contacts that ask for the motion.
        refused: The motion [rad] in whose place they come.
        turns: Whether a turn of the upper arm about itself is mixed in.
    """
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
    if turns:
        turn = np.outer(TURNS, most.max() * np.eye(len(origin))[TURN])
        mixed = (mixed[:, None] + turn).reshape(-1, len(origin))
    for share in (1.0, BEGUN):
        mixed = mixed[direct(share * mixed) >= 0.0]
    bands = np.floor(np.abs(mixed - refused).max(axis=1, initial=0.0) / BAND)
    for band in np.unique(bands):
        yield mixed[bands == band]
