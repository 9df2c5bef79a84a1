"""Start-up: what a user waits for, beside `import numpy`."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from measured import Measured, row

ROUNDS = 7
TICK = """
import tci
robot = tci.load_robot("nao")
with tci.connect(robot, "sim") as driver:
    tci.run(driver, tci.WithdrawalReflex(), duration=0.002)
"""


def seconds(*command: str) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    return time.perf_counter() - start


def start() -> list[Measured]:
    tci = str(Path(sys.executable).parent / "tci")
    cases = {
        "tci --help": (tci, "--help"),
        "import tci": ("-c", "import tci"),
        "first tick of a simulated NAO, from nothing": ("-c", TICK),
    }
    rows = []
    for name, command in cases.items():
        cold = seconds(*command)
        pairs = [(1e3 * seconds(*command), 1e3 * seconds("-c", "import numpy")) for _ in range(ROUNDS)]
        note = f"the first time {1e3 * cold:.0f} ms"
        rows.append(row(name, "import numpy", pairs, unit="ms", note=note))
    return rows
