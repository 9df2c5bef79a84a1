"""Other blends of the same fields, near one that is refused.

Near a limit of a joint the blend may drag the object along or press the skin into it, while a motion in which
one or two joints stop a few degrees earlier doesn't.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations

import numpy as np

from tci.messages.frames import Array, read_only

STEPS = (0.08, 0.16, 0.24)
"""By how much a joint stops earlier, as fractions of its base motion; less is tried first, so that the
answers to neighbouring places stay alike."""
SHORT = 0.2
"""Length [m] of a segment below which nothing is tried: on so short a limb the answers to places 13 mm apart
differ by up to 5 degrees already, on NAO and iCub by 6 to 8 with this."""
SMALLEST = 0.5
"""Some joint moves by this fraction of its base motion: every answer is at least half of a full one."""


def beside(motion: Array, most: Array) -> Array:
    """Motions (m, n) [rad] beside `motion` (n,), the nearest first: one or two joints move less.

    `most` (n,) [rad] are the largest base motions of the joints.
    """
    shrinks = _shrinks(tuple(np.flatnonzero(motion).tolist()), len(motion))
    others = np.sign(motion) * np.maximum(np.abs(motion) - shrinks * most, 0.0)
    found: Array = others[np.any(np.abs(others) >= SMALLEST * np.where(most > 0.0, most, np.inf), axis=1)]
    return found


@cache
def _shrinks(joints: tuple[int, ...], count: int) -> Array:
    rows = []
    for step in STEPS:
        for changed in (*combinations(joints, 1), *combinations(joints, 2)):
            rows.append([step * (joint in changed) for joint in range(count)])
    return read_only(np.reshape(rows, (-1, count)))
