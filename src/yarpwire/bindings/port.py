"""A port of YARP. YARP passes received messages as bytes, so yarpwire decodes them with the code that `wire`
uses."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from yarpwire.bindings.module import (
    RESTED,
    close_port,
    closes_at_rest,
    connect,
    open_port,
    reader,
    to_bottle,
)
from yarpwire.bottle import encode_bottle
from yarpwire.carrier import FAST_TCP
from yarpwire.dialect import Dialect
from yarpwire.errors import PortError
from yarpwire.incoming import Answer, Delivery
from yarpwire.listener import error_text
from yarpwire.message import CALL, DATA, Command, Stamp
from yarpwire.source import LONGEST
from yarpwire.values import Array

KEPT = 16
"""Number of sent messages that are kept in memory, since YARP reads them later in its own thread. Assumed:
more than YARP sends at a time."""
SENT = 0.001
"""Longest time [s] that `write` waits until the previous message is sent. If the previous message is still
not sent, new messages are dropped without waiting. Assumed: a small part of a control period."""


class BindingsPort:
    """A port of YARP that reads and writes. Writing never waits for a reader."""

    def __init__(
        self, yarp: Any, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None
    ) -> None:
        """Opens the port. Raises PortError if YARP refuses the name."""
        self.name = name
        self.last_error = ""
        self.dropped = 0
        """Number of messages dropped because readers were too slow."""
        self._yarp, self._dialect, self._receive = yarp, dialect, receive
        self._sending: deque[Any] = deque(maxlen=KEPT)
        self._stuck = False
        self._port = yarp.Port()
        self._port.enableBackgroundWrite(True)
        if receive is not None:
            self._reader = reader(yarp, self._read)
            self._port.setReader(self._reader)
        open_port(yarp, self._port, name)

    @property
    def outputs(self) -> Sequence[str]:
        count: int = self._port.getOutputCount()
        return ("?",) * count

    def register(self) -> None:
        self._yarp.NetworkBase.registerContact(self._port.where())

    def listen_to(self, source: str, carrier: str) -> None:
        connect(self._yarp, source, self.name, carrier)

    def write(self, value: Array | Sequence[Any], stamp: Stamp | None = None) -> None:
        if not self._is_free():
            self.dropped += 1
            return
        if stamp is not None:
            self._port.setEnvelope(self._yarp.Stamp(stamp.count, stamp.time))
        if isinstance(value, np.ndarray):
            message = self._yarp.Vector(value.tolist())
        else:
            message = to_bottle(self._yarp, value)
        self._sending.append(message)
        self._port.write(message)

    def close(self) -> None:
        close_port(self._port)

    def _is_free(self) -> bool:
        """Returns True if YARP has sent the previous message. Waits at most `SENT` [s] until the message is
        sent, since it may be only a moment old."""
        until = time.monotonic() + (0.0 if self._stuck else SENT)
        while self._port.isWriting():
            self._stuck = time.monotonic() >= until
            if self._stuck:
                return False
        self._stuck = False
        return True

    def _read(self, connection: Any) -> bool:
        if self._receive is None or not connection.isValid():
            return False
        arrived, size = time.monotonic(), connection.getSize()
        if connection.isTextMode() or not 0 < size <= LONGEST:
            self.last_error = f"text, or a message of {size} bytes; valid: 1 to {LONGEST} bytes"
            return False
        connection.pushInt(size)
        # A string of YARP can hold any bytes; SWIG turns those that are not UTF-8 into surrogates.
        body = connection.expectString().encode("utf-8", errors="surrogateescape")
        writer = connection.getWriter()
        sender = connection.getRemoteContact().getName()
        command = Command(DATA if writer is None else CALL, self._envelope())
        try:
            answer = self._receive(Delivery(command, sender, arrived, body))
        except Exception as error:  # the exception must not propagate through C++
            self.last_error = f"{sender}: {error_text(error)}"
            return False
        if writer is not None and answer is not None:
            self._answer(writer, answer)
        return True

    def _answer(self, writer: Any, answer: Sequence[Any] | str | bytes) -> None:
        """Writes the answer to a call into YARP's `writer`, as bytes, since YARP's class Bottle can't express
        all replies of the dialect 4.x."""
        if not isinstance(answer, bytes):
            answer = encode_bottle([answer] if isinstance(answer, str) else answer, self._dialect)
        words, rest = divmod(len(answer), 4)
        for word in struct.unpack_from(f"<{words}i", answer):
            writer.appendInt32(word)
        for byte in struct.unpack_from(f"<{rest}b", answer, 4 * words):
            writer.appendInt8(byte)

    def _envelope(self) -> str:
        stamp = self._yarp.Stamp()
        there = self._port.getEnvelope(stamp) and stamp.isValid()
        return f"{stamp.getCount()} {stamp.getTime()!r}" if there else ""


class BindingsWriter:
    """A port that sends to one other port."""

    def __init__(self, yarp: Any, target: str, sender: str, dialect: Dialect) -> None:
        """Opens the port and connects it to `target`. Raises PortError if that fails."""
        self._target = target
        self._closes, self._used = closes_at_rest(), time.monotonic()
        self._port = BindingsPort(yarp, sender, dialect)
        try:
            connect(yarp, sender, target, FAST_TCP.name)
        except PortError:
            self._port.close()
            raise

    def offer(self, value: Array | Sequence[Any], dialect: Dialect, stamp: Stamp | None = None) -> bool:
        if self.is_over():
            raise PortError(f"{self._target} is gone")
        self._used = time.monotonic()
        before = self._port.dropped
        self._port.write(value, stamp)
        return self._port.dropped == before

    def is_over(self) -> bool:
        rested = self._closes and time.monotonic() - self._used > RESTED
        return rested or not self._port.outputs

    def close(self) -> None:
        self._port.close()
