"""Compiles loops ahead of time with numba, for one signature that all callers share.

Loops are compiled once. Their machine code is cached on disk until a source file that they depend on changes.

Numba itself checks only the date of the file that contains the loop. If a loop in another file, which this
loop calls, has changed, Numba would run old machine code. TCI checks a hash of the loop's file and of all
files that this file imports, directly or indirectly.

By default, compiled loops count references to arrays with atomic instructions, which took most of the time of
small loops. TCI switches this off for loops that allocate no array, with Numba's option `_nrt`. Numba uses
this option for its own loops too.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from llvmlite.binding import parse_assembly
from numba import float64, njit, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache

from tci.support.compile_ahead import compile_ahead, is_worker, waiting

HERE = Path(__file__).parents[1]
IMPORT = re.compile(r"^from (tci[\w.]*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)


def compiled(*signatures: Any, allocates: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compiles a loop for these signatures now, or loads it from the cache.

    Set `allocates` for a loop that creates or copies arrays; otherwise Numba raises "NRT required". If
    neither the folder of the source nor the user's cache is writable, the loop is compiled at each start.
    """

    def decorate(loop: Callable[..., Any]) -> Any:
        function: Any = _jit(loop, _nrt=allocates)
        try:
            function._cache = _Cache(loop)
        except RuntimeError:  # numba finds no folder to write to
            pass
        else:
            if is_worker():
                waiting.append((function, signatures))
                return function
        for signature in signatures:
            function.compile(signature)
        function.disable_compile()
        return function

    return decorate


class _OnlyMachineCode(CompileResultCacheImpl):
    """Converts a compiled loop to the data in the cache, without LLVM's bitcode and without annotations.
    Loading a loop then takes half the time.

    Numba needs the bitcode only of a loop that other loops call. Loops in the cache never call each other.
    """

    def reduce(self, result: Any) -> tuple[Any, ...]:
        reduced = super().reduce(result)  # type: ignore[no-untyped-call]  # Numba has no types
        try:
            library, *facts, _, loads, environments = reduced
            name, kind, (machine_code, _) = library
        except (TypeError, ValueError):  # another version of Numba stores more or fewer things
            return tuple(reduced)
        if kind != "object":
            return tuple(reduced)
        # Numba looks up in the bitcode which functions the machine code has. Variables with the functions'
        # names are enough, and an attempt to link them as functions would fail.
        functions = result.fndesc.llvm_func_name, result.fndesc.llvm_cpython_wrapper_name
        names = parse_assembly("\n".join(f'@"{function}" = global i8 0' for function in functions))
        return (name, kind, (machine_code, names.as_bitcode())), *facts, "", loads, environments


class _Cache(FunctionCache):
    """Cache on disk with the machine code of one compiled loop."""

    _impl_class = _OnlyMachineCode

    def __init__(self, loop: Callable[..., Any]) -> None:
        super().__init__(loop)  # type: ignore[no-untyped-call]  # Numba has no types
        self._cache_file._source_stamp = _stamp(Path(loop.__code__.co_filename))
        self._is_ours = loop.__module__.startswith("tci.")

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Returns the compiled loop for the argument types `signature`, or None if the cache lacks it.

        If the cache lacks one of TCI's loops, first compiles all of them. Numba's own method would also load
        SciPy, which takes half a second.
        """
        load: Callable[..., Any] = self._load_overload
        found = load(signature, context)
        if found is None and self._is_ours and not is_worker():
            index: Callable[[], Any] = self._cache_file._load_index
            compile_ahead(lambda: not index())
            found = load(signature, context)
        return found


def inlined(loop: Callable[..., Any]) -> Any:
    """Compiles a loop that only compiled loops call, and inserts its machine code into theirs. Such a loop
    must not allocate arrays.

    Inserted machine code (inlining) is faster than a call: a call would pass seven numbers or more for each
    array.
    """
    # In a worker only loops call this one, so it needs no wrapper for calls from Python there. Without the
    # wrapper, a call from Python would crash.
    return _jit(loop, _nrt=False, forceinline=True, no_cpython_wrapper=is_worker())


def _jit(loop: Callable[..., Any], **options: bool) -> Any:
    # Only programs in C need the wrapper that is left out.
    untyped: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
    return njit(**untyped)(loop)


@cache
def _stamp(file: Path) -> str:
    """Returns a hash that changes if `file`, or a file of TCI that it imports directly or indirectly,
    changes."""
    digest = hashlib.sha256()
    for one in sorted(_sources(file)):
        digest.update(_content(one))
    return digest.hexdigest()


@cache
def _content(file: Path) -> bytes:
    return hashlib.sha256(file.read_bytes()).digest()


def _sources(file: Path) -> set[Path]:
    """Returns the files that a loop in `file` may depend on: `file`, all files of TCI that it imports,
    directly or indirectly, and this module."""
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
    """Returns the Numba type of a contiguous array that the loop only reads."""
    return types.Array(dtype, dimensions, "C", readonly=True)


def views(dimensions: int, dtype: Any = float64) -> Any:
    """Returns the Numba type of an array that the loop only reads and whose elements need not be
    contiguous."""
    return types.Array(dtype, dimensions, "A", readonly=True)


def writes(dimensions: int, dtype: Any = float64) -> Any:
    """Returns the Numba type of a contiguous array that the loop changes."""
    return types.Array(dtype, dimensions, "C")


def record(kind: type, *fields: Any) -> Any:
    """Returns the Numba type of a NamedTuple whose fields have the types `fields`.

    The NamedTuple must be defined at the top of a module, because cached machine code refers to it by name.
    """
    if len({*fields}) == 1:
        return types.NamedUniTuple(fields[0], len(fields), kind)  # type: ignore[no-untyped-call]  # Numba has no types
    return types.NamedTuple(fields, kind)  # type: ignore[no-untyped-call]  # Numba has no types


def entry(loop: Any, signature: int = 0) -> Callable[..., Any]:
    """Returns the machine code of a compiled loop for its signature number `signature`: it accepts only
    arguments of exactly these types.

    A call of this machine code skips Numba's type check of each array within the arguments. For 30 arrays the
    check takes 6 us, longer than most loops. The caller must ensure types and numbers of dimensions: with an
    array of another kind, the loop reads and writes memory that is not its own.
    """
    made = [*loop.overloads.values()]
    return made[signature].entry_point if made else loop  # type: ignore[no-any-return]  # Numba has no types


def returns(*results: Any) -> Any:
    """Returns the Numba type of a tuple with elements of the types `results`.

    This type is the return type of a loop with several results, or the type of a tuple that is an argument of
    a loop. For example, `returns(A, B)(C)` is the signature of a loop with an argument of type C and results
    of types A and B."""
    return types.Tuple(results)  # type: ignore[no-untyped-call]  # Numba has no types
