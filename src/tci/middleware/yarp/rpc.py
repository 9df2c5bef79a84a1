"""Calls to somebody's port, and their replies."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from typing import Any

from tci.errors import LinkError, WireError
from tci.middleware.yarp import message
from tci.middleware.yarp.bottle import encode_bottle, read_bottle
from tci.middleware.yarp.carrier import TCP, Carrier
from tci.middleware.yarp.dialect import Dialect
from tci.middleware.yarp.names import PATIENCE, Contact
from tci.middleware.yarp.outgoing import dial, is_over
from tci.middleware.yarp.source import SocketSource
from tci.middleware.yarp.text import from_text, to_text


class Rpc:
    """Calls to a port. The connection is made when it is needed, again after a failure."""

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

    def call(self, *items: Any, patience: float = PATIENCE) -> list[Any]:
        """The reply to a call; empty where the other end says nothing.

        Raises LinkError when nobody is there or no answer comes within `patience` [s], and when what comes
        is no reply. There is no second try: who calls decides that.
        """
        try:
            if self._open is not None and is_over(self._open[0]):
                self.close()  # ports that authenticate close after 2 s without a call
            sock, source = self._open or self._dial(patience)
            sock.settimeout(patience)
            source.allow()
            if self._carrier.code is None:
                return self._call_text(sock, source, items)
            call = message.pack_command(message.CALL)
            sock.sendall(message.pack_message([call, encode_bottle(items, self.dialect)]))
            return self._reply(source)
        except (OSError, EOFError, WireError) as error:
            self.close()
            what = "does not answer" if isinstance(error, TimeoutError) else "failed at"
            raise LinkError(f"{self.contact.name} {what} {to_text(items)[:80]}: {error}") from error

    def close(self) -> None:
        """Let go of the connection."""
        if self._open is not None:
            self._open[0].close()
            self._open = None

    def _dial(self, patience: float) -> tuple[socket.socket, SocketSource]:
        sock, source, _ = dial(self.contact, self._sender, self._carrier, self._key, patience=patience)
        self._open = sock, source
        return self._open

    def _reply(self, source: SocketSource) -> list[Any]:
        reply: list[Any] = []
        if source.peek(2) != b"YA":
            reply = read_bottle(source, self.dialect)
        if self._carrier.acknowledged:
            message.read_number(source)
        return reply

    def _call_text(self, sock: socket.socket, source: SocketSource, items: Sequence[Any]) -> list[Any]:
        sock.sendall(f"d\r\n{to_text(items)}\r\n".encode())
        reply = source.line()
        if self._carrier.acknowledged and reply != "<ACK>" and (end := source.line()) != "<ACK>":
            raise WireError(f"{end[:40]!r} in the place of an acknowledgement")
        return [] if reply == "<ACK>" else from_text(reply)
