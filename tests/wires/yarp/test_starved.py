"""Boards that send late, each at another time: late data is a HOLD, never a STOP."""

from __future__ import annotations

import os
import random
import threading
import time
from collections import deque
from typing import Any

import numpy as np
import pytest

import tci
from helpers.yarp_show import Show
from tci.gate.gate import GateState
from tci.messages import Mode
from yarpwire.dialect import V3


class Late:
    """A port that keeps its messages for a while and then sends them all, or only the last one."""

    def __init__(self, port: Any) -> None:
        self._port, self._kept, self.until, self.loses = port, deque[tuple[Any, ...]](), 0.0, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def write(self, *message: Any) -> None:
        if self.loses:
            self._kept.clear()
        self._kept.append(message)
        if time.monotonic() >= self.until:
            while self._kept:
                self._port.write(*self._kept.popleft())


def test_boards_that_are_starved_by_turns_hold_the_robot_and_never_stop_it(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each board is silent by turns, and then sends everything, or only its last state. `STARVED` in the
    environment is the length [s]; ten minutes take silences up to 2 s."""
    length = float(os.environ.get("STARVED", "6"))
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path_factory.mktemp("yarp")))
    show = Show(V3, "icub")
    ports = show.server._ports
    boards = [name for name in ports if name.endswith("stateExt:o")]
    late = {name: Late(ports[name]) for name in boards}
    ports.update(late)  # type: ignore[arg-type] # a port with another `write`
    choose, over = random.Random(7), threading.Event()

    def starve() -> None:
        while not over.wait(choose.uniform(0.05, 0.4)):
            one = late[choose.choice(boards)]
            one.loses = choose.random() < 0.5
            one.until = time.monotonic() + choose.uniform(0.05, 0.5 if length < 60 else 2.0)
            over.wait(max(0.0, one.until - time.monotonic()) if choose.random() < 0.5 else 0.0)

    starver = threading.Thread(target=starve, daemon=True)
    states: list[GateState] = []
    moved: list[float] = []
    numbers: dict[float, set[int]] = {}
    try:
        with tci.connect(
            tci.load_robot("icub"), "yarp:{}:{}".format(*show.names.address), arm=True
        ) as driver:
            body = tci.GenericBody(driver.robot)
            parts = [part for part in driver.robot.parts if part.kind == "arm"]
            first = driver.read().joints
            begin, here = first.position.copy(), body.posture(first)
            starver.start()
            for now in driver.ticks(duration=length):
                joints = driver.read().joints
                swing = 0.25 * np.sin(2.0 * np.pi * now / 2.0)
                wanted = tuple(
                    tci.GenericCommand(part.name, Mode.POSITION, here[part.name] + swing) for part in parts
                )
                orders, _ = body.to_platform(wanted, joints)
                sent = driver.write(driver.gate.step(orders, joints, now))
                states.append(sent.state)
                numbers.setdefault(joints.stamp, set()).add(joints.sequence)
                moved.append(float(np.abs(joints.position - begin).max()))
            stopped = driver.gate.reason if driver.gate.state is GateState.STOP else None
    finally:
        over.set()
        show.close()
    assert stopped is None
    assert states.count(GateState.HOLD) > 5, "nothing was late"
    assert max(moved) > 0.1
    assert all(len(some) == 1 for some in numbers.values())
    assert len({number for some in numbers.values() for number in some}) == len(numbers)
