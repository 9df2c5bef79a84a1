"""Compiles all loops side by side before the first one is used, once per installation and processor.

Numba compiles one loop after another, each for up to seconds, in silence. Here worker processes (one per
processor, at most MOST) write the loops' files, and a line on stderr shows the progress. A worker is a
command of its own: a pool of `multiprocessing` would import the user's script again. The process that
started the workers waits for them, and then loads the files like every later process.
"""

from __future__ import annotations

import gc
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import groupby
from pathlib import Path
from typing import Any

try:
    import fcntl
except ModuleNotFoundError:  # Windows: two processes may compile the same loops, which only costs time
    fcntl = None  # type: ignore[assignment]  # the module is missing

HERE = Path(__file__).parents[1]
CLAIMS = "TCI_COMPILE_CLAIMS"
"""Environment variable of a worker: the folder in which workers create a file for each package of loops that
they compile, so that no two compile the same one."""
MOST = 4
"""Largest number of workers. A worker needs up to 400 MB, and the longest package takes a third of the whole
time, so more workers would hardly be faster."""
TOLD = 6
"""Number of lines that are shown of what a worker that failed wrote to stderr."""
waiting: list[tuple[Callable[..., Any], Callable[[], object]]] = []
"""Loops that this worker has imported, each with what compiles it."""
_tried = False


def is_worker() -> bool:
    """True if this process only compiles."""
    return CLAIMS in os.environ


def compile_ahead(is_missing: Callable[[], bool]) -> None:
    """Compiles all loops, except those that are seldom used, if `is_missing()`; at most once per process.

    Other processes that start meanwhile wait instead of compiling the same loops. A worker that fails is told
    on stderr; what it leaves the caller must compile.
    """
    global _tried
    if _tried or is_worker():
        return
    _tried = True
    with _alone():
        if is_missing():
            _compile_all()


@contextmanager
def _alone() -> Iterator[None]:
    """Holds a lock on the package. Says so on stderr if it waits for another process."""
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
        processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        workers = []
        for number in range(min(processors, MOST)):
            with Path(claims, f"errors-{number}").open("wb") as errors:
                workers.append(subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL,
                                                stdout=subprocess.DEVNULL, stderr=errors))  # fmt: skip
        try:
            _show_progress(Path(claims), workers)
        finally:
            for worker in workers:
                worker.kill()
                worker.wait()
        for number, worker in enumerate(workers):
            if worker.returncode:
                lines = Path(claims, f"errors-{number}").read_text(errors="replace").splitlines()[-TOLD:]
                print(f"tci: a process that compiles loops ended with status {worker.returncode}; its loops "
                      "are compiled now", *lines, sep="\n  ", file=sys.stderr, flush=True)  # fmt: skip


def _show_progress(claims: Path, workers: list[subprocess.Popen[bytes]]) -> None:
    """Until the workers end: one line on a terminal, otherwise a new line every 10 s."""
    begin, terminal = time.monotonic(), sys.stderr.isatty()
    back, end, pause = ("\r", "", 0.2) if terminal else ("", "\n", 10.0)
    print("tci: compiling its loops for this processor, once after installing it: about half a minute on two "
          "idle processors", file=sys.stderr, flush=True)  # fmt: skip
    shown = begin
    while any(worker.poll() is None for worker in workers):
        time.sleep(0.05)
        if time.monotonic() - shown >= pause:
            shown = time.monotonic()
            line = f"tci: {_state(claims, shown - begin)}"
            print(f"{back}{line:<78.78}" if back else line, end=end, file=sys.stderr, flush=True)
    done = (
        "could not compile all its loops"
        if any(worker.returncode for worker in workers)
        else "compiled its loops"
    )
    line = f"tci: {done} in {time.monotonic() - begin:.0f} s"
    print(f"{back}{line:<78.78}" if back else line, file=sys.stderr)


def _state(claims: Path, now: float) -> str:
    """What is compiled `now` [s] after the start, what is being compiled, and how many loops are left: their
    time would only be guessed on a machine that others use too."""
    if not (claims / "all").exists():
        return "finding its loops"
    names = (claims / "all").read_text().split()
    left = [name for name in names if not (claims / f"{name}.done").exists()]
    packages = sorted({name.rsplit(".", 2)[0] for name in left})
    work = ", ".join(name.removeprefix("tci.") for name in packages if (claims / name).exists())
    return f"compiled {len(names) - len(left)} of {len(names)} loops in {now:.0f} s; now {work or 'the next'}"


def modules_with_loops() -> list[str]:
    """Names of all modules that declare a compiled loop."""
    files = (file for file in sorted(HERE.rglob("*.py")) if file.parent != Path(__file__).parent)
    found = (file for file in files if re.search(r"^(@|\w+ = )compiled\(", file.read_text(), re.MULTILINE))
    return [".".join(("tci", *file.relative_to(HERE).with_suffix("").parts)) for file in found]


def work() -> None:
    """Compiles, in a worker, every package of loops that no other worker has claimed.

    Loops of a package stay together, because they insert the same smaller loops: two workers would both
    compile those.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends the workers without a traceback of each
    claims = Path(os.environ[CLAIMS])
    for name in modules_with_loops():
        import_module(name)
    # Numba creates millions of objects that live long. Python's search for cyclic garbage among them took a
    # fifth of the time, so here it runs more rarely.
    gc.freeze()
    gc.set_threshold(50_000, 10, 10)
    packages = [[*loops] for _, loops in groupby(sorted(waiting, key=_package), key=_package)]
    complete = claims / f"all-{os.getpid()}"
    complete.write_text("\n".join(map(_name, waiting)))
    complete.rename(claims / "all")  # a rename is atomic, so no process reads an incomplete file
    for loops in sorted(packages, key=len, reverse=True):
        try:
            (claims / _package(loops[0])).touch(exist_ok=False)
        except FileExistsError:
            continue
        for loop in loops:
            loop[1]()
            (claims / f"{_name(loop)}.done").touch()


def _name(loop: tuple[Callable[..., Any], object]) -> str:
    return f"{loop[0].__module__}.{loop[0].__name__}"


def _package(loop: tuple[Callable[..., Any], object]) -> str:
    return loop[0].__module__.rpartition(".")[0]
