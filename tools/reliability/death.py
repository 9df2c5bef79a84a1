"""A process that is needed is killed, stopped or closed: how long until its listener says hold."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

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
    count, slowest = (1000 if full else 6), 0.0
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
    return Row(
        "SIGKILL, SIGSTOP of a needed process", f"{count}", f"hold after {slowest * 1e3:.0f} ms at most",
        "100 ms", slowest <= 0.1,
    )  # fmt: skip
