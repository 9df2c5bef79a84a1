"""A TCP port that others connect to: one thread that accepts, one per connection, so many and no more."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable

from tci.errors import LinkError, TciError

MOST_CONNECTIONS = 64
"""Connections that one port holds at a time. Ours."""


class Listener:
    """Accepts connections and gives each to `serve(socket, host)`, in a thread of its own."""

    def __init__(
        self,
        host: str,
        port: int,
        serve: Callable[[socket.socket, str], None],
        *,
        name: str,
        make_room: Callable[[], bool] = lambda: False,
    ) -> None:
        """`make_room` may end one connection for the next one, and says whether it did.

        Raises LinkError when the port is taken.
        """
        self._name, self._serve, self._make_room = name, serve, make_room
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        self.dropped = 0
        """Connections that ended because what came was not allowed, or that were one too many."""
        self.last_error = ""
        """Why the last of them was dropped."""
        try:
            self._socket = socket.create_server((host, port), backlog=MOST_CONNECTIONS)
        except OSError as error:
            raise LinkError(
                f"{name} can't listen at {host}:{port}: {error.strerror or error}; valid: a free port"
            ) from error
        bound = self._socket.getsockname()
        self.address: tuple[str, int] = (str(bound[0]), int(bound[1]))
        """Host and port."""
        self._closed = False
        threading.Thread(target=self._accept, name=f"yarp accept {name}", daemon=True).start()

    def close(self) -> None:
        """Let go of the port and of every connection; shut down first, for the number is given out again."""
        self._closed = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        with self._lock:
            connections = list(self._open)
        for sock in connections:
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while not self._closed:
            try:
                sock, address = self._socket.accept()
            except OSError:
                if self._closed:
                    return
                continue
            with self._lock:
                full = len(self._open) >= MOST_CONNECTIONS
            if full and not self._make_room():
                self.dropped += 1
                self.last_error = f"more than {MOST_CONNECTIONS} connections"
                sock.close()
                continue
            with self._lock:
                if self._closed:  # and does not know of this one
                    sock.close()
                    return
                self._open.add(sock)
            threading.Thread(
                target=self._run, args=(sock, str(address[0])), name=f"yarp serve {self._name}", daemon=True
            ).start()

    def _run(self, sock: socket.socket, host: str) -> None:
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._serve(sock, host)
        except (EOFError, TimeoutError, ConnectionError):
            pass
        except Exception as error:  # beyond this thread it would end the process
            if not self._closed:
                self.dropped += 1
                self.last_error = told(error)
        finally:
            with self._lock:
                self._open.discard(sock)
            sock.close()


def told(error: Exception) -> str:
    """What is said of it: the kind too, of what nobody foresaw."""
    return str(error) if isinstance(error, TciError | OSError) else f"{type(error).__name__}: {error}"
