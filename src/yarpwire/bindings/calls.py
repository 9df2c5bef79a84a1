"""Calls to other ports, made with YARP's bindings."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

from yarpwire.bindings.module import (
    RESTED,
    close_port,
    closes_at_rest,
    connect,
    open_port,
    to_bottle,
)
from yarpwire.carrier import TCP
from yarpwire.errors import PortError
from yarpwire.names import PATIENCE
from yarpwire.text import from_text, to_text

_lines = itertools.count()


class BindingsCaller:
    """Makes calls over one connection. Connects at the first call, and again after a failure."""

    def __init__(self, yarp: Any, target: str, sender: str) -> None:
        self._yarp, self._target, self._sender = yarp, target, sender
        self._line: Line | None = None
        self._open_calls: deque[Future[list[Any]]] = deque()

    def call(self, *items: Any, patience: float = PATIENCE) -> list[Any]:
        self._open_calls.clear()  # the callers of these calls have given up waiting
        return self._result(self._submit(items), patience)

    def send_call(self, *items: Any) -> None:
        self._open_calls.append(self._submit(items))

    def is_answered(self, patience: float) -> bool:
        return not self._open_calls or bool(wait([self._open_calls[0]], patience).done)

    def read_reply(self) -> list[Any]:
        if not self._open_calls:
            raise PortError(f"{self._target}: the connection was closed")
        return self._result(self._open_calls.popleft(), 0.0)

    def close(self) -> None:
        wait([self._let_go()], PATIENCE)

    def _let_go(self) -> Future[None]:
        self._open_calls.clear()
        line, self._line = self._line, None
        if line is not None:
            return line.close()
        done: Future[None] = Future()
        done.set_result(None)
        return done

    def _submit(self, items: Sequence[Any]) -> Future[list[Any]]:
        if self._line is None:
            self._line = Line(self._yarp, self._target, f"{self._sender}/{next(_lines)}")
        return self._line.submit(items)

    def _result(self, found: Future[list[Any]], patience: float) -> list[Any]:
        try:
            return found.result(patience)
        except PortError:
            self._let_go()
            raise
        except TimeoutError:
            self._let_go()
            raise PortError(f"{self._target} does not answer in time") from None


class Line:
    """A port for calls, with a thread that makes the calls, since YARP blocks until the reply arrives."""

    def __init__(self, yarp: Any, target: str, sender: str) -> None:
        self._yarp, self._target, self._sender = yarp, target, sender
        self._port: Any = None
        self._used = 0.0
        self._closes = closes_at_rest()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=f"yarp {sender}")

    def submit(self, items: Sequence[Any]) -> Future[list[Any]]:
        """Begins a call. The future returns the reply, or raises PortError."""
        return self._thread.submit(self._exchange, items)

    def close(self) -> Future[None]:
        """Closes the port after the call in progress has ended."""
        done = self._thread.submit(self._hang_up)
        self._thread.shutdown(wait=False)
        return done

    def _exchange(self, items: Sequence[Any]) -> list[Any]:
        now = time.monotonic()
        if self._closes and now - self._used > RESTED:
            self._hang_up()
        self._used = now
        if self._port is None:
            self._port = self._yarp.Port()
            self._port.setTimeout(PATIENCE)
            open_port(self._yarp, self._port, self._sender)
            connect(self._yarp, self._sender, self._target, TCP.name)
        reply = self._yarp.Bottle()
        if not self._port.write(to_bottle(self._yarp, items), reply):
            raise PortError(f"{self._target} does not answer {to_text(items)[:80]}")
        return from_text(reply.toString())

    def _hang_up(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            close_port(port)
