"""The check for threads and descriptors that a driver leaves open detects a driver that forgets to close
them."""

from __future__ import annotations

import os
import socket
import threading

import tci
from helpers.held import left_behind
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver


def test_what_a_driver_forgets_is_found() -> None:
    forgotten, end = [], threading.Event()
    thread = threading.Thread(target=end.wait)

    def make() -> Driver:
        thread.start()
        forgotten.append(socket.socket())
        return SimulatedDriver(tci.load_robot("nao"), arm=True)

    left = left_behind(make, Driver.read, patience=0.2)
    assert left == {thread, f"socket:[{os.fstat(forgotten[0].fileno()).st_ino}]"}
    forgotten.pop().close()
    end.set()
