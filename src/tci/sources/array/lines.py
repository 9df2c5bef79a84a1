"""Lines of text, each with the values of one pad: `[NAME] number number ...`."""

from __future__ import annotations

import re

import numpy as np

from tci.drivers.source import Sample, no_values
from tci.errors import FrameError

SPLIT = re.compile(r"[\s,;\[\]]+")
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*:?")
NUMBERS_IN_WORDS = ("nan", "inf", "infinity")
LONGEST = 1_000_000
"""Longest line [bytes]: the values of 100 000 channels."""


def sample_of(line: str, only: str, missing: float) -> Sample | None:
    """The values in a line; None for an empty line or one that begins with `#`.

    Numbers are separated by spaces, commas or semicolons; brackets count as spaces. The name of the pad comes
    first, unless there is `only` one. NaN and `missing` are no value. Raises FrameError for anything else.
    """
    words = [word for word in SPLIT.split(line) if word]
    if not words or words[0].startswith("#"):
        return None
    pad = only
    if NAME.fullmatch(words[0]) and words[0].lower() not in NUMBERS_IN_WORDS:
        pad = words.pop(0).removesuffix(":")
    if not pad:
        raise FrameError("a line without the name of its patch; valid: NAME 1 2 3, or the option patch=NAME")
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise FrameError(f"{pad}: {error}"[:120]) from None
    return Sample(pad, no_values(values, missing).astype(np.float32))


class LineBuffer:
    """Cuts a stream of bytes into lines."""

    def __init__(self) -> None:
        self._rest = b""

    def add(self, data: bytes) -> list[str]:
        """The whole lines so far. Raises FrameError if a line is longer than `LONGEST`."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST:
            self._rest = b""
            raise FrameError(f"a line of more than {LONGEST} bytes")
        return [line.decode("ascii", "replace") for line in lines]
