"""Calls to other ports, and their replies."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from yarpwire import message
from yarpwire.bottle import encode_bottle, read_bottle
from yarpwire.carrier import TCP, Carrier
from yarpwire.dialect import Dialect
from yarpwire.errors import PortError, WireError
from yarpwire.names import PATIENCE, Contact
from yarpwire.outgoing import dial, is_over, is_readable
from yarpwire.source import SocketSource
from yarpwire.text import from_text, to_text

SOON = 0.05
"""Longest time [s] to wait for the rest of a reply that has begun to arrive. Assumed: replies are short and
sent in one piece."""


class Rpc:
    """Makes calls to a port. Connects at the first call, and again after a failure."""

    def __init__(
        self,
        contact: Contact,
        sender: str,
        dialect: Dialect,
        *,
        key: bytes | None = None,
        carrier: Carrier = TCP,
    ) -> None:
        self.contact, self.dialect = contact, dialect
        self._sender, self._key, self._carrier = sender, key, carrier
        self._open: tuple[socket.socket, SocketSource] | None = None
        self._open_calls = 0
        self._lock = threading.Lock()

    def call(self, *items: Any, patience: float = PATIENCE) -> list[Any]:
        """Makes a call and returns the reply, which is empty if the other end sends no reply.

        Raises PortError if nothing answers within `patience` [s], or if the reply is invalid. A failed call
        is not repeated.
        """
        with self._lock, self._port_errors(items):
            while self._open_calls:
                self._next_reply(patience)  # the callers of these calls have given up waiting
            sock, source = self._connect(patience)
            self._send(sock, items)
            return self._reply(source)

    def send_call(self, *items: Any) -> None:
        """Sends a call without waiting for its reply, which `read_reply` returns. Raises PortError if sending
        fails."""
        with self._lock, self._port_errors(items):
            self._send(self._connect(PATIENCE)[0], items)
            self._open_calls += 1

    def is_answered(self, patience: float) -> bool:
        """Returns True if the reply to the oldest open call begins to arrive within `patience` [s]."""
        if self._open is None:
            return True  # `read_reply` raises the error
        sock, source = self._open
        try:
            return source.waiting() or is_readable(sock, patience)
        except (OSError, ValueError):  # closed in the meantime
            return True

    def read_reply(self, patience: float = SOON) -> list[Any]:
        """Returns the reply to the oldest open call. Raises PortError if no valid reply arrives within
        `patience` [s]."""
        with self._lock, self._port_errors(()):
            return self._next_reply(patience)

    def close(self) -> None:
        """Closes the connection."""
        if self._open is not None:
            self._open[0].close()
            self._open = None

    @contextmanager
    def _port_errors(self, items: Sequence[Any]) -> Iterator[None]:
        """Turns errors inside the context into a PortError that names the call `items`, and closes the
        connection after an error."""
        try:
            yield
        except (OSError, EOFError, WireError) as error:
            self.close()
            self._open_calls = 0
            what = "does not answer" if isinstance(error, TimeoutError) else "failed at"
            raise PortError(f"{self.contact.name} {what} {to_text(items)[:80]}: {error}") from error

    def _connect(self, patience: float) -> tuple[socket.socket, SocketSource]:
        if self._open is not None and not self._open_calls and is_over(self._open[0]):
            self.close()  # ports with authentication close a connection after 2 s without a call
        sock, source = self._open or self._dial(patience)
        sock.settimeout(patience)
        source.allow()
        return sock, source

    def _send(self, sock: socket.socket, items: Sequence[Any]) -> None:
        if self._carrier.code is None:
            sock.sendall(f"d\r\n{to_text(items)}\r\n".encode())
            return
        call = message.pack_command(message.CALL)
        sock.sendall(message.pack_message([call, encode_bottle(items, self.dialect)]))

    def _next_reply(self, patience: float) -> list[Any]:
        if self._open is None:
            self._open_calls = 0
            raise EOFError("the connection was closed")
        sock, source = self._open
        sock.settimeout(patience)
        source.allow()
        self._open_calls = max(0, self._open_calls - 1)
        return self._reply(source)

    def _dial(self, patience: float) -> tuple[socket.socket, SocketSource]:
        sock, source, _ = dial(self.contact, self._sender, self._carrier, self._key, patience=patience)
        self._open = sock, source
        return self._open

    def _reply(self, source: SocketSource) -> list[Any]:
        if self._carrier.code is None:
            return self._reply_text(source)
        reply: list[Any] = []
        if source.peek(2) != b"YA":
            reply = read_bottle(source, self.dialect)
        if self._carrier.acknowledged:
            message.read_number(source)
        return reply

    def _reply_text(self, source: SocketSource) -> list[Any]:
        reply = source.line()
        if self._carrier.acknowledged and reply != "<ACK>" and (end := source.line()) != "<ACK>":
            raise WireError(f"{end[:40]!r} in the place of an acknowledgement")
        return [] if reply == "<ACK>" else from_text(reply)
