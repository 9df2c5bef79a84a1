"""Where bytes come from. Every length is checked here, before memory is taken."""

from __future__ import annotations

import socket
from typing import Protocol

from tci.errors import WireError

LONGEST = 1 << 24
"""Longest message [bytes] that is read. Ours: a skin of 4000 taxels has 32 kB."""
LONGEST_LINE = 1 << 16
"""Longest line of text [bytes]. Ours."""
CHUNK = 1 << 16


class Source(Protocol):
    """Something that bytes are taken from."""

    def take(self, count: int) -> bytes:
        """The next `count` bytes. Raises WireError when so many can't come."""
        ...

    def left(self) -> int:
        """How many bytes there may be at most."""
        ...


class Memory:
    """Bytes at hand."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def take(self, count: int) -> bytes:
        if not 0 <= count <= self.left():
            raise WireError(f"length {count} at byte {self._at}; valid: 0 to {self.left()}, what is there")
        self._at += count
        return self._data[self._at - count : self._at]

    def left(self) -> int:
        return len(self._data) - self._at


class SocketSource:
    """A socket, read no further than a budget that `allow` renews; its own time-out bounds each wait."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self._buffer = bytearray()
        self._budget = LONGEST

    def allow(self, budget: int = LONGEST) -> None:
        """Let the next message have `budget` bytes in all."""
        self._budget = budget

    def left(self) -> int:
        return self._budget

    def take(self, count: int) -> bytes:
        """Raises WireError for more than the budget, EOFError at the end, TimeoutError after the socket's."""
        if not 0 <= count <= self._budget:
            raise WireError(f"length {count}; valid: 0 to {self._budget}")
        self._budget -= count
        while len(self._buffer) < count:
            self._receive(CHUNK)
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        return taken

    def peek(self, count: int) -> bytes:
        """The next `count` bytes, which stay."""
        while len(self._buffer) < count:
            self._receive(CHUNK)
        return bytes(self._buffer[:count])

    def line(self) -> str:
        """The next line of text without its end. Raises WireError for one without an end."""
        while (end := self._buffer.find(b"\n")) < 0:
            if len(self._buffer) > LONGEST_LINE:
                raise WireError(f"a line of more than {LONGEST_LINE} bytes")
            self._receive(CHUNK)
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        return line.rstrip(b"\r").decode("utf-8", errors="replace")

    def waiting(self) -> bool:
        """Whether bytes were received that nobody took yet."""
        return bool(self._buffer)

    def _receive(self, most: int) -> None:
        received = self._socket.recv(most)
        if not received:
            raise EOFError
        self._buffer += received
