"""Benchmark of start-up times and of memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
from measured import Measured, row

TCI = str(Path(sys.executable).parent / "tci")
FEW = 3
"""Number of rounds for cases that last many seconds."""
ROUNDS = 7
FIVE = """
import tci
robot = tci.load_robot("nao")
with tci.connect(robot, "sim") as driver:
    tci.run(driver, tci.WithdrawalReflex(), duration=0.002)
"""
"""The five-line program of the README, shortened to one period."""
MIB = 2**20
VIEWED = 20.0
"""Time [s] for which the viewer runs without an open page."""


def seconds(*command: str, **variables: str) -> float:
    """Returns the run time [s] of a Python program."""
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, *command], check=True, capture_output=True, env={**os.environ, **variables}
    )
    return time.perf_counter() - start


def start() -> list[Measured]:
    """Times the start of processes. The loops are compiled before, except in rows whose name says
    otherwise."""
    cases = {"`tci --help`": ((TCI, "--help"), None), "`import tci`": (("-c", "import tci"), None)}
    rows = []
    seconds("-c", FIVE)
    for name, (command, most) in {**cases, "the README's program": (("-c", FIVE), 1000.0)}.items():
        pairs = [(1e3 * seconds(*command), 1e3 * seconds("-c", "import numpy")) for _ in range(ROUNDS)]
        rows.append(row(f"run time of {name}", "run time of `import numpy`", pairs, unit="ms", most=most))
    return [*rows, *fresh()]


def fresh() -> list[Measured]:
    """Times the first start of a fresh installation, which compiles its loops, and the second start."""
    firsts, seconds_ = [], []
    for _ in range(FEW):
        with TemporaryDirectory() as cache:
            first, second = (seconds("-c", FIVE, NUMBA_CACHE_DIR=cache) for _ in range(2))
            numpy = seconds("-c", "import numpy")
        firsts.append((first, numpy))
        seconds_.append((second, numpy))
    name, peer = "run time of the README's program", "run time of `import numpy`"
    return [
        row(f"{name}, first start", peer, firsts, unit="s", most=15.0),
        row(f"{name}, second start", peer, seconds_, unit="s"),
    ]


def demo() -> list[Measured]:
    """Times the demo including its picture and report. The loops are compiled before."""
    with TemporaryDirectory() as folder:
        command = (TCI, "demo", "--headless", "--out", folder)
        pairs = [(seconds(*command), 25.0) for _ in range(2)]
    return [row("run time of `tci demo`", "none: the target", pairs, unit="s", most=25.0)]


def memory() -> list[Measured]:
    """Measures the largest resident memory of a program and its child processes."""
    run = [TCI, "run", "withdrawal", "icub", "--duration", "3", "--poke"]
    with TemporaryDirectory() as folder:
        view = [TCI, "view", "--headless", "--port", "0", "--out", folder, "--duration", f"{VIEWED:g}"]
        taken = [(largest(run) / MIB, largest(view) / MIB) for _ in range(FEW)]
    return [
        row(
            f"memory of `{name}`",
            "none: the target",
            [(one[n], most) for one in taken],
            unit="MiB",
            most=most,
        )
        for n, (name, most) in enumerate((("tci run icub", 350.0), ("tci view", 450.0)))
    ]


def largest(command: list[str]) -> float:
    """Returns the largest total memory [bytes] of a program and its child processes while the program
    runs."""
    most = 0.0
    with subprocess.Popen([sys.executable, *command], stdout=subprocess.DEVNULL) as started:
        process = psutil.Process(started.pid)
        while started.poll() is None:
            now = 0.0
            for one in (process, *process.children(recursive=True)):
                try:
                    now += one.memory_info().rss
                except psutil.NoSuchProcess:
                    continue
            most = max(most, now)
            time.sleep(0.05)
    if started.returncode:
        raise SystemExit(f"{' '.join(command)} failed")
    return most
