"""Compiled loops, and the types of the arrays that they take: one signature for all callers.

Loops are compiled once and kept on disk, until any source that they are made of changes.

Numba looks only at the file of the loop itself, and at its date: after an update of a file that the loop
calls into, it would run the old machine code. So what it compares here is the content of that file and of all
that it imports.

Numba counts who uses an array, with locked instructions: that was most of what a small loop did. A loop that
makes no array need not count (`_nrt`, which numba's own loops use too).
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import float64, njit, types

from tci.compile_ahead import compile_ahead, is_worker, waiting

HERE = Path(__file__).parent
IMPORT = re.compile(r"^from (tci[\w.]*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)


def compiled(*signatures: Any, allocates: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compile a loop for these signatures now, or load what was compiled before.

    One that makes or copies arrays `allocates`: numba raises "NRT required" for another that does. Where
    nothing can be written, neither beside the source nor in the user's cache, it is compiled each time.
    """

    def decorate(loop: Callable[..., Any]) -> Any:
        function: Any = _jit(loop, _nrt=allocates)
        try:
            function.enable_caching()
        except RuntimeError:  # numba finds no folder to write to
            pass
        else:
            function._cache._cache_file._source_stamp = _stamp(Path(loop.__code__.co_filename))
            if is_worker():
                waiting.append((function, signatures))
                return function
            if loop.__module__.startswith("tci."):
                compile_ahead(
                    Path(function._cache.cache_path), lambda: not function._cache._cache_file._load_index()
                )
        for signature in signatures:
            function.compile(signature)
        function.disable_compile()
        return function

    return decorate


def inlined(loop: Callable[..., Any]) -> Any:
    """A loop that only compiled loops call, which keep it with themselves; it makes no arrays.

    It becomes part of them: an array is seven numbers or more, which a call would write and read again.
    """
    return _jit(loop, _nrt=False, forceinline=True)


def _jit(loop: Callable[..., Any], **options: bool) -> Any:
    untyped: dict[str, Any] = {"error_model": "numpy", **options}
    return njit(**untyped)(loop)


@cache
def _stamp(file: Path) -> str:
    """A hash of the file and of all files of TCI that it imports, and they."""
    digest = hashlib.sha256()
    for one in sorted(_sources(file)):
        digest.update(one.read_bytes())
    return digest.hexdigest()


def _sources(file: Path) -> set[Path]:
    """Files that a loop may be made of: it takes loops and constants from no others."""
    found, new = {Path(__file__)}, [file]
    while new:
        found.add(one := new.pop())
        new += _imported(one) - found
    return found


@cache
def _imported(file: Path) -> frozenset[Path]:
    names = [
        f"{module}.{name.strip()}"
        for module, several, line in IMPORT.findall(file.read_text())
        for name in (several or line).split(",")
    ]
    files = {HERE.joinpath(*name.split(".")[1:]).with_suffix(".py") for name in names}
    files |= {one.parent.with_suffix(".py") for one in files}
    return frozenset(one for one in files if one.is_file())


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
