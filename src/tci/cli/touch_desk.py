"""Where `tci serve` takes touches from `tci touch` in another process: a local socket of this user.

One line of JSON asks, `{"touch": [WORDS, ...], "touches": FILE or null}`; one tells what begins,
`{"begun": ...}`, and one what was felt, `{"done": ...}`. A refusal is `{"error": ...}`.
"""

from __future__ import annotations

import json
import os
import re
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

from tci.body.generic_body import GenericBody
from tci.cli.touching import ask
from tci.drivers.combined_server import JOIN
from tci.drivers.driver import Driver
from tci.drivers.lease import own_folder
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, DriverError, TciError
from tci.robot.description import Robot
from tci.runtime.loop import Tick
from tci.touches.planned_touch import PlannedTouch

AFTER = 0.3
"""Time [s] after the end of a touch in which the hand goes away and the last frame arrives."""
PATIENCE = 5.0
"""Longest time [s] for the first line of a client, and for a served robot whose clock stands still."""
PLATEAU = 0.5
"""Fraction of the largest asked force from which a moment counts for the felt force."""
LARGEST = 1 << 16
Series = list[tuple[float, float, dict[str, float]]]
"""For each period the time [s] of the world, that of the machine, and the force [N] on each patch."""


def desk_path(robot: Robot, via: str) -> Path:
    """Where this process, which serves `robot` over `via`, can be asked. Raises the errors of
    `own_folder`."""
    wires = "+".join(one.partition(":")[0] for one in via.split(JOIN))
    return own_folder() / f"touch-{_short(robot.name)}-{wires}-{os.getpid()}.sock"


def desks(robot: Robot) -> Iterator[tuple[str, Path]]:
    """Wires over which processes of this user serve `robot` now, and where each can be asked."""
    for path in sorted(own_folder().glob(f"touch-{_short(robot.name)}-*-*.sock")):
        with socket.socket(socket.AF_UNIX) as probe:
            try:
                probe.connect(str(path))
            except OSError:  # its process was killed
                path.unlink(missing_ok=True)
                continue
        yield path.name.split("-")[-2], path


