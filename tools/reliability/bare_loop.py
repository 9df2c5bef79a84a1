"""A bare loop at 1 kHz in a process of its own: what the machine does to any loop.

It sleeps, and then does the same piece of plain NumPy work in every period, about as long as most of ours.
`bare_loop.py SECONDS` prints how late it was and how long its work took, as counts of a `Histogram`.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import ExitStack, suppress

import numpy as np

from tci.clock import MonotonicClock, ticks
from tci.errors import TciError
from tci.runtime.loop_report import Histogram
from tci.runtime.real_time import real_time

PERIOD = 0.001
PIECES = 100
"""Additions of 64 numbers in a period."""


def main(seconds: float) -> None:
    late, own = Histogram(), Histogram()
    start, numbers = None, np.zeros(64)
    with ExitStack() as stack:
        with suppress(TciError):
            stack.enter_context(real_time(processor=min(os.sched_getaffinity(0))))
        for now in ticks(MonotonicClock(), PERIOD, duration=seconds):
            start = now if start is None else start
            begin = time.thread_time()
            for _ in range(PIECES):
                numbers = numbers + 1.0
            own.add(time.thread_time() - begin)
            late.add((now - start + 1e-9) % PERIOD)
    print(json.dumps({"late": late.counts.tolist(), "own": own.counts.tolist()}))


if __name__ == "__main__":
    main(float(sys.argv[1]))
