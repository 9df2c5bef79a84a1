"""Numbers from a topic of ROS 2, of any message type."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.errors import DriverError, FrameError
from tci.recording.schemas import raw_of_cloud
from tci.shared.ros2_node import open_node, where_seen
from tci.shared.ros_node import RosNode, list_topics
from tci.shared.ros_types import message_type
from tci.sources.array.path import FieldPath

DISCOVERY = 3.0
"""Longest time [s] until a running publisher is found. Assumed: discovery takes a second or two."""
PAUSE = 0.002
"""Time [s] between two looks for messages."""
CLOUD = "sensor_msgs/msg/PointCloud2"
PLACES = ("x", "y", "z")
PACKS = {"be16": np.dtype(">u2"), "le16": np.dtype("<u2")}
"""How two bytes of a field of bytes make one value."""


class Topic:
    """One topic, from which one pad gets its values."""

    def __init__(self, name: str, *, type_: str, path: str, msg: str, pack: str) -> None:
        """
        Args:
            name: Name of the topic, with a leading slash.
            type_: `package/msg/Name`; empty for the type that the publisher says.
            path: Where the numbers are (`FieldPath`), or the field of a PointCloud2; empty for the usual.
            msg: The user's definitions of message types: a file or a folder.
            pack: `be16` or `le16` if two bytes of the field are one value; empty if not.

        Raises DriverError for a path or pack that can't be meant.
        """
        if pack and pack not in PACKS:
            raise DriverError(f"pack={pack}; valid: {', '.join(PACKS)}")
        self.name, self._type, self._msg, self._pack = name, type_, msg, PACKS.get(pack)
        self._said = path
        self._path = FieldPath(path or "data")
        self._node: RosNode | None = None
        self._arrived: list[tuple[NDArray[np.generic], float | None]] = []

    def open(self) -> None:
        """Raises DriverError if nobody publishes the topic, or its type is not known."""
        node = self._node = open_node("tci_array_source", "")
        end = time.monotonic() + DISCOVERY
        while not (offered := node.types_of(self.name)) and time.monotonic() < end:
            time.sleep(0.02)
        if not offered and not self._type:
            raise DriverError(
                f"nobody publishes {self.name} ({where_seen()}); seen: {list_topics(node.topics())}; start "
                "the publisher, set ROS_DOMAIN_ID, or name the type with type= to wait for it"
            )
        if self._type and offered and self._type not in offered:
            raise DriverError(
                f"{self.name} is {', '.join(offered)}; valid: type={offered[0]}, or leave it out"
            )
        self._type = self._type or offered[0]
        node.subscribe(self.name, message_type(self._type, self._msg), self._take, keep=4)

    def read(self, wait: float) -> list[tuple[NDArray[np.generic], float | None]]:
        """The values and stamps [s] of messages that arrived within `wait` [s]; None for one without a stamp.

        Raises FrameError if none of them could be used.
        """
        node = self._node
        if node is None:
            raise ConnectionResetError("not open")
        end = time.monotonic() + wait
        while True:
            before = node.rejected.copy()
            node.poll()
            found, self._arrived = self._arrived, []
            if found:
                return found
            if fresh := node.rejected - before:
                raise FrameError(next(iter(fresh)))
            if time.monotonic() >= end:
                return []
            time.sleep(PAUSE)

    def diagnose(self) -> Iterator[Finding]:
        """What the topic is, or which others there are."""
        node = self._node
        if node is None:
            return
        offered = node.types_of(self.name)
        if offered:
            yield Finding(Level.OK, self.name, f"{', '.join(offered)} in {where_seen()}")
            return
        said = f"nobody publishes it now ({where_seen()}); seen: {list_topics(node.topics())}"
        yield Finding(Level.WARNING, self.name, said, "start its publisher, or set ROS_DOMAIN_ID")

    def close(self) -> None:
        if self._node is not None:
            self._node.close()
            self._node = None

    def _take(self, message: Mapping[str, Any]) -> None:
        if self._type == CLOUD:
            names = [str(field["name"]) for field in message["fields"]]
            usual = ["raw"] if "raw" in names else [name for name in names if name not in PLACES]
            values = raw_of_cloud(message, self._said or (usual[0] if len(usual) == 1 else "raw"))
        else:
            values = self._path.values(message)
        if self._pack is not None:
            data = values.astype(np.uint8).tobytes()
            if len(data) % self._pack.itemsize:
                raise FrameError(f"{self._path.text}: {len(data)} bytes; valid: two for each value")
            values = np.frombuffer(data, self._pack)
        self._arrived.append((values, _stamp_of(message)))


def _stamp_of(message: Mapping[str, Any]) -> float | None:
    """The stamp [s] of the message's header; None without one, and for one that was left at 0."""
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    if not isinstance(stamp, Mapping):
        return None
    return float(stamp["sec"]) + 1e-9 * float(stamp["nanosec"]) or None
