"""Check of a motion in response to a touch: it must not press the skin into an object that touches it.

Each capability that responds to touches asks here first. The direction "away" is that of the contact normals,
not that of the receptive fields, and does not depend on the shape of the generic body.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.body.generic_body import GenericBody
from tci.frames import Array
from tci.messages import Mode, Perception

PRESSED = 1e-5
"""Depth [m] up to which a motion counts as tangential to the skin: rounding."""
LEAST = 1e-3
"""Least distance [m] that the contact point must move away from the object. Assumed: less would not end the
contact with a soft object."""
STEEP = 0.2
"""Least ratio of the motion away from the object to the motion across it. Assumed: the friction coefficient
of skin is larger, so a flatter motion would drag the object along."""


def why_not(
    perception: Perception,
    body: GenericBody,
    part: str,
    target: Array,
    *,
    mode: Mode = Mode.POSITION,
    answers: Sequence[int] = (),
) -> str:
    """Returns the reason why a part must not move to generic angles `target` (n,) [rad]; empty if it may.

    No contact of the robot, on any part, may be pressed anywhere on the way. Of the contacts that the motion
    `answers`, given by their indices in `perception.contacts`, at least one must get away. `mode` is the
    control mode of the motion.
    """
    inwards, across = body.retreat(perception, part, target, mode)
    if not inwards.size:
        return ""
    deepest = inwards.min(axis=0)
    worst = int(deepest.argmin())
    if deepest[worst] < -PRESSED:
        patch = perception.contacts[worst].patch
        return (
            f"its motion would press {patch} {-deepest[worst] * 1e3:.2g} mm into the object that touches it; "
            "valid: a motion away from it"
        )
    reasons = [_why_kept(perception.contacts[one].patch, inwards[:, one], across[:, one]) for one in answers]
    return reasons[0] if reasons and all(reasons) else ""


def are_hopeless(
    perception: Perception,
    body: GenericBody,
    part: str,
    targets: Array,
    answers: Sequence[Sequence[int]],
) -> list[bool]:
    """Returns True for each motion that `why_not` would refuse for its end alone.

    Each has a row of `targets` (m, n) [rad] and the contacts that it `answers`. The others need a closer
    look.
    """
    inwards = body.retreat_at_ends(perception, part, targets)[0]
    pressed = inwards.min(axis=1, initial=np.inf) < -PRESSED
    return [
        bool(one) or all(way[contact] < LEAST for contact in own)
        for one, way, own in zip(pressed, inwards, answers, strict=True)
    ]


def _why_kept(patch: str, way: Array, across: Array) -> str:
    """Returns the reason why a contact point does not get away from the object; empty if it does.

    Args:
        patch: Patch of the contact.
        way: Displacement (k,) [m] away from the object at k points of the motion.
        across: Displacement (k,) [m] tangential to the skin.
    """
    if way[-1] < LEAST:
        return (
            f"its motion would take {patch} {way[-1] * 1e3:.2g} mm away from the object that touches it; "
            f"valid: {LEAST * 1e3:g} mm or more"
        )
    if (way < STEEP * across).any():
        return f"its motion would drag {patch} along the object that touches it; valid: a motion away from it"
    return ""
