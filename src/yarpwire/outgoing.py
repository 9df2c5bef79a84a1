"""A connection from this process to another port."""

from __future__ import annotations

import contextlib
import selectors
import socket
import struct
import time
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from yarpwire import auth, message
from yarpwire.bottle import encode_bottle, encode_vector
from yarpwire.carrier import TEXT, TEXT_ACK, UDP, Carrier
from yarpwire.dialect import Dialect
from yarpwire.errors import PortError, WireError
from yarpwire.message import Stamp
from yarpwire.names import PATIENCE, Contact
from yarpwire.source import SocketSource
from yarpwire.text import to_text
from yarpwire.values import Array

MOST_UNANSWERED = 16
"""Largest number of messages that the reader has not acknowledged. When this number is reached, new messages
are dropped. Assumed: a reader with so many unacknowledged messages is slower than the sender."""
STUCK = 1.0
"""If a reader does not accept the rest of a message within this time [s], the connection counts as lost.
Assumed: a running reader reads within a few periods."""
GOODBYE = 0.5
"""Longest time [s] to wait for each step of ending a udp connection. Assumed: closing must not wait long for
a dead reader."""
DATAGRAM = 65_499


def dial(
    contact: Contact, sender: str, carrier: Carrier, key: bytes | None, *, patience: float = PATIENCE
) -> tuple[socket.socket, SocketSource, int]:
    """Connects to a port and sends the sender's name. Returns the socket, its source of bytes, and the number
    in the port's answer. For udp, this number is the UDP port that receives the datagrams. For a text
    carrier, whose answer contains no number, it is 0.

    Raises PortError if nothing answers, or if the answer is not that of a YARP port.
    """
    sock = None
    try:
        sock = socket.create_connection((contact.host, contact.port), timeout=patience)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        source = SocketSource(sock)
        if key is not None:
            auth.connect(sock, source, key)
        if carrier.code is None:
            sock.sendall(f"{carrier.greeting}{sender}\r\n".encode())
            if not (line := source.line()).startswith("Welcome"):
                raise WireError(f"{line[:40]!r} in the place of a welcome")
            return sock, source, 0
        sock.sendall(message.header(carrier.code, sender))
        return sock, source, message.read_number(source)
    except (OSError, EOFError, WireError, ValueError) as error:  # ValueError: not a valid host name
        if sock is not None:
            sock.close()
        raise PortError(
            f"{contact.name} at {contact.host}:{contact.port} can't be reached by {carrier.name}: "
            f"{error or 'it closed the connection'}"
        ) from error


def order(contact: Contact, words: Sequence[Any], key: bytes | None) -> str:
    """Sends an order to another port, as `yarp connect` does, and returns the answer. Raises PortError if
    that fails."""
    sock, source, _ = dial(contact, "admin", TEXT_ACK, key)
    with sock:
        try:
            sock.sendall(f"a\r\n{to_text(words)}\r\n".encode())
            lines = []
            while (line := source.line()) != "<ACK>":
                lines.append(line)
        except (OSError, EOFError, WireError) as error:
            raise PortError(f"{contact.name} does not answer {to_text(words)}: {error}") from error
    return "\n".join(lines)


def is_over(sock: socket.socket) -> bool:
    """Returns True if the other end has closed the connection and all received data is read."""
    try:
        sock.setblocking(False)  # a timeout of the socket itself would cause a wait
        return not sock.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True


def is_readable(sock: socket.socket, patience: float) -> bool:
    """Returns True if data or the end of a connection arrives within `patience` [s].

    Does not use `select.select`, because it refuses file descriptors with the number 1024 or a higher number.
    Raises OSError or ValueError if the socket is closed.
    """
    with selectors.DefaultSelector() as selector:
        selector.register(sock, selectors.EVENT_READ)
        return bool(selector.select(patience))


