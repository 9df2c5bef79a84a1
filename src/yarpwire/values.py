"""Values of a Bottle: Python types, and small subclasses for further types of YARP.

An int is sent as int32 or int64, depending on its size. A float is sent as float64, bytes as YARP's type
blob, and a bool as YARP's type vocab (a word of up to four letters). The subclasses are Vocab, Vocab64, Int8,
Int16, Int64, Float32, Dict and Loose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yarpwire.errors import WireError

Array = NDArray[np.float64]


class Vocab(int):
    """A vocabulary: up to four letters that are packed into an int32, such as `Vocab("set")`. A Vocab
    compares as equal to this integer."""

    def __new__(cls, word: str | int) -> Vocab:
        """Creates a vocabulary from its letters, or from the integer into which they are packed. Raises
        WireError unless `word` has one to four letters, or is an int32."""
        return super().__new__(cls, _pack(word, 4))

    @property
    def word(self) -> str:
        """Letters of the vocabulary."""
        return _letters(self, 4)

    def __repr__(self) -> str:
        return f"[{self.word}]"


class Vocab64(int):
    """A vocabulary of up to eight letters that are packed into an int64 (4.x only)."""

    def __new__(cls, word: str | int) -> Vocab64:
        return super().__new__(cls, _pack(word, 8))

    @property
    def word(self) -> str:
        """Letters of the vocabulary."""
        return _letters(self, 8)


class Int8(int):
    """An integer of one byte."""


class Int16(int):
    """An integer of two bytes."""


class Int64(int):
    """An integer that always takes eight bytes."""


class Float32(float):
    """A float of four bytes."""


class Dict(list[Any]):
    """A list that is marked as a dictionary. The items of the dictionary are lists (key value)."""


class Loose(list[Any]):
    """A list in which each item has its own tag, although all items have one type. Replies of 4.x contain
    these lists."""


Value = int | float | str | bytes | Sequence[Any]
"""One item of a Bottle. Lists may contain lists."""


def _pack(word: str | int, size: int) -> int:
    if not isinstance(word, str):
        half = 1 << 8 * size - 1
        if not isinstance(word, int) or not -half <= word < half:
            raise WireError(f"vocabulary {str(word)[:40]}; valid: 1 to {size} letters, or their integer")
        return word
    letters = word.encode("latin-1", errors="replace")
    if not 0 < len(letters) <= size:
        raise WireError(f"vocabulary {word!r}; valid: 1 to {size} letters")
    return int.from_bytes(letters.ljust(size, b"\0"), "little", signed=True)


def _letters(number: int, size: int) -> str:
    return int(number).to_bytes(size, "little", signed=True).rstrip(b"\0").decode("latin-1")


TRUE, FALSE = Vocab(ord("1")), Vocab(0)
