"""A minimal loop at 1 kHz in a separate process. It shows the delays that the machine causes in any loop.

In every period the loop copies as much data as the loop of TCI reads and writes, with NumPy only: joint
angles and speeds and, for each new skin frame, the raw bytes, the pressures and the mask of pressures above
0. `bare_loop.py SECONDS FRAMES SERVOS CHANNELS...` prints the delays of the periods and the times of the work
as counts of a `Histogram`. FRAMES is the number of frames per second. Each number CHANNELS adds a patch with
this number of channels.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import ExitStack, suppress

import numpy as np

from tci.errors import TciError
from tci.messages.clock import MonotonicClock, ticks
from tci.runtime.loop_report import Histogram
from tci.runtime.priority import real_time

PERIOD = 0.001


def main(seconds: float, frames: float, servos: int, channels: list[int]) -> None:
    late, own = Histogram(), Histogram()
    start, number = None, -1
    joints, raw = np.zeros(servos), [np.full(count, 5, np.uint8) for count in channels]
    with ExitStack() as stack:
        with suppress(TciError):
            stack.enter_context(real_time(processor=min(os.sched_getaffinity(0))))
        for now in ticks(MonotonicClock(), PERIOD, duration=seconds):
            start = now if start is None else start
            begin = time.thread_time()
            told = joints.copy(), np.zeros(servos)
            joints = told[0] + PERIOD * told[1]
            if int((now - start) * frames) != number:
                number = int((now - start) * frames)
                pressures = [np.float32(10.0) * (values.copy() - np.float32(5.0)) for values in raw]
                active = [np.flatnonzero(pressure > 0.0) for pressure in pressures]
                del pressures, active
            own.add(time.thread_time() - begin)
            late.add((now - start + 1e-9) % PERIOD)
    print(json.dumps({"late": late.counts.tolist(), "own": own.counts.tolist()}))


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), [int(word) for word in sys.argv[4:]])
