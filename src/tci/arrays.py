"""Types of the arrays that compiled loops take, so that each loop is compiled once, for all callers."""

from __future__ import annotations

from typing import Any

from numba import float64, types


def reads(dimensions: int, dtype: Any = float64) -> Any:
    """An array that the loop only reads; contiguous."""
    return types.Array(dtype, dimensions, "C", readonly=True)


def views(dimensions: int, dtype: Any = float64) -> Any:
    """A small array that the loop only reads, with any strides."""
    return types.Array(dtype, dimensions, "A", readonly=True)


def writes(dimensions: int, dtype: Any = float64) -> Any:
    """An array that the loop changes; contiguous."""
    return types.Array(dtype, dimensions, "C")


def returns(*results: Any) -> Any:
    """What a loop gives back, called with its arguments: the whole signature."""
    return types.Tuple(results)  # type: ignore[no-untyped-call] # Numba's has no types
