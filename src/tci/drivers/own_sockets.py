"""Access to sockets that a library opens in this process without offering settings for them.

Works only on Linux, which lists the sockets of a process. On other systems this module finds no sockets and
changes nothing.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from yarpwire.connection_limit import MOST, AcceptedConnection, surplus

try:
    import resource
except ModuleNotFoundError:  # Windows
    resource = None  # type: ignore[assignment]  # the module is missing

FOLDER = Path("/proc/self/fd")
INTERVAL = 0.25
"""Time [s] between two checks of a library's connections. Assumed: a flood opens no more than a few hundred
connections between two checks."""
SO_DOMAIN = 39
"""Linux's socket option SO_DOMAIN, the address family of a socket. Python does not define the option."""
INFO = 256
"""Bytes that are requested of Linux's `struct tcp_info`. Newer versions of Linux have a longer struct."""
SILENT_AT, RECEIVED_AT = 52, 128
"""Offsets [bytes] of two values in `struct tcp_info`: the time [ms] since data last arrived (u32), and the
number of bytes received (u64)."""


_C: Any = ctypes.CDLL(None, use_errno=True) if FOLDER.is_dir() else None


class OwnSocket:
    """A second file descriptor of a socket that a library opened.

    The descriptor is not wrapped in a Python socket, because that might also make the library's own
    descriptor non-blocking.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.name = os.readlink(FOLDER / str(descriptor))
        """Name that Linux gives the socket: `socket:[INODE]`."""

    def get(self, level: int, option: int, size: int = 4) -> bytes:
        """Returns a socket option as bytes. Raises OSError."""
        data, length = ctypes.create_string_buffer(size), ctypes.c_uint(size)
        _checked(_C.getsockopt(self._descriptor, level, option, data, ctypes.byref(length)))
        return data.raw[: length.value]

    def flag(self, option: int) -> int:
        """Returns an integer option of level SOL_SOCKET. Raises OSError."""
        return int.from_bytes(self.get(socket.SOL_SOCKET, option), sys.byteorder)

    def bind_to(self, device: bytes) -> None:
        """Makes the socket receive data from one network interface only. Raises OSError."""
        option = (socket.SOL_SOCKET, socket.SO_BINDTODEVICE, device, len(device))
        _checked(_C.setsockopt(self._descriptor, *option))

    def port(self) -> int:
        """Returns the local port. Raises OSError."""
        data, length = ctypes.create_string_buffer(128), ctypes.c_uint(128)
        _checked(_C.getsockname(self._descriptor, data, ctypes.byref(length)))
        return int.from_bytes(data.raw[2:4], "big")

    def end(self) -> None:
        """Shuts the connection down, also for the library's own descriptor. Raises OSError."""
        _checked(_C.shutdown(self._descriptor, socket.SHUT_RDWR))


def _checked(result: int) -> None:
    if result:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def own_sockets(kind: socket.SocketKind) -> Iterator[OwnSocket]:
    """Yields each IP socket of type `kind` in this process; valid only until the next socket is yielded."""
    for number in os.listdir(FOLDER) if FOLDER.is_dir() else ():
        with suppress(OSError):  # closed in the meantime
            descriptor = os.dup(int(number))
            try:
                found = OwnSocket(descriptor)
                right = found.name.startswith("socket:") and found.flag(socket.SO_TYPE) == kind
                if right and found.flag(SO_DOMAIN) in (socket.AF_INET, socket.AF_INET6):
                    yield found
            finally:
                os.close(descriptor)


def listening() -> set[int]:
    """Returns the TCP ports that this process listens on."""
    return {found.port() for found in own_sockets(socket.SOCK_STREAM) if found.flag(socket.SO_ACCEPTCONN)}


@contextmanager
def on_interface(name: str) -> Iterator[None]:
    """Makes UDP sockets that are opened inside the block receive data from one network interface only.

    Needed for DDS, which listens on every network interface although it is configured to use only one.
    Without this function, DDS would also read data that arrives on the other interfaces.
    """
    before = {found.name for found in own_sockets(socket.SOCK_DGRAM)}
    yield
    for found in own_sockets(socket.SOCK_DGRAM):
        if found.name not in before:
            found.bind_to(name.encode() + b"\0")


def on_loopback() -> AbstractContextManager[None]:
    """Makes UDP sockets that are opened inside the block receive data from this machine only."""
    return on_interface("lo")


class ConnectionMonitor:
    """Bounds the number of connections to a library's server in this process.

    `ConnectionLimit` has the same rules for TCI's own servers. A connection counts as unverified until it has
    sent a byte.
    """

    def __init__(self, port: int, *, most: int = MOST) -> None:
        self._port, self._most = port, most
        self.ended = 0
        """Number of connections that were closed."""
        self._closed = threading.Event()
        _open_more_files()
        threading.Thread(target=self._keep_checking, name=f"connections to {port}", daemon=True).start()

    def check(self) -> None:
        """Closes connections above the largest number, and connections that have sent no byte for too
        long."""
        now, going = time.monotonic(), set[str]()
        found = [_connection(partial(going.add, one.name), one, now) for one in self._connections()]
        for connection in surplus(found, now, self._most):
            connection.end()
        for one in self._connections() if going else ():
            if one.name in going:
                self.ended += 1
                one.end()

    def close(self) -> None:
        """Ends the checks."""
        self._closed.set()

    def _connections(self) -> Iterator[OwnSocket]:
        for one in own_sockets(socket.SOCK_STREAM):
            if not one.flag(socket.SO_ACCEPTCONN) and one.port() == self._port:
                yield one

    def _keep_checking(self) -> None:
        while not self._closed.wait(INTERVAL):
            with suppress(OSError):  # a connection may end in the meantime
                self.check()


def _open_more_files() -> None:
    """Raises the process's limit on open files to the system's maximum.

    Needed for NAOqi's server: if the server can't open a file for one connection, it accepts no further
    connections.
    """
    if resource is not None:
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _connection(end: Callable[[], None], one: OwnSocket, now: float) -> AcceptedConnection:
    info = one.get(socket.IPPROTO_TCP, socket.TCP_INFO, INFO)
    (silent,), (received,) = (
        struct.unpack_from("=I", info, SILENT_AT),
        struct.unpack_from("=Q", info, RECEIVED_AT),
    )
    return AcceptedConnection(end, now - silent / 1e3, bool(received))
