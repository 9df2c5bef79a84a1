"""Messages of a port that a feed keeps, and the times at which the feed waits for the next message."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from helpers.yarp_show import until
from yarpwire import feed as feeds
from yarpwire.dialect import V3
from yarpwire.feed import Feed
from yarpwire.message import Stamp
from yarpwire.name_server import NameServer
from yarpwire.network import Network
from yarpwire.wire import Wire

EVERY = 0.05
"""Time [s] between the stamps of two messages."""


class Writer:
    """A port that writes one number at a time, and the feed that reads it."""

    def __init__(self, network: Network) -> None:
        self.port = network.port("/skin", V3)
        self.feed = Feed("/skin", network, V3, lambda d: d.vector(V3), own="/reader", carrier="fast_tcp")
        self.count = 0

    def write(self) -> None:
        self.port.write(np.full(3, float(self.count)), Stamp(self.count, self.count * EVERY))
        self.count += 1

    def came(self) -> bool:
        return self.feed.latest is not None and self.feed.latest.sequence == self.count - 1


@pytest.fixture
def writer() -> Iterator[Writer]:
    with NameServer() as server:
        writer = Writer(Wire(server.address))
        yield writer
        writer.feed.close()
        writer.port.close()


def test_a_message_that_is_due_is_waited_for(writer: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(3):
        writer.write()
        assert until(writer.came)
    monkeypatch.setattr(writer.feed, "_every", EVERY)
    monkeypatch.setattr(feeds, "LATE", 60.0)
    late = threading.Timer(0.2, writer.write)
    late.start()
    writer.feed.await_due(time.monotonic() + 60.0, 0.005)
    assert writer.feed.latest is not None
    assert writer.feed.latest.sequence == 3
    late.join()


def test_what_comes_often_or_is_not_due_or_never_came_is_not_waited_for(
    writer: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feeds, "LATE", 1e6)  # otherwise a wait would never end
    writer.feed.await_due(1e9, 0.005)
    for _ in range(3):
        writer.write()
        assert until(writer.came)
    monkeypatch.setattr(writer.feed, "_every", EVERY)
    writer.feed.await_due(1e9, 2 * EVERY)
    writer.feed.await_due(0.0, 0.005)


def test_messages_of_one_stamp_are_told_apart_by_their_count(writer: Writer) -> None:
    for count in range(5):
        writer.port.write(np.full(3, float(count)), Stamp(count, 7.0))
        writer.count = count + 1
        assert until(writer.came)
    writer.port.write(np.zeros(3), Stamp(2, 7.0))  # an older message is ignored
    writer.port.write(np.full(3, 5.0), Stamp(5, 7.0))
    writer.count = 6
    assert until(writer.came)
    assert writer.feed.latest is not None
    assert writer.feed.latest.value.tolist() == [5.0] * 3
    assert writer.feed.lost == 0
