"""Compiles all loops in parallel before the first loop is used. The compilation happens once per installation
and processor.

Numba compiles one loop after another, each for a second or more, without any output. Here several worker
processes (one per processor, at most MOST) compile loops into Numba's cache on disk. Each loop is compiled by
one worker, and a line on stderr shows the progress. The process that started the workers waits for them, and
then loads the machine code from the cache. Every later process also loads the machine code from the cache.
"""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

try:
    import fcntl
except ModuleNotFoundError:  # fcntl does not exist on Windows
    fcntl = None  # type: ignore[assignment]  # the module is missing

HERE = Path(__file__).parents[1]
CLAIMS = "TCI_COMPILE_CLAIMS"
"""Environment variable of a worker: the folder in which the workers create a file for each loop that they
compile, so that no two workers compile the same loop."""
MOST = 4
"""Largest number of workers. A worker needs up to 400 MB, and the longest loop takes a quarter of the whole
time, so more workers would hardly be faster."""

Loop = tuple[Any, tuple[Any, ...]]
"""A numba function that is not compiled yet, and its signatures."""
waiting: list[Loop] = []
"""Loops that this worker process has imported and may have to compile, in the order of their import."""
_tried = False


def is_worker() -> bool:
    """Returns True if this process is a worker, which only compiles."""
    return CLAIMS in os.environ


def compile_ahead(is_missing: Callable[[], bool]) -> None:
    """Compiles all loops into the cache. Does nothing if this process has tried before, or if `is_missing()`
    returns False.

    This function holds a lock on the folder of the cache. Other processes that start meanwhile wait until the
    lock is released, instead of compiling the same loops. If the workers failed to compile a loop, the caller
    must compile it.
    """
    global _tried
    if _tried or not is_missing():
        return
    _tried = True
    with _alone():
        if is_missing():
            _compile_all()


@contextmanager
def _alone() -> Iterator[None]:
    """Prevents other TCI processes from compiling loops during the `with` block. If another process compiles
    already, first waits for it, and prints a line about this on stderr.

    On a system without file locks, two processes may compile the same loops; this only costs time.
    """
    if fcntl is None:
        yield
        return
    place = os.open(HERE, os.O_RDONLY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("tci: another tci process compiles its loops; waiting for it", file=sys.stderr, flush=True)
            fcntl.flock(place, fcntl.LOCK_EX)
        yield
    finally:
        os.close(place)


def _compile_all() -> None:
    with tempfile.TemporaryDirectory(prefix="tci-loops-") as claims:
        command = [sys.executable, "-c", f"from {__name__} import work; work()"]
        environment = {**os.environ, CLAIMS: claims, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        workers = [
            subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                             stderr=subprocess.DEVNULL)
            for _ in range(min(_processors(), MOST))
        ]  # fmt: skip
        try:
            _show_progress(Path(claims), workers)
        finally:
            for worker in workers:
                worker.kill()
                worker.wait()


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _show_progress(claims: Path, workers: list[subprocess.Popen[bytes]]) -> None:
    """Shows the progress of compiling on stderr until the `workers` end: in one line on a terminal, otherwise
    in a new line every 10 s."""
    begin, terminal = time.monotonic(), sys.stderr.isatty()
    back, end, pause = ("\r", "", 0.2) if terminal else ("", "\n", 10.0)
    print("tci: compiling its loops for this processor, once after installing it: about half a minute on two "
          "processors", file=sys.stderr, flush=True)  # fmt: skip
    shown = begin
    while any(worker.poll() is None for worker in workers):
        time.sleep(0.1)
        if time.monotonic() - shown >= pause:
            shown = time.monotonic()
            line = f"tci: {_state(claims, shown - begin)}"
            print(f"{back}{line:<50}" if back else line, end=end, file=sys.stderr, flush=True)
    line = f"tci: compiled its loops in {time.monotonic() - begin:.0f} s"
    print(f"{back}{line:<50}" if back else line, file=sys.stderr)


def _state(claims: Path, now: float) -> str:
    """Returns a line for the user: the number of compiled loops, and the estimated remaining time. `now` [s]
    is the time since the start.
    """
    if not (claims / "all").exists():
        return "finding its loops"
    lengths = {
        name: int(length) for name, length in map(str.split, (claims / "all").read_text().splitlines())
    }
    done = [name for name in lengths if (claims / f"{name}.done").exists()]
    share = sum(lengths[name] for name in done) / max(sum(lengths.values()), 1)
    left = now * (1.0 - share) / share if done else 0.0
    words = f", about {left:.0f} s left" if left >= 5.0 else ", the longest are under way" if done else ""
    if len(done) == len(lengths):
        words = ", now stores them"
    return f"compiled {len(done)} of {len(lengths)} loops in {now:.0f} s{words}"


def modules_with_loops() -> list[str]:
    """Returns the names of all modules that declare a compiled loop."""
    files = (file for file in sorted(HERE.rglob("*.py")) if file != Path(__file__))
    found = (file for file in files if re.search(r"^@compiled\(", file.read_text(), re.MULTILINE))
    return [".".join(("tci", *file.relative_to(HERE).with_suffix("").parts)) for file in found]


def work() -> None:
    """Compiles every loop that no other worker has claimed. This function is called in a worker."""
    claims = Path(os.environ[CLAIMS])
    for name in modules_with_loops():
        import_module(name)
    # Numba creates millions of objects that live long. Python's search for cyclic garbage among them took a
    # fifth of the time, so here it runs more rarely.
    gc.freeze()
    gc.set_threshold(50_000, 10, 10)
    # The longest loop must not be the last one.
    loops = sorted(waiting, key=lambda loop: -_length(loop[0]))
    names = [f"{loop.py_func.__module__}.{loop.py_func.__name__}" for loop, _ in loops]
    sizes = [_length(loop) for loop, _ in loops]
    lines = "".join(f"{name} {size}\n" for name, size in zip(names, sizes, strict=True))
    complete = claims / f"all-{os.getpid()}"
    complete.write_text(lines)
    complete.rename(claims / "all")  # a rename is atomic, so no process reads an incomplete file
    for (loop, signatures), name in zip(loops, names, strict=True):
        try:
            (claims / name).touch(exist_ok=False)
        except FileExistsError:
            continue
        for signature in signatures:
            loop.compile(signature)
        (claims / f"{name}.done").touch()


def _length(loop: Any) -> int:
    """Returns a measure of the compile time of a loop: the length [bytes] of its bytecode and of the bytecode
    of all loops that are inserted into it."""
    found, look = set[Any](), [loop]
    while look:
        function = look.pop().py_func
        if function not in found:  # an attribute may have the name of a loop, even of the one that reads it
            found.add(function)
            look += filter(_is_loop, (function.__globals__.get(name) for name in function.__code__.co_names))
    return sum(len(function.__code__.co_code) for function in found)


def _is_loop(one: object) -> bool:
    return hasattr(one, "py_func")
