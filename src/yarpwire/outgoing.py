"""A connection of ours to somebody's port."""

from __future__ import annotations

import contextlib
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
"""Messages that may lack their acknowledgement before new ones are dropped. Ours."""
STUCK = 1.0
"""How long [s] the rest of a message may wait for a reader that does not read. Ours."""
GOODBYE = 0.5
"""How long [s] a goodbye beside the datagrams may take. Ours."""
DATAGRAM = 65_499


def dial(
    contact: Contact, sender: str, carrier: Carrier, key: bytes | None, *, patience: float = PATIENCE
) -> tuple[socket.socket, SocketSource, int]:
    """Connect to a port and say who we are. The last value is what the other end answered.

    Raises PortError when nobody is there, or when it doesn't answer as a YARP port does.
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
    except (OSError, EOFError, WireError, ValueError) as error:  # ValueError: no name of a host
        if sock is not None:
            sock.close()
        raise PortError(
            f"{contact.name} at {contact.host}:{contact.port} can't be reached by {carrier.name}: "
            f"{error or 'it closed the connection'}"
        ) from error


def order(contact: Contact, words: Sequence[Any], key: bytes | None) -> str:
    """Give an order to somebody's port, as `yarp connect` does, and return what it says. Raises
    PortError."""
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
    """Whether the other end has closed a connection on which it sends nothing now."""
    try:
        sock.setblocking(False)  # a time-out of the socket's own would be waited for
        return not sock.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True


class Outgoing:
    """Sends messages and never waits: to a reader that is too slow, the newer ones are dropped."""

    def __init__(self, contact: Contact, sender: str, carrier: Carrier, key: bytes | None = None) -> None:
        """Raises PortError as `dial`."""
        self.contact, self.carrier = contact, carrier
        self._sender, self._key = sender, key
        self.dropped = 0
        """Messages that the reader was too slow for."""
        self._socket, _, port = dial(contact, sender, carrier, key)
        self._rest = b""
        self._since = 0.0
        self._unanswered = self._answered = 0
        if carrier is UDP:
            self._to_datagrams(port)
        self._socket.setblocking(False)

    def offer(self, value: Array | Sequence[Any], dialect: Dialect, stamp: Stamp | None = None) -> bool:
        """Send a Vector (an array) or a Bottle (a list), or drop it. Raises PortError for a lost reader."""
        rest = "" if stamp is None else str(stamp)
        if self.carrier.code is None:
            return self.push(f"{f'D {rest}'.strip()}\r\n{to_text(list(value))}\r\n".encode())
        if isinstance(value, np.ndarray):
            blocks: tuple[bytes, ...] = encode_vector(value, dialect)
        else:
            blocks = (encode_bottle(value, dialect),)
        return self.push(message.pack_message([message.pack_command(message.DATA, rest), *blocks]))

    def push(self, data: bytes) -> bool:
        """Send a message that is ready. Raises PortError when nobody is there."""
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
        """Whether the reader is gone."""
        return self.carrier is not UDP and is_over(self._socket)

    def close(self) -> None:
        """Say goodbye and let go."""
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
        """Let go of a reader that is gone, or knows already. It never waits."""
        self._socket.close()

    def _part(self) -> None:
        """As YARP does over udp: by a connection of text, to whose order the reader answers."""
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
        """From now on to the UDP port that the reader named."""
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
