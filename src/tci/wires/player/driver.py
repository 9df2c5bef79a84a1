"""`player:[HOST][:PORT]`: driver for a robot on a Player server, which may be another TCI process.

The device actarray:N has the joints of the robot's N-th part; opaque:N has the skin of its N-th patch. N
counts from 0. The robot's binding `player` may set other numbers. TCI processes exchange their own messages
(`remote`) through the device opaque:99 and the opaque devices after it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.remote.driver import RemoteDriver
from tci.drivers.remote.encoding import orders_bytes, to_skin, to_state
from tci.drivers.remote.hosts import numeric
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.drivers.remote.source_clock import SourceClock
from tci.drivers.remote.whole_parts import WholeParts
from tci.errors import DriverError, FrameError
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.description import Robot
from tci.wires.player.client import Client, parse
from tci.wires.player.wire import (
    ACTARRAY,
    OPAQUE,
    POSITIONS,
    STATE,
    Message,
    MessageKind,
    blob,
    floats,
    to_actuators,
    to_blob,
)
from tci.wires.player.wire import to_skin as to_raw

STATES, FRAMES = 99, 100
"""Indices of opaque devices for TCI processes. Device STATES has the robot's states, and device FRAMES has
the skin frames of the first patch. The devices after FRAMES have the skin frames of the other patches."""
WAIT = 5.0
"""Time [s] that a new driver waits for joints and skin. Assumed: a server sends joints and skin in every
period."""


def numbers(robot: Robot) -> dict[tuple[int, int], str]:
    """Returns the name of the part or patch of each device, by the interface and the index of the device.

    Raises DriverError if the binding has an invalid address.
    """
    binding = robot.binding("player")
    parts = tuple(dict.fromkeys(servo.robot_part for servo in robot.servos))
    found: dict[tuple[int, int], str] = {}
    for interface, names in ((ACTARRAY, parts), (OPAQUE, tuple(patch.name for patch in robot.skin))):
        for usual, name in enumerate(names):
            index = binding.address(name, str(usual))
            if not index.isdecimal() or (interface, int(index)) in found:
                raise DriverError(f"player address of {name} is {index!r}; valid: a number of its own")
            found[interface, int(index)] = name
    return found


class PlayerDriver(RemoteDriver):
    """A driver of a robot on a Player server."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False, wait: float = WAIT) -> None:
        """Connects to the server. Raises DriverError if no server answers, if devices are missing, or if no
        joint data arrives in time."""
        host, port = parse(address)
        super().__init__(robot, middleware="player", place=f"{host}:{port}", arm=arm)
        self._devices = numbers(robot)
        self._client = Client(host, port)
        self._why = ""
        self._arrived = {name: (SourceClock(), 0) for name in self._devices.values()}
        self._latest: dict[str, SkinFrame] = {}
        count = len(robot.servos)
        self._position, self._velocity = np.full(count, np.nan), np.zeros(count)
        self._stamps = np.full(count, -np.inf)
        self._parts = WholeParts(robot)
        self._sequence_in = 0
        try:
            offered = self._client.devices()
            self.is_native = (OPAQUE, STATES) not in offered
            if self.is_native:
                self._use_full_gate(f"player:{numeric(host)}:{port}:{robot.name}")
                self._open_devices(offered)
                self._wait_for_joints(wait)
            else:
                for index in range(STATES, FRAMES + len(robot.skin)):
                    self._client.open(OPAQUE, index)
                self._wait()
        except BaseException:
            self._client.close()
            raise

    def diagnose(self) -> tuple[Finding, ...]:
        whose = "a robot's own devices" if self.is_native else "a TCI process"
        found = [Finding(Level.OK, "dialect", f"{whose} at {self.place}")]
        if self.rejected:
            found.append(Finding(Level.WARNING, "messages", f"{self.rejected} unusable: {self._why}"))
        return tuple(found)

    def _receive(self) -> Reading:
        if not self.is_native:
            return super()._receive()
        self._take_native()
        joints = JointReading(
            stamp=float(self._stamps.min()), sequence=self._sequence_in,
            position=self._position.copy(), velocity=self._velocity.copy(),
        )  # fmt: skip
        return Reading(joints, tuple(self._latest.values()))

    def _send(self, safe: SafeCommand) -> None:
        if not self.is_native:
            super()._send(safe)
            return
        whole = self._parts.complete(safe, self._position)
        for (interface, index), name in self._devices.items():
            if interface == ACTARRAY and name in whole:
                self._client.command(ACTARRAY, index, POSITIONS, floats(whole[name]))

    def _halt(self) -> None:
        self._parts.forget()

    def _close(self) -> None:
        super()._close()
        self._client.close()

    def _poll(self) -> Iterator[State | SessionFrame]:
        found = self._client.poll()
        latest = {m.index: m for m in found if (m.interface, m.kind) == (OPAQUE, MessageKind.DATA)}
        for message in latest.values():
            try:
                data = to_blob(message.body)
                yield to_state(self.robot, data) if message.index == STATES else to_skin(self.robot, data)
            except FrameError as error:
                self._refuse(error)

    def _put(self, orders: Orders) -> None:
        self._client.command(OPAQUE, STATES, STATE, blob(orders_bytes(self.robot, orders)))

    def _why_silent(self) -> str:
        return self._why or self._client.lost or "its process sends no states"

    def _open_devices(self, offered: list[tuple[int, int]]) -> None:
        for device, name in self._devices.items():
            if device not in offered:
                what = "actarray" if device[0] == ACTARRAY else "opaque"
                raise DriverError(f"{self.place} has no {what}:{device[1]} for {name}")
            self._client.open(*device)

    def _wait_for_joints(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while np.isinf(self._stamps).any() or (len(self._latest) < len(self.robot.skin)):
            if self._client.lost:
                raise DriverError(f"{self.place}: {self._client.lost}")
            if time.monotonic() > end:
                if np.isinf(self._stamps).any():
                    missing = {s.robot_part for s in self.robot.servos if np.isinf(self._stamps[s.index])}
                    why = f": {self._why}" if self._why else ""
                    raise DriverError(f"no joints of {', '.join(sorted(missing))} within {seconds:g} s{why}")
                return
            self._take_native()
            time.sleep(0.002)

    def _take_native(self) -> None:
        latest = {
            (message.interface, message.index, message.kind): message for message in self._client.poll()
        }
        for message in latest.values():
            name = self._devices.get((message.interface, message.index))
            if name is None or (message.kind, message.subtype) != (MessageKind.DATA, STATE):
                continue
            try:
                self._accept_data(name, message)
            except FrameError as error:
                self._refuse(error)

    def _accept_data(self, name: str, message: Message) -> None:
        """Decodes and stores the joint data of the part `name`, or a frame of the patch `name`. Raises
        FrameError if the data is invalid."""
        clock, count = self._arrived[name]
        if message.interface == OPAQUE:
            values = to_raw(to_blob(message.body), self.robot.patch(name).channels)
            stamp = clock.place(message.stamp, self.clock.now())
            if stamp is not None:
                self._arrived[name] = clock, count + 1
                self._latest[name] = SkinFrame(name, stamp, count + 1, values)
            return
        position, velocity = to_actuators(message.body)
        servos = [servo.index for servo in self.robot.servos_of(name)]
        if len(position) != len(servos):
            raise FrameError(f"actarray of {name}: {len(position)} joints; valid: {len(servos)}")
        stamp = clock.place(message.stamp, self.clock.now())
        if stamp is not None:
            self._position[servos], self._velocity[servos] = position, velocity
            oldest = self._stamps.min()
            self._stamps[servos] = stamp
            self._sequence_in += bool(self._stamps.min() != oldest)  # the number belongs to the stamp

    def _refuse(self, error: FrameError) -> None:
        self.rejected += 1
        self._why = str(error)
