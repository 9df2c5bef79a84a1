"""Kills or stops a process that a robot needs, and measures the time until the listener for heartbeats
reports a reason to hold the robot."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from contextlib import ExitStack, suppress

from pool import Result, gather
from row import Row

from tci.errors import TciError
from tci.runtime.heartbeat import Listener
from tci.runtime.priority import real_time

PAUSE = 0.01
"""If the time [s] between two checks exceeds this value, the machine causes the delay, not TCI. Such a trial
is repeated."""
PEER = """
import sys, time
from tci.runtime.heartbeat import INTERVAL, Sender
sender = Sender("peer", int(sys.argv[1]))
while True:
    sender.beat()
    time.sleep(INTERVAL)
"""


def heartbeat(full: bool) -> Row:
    """Measures the time from SIGKILL or SIGSTOP (alternately) to the reason to hold."""
    done = gather(
        "heartbeat", _kills, [(seed, 10 if full else 6) for seed in range(100 if full else 1)], full=full
    )
    slowest, paused = max((one["slowest"] for one in done), default=0.0), sum(one["paused"] for one in done)
    words = f"reason to hold after at most {slowest * 1e3:.0f} ms"
    if paused:
        words += f"; {paused} trials repeated, because the listening process got no processor time for "
        words += f"{PAUSE * 1e3:.0f} ms"
    return Row(
        "SIGKILL or SIGSTOP to a process that the robot needs",
        sum(one["tried"] for one in done),
        1000,
        "times",
        words,
        "at most 100 ms",
        slowest <= 0.1,
    )


def _kills(seed: int, count: int) -> Result:
    del seed
    slowest, tried, paused = 0.0, 0, 0
    with ExitStack() as stack:
        with suppress(TciError):  # real-time priority, if permitted, excludes the delays of other programs
            stack.enter_context(real_time())
        while tried < count:
            time_, pause = _kill((signal.SIGKILL, signal.SIGSTOP)[tried % 2])
            if pause > PAUSE:
                paused += 1
                continue
            tried += 1
            slowest = max(slowest, time_)
    return {"tried": tried, "slowest": slowest, "paused": paused}


def _kill(kind: signal.Signals) -> tuple[float, float]:
    """Returns the time [s] from the signal to the reason to hold, and the longest time [s] between two
    checks."""
    with Listener(["peer"]) as listener:
        peer = subprocess.Popen([sys.executable, "-c", PEER, str(listener.port)])
        try:
            while listener.fault():
                time.sleep(0.001)
            begin = before = time.monotonic()
            peer.send_signal(kind)
            pause, fault = 0.0, ""
            while not fault:
                time.sleep(0.001)
                fault, now = listener.fault(), time.monotonic()
                pause, before = max(pause, now - before), now
            return now - begin, pause
        finally:
            peer.kill()
            peer.wait()
