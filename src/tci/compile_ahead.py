"""Compiles all loops in parallel before the first one is used: once per installation and processor.

Numba compiles one loop after the other, each for a second or more, without any output. Here one worker
process per processor compiles the loops that no other has claimed yet into Numba's cache on disk, and a line
on stderr shows the progress. The process that waited then loads machine code like any later one.
"""

from __future__ import annotations

import fcntl
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
CLAIMS = "TCI_COMPILE_CLAIMS"
"""Environment variable of a worker: the folder in which a file named after each loop claims it."""
MOST = 8
"""Largest number of workers. Assumed: each needs 250 MB, and the longest loop takes a tenth of the whole
time, so more would hardly be faster."""

Loop = tuple[Any, tuple[Any, ...]]
"""A numba function that is not compiled yet, and its signatures."""
waiting: list[Loop] = []
"""Loops of a worker, in the order of their import."""
_tried = False


def is_worker() -> bool:
    """Returns True if this process only compiles."""
    return CLAIMS in os.environ


def compile_ahead(is_missing: Callable[[], bool]) -> None:
    """Compiles all loops into the cache, unless this process has tried before or `is_missing()` is False.

    Other processes that start meanwhile wait at this folder instead of compiling the same loops, whichever
    loop they import first. Loops that the workers could not compile are left to the caller.
    """
    global _tried
    if _tried or not is_missing():
        return
    _tried = True
    place = os.open(HERE, os.O_RDONLY)
    try:
        fcntl.flock(place, fcntl.LOCK_EX)
        if is_missing():
            _compile_all()
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
    """Shows the workers' progress on stderr until they end."""
    begin, alive = time.monotonic(), sys.stderr.isatty()
    back = "\r" if alive else ""
    words = "tci: compiling its loops for this processor, once after installing it"
    print(words, end="" if alive else "\n", file=sys.stderr, flush=True)
    while any(worker.poll() is None for worker in workers):
        time.sleep(0.1)
        if alive:
            loops = (claims / "all").read_text().count("\n") if (claims / "all").exists() else 0
            done = sum(file.suffix == ".done" for file in claims.iterdir())
            share = f"{done} of {loops}, " if loops else ""
            print(
                f"{back}{words}: {share}{time.monotonic() - begin:.0f} s ",
                end="",
                file=sys.stderr,
                flush=True,
            )
    print(f"{back}{words}: done in {time.monotonic() - begin:.0f} s", file=sys.stderr)


def modules_with_loops() -> list[str]:
    """Returns the names of all modules that declare a compiled loop."""
    files = (file for file in sorted(HERE.rglob("*.py")) if file != Path(__file__))
    found = (file for file in files if re.search(r"^@compiled\(", file.read_text(), re.MULTILINE))
    return [".".join(("tci", *file.relative_to(HERE).with_suffix("").parts)) for file in found]


def work() -> None:
    """Compiles every loop that no other worker has claimed. Called in a worker."""
    claims = Path(os.environ[CLAIMS])
    for name in modules_with_loops():
        import_module(name)
    # Long bytecode mostly takes long to compile, and the longest loop must not be the last one.
    loops = sorted(waiting, key=lambda loop: -len(loop[0].py_func.__code__.co_code))
    names = [f"{loop.py_func.__module__}.{loop.py_func.__name__}" for loop, _ in loops]
    (claims / "all").write_text("".join(f"{name}\n" for name in names))
    for (loop, signatures), name in zip(loops, names, strict=True):
        try:
            (claims / name).touch(exist_ok=False)
        except FileExistsError:
            continue
        for signature in signatures:
            loop.compile(signature)
        (claims / f"{name}.done").touch()
