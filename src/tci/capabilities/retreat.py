"""Where a motion leads: nothing moves because of a touch if that would press what is touched.

Each capability that answers touches asks here first. The contact's normal says where away is; the
directions of its fields, and what the generic body is taken to look like, do not.
"""

from __future__ import annotations

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
    part: str,
    target: Array,
    *,
    mode: Mode = Mode.POSITION,
    answers: int | None = None,
) -> str:
    """Why a part must not go to generic angles `target` (n,) in a mode; empty when it may.

    Nowhere on the way may anything that the robot feels be pressed, whichever part it touches, and the
    contact that it `answers`, by its place in `perception.contacts`, must get away.
    """
    inwards, across = perception.retreat(perception.contacts, part, target, mode)
    if not inwards.size:
        return ""
    deepest = inwards.min(axis=0)
    worst = int(deepest.argmin())
    if deepest[worst] < -PRESSED:
        patch = perception.contacts[worst].patch
        return f"its motion would press {patch} {-deepest[worst] * 1e3:.2g} mm into what touches it"
    if answers is None:
        return ""
    patch, way = perception.contacts[answers].patch, inwards[:, answers]
    if way[-1] < LEAST:
        return (
            f"its motion would take {patch} {way[-1] * 1e3:.2g} mm away from what touches it; "
            f"valid: {LEAST * 1e3:g} mm"
        )
    if (way < STEEP * across[:, answers]).any():
        return f"its motion would drag {patch} along what touches it"
    return ""
