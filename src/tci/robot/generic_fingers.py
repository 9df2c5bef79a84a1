"""The generic fingers of a hand: flexion and spread of each of five fingers.

At generic zero all fingers are straight and side by side, the thumb beside the palm. Flexion, towards the
palm, is the angle of the finger's first joint; the other joints follow in proportion. Spread is positive away
from the middle finger; for the middle finger it is positive towards the index finger. The spread of the thumb
is its opposition: 0 beside the palm, 90 degrees across the palm. Signs are equal on both sides.
"""

from __future__ import annotations

FINGERS = ("thumb", "index", "middle", "ring", "little")
"""Names of the fingers, also of the segments that carry the skin of their tips."""
PALM = "palm"
"""Name of the segment that carries the skin of the palm."""
JOINTS = tuple(f"{finger}_{motion}" for finger in FINGERS for motion in ("spread", "flexion"))
"""Generic joints, by generic id."""
FLEXIONS = tuple(range(1, len(JOINTS), 2))
"""Generic ids of the flexions, in the order of `FINGERS`."""
