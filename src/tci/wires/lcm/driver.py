"""`lcm[:[NAME@]URL]`: a robot that `tci serve --via lcm` serves to any number of processes.

| channel | content | from | |---|---|---| | `tci/NAME/state` | `tci_lcm.state_t`: joints, gate, commander; in
every period | robot | | `tci/NAME/skin` | `tci_lcm.skin_t`: each new frame of a patch | robot | |
`tci/NAME/facts` | `tci_lcm.facts_t`: the robot's facts, once a second | robot | | `tci/NAME/orders` |
`tci_lcm.orders_t`: orders and heartbeat, in every period | behaviour |

Every member of the multicast group may command the robot, since LCM has no passwords. By default, TCI joins
the group on the loopback interface, so only programs on this machine can be members. A URL with ttl=1 opens
the robot to the whole local network. To use a robot over a network, prefer Zenoh.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.remote.address import RemoteAddress, parse_remote
from tci.drivers.remote.driver import RemoteDriver
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.drivers.remote.server import RemoteServer
from tci.errors import DriverError, FrameError
from tci.messages import Reading, SkinFrame
from tci.robot.description import Robot
from tci.wires.lcm.datagrams import URL, Address, Receiver, Transmitter, parse_url
from tci.wires.lcm.encoding import (
    facts_bytes,
    frame_bytes,
    orders_bytes,
    state_bytes,
    to_orders,
    to_skin,
    to_state,
)

PER_POLL = 64
"""Largest number of messages that one call of `poll` returns. If more messages have arrived, `poll` drops the
older messages. Assumed: this number bounds the time for decoding if very many messages arrive."""
FACTS = 1.0
"""Time [s] between two messages with the robot's facts. LCM has no requests, so a client waits up to this
time for the facts. Assumed: this wait is acceptable."""


class _Bus:
    """Sends and receives one robot's messages in a multicast group."""

    def __init__(self, address: RemoteAddress) -> None:
        """Joins the multicast group. Raises DriverError if the group can't be joined."""
        self.receiver = Receiver(address.where)
        self.transmitter = Transmitter(address.where)
        self._where, self._prefix = address, f"tci/{address.robot}"
        self._works = False

    def put(self, name: str, data: bytes) -> None:
        """Sends a message on the robot's channel `name`. Raises DriverError if sending fails before any
        message has been sent. Later, a message that can't be sent is lost without an error."""
        try:
            self.transmitter.send(f"{self._prefix}/{name}", data)
            self._works = True
        except OSError as error:
            if not self._works:
                raise DriverError(f"{self._where}: the network accepts no data: {error.strerror}") from error

    def poll(self) -> Iterable[tuple[str, bytes, Address]]:
        """Returns channel name, data and sender of the messages for this robot that have arrived, the oldest
        first. If there are very many, drops the older ones."""
        latest: deque[tuple[str, bytes, Address]] = deque(maxlen=PER_POLL)
        for channel, data, sender in self.receiver.poll():
            prefix, _, name = channel.rpartition("/")
            if prefix == self._prefix:
                latest.append((name, data, sender))
        return latest

    def close(self) -> None:
        """Closes the sockets."""
        self.receiver.close()
        self.transmitter.close()


