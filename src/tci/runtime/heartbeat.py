"""Sends and checks heartbeats between TCI processes on one machine. A heartbeat is a small UDP datagram.

Each required process sends beats. The process that owns the driver receives the beats and holds the robot if
no beat of a required process arrives for 80 ms (`TIMEOUT`). To use heartbeats, pass `Listener.fault` to `run`
as the argument `guard`.
"""

from __future__ import annotations

import socket
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from tci.errors import DriverError, TciError
from tci.reasons import Code, Reason

TIMEOUT = 0.08
"""Time [s] without a beat after which a process counts as dead. The robot must hold within 100 ms, and
`TIMEOUT` plus one control period is shorter than this."""
INTERVAL = 0.02
"""Time [s] between two beats. Assumed: four beats are sent within `TIMEOUT`."""
_FORM = struct.Struct("<4sQ16sI")
_MAGIC = b"TCIb"
_PER_CALL = 64
"""Largest number of datagrams that one check of the heartbeats reads. Without this limit, a check would last
too long if very many datagrams arrive."""


def encode(name: str, sequence: int) -> bytes:
    """Returns one beat as bytes. Raises TciError if the process name in the beat is empty or longer than 16
    bytes."""
    raw = name.encode()
    if not 0 < len(raw) <= 16 or b"\0" in raw:
        raise TciError(f"heartbeat of {name!r}; valid: a name of 1 to 16 bytes without zeros")
    body = _FORM.pack(_MAGIC, sequence, raw, 0)[:-4]
    return body + struct.pack("<I", zlib.crc32(body))


def decode(data: bytes) -> tuple[str, int] | None:
    """Returns the process name and the sequence number in a beat. Returns None if the bytes are not a
    beat."""
    if len(data) != _FORM.size:
        return None
    magic, sequence, raw, check = _FORM.unpack(data)
    if magic != _MAGIC or check != zlib.crc32(data[:-4]):
        return None
    try:
        return raw.rstrip(b"\0").decode(), sequence
    except UnicodeDecodeError:
        return None


class Sender:
    """Sends beats to a `Listener`. Call `beat` in the loop that is supervised, never in a separate thread. A
    separate thread would send beats although the loop has stopped.
    """

    def __init__(self, name: str, port: int) -> None:
        """Opens a socket to the listener's `port` on this machine. Raises TciError for an invalid name."""
        encode(name, 0)
        self.name = name
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def beat(self) -> None:
        """Sends a beat. Does nothing if no process listens at the port."""
        try:
            self._socket.sendto(encode(self.name, time.monotonic_ns()), self._to)
        except OSError:
            return  # no process listens; a sender does not report this

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()


class Listener:
    """Records the beats of the required processes. A process that has never sent a beat counts as dead."""

    def __init__(
        self,
        needed: Sequence[str],
        *,
        port: int = 0,
        timeout: float = TIMEOUT,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Listens on `port` of the loopback interface. With `port` 0, the system chooses a free port. Raises
        DriverError if the port is in use.
        """
        if not timeout > 0.0:
            raise TciError(f"heartbeat timeout {timeout} s; valid: above 0")
        self._timeout = timeout
        self._clock = clock
        self._last_beats: dict[str, tuple[float, int]] = {name: (-float("inf"), -1) for name in needed}
        self.rejected = 0
        """Number of datagrams that were rejected: they were not beats of a required process, or were older
        than the latest beat of the process."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError as error:
            self._socket.close()
            raise DriverError(f"heartbeat port {port}: {error.strerror}; valid: a free one, or 0") from error
        self.port: int = self._socket.getsockname()[1]
        """Port on which this listener receives beats."""

    def fault(self) -> Reason | None:
        """Returns a reason to hold the robot, with the names of the processes whose beats are missing.
        Returns None if all required processes are alive.
        """
        for _ in range(_PER_CALL):
            try:
                data = self._socket.recv(_FORM.size + 1)
            except BlockingIOError:
                break
            beat = decode(data)
            if beat is None or beat[0] not in self._last_beats or beat[1] <= self._last_beats[beat[0]][1]:
                self.rejected += 1
                continue
            self._last_beats[beat[0]] = self._clock(), beat[1]
        now = self._clock()
        silent = [name for name, (stamp, _) in self._last_beats.items() if now - stamp > self._timeout]
        if not silent:
            return None
        return Reason(Code.HEARTBEAT_MISSING, f"no heartbeat of {', '.join(silent)}")

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
