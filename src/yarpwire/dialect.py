"""The two dialects of YARP. Their type numbers overlap, so a message is never read as the other dialect."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Dialect:
    """Differences on the wire between YARP 3.x and 4.x."""

    name: str
    """Major version: `3` or `4`."""
    float64: int
    """Tag of a double."""
    float32: int
    """Tag of a single-precision float. The 4.x tag is the double's tag in 3.x."""
    vocab64: int | None
    """Tag of an eight-letter vocabulary; None if the dialect has none."""


V3 = Dialect("3", float64=10, float32=128, vocab64=None)
"""YARP 3.12, which icub-main 2.11 requires."""
V4 = Dialect("4", float64=20, float32=10, vocab64=18)
"""YARP 4.0."""
DIALECTS = {dialect.name: dialect for dialect in (V3, V4)}
