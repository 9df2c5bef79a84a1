"""Where a motion leads: nothing moves because of a touch if that would press what is touched.

Each capability that answers touches asks here first. The contact's normal says where away is; the
directions of its fields, and what the generic body is taken to look like, do not.
"""

from __future__ import annotations

from collections.abc import Sequence

from tci.body.generic_body import GenericBody
from tci.frames import Array
from tci.messages import Mode, Perception

PRESSED = 1e-5
"""Depth [m] up to which a motion counts as one along the skin: rounding."""
LEAST = 1e-3
"""How far [m] the point of the contact that is answered must get away. Assumed: less gets nothing free."""
STEEP = 0.2
"""Least share of its way across the skin that it goes away. Assumed: no skin is smoother than that."""


def why_not(
    perception: Perception,
    body: GenericBody,
    part: str,
    target: Array,
    *,
    mode: Mode = Mode.POSITION,
    answers: Sequence[int] = (),
) -> str:
    """Why a part must not go to generic angles `target` (n,) in a mode; empty when it may.

    Nowhere on the way may anything that the robot feels be pressed, whichever part it touches, and the
    contacts that it `answers`, by their places in `perception.contacts`, must not all stay.
    """
    inwards, across = body.retreat(perception, part, target, mode)
    if not inwards.size:
        return ""
    deepest = inwards.min(axis=0)
    worst = int(deepest.argmin())
    if deepest[worst] < -PRESSED:
        patch = perception.contacts[worst].patch
        return f"its motion would press {patch} {-deepest[worst] * 1e3:.2g} mm into what touches it"
    reasons = [_why_kept(perception.contacts[one].patch, inwards[:, one], across[:, one]) for one in answers]
    return reasons[0] if reasons and all(reasons) else ""


def _why_kept(patch: str, way: Array, across: Array) -> str:
    """Why the point of a contact does not get away by a `way` (k,) [m]; empty when it does."""
    if way[-1] < LEAST:
        return (
            f"its motion would take {patch} {way[-1] * 1e3:.2g} mm away from what touches it; "
            f"valid: {LEAST * 1e3:g} mm"
        )
    if (way < STEEP * across).any():
        return f"its motion would drag {patch} along what touches it"
    return ""
