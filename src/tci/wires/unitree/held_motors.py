"""Connection from the driver to the keeper (`keeper.py`), the process that controls a robot's motors. If the
keeper is killed, the driver's process hands the motors back instead.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import asdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError
from tci.messages.frames import Array
from tci.shared.interface_node import InterfaceNode
from tci.wires.unitree.address import UnitreeAddress
from tci.wires.unitree.handover import GIVE as GIVE_TIME
from tci.wires.unitree.handover import TAKE as TAKE_TIME
from tci.wires.unitree.handover import Phase, holding
from tci.wires.unitree.health import Health
from tci.wires.unitree.keeper import FOLLOW, FOLLOWS, GIVE, STATUS, TAKE, TAKES, Keeper, Orders, keep
from tci.wires.unitree.motors import MOTORS, TARGET, gains

WAIT = 10.0
"""Longest delay [s] in taking the motors or handing them back, in addition to the time of the gradual
transition. Assumed: a busy machine starts a process within a few seconds."""
LONGEST = 1024
"""Largest length [bytes] of a status message."""


class Status(NamedTuple):
    """State of the handover of the motors, as the keeper reports it."""

    phase: Phase
    lasting: bool
    """True after a fault that lasts until a person connects again."""
    weight: float
    reason: str


class HeldMotors:
    """Starts the keeper, a process that sends the commands to the motors, and communicates with it. If the
    driver's process ends, the keeper continues until it has handed the motors back."""

    def __init__(self, where: UnitreeAddress, period: float, node: InterfaceNode, health: Health) -> None:
        """Starts the keeper. The keeper takes the motors only after a call of `take`. `node` and `health`
        belong to the driver. If the keeper is killed, this class uses them to hand the motors back. Raises
        DriverError if the operating system lacks the required sockets."""
        if not hasattr(socket, "SOCK_SEQPACKET") or not hasattr(socket, "AF_UNIX"):
            raise DriverError("a Unitree robot can be moved from Linux only; valid: connect with arm=False")
        self.status = Status(Phase.WAITING, False, 0.0, "")
        self.holds: Array = np.zeros(MOTORS)
        """Torques (29,) [N m] that hold the links' weight in the posture in which the motors are taken."""
        self._node, self._health = node, health
        self._goal, self._told = np.zeros(MOTORS, TARGET), np.zeros(MOTORS, dtype=bool)
        self._lock, self._ended = threading.Lock(), False
        self._successor: Keeper | None = None
        self._fade: threading.Thread | None = None
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        self._orders = Orders(
            where.interface, where.domain, where.topic, whole=where.whole, simulation=where.simulation,
            period=period, socket=theirs.fileno(),
        )  # fmt: skip
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tci.wires.unitree.keeper", json.dumps(asdict(self._orders))],
                pass_fds=[theirs.fileno()], start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        threading.Thread(target=self._watch, name="unitree keeper's end", daemon=True).start()

    def poll(self) -> Status:
        """Returns the latest status."""
        with self._lock:
            while not self._ended:
                try:
                    data = self._socket.recv(LONGEST)
                except BlockingIOError:
                    break
                except OSError:
                    data = b""
                if data:
                    phase, lasting, weight = STATUS.unpack_from(data)
                    reason = data[STATUS.size :].decode(errors="replace")
                    self.status = Status(Phase(phase), lasting, weight, reason)
                else:
                    self._ended = True
                    self._hand_back()
            if self._successor is not None:
                fading = self._successor.handover
                self.status = self.status._replace(phase=fading.phase, weight=fading.weight)
            return self.status

    def take(self) -> None:
        """Requests that the keeper takes the motors. The keeper then gradually raises the weight of its
        commands, with the present posture as target."""
        self._told[:] = False
        self._send(TAKES.pack(TAKE, *self.holds.tolist()))

    def wait(self) -> None:
        """Waits until the motors follow targets. Raises DriverError with the reason if the motors do not
        follow in time."""
        end = time.monotonic() + TAKE_TIME + WAIT
        while self.poll().phase is not Phase.LEADING:
            if self.status.lasting or time.monotonic() > end:
                raise DriverError(f"the robot can't be armed: {self.status.reason or 'no answer'}")
            if self.status.phase is Phase.WAITING:
                # repeats the request, since the keeper gives up if no states arrive while taking the motors
                self.take()
            time.sleep(0.01)

    def follow(self, chosen: NDArray[np.bool_], targets: NDArray[np.void]) -> None:
        """Sends the `TARGET`s (29,) of the `chosen` motors (29,) to the keeper."""
        self._told = (self._told & (self._goal["kp"] > 0.0)) | chosen
        self._goal[chosen], self._goal["holds"] = targets[chosen], targets["holds"]
        self._send(FOLLOWS.pack(FOLLOW, *chosen.tolist(), targets.tobytes()))

    def close(self) -> None:
        """Hands the motors back, and waits until the robot's own controller has the motors."""
        self._send(GIVE)
        # after a timeout, the keeper hands the motors back later, when the machine is less busy
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(GIVE_TIME + WAIT)
        self.poll()
        if self._fade is not None:
            self._fade.join(GIVE_TIME + WAIT)
        with self._lock:
            self._ended = True
            self._socket.close()

    def _watch(self) -> None:
        """Waits for the end of the keeper, the process that commands the motors, and then hands the motors
        back if necessary. Runs in its own thread."""
        self._process.wait()
        self.poll()

    def _hand_back(self) -> None:
        """Hands the motors back to the robot's own controller, in a thread, if the keeper ended while it
        controlled the motors."""
        with suppress(subprocess.TimeoutExpired):
            if self._process.wait(1.0) == 0 or self.status.phase is Phase.WAITING:
                words = self.status.reason or "the process that holds the motors has ended"
                self.status = Status(Phase.WAITING, True, 0.0, words)
                return
        goal = holding(self._health.posture, gains(whole=self._orders.whole), self._goal["holds"])
        goal[self._told] = self._goal[self._told]
        state, weight = self._health.state, self.status.weight

        def fade() -> None:
            mine, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            theirs.close()
            with mine:
                keeper = Keeper(self._orders, self._node, mine)
                keeper.take_over(state, goal, weight, time.monotonic())
                self._successor = keeper
                keep(keeper, mine, self._orders.period)

        # Python waits for this thread at exit
        self._fade = threading.Thread(target=fade, name="unitree fade")
        self._fade.start()
        words = "the process that held them was killed, and this one fades them out"
        self.status = Status(Phase.GIVING, True, self.status.weight, words)

    def _send(self, message: bytes) -> None:
        try:
            self._socket.send(message)
        except BlockingIOError:
            pass  # it does not run: what is lost is older than what follows
        except OSError:
            self.poll()
