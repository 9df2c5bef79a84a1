"""The look at what a link leaves behind finds what one forgets."""

from __future__ import annotations

import os
import socket
import threading

import tci
from drivers.held import left_behind
from tci.drivers.driver import Link
from tci.drivers.simulated import SimulatedLink


def test_what_a_link_forgets_is_found() -> None:
    forgotten, end = [], threading.Event()
    thread = threading.Thread(target=end.wait)

    def make() -> Link:
        thread.start()
        forgotten.append(socket.socket())
        return SimulatedLink(tci.load_robot("nao"), arm=True)

    left = left_behind(make, Link.read, patience=0.2)
    assert left == {thread, f"socket:[{os.fstat(forgotten[0].fileno()).st_ino}]"}
    forgotten.pop().close()
    end.set()
