"""Checks of the arguments of received calls."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from tci.messages.frames import Array
from yarpwire.errors import CallError, WireError
from yarpwire.values import Vocab


def joint_numbers(numbers: Sequence[Any], count: int, part: str) -> list[int]:
    """Returns the joint numbers in a call. Raises CallError if a number is not in 0..`count`-1 or is
    repeated."""
    chosen = [int(n) for n in _listed(numbers) if isinstance(n, int) and 0 <= n < count]
    if not chosen or not len(numbers) == len(chosen) == len(set(chosen)):
        raise CallError(f"joints {str(numbers)[:60]} of {part}; valid: 0 to {count - 1}, each once")
    return chosen


def finite(numbers: Sequence[Any], count: int) -> Array:
    """Returns the numbers (count,) in a call.

    Raises CallError if the count differs, or if a value is not a finite number.
    """
    values = [float(number) for number in _listed(numbers) if isinstance(number, int | float)]
    if not len(values) == len(_listed(numbers)) == count or not np.all(np.isfinite(values)):
        raise CallError(f"{str(numbers)[:60]} in place of numbers; valid: {count} finite numbers")
    return np.array(values)


def modes(words: Sequence[Any], count: int, part: str, valid: Collection[Vocab]) -> list[Vocab]:
    """Returns the modes (count,) in a call, which may be given as letters or as their numbers.

    Raises CallError if the count differs, or if a mode is not among `valid`.
    """
    with suppress(WireError):
        found = [Vocab(word) for word in _listed(words)]
        if len(found) == count and all(word in valid for word in found):
            return found
    raise CallError(
        f"modes {str(words)[:60]} for {count} joints of {part}; valid, one per joint: "
        + ", ".join(str(word) for word in valid)
    )


def _listed(items: object) -> Sequence[Any]:
    """Returns `items` if `items` is a list, otherwise an empty list."""
    return items if isinstance(items, list | tuple) else ()
