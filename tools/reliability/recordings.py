"""Measures the data that a recording loses when its process is killed, and the size and writing time of a
minute."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pool import Result, gather
from row import Row

from helpers.recorded import equal_readings, made_up
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording

PERIOD = 0.01
"""Period [s] of the readings that are written."""
WRITER = """
import os, sys
from helpers.recorded import made_up
from tci.recording.recorder import Recorder
readings = made_up(2000)
recorder = Recorder(sys.argv[1], None)
for number, (now, reading) in enumerate(readings):
    recorder.tick(now, reading)
    os.write(1, b"%d\\n" % number)
"""


def killed(full: bool) -> Row:
    """Kills a recording process at random moments. Counts the periods that were lost although `write` had
    returned."""
    jobs = [(seed, 10) for seed in range(10 if full else 1)]
    done = gather("killed", _kill, jobs, full=full)
    worst, damaged = max((d["worst"] for d in done), default=0), sum(d["damaged"] for d in done)
    return Row(
        "SIGKILL to a recording process", sum(d["tried"] for d in done), 100, "times",
        f"at most {1e3 * PERIOD * worst:.0f} ms of the recording lost, {damaged} files damaged",
        "at most 20 ms lost, 0 files damaged",
        PERIOD * worst <= 0.02 and not damaged,
    )  # fmt: skip


def _kill(seed: int, count: int) -> Result:
    worst, damaged = 0, 0
    chance = random.Random(seed)
    readings = made_up(2000)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    for index in range(count):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{index}.mcap"
            command = [sys.executable, "-c", WRITER, str(path)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as writer:
                assert writer.stdout is not None
                lines = chance.randrange(1, 1500)
                for _ in range(lines):
                    writer.stdout.readline()
                time.sleep(chance.random() * 1e-3)
                writer.send_signal(signal.SIGKILL)
                lines += writer.stdout.read().count(b"\n")
            found = list(Recording(path).ticks())
            worst = max(worst, lines - len(found))
            damaged += not all(
                equal_readings(tick.reading, reading)
                for tick, (_, reading) in zip(found, readings, strict=False)
            )
    return {"tried": count, "worst": worst, "damaged": damaged}


def minute(full: bool) -> Row:
    """Writes a compressed recording of one minute with 768 8-bit taxels and 12 joints at 100 Hz, and closes
    it."""
    done = gather("minute", _minute, [(6000,)], full=full, alone=True)
    size, speed, closed = (done[0][key] for key in ("size", "speed", "closed")) if done else (0.0, 99.0, 0.0)
    return Row(
        "writing a recording of one minute", sum(d["tried"] for d in done), 6000, "periods",
        f"{size:.1f} MB; written {speed:.0f} times as fast as real time; closed in {closed:.1f} s",
        "at most 10 MB, at least 50 times as fast as real time", size < 10.0 and speed >= 50.0,
    )  # fmt: skip


def _minute(count: int) -> Result:
    readings = made_up(count)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "minute.mcap"
        begin = time.perf_counter()
        with Recorder(path, None, period=PERIOD) as recorder:
            for now, reading in readings:
                recorder.tick(now, reading)
            written = time.perf_counter() - begin
        closed = time.perf_counter() - begin
        size = path.stat().st_size / 1e6
    return {"tried": count, "size": size, "speed": 60.0 / written, "closed": closed - written}