def _short(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", name)[:40]


class TouchDesk:
    """Answers `tci touch` for one served robot; one client at a time touches."""

    def __init__(self, driver: Driver, via: str, source: str) -> None:
        """Opens the socket. Raises DriverError if the system has none, or has no room for it."""
        if not hasattr(socket, "AF_UNIX"):
            raise DriverError("this system has no local sockets (AF_UNIX)")
        self._driver, self._source = driver, source
        self._body = GenericBody(driver.robot)
        self._series: Series | None = None
        self._turn, self._ends = threading.Lock(), False
        self._path = desk_path(driver.robot, via)
        self._listener = socket.socket(socket.AF_UNIX)
        try:
            unheard = self._path.with_suffix(".new")  # `desks` removes a socket that refuses
            unheard.unlink(missing_ok=True)
            self._listener.bind(str(unheard))
            self._listener.listen(4)
            unheard.replace(self._path)
        except OSError as error:
            self._listener.close()
            raise DriverError(f"no local socket at {self._path}: {error}") from error
        self._thread = threading.Thread(target=self._accept, daemon=True, name="touch desk")
        self._thread.start()

    def see(self, tick: Tick) -> None:
        """Notes what is felt in one period. Called by the loop."""
        if (series := self._series) is not None:
            felt: dict[str, float] = {}
            for contact in tick.perception.contacts:
                felt[contact.patch] = felt.get(contact.patch, 0.0) + contact.force
            series.append((tick.now, time.monotonic(), felt))

    def close(self) -> None:
        self._ends = True
        self._path.unlink(missing_ok=True)
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(PATIENCE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        while not self._ends:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True, name="touch").start()

    def _serve(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            client.settimeout(PATIENCE)
            with client.makefile("rb") as lines:
                line = lines.readline(LARGEST)
            if not line:  # somebody looked who serves
                return
            try:
                if not self._turn.acquire(blocking=False):
                    raise CommandError("another tci touch is at work; valid: one at a time")
                try:
                    self._touch(client, json.loads(line))
                finally:
                    self._series = None
                    self._turn.release()
            except (TciError, OSError, ValueError, TypeError, KeyError) as error:
                _say(client, {"error": str(error)})

    def _touch(self, client: socket.socket, asking: dict[str, Any]) -> None:
        driver = self._driver
        if not isinstance(driver, SimulatedDriver):
            raise CommandError(
                f"{driver.robot.name} is served from {self._source}, not simulated: touch it by hand; "
                "valid: a robot of tci serve --from sim"
            )
        world = driver.world
        hands = [hand for person in world.people for hand in person.hands]
        if any(hand.busy or hand.waiting for hand in hands):
            raise CommandError(
                "the hands are at work for tci serve --touch; valid: tci serve without touches"
            )
        file = asking["touches"]
        asked = ask(
            driver.robot, [str(words) for words in asking["touch"]], None if file is None else Path(file),
            body=self._body, joints=world.joints(),
        )  # fmt: skip
        if asked is None:
            raise CommandError("nothing to do; valid: tci touch ROBOT WORDS, or --touches FILE")
        before = len(asked.missed(driver))
        series: Series = []
        self._series = series
        zero = world.touch_as_planned(asked.planned)
        begun = {"begun": asked.rows(), "left_out": asked.not_here(), "robot": driver.robot.name}
        _say(client, begun | {"starts_s": round(zero, 3)})
        if not self._wait(client, zero + max(one.end for one in asked.planned) + AFTER, world):
            for hand in hands:
                hand.retire()
            return
        seen = list(series)  # the loop goes on while this thread counts
        rows = [
            row
            | {"felt_N": round(_felt(seen, zero, one), 3), "of_real_time": round(_pace(seen, zero, one), 3)}
            for row, one in zip(asked.rows(), asked.planned, strict=True)
        ]
        _say(client, {"done": rows, "missed_touches": asked.missed(driver)[before:]})

    def _wait(self, client: socket.socket, until: float, world: Any) -> bool:
        """Waits for the time `until` [s] of the world. False if the client has gone."""
        now, since = world.time, time.monotonic()
        while now < until:
            if self._ends:
                raise DriverError("the process that serves the robot ends")
            if select.select([client], [], [], 0.02)[0]:
                return False
            if world.time > now:
                now, since = world.time, time.monotonic()
            elif time.monotonic() - since > PATIENCE:
                raise DriverError("the simulation stands still")
        return True


def _felt(series: Series, zero: float, one: PlannedTouch) -> float:
    """Force [N] that was felt on the patch of a touch: the peak of blows, otherwise the median while the hand
    presses."""
    times = np.array([now for now, _, _ in series]) - zero
    forces = np.array([felt.get(one.patch, 0.0) for _, _, felt in series])
    during = (times >= one.onset) & (times <= one.end + AFTER / 2.0)
    if not during.any():
        return 0.0
    if one.kind.generator == "pulses":
        return float(forces[during].max())
    total = one.force.sum(axis=1)
    moments = one.times[total > PLATEAU * total.max()]
    return float(np.median(np.interp(moments, times, forces)))


def _pace(series: Series, zero: float, one: PlannedTouch) -> float:
    """Share of real time at which the simulation ran during a touch."""
    during = [(now, real) for now, real, _ in series if one.onset <= now - zero <= one.end]
    ran, took = np.subtract(during[-1], during[0]) if during else (0.0, 0.0)
    return min(1.0, ran / took) if took > 0.0 else 1.0


def _say(client: socket.socket, words: dict[str, Any]) -> None:
    with suppress(OSError):
        client.sendall(json.dumps(words).encode() + b"\n")
