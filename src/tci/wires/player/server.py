"""Serves a robot as a Player server with one actarray device per part, one opaque device per patch, and
devices for the messages between TCI processes (`tci.drivers.remote`)."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from tci.drivers.driver import Driver
from tci.drivers.remote.controllers import Once, PartControllers, values_order
from tci.drivers.remote.encoding import frame_bytes, state_bytes, to_orders
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.drivers.remote.server import RemoteServer
from tci.errors import CommandError, DriverError, FrameError
from tci.exports.facts import query
from tci.gate.safe_command import SafeCommand
from tci.messages import Perception, Reading, SkinFrame
from tci.messages.clock import Every
from tci.robot.joint_map import initial_position
from tci.wires.player.client import CHUNK, PER_POLL, parse
from tci.wires.player.driver import FRAMES, STATES, numbers
from tci.wires.player.wire import (
    ACTARRAY,
    CLOSE,
    DATAMODE,
    DEVLIST,
    DRIVERINFO,
    ERROR,
    FACTS,
    GEOMETRY,
    GET,
    GREETING,
    OPAQUE,
    OPEN,
    PLAYER,
    POSITION,
    POSITIONS,
    POWER,
    STATE,
    SUBSCRIBE,
    Message,
    MessageKind,
    Stream,
    access,
    actuators,
    blob,
    devices,
    geometry,
    skin,
    to_access,
    to_blob,
    to_floats,
)
from yarpwire.connection_limit import AcceptedConnection, ConnectionLimit

BACKLOG = 128
"""Two limits of connections: how many may wait until the server accepts them, and how many the server accepts
in one period. The limits keep a period short if very many clients connect. Assumed: in normal use, the number
of clients that connect at the same time is below these limits."""
MOST_WAITING = 1 << 16
"""Largest number of bytes that may wait until a slow client reads them. While more bytes wait, the server
drops further data for this client. Assumed: so few bytes need little memory, and are still recent when the
client reads them."""
MOST_OWED = 1 << 20
"""Largest number of bytes, including replies, that may wait until a client reads them. If more bytes wait,
the server disconnects the client, since the server never drops replies. Assumed: a client that works reads
earlier."""
DRIVER = b"tci\0"
"""Name of the driver that every device reports to clients."""


@dataclass(slots=True, eq=False)
class _Client:
    """Connection of one client to the server."""

    socket: socket.socket
    counted: AcceptedConnection
    stream: Stream = field(default_factory=Stream)
    out: bytearray = field(default_factory=bytearray)
    devices: set[tuple[int, int]] = field(default_factory=set)
    sequence: int = 0
    asked: bool = False
    """True from a request for data (pull mode) until the server has sent the message that ends the data."""

    def send(self, message: Message) -> None:
        """Queues a message for the client. If the client reads too slowly, a message with the robot's data is
        dropped.

        Raises FrameError if too many bytes are queued.
        """
        if message.kind == MessageKind.DATA and len(self.out) > MOST_WAITING:
            return
        if len(self.out) > MOST_OWED:
            raise FrameError(
                f"a Player client that does not read was disconnected: {len(self.out)} bytes wait"
            )
        self.sequence += 1
        self.out += message.to_bytes(self.sequence)

    def flush(self) -> None:
        """Sends as many queued bytes as possible without waiting. Raises OSError for a disconnected
        client."""
        while self.out:
            try:
                sent = self.socket.send(self.out)
            except BlockingIOError:
                return
            del self.out[:sent]


class PlayerServer(RemoteServer):
    """Serves a robot as a Player server."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Listens at `address`, `[HOST][:PORT]`; by default only clients on this machine can connect.

        Raises DriverError if the port is in use.
        """
        super().__init__(driver, address, middleware="player")
        host, self.port = parse(address)
        self._devices = numbers(driver.robot)
        self._frames = {patch.name: FRAMES + n for n, patch in enumerate(driver.robot.skin)}
        own = [STATES, *self._frames.values()]
        self._offered = [*self._devices, *((OPAQUE, index) for index in own)]
        self._controllers = PartControllers(driver.robot, self.number, of="a Player client")
        self._position = initial_position(driver.robot)
        self._states, self._is_due = Every(1.0 / driver.robot.binding("player").rate), False
        self._arrived: deque[bytes] = deque(maxlen=64)
        self.rejected = 0
        """Number of invalid messages from clients."""
        self.last_error = ""
        """Error message of the last client that was disconnected because of an invalid message."""
        self._facts = blob(query(driver.robot).model_dump_json().encode())
        self._clients: list[_Client] = []
        self._limit = ConnectionLimit()
        try:
            self._listener = socket.create_server((host, self.port), backlog=BACKLOG)
        except OSError as error:
            raise DriverError(
                f"Player at {host}:{self.port}: {error.strerror}; valid: a free port"
            ) from error
        self._listener.setblocking(False)
        self._host, self.port = host, self._listener.getsockname()[1]

    def where(self) -> str:
        return f"Player at {self._host}:{self.port}"

    def reach(self) -> str:
        return f"player:{self._host}:{self.port}"

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self._position = reading.joints.position
        self._is_due = self._states.due(self.driver.clock.now())
        if self._is_due:
            stamp = self._epoch(reading.joints.stamp)
            for (interface, index), name in self._devices.items():
                if interface == ACTARRAY:
                    servos = [servo.index for servo in self.driver.robot.servos_of(name)]
                    body = actuators(reading.joints.position[servos], reading.joints.velocity[servos])
                    self._send_data(ACTARRAY, index, stamp, body)
        super().publish(reading, perception, sent)
        self.rejected += len(self._controllers.refusals(self.commanders.states()))
        for client in list(self._clients):
            with self._drop_on_error(client):
                if client.asked and self._is_due:
                    client.asked = False
                    client.send(Message(PLAYER, 0, MessageKind.SYNCH, 1, time.time(), b"", robot=self.port))
                client.flush()

    def close(self) -> None:
        self._listener.close()
        while self._clients:
            self._drop(self._clients[-1])

    def _poll(self) -> Iterator[Orders]:
        with contextlib.suppress(BlockingIOError, OSError):
            for _ in range(BACKLOG):
                self._add_client(self._listener.accept()[0])
        self._limit.trim()
        for client in list(self._clients):
            with self._drop_on_error(client):
                self._read_messages(client)
                client.flush()
        yield from self._controllers.messages(self._position, self.driver.clock.now())
        while self._arrived:
            try:
                yield to_orders(self.driver.robot, self._arrived.popleft())
            except FrameError:
                self.rejected += 1

    def _show(self, state: State) -> None:
        if self._is_due:
            self._send_data(OPAQUE, STATES, time.time(), blob(state_bytes(self.driver.robot, state)))

    def _show_skin(self, frame: SkinFrame) -> None:
        stamp = self._epoch(frame.stamp)
        whole = blob(frame_bytes(self.driver.robot, SessionFrame(self.number, frame)))
        self._send_data(OPAQUE, self._frames[frame.patch], stamp, whole)
        for (interface, index), name in self._devices.items():
            if (interface, name) == (OPAQUE, frame.patch):
                self._send_data(OPAQUE, index, stamp, blob(skin(frame.values)))

    def _send_data(self, interface: int, index: int, stamp: float, body: bytes) -> None:
        for client in self._clients:
            if (interface, index) in client.devices:
                client.send(Message(interface, index, MessageKind.DATA, STATE, stamp, body, robot=self.port))

    def _add_client(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection, self._limit.add(connection.close))
        client.out += b"Player v.3.1.1 (TCI)".ljust(GREETING, b"\0")
        self._clients.append(client)

    @contextlib.contextmanager
    def _drop_on_error(self, client: _Client) -> Iterator[None]:
        """Disconnects the client if the code in the `with` block raises OSError, FrameError or
        struct.error."""
        try:
            yield
        except OSError:
            self._drop(client)
        except (FrameError, struct.error) as error:
            self.last_error = str(error)
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        self._limit.remove(client.counted)
        client.socket.close()
        self._clients.remove(client)

    def _read_messages(self, client: _Client) -> None:
        """Reads and handles the messages of a client.

        Raises OSError if the connection is closed, FrameError for an invalid message.
        """
        for _ in range(PER_POLL):
            try:
                data = client.socket.recv(CHUNK)
            except BlockingIOError:
                return
            if not data:
                raise OSError("gone")
            for message in client.stream.feed(data):
                client.counted.mark_verified()
                if message.kind == MessageKind.REQUEST:
                    self._answer(client, message)
                elif message.kind == MessageKind.COMMAND:
                    self._order(message)

    def _answer(self, client: _Client, message: Message) -> None:
        body = self._reply(client, message)
        kind = MessageKind.NACK if body is None else MessageKind.ACK
        client.send(
            Message(
                message.interface, message.index, kind, message.subtype, time.time(), body or b"",
                host=message.host, robot=message.robot,
            )
        )  # fmt: skip

    def _reply(self, client: _Client, message: Message) -> bytes | None:
        """Returns the body of the answer to a request; None if the request is unknown, and will be refused.
        Raises FrameError if the request is invalid."""
        if message.interface == PLAYER:
            if message.subtype == DEVLIST:
                return devices(self._offered, self.port)
            if message.subtype in (DATAMODE, GET):
                client.asked |= message.subtype == GET
                return b""
            if message.subtype == DRIVERINFO:
                return message.body[:16] + blob(DRIVER)
            if message.subtype != SUBSCRIBE:
                return None
            interface, index, mode = to_access(message.body)
            known = (interface, index) in self._offered and mode in (OPEN, CLOSE)
            if known:
                (client.devices.add if mode == OPEN else client.devices.discard)((interface, index))
            return access(interface, index, mode if known else ERROR, self.port, DRIVER)
        if (message.interface, message.index, message.subtype) == (OPAQUE, STATES, FACTS):
            return self._facts
        name = self._devices.get((message.interface, message.index))
        if message.interface != ACTARRAY or name is None:
            return None
        if message.subtype == GEOMETRY:
            limits = []
            for servo in self.driver.robot.servos_of(name):
                low, high = servo.limits.lower or 0.0, servo.limits.upper or 0.0
                home = float(initial_position(self.driver.robot)[servo.index])
                limits.append((low, high, home, servo.limits.velocity or 0.0))
            return geometry(limits)
        return b"" if message.subtype == POWER else None

    def _order(self, message: Message) -> None:
        """Accepts a command from a client: positions for a robot part, or orders of another TCI process.
        Ignores an invalid command."""
        try:
            if (message.interface, message.index) == (OPAQUE, STATES):
                self._arrived.append(to_blob(message.body))
                return
            name = self._devices.get((message.interface, message.index))
            if message.interface != ACTARRAY or name is None:
                raise FrameError("a command for no actarray")
            servos = self.driver.robot.servos_of(name)
            if message.subtype == POSITIONS:
                order = values_order(name, servos, to_floats(message.body))
            elif message.subtype == POSITION and len(message.body) >= 8:
                joint, value = struct.unpack_from(">if", message.body)
                if not 0 <= joint < len(servos):
                    raise FrameError(f"joint {joint} of {name}; valid: 0 to {len(servos) - 1}")
                order = values_order(name, (servos[joint],), [value])
            else:
                raise FrameError(f"command {message.subtype} for {name}; valid: positions")
        except (FrameError, CommandError):
            self.rejected += 1
            return
        self._controllers.start(name, lambda *_: Once(order))

    def _epoch(self, stamp: float) -> float:
        """Converts a time [s] on the driver's clock to Player's time, the seconds since 1970."""
        return time.time() + stamp - self.driver.clock.now()
