"""A process that is needed is killed, stopped or closed: how long until its listener says hold."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

from pool import Result, gather
from row import Row

from tci.runtime.heartbeat import Listener

PEER = """
import sys, time
from tci.runtime.heartbeat import INTERVAL, Sender
sender = Sender("peer", int(sys.argv[1]))
while True:
    sender.beat()
    time.sleep(INTERVAL)
"""


def heartbeat(full: bool) -> Row:
    """SIGKILL and SIGSTOP in turn; time from the signal to the reason to hold."""
    done = gather(
        "heartbeat", _kill, [(seed, 10 if full else 6) for seed in range(100 if full else 1)], full=full
    )
    slowest = max((result["slowest"] for result in done), default=0.0)
    return Row(
        "SIGKILL, SIGSTOP of a needed process", sum(result["tried"] for result in done), 1000, "times",
        f"hold after {slowest * 1e3:.0f} ms at most", "100 ms", slowest <= 0.1,
    )  # fmt: skip


def _kill(seed: int, count: int) -> Result:
    del seed
    slowest = 0.0
    for index in range(count):
        with Listener(["peer"]) as listener:
            peer = subprocess.Popen([sys.executable, "-c", PEER, str(listener.port)])
            try:
                while listener.fault():
                    time.sleep(0.001)
                begin = time.monotonic()
                peer.send_signal((signal.SIGKILL, signal.SIGSTOP)[index % 2])
                while not listener.fault():
                    time.sleep(0.001)
                slowest = max(slowest, time.monotonic() - begin)
            finally:
                peer.kill()
                peer.wait()
    return {"tried": count, "slowest": slowest}
