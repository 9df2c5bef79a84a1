"""A TCP port that other programs connect to. One thread accepts connections, and each connection has its own
thread. `connection_limit` bounds the number of connections."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from functools import partial

from yarpwire.connection_limit import MOST, AcceptedConnection, ConnectionLimit
from yarpwire.errors import PortError, YarpError

LEAVING = 0.1
"""Longest time [s] that `close` waits for the threads of its connections. Assumed: after its socket is shut
down, a thread ends within a millisecond. `close` waits because a running thread keeps its objects in
memory."""


class Listener:
    """Accepts connections and passes each to `serve(socket, connection)`, in a thread of its own."""

    def __init__(
        self, host: str, port: int, serve: Callable[[socket.socket, AcceptedConnection], None], *, name: str
    ) -> None:
        """Opens the port. Raises PortError if the port is in use."""
        self._name, self._serve = name, serve
        self._limit = ConnectionLimit()
        self._threads: set[threading.Thread] = set()
        self._wrong = 0
        self.last_error = ""
        """Error that ended the connection that was dropped last."""
        try:
            self._socket = socket.create_server((host, port), backlog=MOST)
        except OSError as error:
            raise PortError(
                f"{name} can't listen at {host}:{port}: {error.strerror or error}; valid: a free port"
            ) from error
        bound = self._socket.getsockname()
        self.address: tuple[str, int] = (str(bound[0]), int(bound[1]))
        """Host and port at which the listener accepts connections."""
        self._closed = False
        self._start(self._accept, name=f"yarp accept {name}")

    @property
    def dropped(self) -> int:
        """Number of connections that ended because of invalid data, or to make room for others."""
        return self._wrong + self._limit.ended

    def close(self) -> None:
        """Closes the port and every connection. Sockets are shut down before they are closed, so that the
        port number can be used again immediately."""
        self._closed = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._limit.end_all()
        until = time.monotonic() + LEAVING
        for thread in self._threads.copy():
            # `close` runs in this thread, or the thread has not started yet
            with contextlib.suppress(RuntimeError):
                thread.join(max(0.0, until - time.monotonic()))

    def _accept(self) -> None:
        while not self._closed:
            try:
                sock, address = self._socket.accept()
            except OSError:
                if self._closed:
                    return
                continue
            connection = self._limit.add(partial(_end, sock), str(address[0]))
            if self._closed:  # this connection arrived while `close` ran
                _end(sock)
            self._start(self._run, sock, connection, name=f"yarp serve {self._name}")

    def _start(self, work: Callable[..., None], *arguments: object, name: str) -> None:
        def run() -> None:
            try:
                work(*arguments)
            finally:
                self._threads.discard(threading.current_thread())

        thread = threading.Thread(target=run, name=name, daemon=True)
        self._threads.add(thread)
        thread.start()

    def _run(self, sock: socket.socket, connection: AcceptedConnection) -> None:
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._serve(sock, connection)
        except (EOFError, TimeoutError, ConnectionError):
            pass
        except Exception as error:  # otherwise the exception would end the process
            if not self._closed:
                self._wrong += 1
                self.last_error = error_text(error)
        finally:
            self._limit.remove(connection)
            sock.close()


def _end(sock: socket.socket) -> None:
    """Shuts a socket down. This wakes the thread that waits for data; closing the socket would not wake
    it."""
    with contextlib.suppress(OSError):
        sock.shutdown(socket.SHUT_RDWR)


def error_text(error: Exception) -> str:
    """Returns the text of an error, with its type if the error is unexpected."""
    return str(error) if isinstance(error, YarpError | OSError) else f"{type(error).__name__}: {error}"
