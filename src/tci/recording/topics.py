"""Writes the topics of a recording. A topic gets its channel when its first message is written."""

from __future__ import annotations

from typing import Any

from mcap.writer import Writer

from tci.recording.rosmsg.cdr import MessageType


class Topics:
    """Writes messages to one MCAP file."""

    def __init__(self, writer: Writer) -> None:
        self._writer: Any = writer  # some functions of mcap have no type annotations
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def put(self, topic: str, kind: MessageType, stamp: int, data: bytes) -> None:
        """Writes a message with the time `stamp` [ns]."""
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._register(topic, kind)
        self._writer.add_message(channel, log_time=stamp, data=data, publish_time=stamp)

    def finish(self) -> None:
        """Ends the file with its index."""
        self._writer.finish()

    def _register(self, topic: str, kind: MessageType) -> int:
        if kind.name not in self._schemas:
            definition = kind.definition.encode()
            self._schemas[kind.name] = self._writer.register_schema(kind.name, "ros2msg", definition)
        channel: int = self._writer.register_channel(topic, "cdr", self._schemas[kind.name])
        return channel
