"""Sets options of the sockets that a library opens in this process. This is needed for libraries that have no
settings for these options. Works only on Linux, which lists the sockets of a process. On other systems, this
module finds no sockets and has no effect."""

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
"""Time [s] between two checks of a library's connections. Assumed: even an attacker opens no more than a few
hundred connections between two checks."""
SO_DOMAIN = 39
"""Linux's socket option SO_DOMAIN, the address family of a socket. Python does not define the option."""
INFO = 256
"""Number of bytes that TCI reads from the beginning of Linux's `struct tcp_info`. In newer versions of Linux,
the struct is longer."""
SILENT_AT, RECEIVED_AT = 52, 128
"""Offsets [bytes] of two values in `struct tcp_info`: the time [ms] since data last arrived (u32), and the
number of bytes received (u64)."""


_C: Any = ctypes.CDLL(None, use_errno=True) if FOLDER.is_dir() else None


class OwnSocket:
    """A second file descriptor of a socket that a library opened. The descriptor is not wrapped in a Python
    socket, because a Python socket might also make the library's own descriptor non-blocking.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.name = os.readlink(FOLDER / str(descriptor))
        """Name that Linux gives the socket: `socket:[INODE]`."""

    def get(self, level: int, option: int, size: int = 4) -> bytes:
        """Returns a socket option as bytes. Raises OSError if the system refuses the request."""
        data, length = ctypes.create_string_buffer(size), ctypes.c_uint(size)
        _checked(_C.getsockopt(self._descriptor, level, option, data, ctypes.byref(length)))
        return data.raw[: length.value]

    def flag(self, option: int) -> int:
        """Returns an integer option of level SOL_SOCKET. Raises OSError if the system refuses the request."""
        return int.from_bytes(self.get(socket.SOL_SOCKET, option), sys.byteorder)

    def bind_to(self, device: bytes) -> None:
        """Makes the socket receive data only from the network interface `device`. Raises OSError if the
        system refuses the option."""
        option = (socket.SOL_SOCKET, socket.SO_BINDTODEVICE, device, len(device))
        _checked(_C.setsockopt(self._descriptor, *option))

    def port(self) -> int:
        """Returns the local port. Raises OSError if the system refuses the request."""
        data, length = ctypes.create_string_buffer(128), ctypes.c_uint(128)
        _checked(_C.getsockname(self._descriptor, data, ctypes.byref(length)))
        return int.from_bytes(data.raw[2:4], "big")

    def end(self) -> None:
        """Shuts down the socket's connection. The library can then no longer use the connection either.
        Raises OSError if the socket has no connection."""
        _checked(_C.shutdown(self._descriptor, socket.SHUT_RDWR))


def _checked(result: int) -> None:
    if result:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def own_sockets(kind: socket.SocketKind) -> Iterator[OwnSocket]:
    """Yields each IP socket of type `kind` in this process; valid only until the next socket is yielded."""
    for number in os.listdir(FOLDER) if FOLDER.is_dir() else ():
        with suppress(OSError):  # the socket may be closed before it is duplicated
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
    """Makes UDP sockets that are opened inside the `with` block receive data only from the network interface
    `name`. DDS needs this: it listens on every interface, even if it is configured for only one."""
    before = {found.name for found in own_sockets(socket.SOCK_DGRAM)}
    yield
    for found in own_sockets(socket.SOCK_DGRAM):
        if found.name not in before:
            found.bind_to(name.encode() + b"\0")


def on_loopback() -> AbstractContextManager[None]:
    """Makes UDP sockets that are opened inside the `with` block receive data only from this machine."""
    return on_interface("lo")


class ConnectionMonitor:
    """Bounds the number of connections to a server that a library runs in this process. A connection counts
    as unverified until the other program has sent a byte. If there are too many connections, closes
    unverified ones first, then those that were silent for the longest time."""

    def __init__(self, port: int, *, most: int = MOST) -> None:
        self._port, self._most = port, most
        self.ended = 0
        """Number of connections that this monitor closed."""
        self._closed = threading.Event()
        _open_more_files()
        threading.Thread(target=self._keep_checking, name=f"connections to {port}", daemon=True).start()

    def check(self) -> None:
        """Closes connections if there are too many, first those that have not sent a byte yet. Also closes
        each connection that has not sent a byte within its first seconds."""
        now, going = time.monotonic(), set[str]()
        found = [_connection(partial(going.add, one.name), one, now) for one in self._connections()]
        for connection in surplus(found, now, self._most):
            connection.end()
        for one in self._connections() if going else ():
            if one.name in going:
                self.ended += 1
                one.end()

    def close(self) -> None:
        """Stops checking the connections."""
        self._closed.set()

    def _connections(self) -> Iterator[OwnSocket]:
        for one in own_sockets(socket.SOCK_STREAM):
            if not one.flag(socket.SO_ACCEPTCONN) and one.port() == self._port:
                yield one

    def _keep_checking(self) -> None:
        while not self._closed.wait(INTERVAL):
            with suppress(OSError):  # a connection may end during the check
                self.check()


def _open_more_files() -> None:
    """Raises the process's limit on open files to the system's maximum.

    Reason: if NAOqi's server reaches the limit when a connection arrives, it accepts no connections any more.
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
