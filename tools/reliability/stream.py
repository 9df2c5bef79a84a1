"""Sends a large skin at a high rate from another process over YARP, and counts the lost frames."""

from __future__ import annotations

import subprocess
import sys
import time

from row import Row

from yarpwire.dialect import V3
from yarpwire.feed import Feed
from yarpwire.name_server import NameServer
from yarpwire.wire import Wire

TAXELS, RATE = 4000, 1000
WRITER = """
import sys, time
import numpy as np
from tci.messages.clock import MonotonicClock, ticks
from yarpwire.dialect import V3
from yarpwire.message import Stamp
from yarpwire.names import Names
from yarpwire.port import Port
host, number, taxels, rate, seconds = sys.argv[1], *map(int, sys.argv[2:])
port = Port("/skin", Names((host, number)), V3)
print("ready", flush=True)
while not port.outputs:
    time.sleep(0.01)
values, clock = np.full(taxels, 240.0), MonotonicClock()
begin = clock.now()
for count in range(seconds * rate):
    clock.sleep_until(begin + count / rate)
    values[count % taxels] = count
    port.write(values, Stamp(count, time.time()))
print(port.dropped, flush=True)
sys.stdin.read()
"""


def yarp_skin(full: bool) -> Row:
    """Sends 4000 taxels at 1 kHz for a minute. Counts the frames that the writer dropped, and the frames that
    did not arrive."""
    seconds, wrong = (60 if full else 3), 0
    expected = seconds * RATE
    with NameServer() as server:
        command = [sys.executable, "-c", WRITER, *map(str, (*server.address, TAXELS, RATE, seconds))]
        writer = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
        feed = Feed(
            "/skin", Wire(server.address), V3, lambda delivery: delivery.vector(V3), own="/reader",
            carrier="fast_tcp",
        )  # fmt: skip
        dropped = int(writer.stdout.readline())
        end = time.monotonic() + 5.0
        while feed.latest is None or feed.latest.sequence + 1 + feed.lost + dropped < expected:
            if time.monotonic() > end:
                break
            time.sleep(0.01)
        read = feed.latest.sequence + 1 if feed.latest is not None else 0
        wrong = feed.wrong
        feed.close()
        writer.communicate()
    return Row(
        f"skin of {TAXELS} taxels at {RATE} Hz over YARP",
        seconds,
        60,
        "s",
        f"{expected - read} of {expected} frames lost ({dropped} dropped by the writer); "
        f"{wrong} frames refused",
        "0 frames lost in 60 s",
        read == expected and wrong == 0,
    )


if __name__ == "__main__":
    print(yarp_skin("full" in sys.argv))