class LcmDriver(RemoteDriver):
    """A robot that another process serves through LCM."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False) -> None:
        """Connects to `address`. Raises DriverError if no process at this address serves a robot with this
        description."""
        where = _parse(address, robot)
        super().__init__(robot, middleware="lcm", place=str(where), arm=arm)
        self._bus = _Bus(where)
        self._home: Address | None = None
        self._why = ""
        try:
            self._wait()
        except BaseException:
            self._bus.close()
            raise

    def _receive(self) -> Reading:
        before = self._state
        reading = super()._receive()
        end = self.clock.now() + self.gate.stale_after
        # If no program reads the socket, the system keeps the oldest datagrams, so the latest state may be
        # unread.
        while self._state is not before and self._is_late() and self.clock.now() < end:
            self.clock.sleep_until(self.clock.now() + self.period)
            reading = super()._receive()
        return reading

    def _is_late(self) -> bool:
        """Returns True if the latest state from the robot's process is too old for the gate."""
        assert self._state is not None
        return self.clock.now() - (self._state.now + self._shift) > self.gate.stale_after

    def _poll(self) -> Iterator[State | SessionFrame]:
        """Yields the states and skin frames that have arrived from the robot's process. Ignores messages with
        this process's session number from other senders, since every member of the multicast group can read
        this number."""
        readers: dict[str, Callable[[Robot, bytes], State | SessionFrame]] = {
            "state": to_state, "skin": to_skin
        }  # fmt: skip
        for name, data, sender in self._bus.poll():
            if name not in readers:
                continue
            try:
                message = readers[name](self.robot, data)
            except FrameError as error:
                self.rejected += 1
                self._why = str(error)
                continue
            if self._home is None and isinstance(message, State):
                self._home = sender
            own = self._state is not None and message.session == self._state.session
            if own and sender != self._home:
                self.strangers += 1
            else:
                yield message

    def _put(self, orders: Orders) -> None:
        self._bus.put("orders", orders_bytes(self.robot, orders))

    def _why_silent(self) -> str:
        return self._why or "serve it with tci serve ROBOT --via lcm, under the same URL"

    @property
    def lost(self) -> int:
        """Number of messages that other processes sent to the multicast group, and that this process never
        received."""
        return self._bus.receiver.datagrams.lost

    def diagnose(self) -> tuple[Finding, ...]:
        seen = self._bus.receiver.datagrams
        figures = {"lost": float(seen.lost), "rejected": float(seen.rejected + self.rejected)}
        said = f"{seen.lost} messages lost, {seen.rejected + self.rejected} refused"
        found = super().diagnose()
        if not seen.lost:
            return (*found, Finding(Level.OK, "datagrams", said, figures=figures))
        advice = "single losses do no harm; if there are many, close other programs or use zenoh"
        return (*found, Finding(Level.WARNING, "datagrams", said, advice, figures))

    def _close(self) -> None:
        super()._close()
        self._bus.close()


class LcmServer(RemoteServer):
    """Serves a robot through LCM."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Joins the multicast group. Raises DriverError if `address` can't be used."""
        super().__init__(driver, address, middleware="lcm")
        self._where = _parse(address, driver.robot)
        self._bus = _Bus(self._where)
        self._homes: dict[int, Address] = {}
        self.rejected = 0
        """Number of rejected messages. A message is rejected if it has no valid orders for this robot, or if
        its client number belongs to a process at another address."""
        self._facts, self._due = facts_bytes(driver.robot), -float("inf")
        self._open = True

    def where(self) -> str:
        everybody = ", read and commanded by everybody on the local network"
        return f"{self._where}{everybody if parse_url(self._where.where).ttl else ''}"

    def reach(self) -> str:
        return str(self._where)

    def _poll(self) -> Iterable[Orders]:
        there = {commander.client for commander in self.commanders.states()}
        self._homes = {client: home for client, home in self._homes.items() if client in there}
        for name, data, sender in self._bus.poll():
            if name == "state":
                self._overhear(partial(to_state, self.driver.robot, data))
            if name != "orders":
                continue
            try:
                orders = to_orders(self.driver.robot, data)
            except FrameError:
                self.rejected += 1
                continue
            if self._homes.setdefault(orders.client, sender) == sender:
                yield orders
            else:
                self.rejected += 1

    def _show(self, state: State) -> None:
        self._bus.put("state", state_bytes(self.driver.robot, state))
        if state.sent >= self._due:
            self._due = state.sent + FACTS
            self._bus.put("facts", self._facts)

    def _show_skin(self, frame: SkinFrame) -> None:
        self._bus.put("skin", frame_bytes(self.driver.robot, SessionFrame(self.number, frame)))

    def close(self) -> None:
        if self._open:
            self._open = False
            self._bus.close()


def _parse(address: str, robot: Robot) -> RemoteAddress:
    return parse_remote("lcm", address, robot.name, os.environ.get("LCM_DEFAULT_URL") or URL)
