"""Sources of bytes. They check the length of all data before they allocate memory."""

from __future__ import annotations

import socket
from typing import Protocol

from yarpwire.errors import WireError

LONGEST = 1 << 24
"""Length [bytes] of the longest message that is read. Assumed: more than any message needs, since the values
of 4000 taxels have 32 kB."""
LONGEST_LINE = 1 << 16
"""Largest length [bytes] of a line of text that is read. Assumed: valid lines are shorter. The limit bounds
the used memory."""
CHUNK = 1 << 16


class Source(Protocol):
    """A source from which bytes are taken in order."""

    def take(self, count: int) -> bytes:
        """Returns the next `count` bytes. Raises WireError if fewer than `count` bytes can follow."""
        ...

    def left(self) -> int:
        """Returns the largest number of bytes that may follow."""
        ...


class Memory:
    """A source that takes its bytes from memory."""

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
    """A source that receives its bytes from a socket. For each message, it reads at most the number of bytes
    that `allow` has set (the budget). The socket's own timeout limits each wait."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self._buffer = b""
        self._at = 0
        self._budget = LONGEST

    def allow(self, budget: int = LONGEST) -> None:
        """Sets the budget, the largest number of bytes of the next message."""
        self._budget = budget

    def left(self) -> int:
        return self._budget

    def take(self, count: int) -> bytes:
        """Returns the next `count` bytes. Raises WireError if `count` is above the number of bytes that the
        message may still contain, EOFError at the end of the connection, and TimeoutError after the socket's
        timeout."""
        if not 0 <= count <= self._budget:
            raise WireError(f"length {count}; valid: 0 to {self._budget}")
        self._budget -= count
        if len(self._buffer) - self._at < count:
            self._need(count)
        begin = self._at
        self._at = end = begin + count
        return self._buffer[begin:end]

    def peek(self, count: int) -> bytes:
        """Returns the next `count` bytes without consuming them."""
        self._need(count)
        return self._buffer[self._at : self._at + count]

    def line(self) -> str:
        """Returns the next line of text without its line end. Raises WireError if the line is too long."""
        while (end := self._buffer.find(b"\n", self._at)) < 0:
            held = len(self._buffer) - self._at
            if held > LONGEST_LINE:
                raise WireError(f"a line of more than {LONGEST_LINE} bytes")
            self._need(held + 1)
        line = self._buffer[self._at : end]
        self._at = end + 1
        return line.rstrip(b"\r").decode("utf-8", errors="replace")

    def waiting(self) -> bool:
        """Returns True if bytes were received that were not taken yet."""
        return self._at < len(self._buffer)

    def await_next(self) -> None:
        """Waits for the beginning of the next message, which may have at most `LONGEST` bytes. Raises
        EOFError at the end of the connection, and TimeoutError after the socket's timeout."""
        self._budget = LONGEST
        if self._at >= len(self._buffer):
            self._need(1)

    def _need(self, count: int) -> None:
        """Receives from the socket until at least `count` bytes are in the buffer. Memory is allocated for
        received bytes only."""
        held = len(self._buffer) - self._at
        if held >= count:
            return
        pieces = [self._buffer[self._at :]] if held else []
        while held < count:
            try:
                received = self._socket.recv(CHUNK)
            except BlockingIOError as error:
                self._keep(pieces)
                raise TimeoutError("nothing came in time") from error
            except OSError:
                self._keep(pieces)
                raise
            if not received:
                self._keep(pieces)
                raise EOFError
            pieces.append(received)
            held += len(received)
        self._keep(pieces)

    def _keep(self, pieces: list[bytes]) -> None:
        self._buffer = pieces[0] if len(pieces) == 1 else b"".join(pieces)
        self._at = 0
