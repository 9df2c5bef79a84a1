"""The two dialects of YARP, 3.x and 4.x. One type number can mean different types in the two dialects, so a
program must choose the dialect."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Dialect:
    """Type numbers (tags) of one dialect. Only the tags that differ between YARP 3.x and 4.x are listed."""

    name: str
    """Major version: `3` or `4`."""
    float64: int
    """Tag of a double."""
    float32: int
    """Tag of a single-precision float. In 4.x it has the number that means a double in 3.x."""
    vocab64: int | None
    """Tag of a vocabulary of up to eight letters. The value is None if the dialect lacks this type."""


V3 = Dialect("3", float64=10, float32=128, vocab64=None)
"""YARP 3.12, which icub-main 2.11 requires."""
V4 = Dialect("4", float64=20, float32=10, vocab64=18)
"""YARP 4.0."""
DIALECTS = {dialect.name: dialect for dialect in (V3, V4)}
