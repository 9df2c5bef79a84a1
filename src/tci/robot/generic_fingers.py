"""The generic fingers of a hand: flexion and spread of each of five fingers.

At generic zero all fingers are straight and side by side, and the thumb is beside the palm. Flexion towards
the palm is positive. The value of flexion is the angle of the finger's first joint; the finger's other joints
move in proportion to this angle. Spread away from the middle finger is positive. For the middle finger
itself, spread towards the index finger is positive. The spread of the thumb is its opposition: 0 beside the
palm, 90 degrees when the thumb is in front of the palm. Equal signs mean equal motions on the left and the
right hand.
"""

from __future__ import annotations

FINGERS = ("thumb", "index", "middle", "ring", "little")
"""Names of the fingers. The segments that carry the skin of the fingertips also have these names."""
PALM = "palm"
"""Name of the segment that carries the skin of the palm."""
JOINTS = tuple(f"{finger}_{motion}" for finger in FINGERS for motion in ("spread", "flexion"))
"""Generic joints, by generic id."""
FLEXIONS = tuple(range(1, len(JOINTS), 2))
"""Generic ids of the flexions, in the order of `FINGERS`."""
