"""A connection that another program opened to a port of this process: reads messages and sends answers."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from yarpwire import auth, message
from yarpwire.bottle import decode_bottle, decode_vector, encode_bottle
from yarpwire.carrier import BY_CODE, TEXT, TEXT_ACK, UDP, Carrier
from yarpwire.connection_limit import AcceptedConnection
from yarpwire.dialect import Dialect
from yarpwire.errors import WireError
from yarpwire.message import Command, Stamp
from yarpwire.names import PATIENCE
from yarpwire.source import Memory, SocketSource
from yarpwire.text import from_text, to_text
from yarpwire.values import Array

BURST, SLICE = 200, 0.01
"""At most BURST messages are read from one connection in SLICE [s]. A faster sender must wait or drop
messages. This allows 20 000 messages per second. Assumed: no real sender needs more."""
UDP_LARGEST = 65_507


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """One received message."""

    command: Command
    """Kind of the message (data, call, or order to the port), and its envelope."""
    sender: str
    """Name of the port that sent the message."""
    arrived: float
    """Time of arrival [s] on the monotonic clock."""
    body: bytes | str
    """Body of the message: a Bottle as bytes or as text."""

    @property
    def stamp(self) -> Stamp | None:
        """Envelope of the message, if the envelope is a Stamp; otherwise None."""
        return self.command.stamp

    def items(self, dialect: Dialect) -> list[Any]:
        """Returns the items of the Bottle. Raises WireError if the body is invalid."""
        return from_text(self.body) if isinstance(self.body, str) else decode_bottle(self.body, dialect)

    def vector(self, dialect: Dialect) -> Array:
        """Returns the numbers (n,) of a Vector. Raises WireError if the body is not a Vector."""
        if isinstance(self.body, bytes):
            return decode_vector(self.body, dialect)
        items = from_text(self.body)
        if not all(isinstance(item, int | float) for item in items):
            raise WireError(f"{self.body[:40]!r} is no list of numbers")
        return np.array(items, dtype=float)


Answer = Sequence[Any] | str | bytes | None
"""Answer to a message: a Bottle, raw lines of text, raw bytes, or no answer."""


class Incoming:
    """Reads one accepted connection until its end."""

    def __init__(
        self, sock: socket.socket, connection: AcceptedConnection, *, dialect: Dialect,
        deliver: Callable[[Delivery], Answer], source: SocketSource | None = None,
    ) -> None:  # fmt: skip
        """`source` has what was already received from the socket."""
        self.sender = ""
        """Name of the port at the other end."""
        self.carrier: Carrier = TEXT
        """Format of the messages on the connection (YARP's "carrier")."""
        self.count = 0
        """Number of messages so far."""
        self._socket, self._connection = sock, connection
        self._source = source or SocketSource(sock)
        self._dialect, self._deliver = dialect, deliver
        self._datagrams: socket.socket | None = None
        self._slice = 0.0
        self._closed = False

    def greet(self, key: bytes | None, names: Callable[[str], None]) -> None:
        """Reads the name of the other end, passes the name to `names`, and answers. `names` may raise an
        error to refuse the connection. Raises WireError if the greeting is invalid."""
        self._socket.settimeout(PATIENCE)
        if key is not None:
            auth.accept(self._socket, self._source, key)
        head = self._source.peek(8)
        if head in (TEXT.greeting.encode(), TEXT_ACK.greeting.encode()):
            self.carrier = TEXT if head == TEXT.greeting.encode() else TEXT_ACK
            self.sender = self._source.line()[8:].strip()[: message.LONGEST_NAME]
            names(self.sender)
            self._socket.sendall(f"Welcome {self.sender}\r\n".encode())
            return
        code = message.read_number(self._source) - message.MAGIC
        if code not in BY_CODE:
            valid = ", ".join(carrier.name for carrier in BY_CODE.values())
            raise WireError(f"a carrier of code {code}; valid: {valid}, text, text_ack")
        self.carrier = BY_CODE[code]
        self.sender = message.read_name(self._source)
        names(self.sender)
        port = self._socket.getsockname()[1]
        if self.carrier is UDP:
            port = self._open_datagrams()
        self._socket.sendall(message.number(port))

    def run(self) -> None:
        """Delivers messages until the end of the connection. Raises WireError if a message is unreadable."""
        if self._datagrams is not None:
            self._socket.close()  # as YARP does, at both ends
            self._run_datagrams(self._datagrams)
            return
        _be_patient(self._socket)
        if self.carrier.code is None:
            self._run_text()
        else:
            self._run_binary()

    def close(self) -> None:
        """Ends the connection."""
        self._closed = True
        for sock in (self._socket, self._datagrams):
            if sock is not None:
                # without a connection, `shutdown` raises but still ends the wait
                with contextlib.suppress(OSError):
                    sock.shutdown(socket.SHUT_RDWR)

    def _run_binary(self) -> None:
        acknowledge = message.number(0) if self.carrier.acknowledged else b""
        while True:
            self._wait()
            command, body = message.unpack_command(message.read_payload(self._source))
            reply = b""
            if command.kind != message.QUIT:
                answer = self._handle(command, body)
                if command.kind != message.DATA and answer is not None:
                    reply = self._encode(answer)
            if reply or acknowledge:
                self._socket.sendall(reply + acknowledge)
            if command.kind == message.QUIT:
                return

    def _run_text(self) -> None:
        end = "<ACK>\r\n" if self.carrier.acknowledged else ""
        while True:
            self._wait()
            line = self._source.line()
            if not line:
                continue
            command = Command(line[0], line[1:].strip())
            reply = ""
            if command.kind in (message.DATA, message.CALL, message.ADMIN):
                answer = self._handle(command, self._source.line())
                if command.kind != message.DATA and answer is not None:
                    reply = (answer if isinstance(answer, str) else to_text(list(answer))) + "\r\n"
            elif command.kind != message.QUIT:
                answer = self._handle(command, "")
                reply = f"{answer}\r\n" if isinstance(answer, str) else ""
            if reply or end:
                self._socket.sendall((reply + end).encode())
            if command.kind == message.QUIT:
                return

    def _encode(self, answer: Sequence[Any] | str | bytes) -> bytes:
        if isinstance(answer, bytes):
            return answer
        return encode_bottle([answer] if isinstance(answer, str) else answer, self._dialect)

    def _open_datagrams(self) -> int:
        sock = self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        _be_patient(sock)
        sock.bind((self._socket.getsockname()[0], 0))
        return int(sock.getsockname()[1])

    def _run_datagrams(self, sock: socket.socket) -> None:
        """Reads datagrams until a quit message arrives. Silence does not end the connection, since the sender
        may still work."""
        with sock:
            while not self._closed:
                try:
                    data, peer = sock.recvfrom(UDP_LARGEST)
                except BlockingIOError:  # after the timeout, check if the connection is closing
                    continue
                if len(data) < 8 or peer[0] != self._connection.host:  # empty data: closed by `close`
                    continue
                if struct.unpack_from("<I", data)[0] != zlib.crc32(data[8:]):
                    continue
                if self.count % BURST == 0:
                    self._wait_slice()
                try:
                    command, body = message.unpack_command(message.read_payload(Memory(data[8:])))
                except WireError:
                    continue
                if command.kind == message.QUIT:
                    return
                self._handle(command, body)

    def _wait(self) -> None:
        """Waits for the beginning of the next message, without a time limit. The rest of the message must
        then arrive before the timeout."""
        if self.count % BURST == 0:
            self._wait_slice()
        while True:
            try:
                return self._source.await_next()
            except TimeoutError:
                continue

    def _wait_slice(self) -> None:
        """Waits, if needed, so that at most 200 messages are read in 10 ms (`BURST`, `SLICE`)."""
        now = time.monotonic()
        if now - self._slice < SLICE:
            time.sleep(self._slice + SLICE - now)
        self._slice = time.monotonic()

    def _handle(self, command: Command, body: bytes | str) -> Answer:
        self.count += 1
        self._connection.last_message = now = time.monotonic()
        return self._deliver(Delivery(command, self.sender, now, body))


def _be_patient(sock: socket.socket) -> None:
    """Limits each wait of the socket, for receiving and for sending, to 2 s (`PATIENCE`). Uses the operating
    system's timeout, since Python's timeout needs one more system call per message."""
    sock.settimeout(None)
    seconds = struct.pack("@ll", int(PATIENCE), int(PATIENCE % 1 * 1e6))
    for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
        sock.setsockopt(socket.SOL_SOCKET, option, seconds)