class Outgoing:
    """Sends messages without waiting. If the reader is too slow, new messages are dropped."""

    def __init__(self, contact: Contact, sender: str, carrier: Carrier, key: bytes | None = None) -> None:
        """Connects to a port. Raises PortError if that fails."""
        self.contact, self.carrier = contact, carrier
        self._sender, self._key = sender, key
        self.dropped = 0
        """Number of messages dropped because the reader was too slow."""
        self._socket, _, port = dial(contact, sender, carrier, key)
        self._rest = b""
        self._since = 0.0
        self._unanswered = self._answered = 0
        if carrier is UDP:
            self._to_datagrams(port)
        self._socket.setblocking(False)

    def offer(self, value: Array | Sequence[Any], dialect: Dialect, stamp: Stamp | None = None) -> bool:
        """Sends a Vector (an array) or a Bottle (a list). Returns False if the message was dropped, since the
        reader is too slow. Raises PortError if the reader is lost."""
        rest = "" if stamp is None else str(stamp)
        if self.carrier.code is None:
            return self.push(f"{f'D {rest}'.strip()}\r\n{to_text(list(value))}\r\n".encode())
        if isinstance(value, np.ndarray):
            blocks: tuple[bytes, ...] = encode_vector(value, dialect)
        else:
            blocks = (encode_bottle(value, dialect),)
        return self.push(message.pack_message([message.pack_command(message.DATA, rest), *blocks]))

    def push(self, data: bytes) -> bool:
        """Sends an encoded message. Returns False if the message was dropped. Raises PortError if the reader
        is lost."""
        try:
            if self.carrier is UDP:
                self._send_datagrams(data)
                return True
            if not self._is_free():
                self.dropped += 1
                return False
            sent = self._socket.send(data)
            if sent < len(data):
                self._rest, self._since = data[sent:], time.monotonic()
            self._unanswered += self.carrier.acknowledged
        except BlockingIOError:
            self.dropped += 1
            return False
        except OSError as error:
            raise PortError(f"{self.contact.name} is gone: {error}") from error
        return True

    def is_over(self) -> bool:
        """Returns True if the reader has disconnected."""
        return self.carrier is not UDP and is_over(self._socket)

    def close(self) -> None:
        """Sends a quit message and closes the connection."""
        with contextlib.suppress(OSError, EOFError, PortError, WireError):
            if self.carrier is UDP:
                self._part()
            elif not self._rest:
                text = self.carrier.code is None
                self._socket.send(
                    b"q\r\n" if text else message.pack_message([message.pack_command(message.QUIT)])
                )
        self.drop()

    def drop(self) -> None:
        """Closes the socket without a quit message and without waiting."""
        self._socket.close()

    def _part(self) -> None:
        """Ends a udp connection as YARP does: opens a text connection to the same port, sends there the order
        to end the udp connection, and waits for the answer."""
        sock, source, _ = dial(self.contact, "admin", TEXT, self._key, patience=GOODBYE)
        with sock:
            sock.sendall(f"~{self._sender}\r\nq\r\n".encode())
            source.line()

    def _is_free(self) -> bool:
        if self._rest:
            sent = self._socket.send(self._rest)
            self._rest = self._rest[sent:]
            if self._rest:
                if time.monotonic() - self._since > STUCK:
                    raise ConnectionError(f"it has not read for {STUCK} s")
                return False
        if self._unanswered >= MOST_UNANSWERED // 2:
            with contextlib.suppress(BlockingIOError):
                received = self._socket.recv(4096)
                if not received:
                    raise ConnectionError("it closed the connection")
                self._answered += len(received)
                size = 7 if self.carrier is TEXT_ACK else 8
                self._unanswered -= self._answered // size
                self._answered %= size
        return self._unanswered < MOST_UNANSWERED

    def _to_datagrams(self, port: int) -> None:
        """Replaces the TCP connection by datagrams (UDP) to the `port` that the reader has named."""
        peer = self._socket.getpeername()
        self._socket.close()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if not 0 < port < 65536:
                raise OSError(f"its UDP port is {port}")
            self._socket.connect((peer[0], port))
        except OSError as error:
            self._socket.close()
            raise PortError(f"{self.contact.name} can't be reached by udp: {error}") from error

    def _send_datagrams(self, data: bytes) -> None:
        for number, at in enumerate(range(0, len(data), DATAGRAM)):
            piece = data[at : at + DATAGRAM]
            self._socket.send(struct.pack("<Ii", zlib.crc32(piece), number) + piece)
