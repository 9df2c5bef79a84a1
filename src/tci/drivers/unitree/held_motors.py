"""The driver's end of the process that holds a robot's motors (`keeper`)."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import asdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.drivers.unitree.address import UnitreeAddress
from tci.drivers.unitree.handover import GIVE as GIVE_TIME
from tci.drivers.unitree.handover import TAKE as TAKE_TIME
from tci.drivers.unitree.handover import Phase
from tci.drivers.unitree.keeper import FOLLOW, FOLLOWS, GIVE, STATUS, TAKE, Orders
from tci.errors import DriverError
from tci.frames import Array

WAIT = 10.0
"""Time [s] that taking the motors may last beyond its ramp. Assumed: a busy machine starts a process in a few
seconds."""
LONGEST = 1024
"""Longest status [bytes]."""


class Status(NamedTuple):
    """State of the motors' handover."""

    phase: Phase
    lasting: bool
    """True for a fault after which only a person connects again."""
    weight: float
    reason: str


class HeldMotors:
    """Starts the keeper and talks with it. It outlives this process."""

    def __init__(self, where: UnitreeAddress, period: float) -> None:
        """Starts the process; nothing is taken yet. Raises DriverError on systems without its sockets."""
        if not hasattr(socket, "SOCK_SEQPACKET") or not hasattr(socket, "AF_UNIX"):
            raise DriverError("a Unitree robot can be moved from Linux only; valid: connect with arm=False")
        self.status = Status(Phase.WAITING, False, 0.0, "")
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        orders = Orders(
            where.interface, where.domain, where.topic, whole=where.whole, simulation=where.simulation,
            period=period, socket=theirs.fileno(),
        )  # fmt: skip
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tci.drivers.unitree.keeper", json.dumps(asdict(orders))],
                pass_fds=[theirs.fileno()], start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip

    def poll(self) -> Status:
        """Returns the latest status."""
        while True:
            try:
                data = self._socket.recv(LONGEST)
            except BlockingIOError:
                return self.status
            except OSError:
                data = b""
            if not data:
                if not self.status.lasting:
                    words = "the process that holds the motors has ended"
                    self.status = Status(Phase.WAITING, True, 0.0, words)
                return self.status
            phase, lasting, weight = STATUS.unpack_from(data)
            reason = data[STATUS.size :].decode(errors="replace")
            self.status = Status(Phase(phase), lasting, weight, reason)

    def take(self) -> None:
        """Asks for the motors: their weight then rises at the posture in which they are."""
        self._send(TAKE)

    def wait(self) -> None:
        """Waits until the motors follow. Raises DriverError with the reason why they do not."""
        end = time.monotonic() + TAKE_TIME + WAIT
        while self.poll().phase is not Phase.LEADING:
            if self.status.lasting or time.monotonic() > end:
                raise DriverError(f"the robot can't be armed: {self.status.reason or 'no answer'}")
            if self.status.phase is Phase.WAITING:
                self.take()  # again, if the robot fell silent on the way
            time.sleep(0.01)

    def follow(self, chosen: NDArray[np.bool_], targets: Array) -> None:
        """Sends targets (5, 29) of the `chosen` motors (29,)."""
        self._send(FOLLOWS.pack(FOLLOW, *chosen.tolist(), *targets.ravel().tolist()))

    def close(self) -> None:
        """Hands the motors back and waits for it."""
        self._send(GIVE)
        with suppress(subprocess.TimeoutExpired):  # it hands them back as soon as the machine lets it
            self._process.wait(GIVE_TIME + WAIT)
        self._socket.close()

    def _send(self, message: bytes) -> None:
        try:
            self._socket.send(message)
        except BlockingIOError:
            pass  # it does not run: what is lost is older than what follows
        except OSError:
            self.poll()
