"""Loops in machine code: compiled by numba for declared types, and kept on disk.

One file keeps the machine code of one loop. It is valid until the loop's file, a file that this one imports,
numba or the processor changes; numba's own cache looks at the loop's file only, and would run old code after
a change elsewhere. The files lie in `__pycache__` beside the source, in the user's cache if that folder can't
be written to, or where `NUMBA_CACHE_DIR` says.

A call runs the machine code at once, without numba's check of each array: with it a tick takes an eighth
longer, and the first command four times as long. But a loop that is called with wrong types, or arrays that
are not contiguous, reads and writes memory that is not theirs. So with `TCI_CHECK_LOOPS=1` loops are called
through numba's check, which raises TypeError: all tests run so, except the live ones.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import sys
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite.binding import parse_assembly
from numba import float64, njit, types
from numba.core.caching import CompileResultCacheImpl
from numba.core.serialize import dumps

from tci.support.compile_ahead import compile_ahead, is_worker, waiting

HERE = Path(__file__).parents[1]
IMPORT = re.compile(r"^from (tci[\w.]*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
DIGEST = hashlib.sha256().digest_size
CHECKED = os.environ.get("TCI_CHECK_LOOPS", "0") != "0"
python_of: dict[Any, Callable[..., Any]] = {}
"""The Python function of each loop that was loaded."""


def compiled(signature: Any, *, seldom: bool = False) -> Callable[..., Any]:
    """Makes a loop machine code for the types of `signature`. The loop must not create arrays: counting
    references to them with atomic instructions takes most of the time of a small loop.

    Args:
        signature: Types of result and arguments. Numba converts what it safely can (a writable array for one
            that is only read), but nothing within a NamedTuple.
        seldom: True for a loop that most programs never call, and no control loop, since it may take seconds:
            it is compiled and loaded when it is first called.
    """

    def decorate(loop: Callable[..., Any]) -> Any:
        function = _jit(loop)
        if seldom:
            return Seldom(function, signature)
        if is_worker():
            waiting.append((loop, partial(load, function, signature)))
            return function
        return load(function, signature, ahead=loop.__module__.startswith("tci."))

    return decorate


class Seldom:
    """A compiled loop that is loaded when it is first called."""

    def __init__(self, function: Any, signature: Any) -> None:
        self.py_func, self._load = function.py_func, partial(load, function, signature)
        self._code: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        if self._code is None:
            self._code = self._load()
        return self._code(*arguments)


def load(function: Any, signature: Any, *, ahead: bool = False) -> Callable[..., Any]:
    """Loads a loop's machine code from its file, or compiles it and writes the file. Returns what to call.

    With `ahead`, a loop without a file has all of TCI's loops compiled first, by several processes.
    """
    kept = _kept_code(function, signature)
    found = kept and kept.read()
    if kept and not found and ahead:
        compile_ahead(kept.is_missing)
        found = kept.read()
    if found:
        function.add_overload(found)
    else:
        function.compile(signature)
        if kept:
            kept.write(*function.overloads.values())
    function.disable_compile()
    (made,) = function.overloads.values()
    called: Callable[..., Any] = function if CHECKED else made.entry_point
    python_of[called] = function.py_func
    return called


def _kept_code(function: Any, signature: Any) -> KeptCode | None:
    try:
        return KeptCode(function, signature)
    except RuntimeError:  # no folder can be written to: the loop is compiled at each start
        return None


class KeptCode(CompileResultCacheImpl):
    """The file with a loop's machine code: a checksum, the key of what the code was made from, the code.

    Numba's own files have no checksum: one that is cut short ends every later start in a traceback, and a
    flipped bit is run.
    """

    def __init__(self, function: Any, signature: Any) -> None:
        super().__init__(function.py_func)  # type: ignore[no-untyped-call]  # Numba has no types
        self._target = function.targetctx
        name = hashlib.sha256(repr(signature).encode()).hexdigest()[:12]
        self.path = Path(self.locator.get_cache_path(), f"{self.filename_base}.{name}.loop")
        stamp = _stamp(Path(function.py_func.__code__.co_filename))
        processor = self._target.codegen().magic_tuple()
        made_from = numba.__version__, llvmlite.__version__, processor, repr(signature), stamp
        self._key = hashlib.sha256(repr(made_from).encode()).digest()

    def reduce(self, result: Any) -> tuple[Any, ...]:
        """Leaves out LLVM's bitcode: a loop then loads in half the time.

        Numba needs it to insert a loop into others, which is not done with loaded loops, and to look up which
        functions the machine code has: variables with their names are enough for that.
        """
        library, *facts = super().reduce(result)  # type: ignore[no-untyped-call]  # Numba has no types
        name, kind, (machine_code, _) = library
        functions = result.fndesc.llvm_func_name, result.fndesc.llvm_cpython_wrapper_name
        names = parse_assembly("\n".join(f'@"{function}" = global i8 0' for function in functions))
        return (name, kind, (machine_code, names.as_bitcode())), *facts

    def is_missing(self) -> bool:
        """True if the file must be made, or made anew because a source has changed."""
        return self._code() is None

    def read(self) -> Any | None:
        """The compiled loop; None if it is missing, made from other sources, or damaged."""
        code = self._code()
        return None if code is None else self.rebuild(self._target, pickle.loads(code))  # type: ignore[no-untyped-call]  # Numba has no types

    def _code(self) -> bytes | None:
        try:
            content = self.path.read_bytes()
        except OSError:
            return None
        checksum, rest = content[:DIGEST], content[DIGEST:]
        if hashlib.sha256(rest).digest() != checksum:
            self.path.unlink(missing_ok=True)
            print(f"tci: {self.path} is damaged: deleted, and compiled anew", file=sys.stderr, flush=True)
            return None
        return rest[DIGEST:] if rest.startswith(self._key) else None

    def write(self, result: Any) -> None:
        """Writes the file, at once as a whole: another process reads the old file, or the new one."""
        content = self._key + dumps(self.reduce(result))  # type: ignore[no-untyped-call]  # Numba has no types
        try:
            handle, draft = tempfile.mkstemp(dir=self.path.parent, prefix=self.path.name)
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(draft, self.path)
        except OSError as error:
            print(f"tci: no machine code is kept in {self.path}: {error.strerror}", file=sys.stderr)


def inlined(loop: Callable[..., Any]) -> Any:
    """Compiles a loop that only compiled loops call, and inserts its machine code into theirs. It must not
    allocate arrays.

    Inserted machine code is faster than a call, which would pass seven numbers or more for each array.
    """
    # In a worker only loops call this one, so it needs no wrapper for calls from Python there. Without the
    # wrapper, a call from Python would crash.
    function = _jit(loop, forceinline=True, no_cpython_wrapper=is_worker())
    template = function.get_call_template

    # Numba compiles a loop once more for each constant that it is called with; that took a tenth of all time.
    def without_literals(types_of_arguments: Any, named: Any) -> Any:
        plain = [types.unliteral(one) for one in types_of_arguments]  # type: ignore[no-untyped-call]  # Numba has no types
        return template(plain, named)

    function.get_call_template = without_literals
    return function


def _jit(loop: Callable[..., Any], **options: bool) -> Any:
    # Only programs in C need the wrapper that is left out.
    untyped: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": False, **options}
    return njit(**untyped)(loop)


@cache
def _stamp(file: Path) -> str:
    return hashlib.sha256(b"".join(_content(one) for one in sorted(_sources(file)))).hexdigest()


def _sources(file: Path) -> set[Path]:
    """`file`, all files of TCI that it imports, directly or indirectly, and this module."""
    found, new = {Path(__file__)}, [file]
    while new:
        found.add(one := new.pop())
        new += _imported(one) - found
    return found


@cache
def _content(file: Path) -> bytes:
    return hashlib.sha256(file.read_bytes()).digest()


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
    """Numba's type of a contiguous array that the loop only reads."""
    return types.Array(dtype, dimensions, "C", readonly=True)


def views(dimensions: int, dtype: Any = float64) -> Any:
    """Numba's type of an array that the loop only reads and whose elements need not be contiguous."""
    return types.Array(dtype, dimensions, "A", readonly=True)


def writes(dimensions: int, dtype: Any = float64) -> Any:
    """Numba's type of a contiguous array that the loop changes."""
    return types.Array(dtype, dimensions, "C")


def record(kind: type, *fields: Any) -> Any:
    """Numba's type of a NamedTuple whose fields have the types `fields`.

    It must be defined at the top of a module, because kept machine code refers to it by name.
    """
    if len({*fields}) == 1:
        return types.NamedUniTuple(fields[0], len(fields), kind)  # type: ignore[no-untyped-call]  # Numba has no types
    return types.NamedTuple(fields, kind)  # type: ignore[no-untyped-call]  # Numba has no types


def returns(*results: Any) -> Any:
    """Numba's type of a tuple: of several results, or as an argument. `returns(A, B)(C)` is the signature of
    a loop with an argument of type C and results of types A and B."""
    return types.Tuple(results)  # type: ignore[no-untyped-call]  # Numba has no types
