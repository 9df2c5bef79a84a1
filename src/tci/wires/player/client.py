"""A client of a Player server. The client waits for answers only while connecting."""

from __future__ import annotations

import contextlib
import re
import socket
import time

from tci.errors import DriverError, FrameError
from tci.wires.player.wire import (
    DATAMODE,
    DEVLIST,
    GREETING,
    OPEN,
    PLAYER,
    PUSH,
    SUBSCRIBE,
    Message,
    MessageKind,
    Stream,
    access,
    to_access,
    to_devices,
)

PORT = 6665
"""Default port of a server."""
TIMEOUT = 3.0
"""Time [s] within which a server must answer. Assumed: on a local network, servers answer within a second."""
CHUNK = 1 << 16
PER_POLL = 64
"""Largest number of chunks that one call of `poll` reads; a chunk has CHUNK bytes. Without a limit, a call
would not end while very much data arrives. Assumed: usually fewer chunks wait."""
ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9_.-]*|\[[0-9a-fA-F:]+\])(:(?P<port>[0-9]{1,5}))?")


def parse(address: str) -> tuple[str, int]:
    """Returns host and port of the address `[HOST][:PORT]`. Raises DriverError for an invalid address."""
    found = ADDRESS.fullmatch(address)
    if found is None or int(found["port"] or PORT) > 65535:
        raise DriverError(f"{address!r} is no address; valid: player:HOST:PORT, each may be left out")
    return found["host"].strip("[]") or "127.0.0.1", int(found["port"] or PORT)


class Client:
    """A connection to one server."""

    def __init__(self, host: str, port: int) -> None:
        """Connects to the server. Raises DriverError if no Player server answers at `host` and `port`."""
        self.where, self._robot = f"{host}:{port}", port
        self._stream = Stream()
        self._waiting: list[Message] = []
        self.lost = ""
        """Reason why the connection is lost; empty while the connection works."""
        try:
            self._socket = socket.create_connection((host, port), timeout=TIMEOUT)
        except OSError as error:
            raise DriverError(f"no Player server at {self.where}: {error}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            greeting = self._exactly(GREETING)
            if not greeting.startswith(b"Player v."):
                raise DriverError(f"{self.where} is no Player server: it sends {greeting!r}")
            self._request(DATAMODE, PUSH.to_bytes(4, "big"))
        except BaseException:
            self.close()
            raise

    def devices(self) -> list[tuple[int, int]]:
        """Returns interface and index of each device of the server. Raises DriverError if the server does not
        answer."""
        try:
            return to_devices(self._request(DEVLIST, b"").body)
        except FrameError as error:
            raise DriverError(f"{self.where}: {error}") from error

    def open(self, interface: int, index: int) -> None:
        """Subscribes to a device. Raises DriverError if the server refuses the subscription."""
        answer = self._request(SUBSCRIBE, access(interface, index, OPEN, self._robot)).body
        if to_access(answer)[2] != OPEN:
            raise DriverError(f"{self.where} refuses device {interface}:{index}")

    def poll(self) -> list[Message]:
        """Returns the messages that have arrived, the oldest first. Never waits for a message."""
        found, self._waiting = self._waiting, []
        self._socket.setblocking(False)
        for _ in range(PER_POLL):
            if self.lost:
                break
            try:
                data = self._socket.recv(CHUNK)
            except BlockingIOError:
                break
            except OSError as error:
                self.lost = str(error)
                break
            self._acknowledge()
            found += self._fed(data)
        return found

    def send(self, message: Message) -> bool:
        """Sends a message without waiting. Returns True if the message was sent. Drops a message that can't
        be sent immediately.
        """
        data = message.to_bytes()
        try:
            self._socket.setblocking(False)
            sent = self._socket.send(data)
        except BlockingIOError:
            return False
        except OSError as error:
            self.lost = self.lost or str(error)
            return False
        # the rest of the message must follow, otherwise the server reads wrong message boundaries
        if sent < len(data):
            self._socket.settimeout(TIMEOUT)
            try:
                self._socket.sendall(data[sent:])
            except OSError as error:
                self.lost = str(error)
                return False
        return True

    def command(self, interface: int, index: int, subtype: int, body: bytes) -> bool:
        """Sends a command to a device. Returns True if the command was sent."""
        return self.send(
            Message(interface, index, MessageKind.COMMAND, subtype, time.time(), body, robot=self._robot)
        )

    def close(self) -> None:
        """Closes the connection."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self.lost = self.lost or "closed"

    def _request(self, subtype: int, body: bytes) -> Message:
        """Sends a request to the server and returns the answer. Data that arrives before the answer is
        returned by the next call of `poll`. Raises DriverError if the server refuses or does not answer.
        """
        self.send(Message(PLAYER, 0, MessageKind.REQUEST, subtype, 0.0, body, robot=self._robot))
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end and not self.lost:
            self._socket.settimeout(max(0.01, end - time.monotonic()))
            try:
                data = self._socket.recv(CHUNK)
            except OSError:
                continue
            self._acknowledge()
            for message in self._fed(data):
                if (
                    message.interface == PLAYER
                    and message.subtype == subtype
                    and message.kind in (MessageKind.ACK, MessageKind.NACK)
                ):
                    if message.kind == MessageKind.ACK:
                        return message
                    raise DriverError(f"{self.where} refuses request {subtype}")
                self._waiting.append(message)
        raise DriverError(
            f"{self.where} does not answer request {subtype}{': ' if self.lost else ''}{self.lost}"
        )

    def _fed(self, data: bytes) -> list[Message]:
        if not data:
            self.lost = "the server has closed the connection"
            return []
        try:
            return list(self._stream.feed(data))
        except FrameError as error:
            self.lost = str(error)
            return []

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            try:
                got = self._socket.recv(size - len(data))
            except OSError as error:
                raise DriverError(f"{self.where} sends nothing: {error}") from error
            if not got:
                raise DriverError(f"{self.where} has closed the connection")
            data += got
        return data

    def _acknowledge(self) -> None:
        """Makes the operating system acknowledge received data immediately. Otherwise a server with Nagle's
        algorithm waits 40 ms before sending more data."""
        if hasattr(socket, "TCP_QUICKACK"):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
