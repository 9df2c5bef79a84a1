"""The generic fingers of a hand: flexion and spread of each of five fingers.

At generic zero all fingers are straight and side by side, the thumb beside the palm. Flexion, towards the
palm, is that of the whole finger: the angle of its first joint, which the others follow in proportion. Spread
is positive away from the middle finger, and that of the middle finger towards the index finger; that of the
thumb is its opposition, from beside the palm to across it at 90 degrees. Signs are the same on both sides.
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
