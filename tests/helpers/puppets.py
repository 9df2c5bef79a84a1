"""A simulated G1 that consists only of DDS topics, in a thread. Tests set its posture. It records all
commands."""

from __future__ import annotations

import threading
import time
from typing import Any, NamedTuple, Self

import numpy as np

from tci.runtime.priority import real_time_where_permitted
from tci.shared.interface_node import MOST, InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.wire import STATE, WEIGHT, decode_command, encode_state

PERIOD = 0.004


class Heard(NamedTuple):
    """One received command."""

    time: float
    weight: float
    motor: Any
    right: bool
    mode_machine: int


class Puppet:
    """A robot without physics, whose posture changes only if a test or `obeys` changes it."""

    def __init__(self, domain: int, topic: str = "rt/arm_sdk") -> None:
        self.state: Any = np.zeros((), STATE)
        self.state["mode_machine"], self.state["quaternion"][0] = 5, 1.0
        self.state["motor"]["q"][:29] = np.linspace(-0.5, 0.5, 29)
        self.heard: list[Heard] = []
        self.silent = False
        """True while the robot sends no states."""
        self.spoilt = False
        """True while the checksums of its states are wrong."""
        self.obeys = False
        """True while the joints immediately reach the targets of commands with weight 1."""
        self._node = InterfaceNode("lo", domain)
        self._states = self._node.out("rt/lowstate", messages.STATE)
        self._commands = self._node.reader(topic, messages.COMMAND, keep=MOST, reliable=True)
        self._open = True
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def _live(self) -> None:
        # real time as on a robot, where the loop does not wait for other programs
        with real_time_where_permitted():
            self._move()

    def _move(self) -> None:
        due = time.monotonic()
        while self._open:
            if time.monotonic() >= due:
                due += PERIOD
                if not self.silent:
                    data = encode_state(self.state)
                    self._states(data[:-1] + bytes([data[-1] ^ self.spoilt]))
            for sample in latest(self._commands):
                command, right = decode_command(sample.raw)
                if self.obeys and command["motor"]["q"][WEIGHT] == 1.0:
                    self.state["motor"]["q"][12:29] = command["motor"]["q"][12:29]
                self.heard.append(
                    Heard(
                        time.monotonic(), float(command["motor"]["q"][WEIGHT]), command["motor"], right,
                        int(command["mode_machine"]),
                    )
                )  # fmt: skip
            time.sleep(0.001)

    @property
    def weights(self) -> list[float]:
        """Weights of all commands that were received so far."""
        return [heard.weight for heard in self.heard]

    def wait(self, condition: Any, patience: float = 15.0) -> None:
        """Waits until `condition(self)` is true."""
        end = time.monotonic() + patience
        while not condition(self):
            assert time.monotonic() < end, (self.weights[-5:], len(self.heard))
            time.sleep(0.005)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._open = False
        self._thread.join()
        self._node.close()
