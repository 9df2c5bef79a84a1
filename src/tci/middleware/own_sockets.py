"""Sockets that a library opens in this process and has no setting for. Linux shows them, others show none."""

from __future__ import annotations

import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from tci.middleware.visitors import MOST, Visitor, surplus

try:
    import resource
except ModuleNotFoundError:  # on Windows
    resource = None  # type: ignore[assignment]

FOLDER = Path("/proc/self/fd")
LOOK = 0.1
"""Time [s] between two looks at a library's connections. Assumed: a flood opens a few hundred meanwhile."""
INFO = 256
"""Bytes asked for of Linux's `struct tcp_info`, which grows."""
SILENT_AT, RECEIVED_AT = 52, 128
"""Where it has the time [ms] since something came, as u32, and how many bytes came, as u64."""


def own_sockets(kind: socket.SocketKind) -> Iterator[tuple[str, socket.socket]]:
    """Each IP socket of `kind`: its name in the system, and a second handle, closed as the next one comes."""
    for number in os.listdir(FOLDER) if FOLDER.is_dir() else ():
        with suppress(OSError):  # closed meanwhile
            name = os.readlink(FOLDER / number)
            if name.startswith("socket:"):
                with socket.socket(fileno=os.dup(int(number))) as found:
                    if found.type == kind and found.family in (socket.AF_INET, socket.AF_INET6):
                        yield name, found


def listening() -> set[int]:
    """TCP ports that this process listens at."""
    found = own_sockets(socket.SOCK_STREAM)
    return {
        sock.getsockname()[1] for _, sock in found if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
    }


@contextmanager
def on_loopback() -> Iterator[None]:
    """UDP sockets that are opened meanwhile get only what comes from this machine.

    DDS listens on every interface, whichever one it is told to use: what arrives elsewhere is read as well.
    """
    before = {name for name, _ in own_sockets(socket.SOCK_DGRAM)}
    yield
    for name, found in own_sockets(socket.SOCK_DGRAM):
        if name not in before:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo\0")


class Watch:
    """Bounds the connections to a library's server in this process, as `Visitors` does those of our own.

    A stranger is one that has not sent a single byte.
    """

    def __init__(self, port: int, *, most: int = MOST) -> None:
        self._port, self._most = port, most
        self.ended = 0
        """Connections that had to go."""
        self._closed = threading.Event()
        _open_more_files()
        threading.Thread(target=self._keep_looking, name=f"connections to {port}", daemon=True).start()

    def look(self) -> None:
        """Let those go that have to."""
        now, going = time.monotonic(), set[str]()
        found = [_visitor(partial(going.add, name), sock, now) for name, sock in self._connections()]
        for visitor in surplus(found, now, self._most):
            visitor.end()
        for name, sock in self._connections() if going else ():
            if name in going:
                self.ended += 1
                sock.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Look no more."""
        self._closed.set()

    def _connections(self) -> Iterator[tuple[str, socket.socket]]:
        for name, sock in own_sockets(socket.SOCK_STREAM):
            listens = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
            if not listens and sock.getsockname()[1] == self._port:
                yield name, sock

    def _keep_looking(self) -> None:
        while not self._closed.wait(LOOK):
            with suppress(OSError):  # a connection that ended meanwhile
                self.look()


def _open_more_files() -> None:
    """Let this process have as many as the system grants: a server that found none left for a newcomer may
    never accept anybody again (NAOqi's)."""
    if resource is not None:
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _visitor(end: Callable[[], None], sock: socket.socket, now: float) -> Visitor:
    info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, INFO)
    (silent,), (received,) = (
        struct.unpack_from("=I", info, SILENT_AT),
        struct.unpack_from("=Q", info, RECEIVED_AT),
    )
    return Visitor(end, now - silent / 1e3, bool(received))
