"""Numbers from a topic of ROS 2 or ROS 1, of any message type."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.errors import DriverError, FrameError
from tci.recording.rosmsg.cdr import MessageType
from tci.recording.schemas import raw_of_cloud
from tci.shared.ros_node import Publish, RosNode, list_topics
from tci.sources.array.path import SEVERAL, FieldPath

DISCOVERY = 3.0
"""Longest time [s] until a running publisher is found. Assumed: discovery takes a second or two."""
PAUSE = 0.002
"""Time [s] between two looks for messages."""
CLOUD = "sensor_msgs/msg/PointCloud2"
PLACES = ("x", "y", "z")
DATA = FieldPath("data")
"""Where the numbers are in arrays of the package std_msgs."""
NODE = "tci_array_source"
EMPTY = MessageType("std_msgs/msg/Empty", (("uint8", "structure_needs_at_least_one_member"),), headed=False)
"""As ROS 2 sends it."""
OFTEN, AGAIN = 0.05, 0.5
"""Shortest time [s] between two requests, and that after which one counts as lost: AgiBot's own programs ask
its hands 1 to 20 times a second, to spare their bus."""
PACKS = {"be16": np.dtype(">u2"), "le16": np.dtype("<u2")}
"""How two bytes of a field of bytes make one value."""


class Ros(NamedTuple):
    """One kind of ROS, as far as a topic needs it."""

    open: Callable[[], RosNode]
    where_seen: Callable[[], str]
    """Where nodes are looked for, in words."""
    hint: str
    """What to do if nobody publishes."""


def ros2() -> Ros:
    """Raises ImportError without a library for ROS 2."""
    module = import_module("tci.shared.ros2_node")
    return Ros(lambda: module.open_node(NODE, ""), module.where_seen, "set ROS_DOMAIN_ID")


def ros1() -> Ros:
    """Raises MissingExtraError without rospy."""
    module = import_module("tci.shared.ros1_node")
    module.load_rospy()
    return Ros(lambda: module.Ros1Node(NODE), module.where_seen, "set ROS_MASTER_URI")


class Topic:
    """One topic, from which one or more pads get their values."""

    def __init__(self, ros: Ros, name: str, *, type_: str, path: str, msg: str, pack: str, ask: str) -> None:
        """
        Args:
            ros: Whose topic it is.
            name: Name of the topic, with a leading slash.
            type_: `package/msg/Name`; empty for the type that the publisher says.
            path: Where the numbers are (`FieldPath`), or the field of a PointCloud2; empty for the usual.
                With strokes between them, one for each pad.
            msg: The user's definitions of message types: a file or a folder.
            pack: `be16` or `le16` if two bytes of the field are one value; empty if not.
            ask: Topic of ROS 2 on which an empty message asks for the next one; empty if they come by
                themselves.

        Raises DriverError for a path or pack that can't be meant.
        """
        if pack and pack not in PACKS:
            raise DriverError(f"pack={pack}; valid: {', '.join(PACKS)}")
        self.name, self._ros, self._type, self._msg, self._pack = name, ros, type_, msg, PACKS.get(pack)
        self._paths = [FieldPath(one) for one in SEVERAL.split(path)] if path else []
        self._ask, self._asked, self._waits = ask, -np.inf, False
        self._request: Publish | None = None
        self._node: RosNode | None = None
        self._arrived: deque[tuple[str, NDArray[np.generic], float | None]] = deque()
        self._pads: Sequence[str] = ()
        self._rejected: Counter[str] = Counter()

    def open(self, pads: Sequence[str]) -> None:
        """Raises DriverError if nobody publishes the topic, if its type is not known, or if there is not one
        path for each of the `pads`."""
        if len(pads) != max(len(self._paths), 1):
            raise DriverError(
                f"{len(self._paths) or 'no'} paths for {len(pads)} patches; valid: one for each patch, as in "
                f"array:ros2://{self.name},patch=A/B,path=data[0:64]/data[64:128]"
            )
        self._pads = pads
        node = self._node = self._ros.open()
        self._rejected = Counter()
        end = time.monotonic() + DISCOVERY
        while not (offered := node.types_of(self.name)) and time.monotonic() < end:
            time.sleep(0.02)
        if not offered and not self._type:
            seen = list_topics(node.topics(), like=self.name)
            raise DriverError(
                f"nobody publishes {self.name} ({self._ros.where_seen()}); seen: {seen}; start the "
                f"publisher, {self._ros.hint}, or name the type with type= to wait for it"
            )
        if self._type and offered and self._type not in offered:
            raise DriverError(
                f"{self.name} is {', '.join(offered)}; valid: type={offered[0]}, or leave it out"
            )
        self._type = self._type or offered[0]
        node.watch(self.name, self._type, self._msg, self._take, keep=4)
        self._request = node.advertise(self._ask, EMPTY) if self._ask else None

    def read(self, wait: float) -> list[tuple[str, NDArray[np.generic], float | None]]:
        """Pad, values and stamp [s] from messages that arrived within `wait` [s]; None for one without a
        stamp.

        Raises FrameError if none arrived that could be used since one that couldn't.
        """
        node = self._node
        if node is None:
            raise ConnectionResetError("not open")
        end = time.monotonic() + wait
        while True:
            self._ask_for_one()
            node.poll()
            if found := [self._arrived.popleft() for _ in range(len(self._arrived))]:
                return found
            if fresh := node.rejected - self._rejected:
                self._rejected = node.rejected.copy()
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
            yield Finding(Level.OK, self.name, f"{', '.join(offered)} in {self._ros.where_seen()}")
            return
        seen = list_topics(node.topics(), like=self.name)
        said = f"nobody publishes it now ({self._ros.where_seen()}); seen: {seen}"
        yield Finding(Level.WARNING, self.name, said, f"start its publisher, or {self._ros.hint}")

    def close(self) -> None:
        if self._node is not None:
            self._node.close()
            self._node = None

    def _ask_for_one(self) -> None:
        now = time.monotonic()
        if self._request is not None and now - self._asked >= (AGAIN if self._waits else OFTEN):
            self._asked, self._waits = now, True
            self._request((0,))

    def _take(self, message: Mapping[str, Any]) -> None:
        """What one path does not find keeps no other pad from its values."""
        self._waits = False
        stamp, fault = _stamp_of(message), None
        for number, pad in enumerate(self._pads):
            try:
                self._arrived.append((pad, self._values(message, number), stamp))
            except FrameError as error:
                fault = fault or error
        if fault is not None:
            raise fault

    def _values(self, message: Mapping[str, Any], number: int) -> NDArray[np.generic]:
        path = self._paths[number] if self._paths else None
        if self._type == CLOUD:
            names = [str(field["name"]) for field in message["fields"]]
            usual = ["raw"] if "raw" in names else [name for name in names if name not in PLACES]
            return raw_of_cloud(message, path.text if path else usual[0] if len(usual) == 1 else "raw")
        path = path or DATA
        values = path.values(message)
        if self._pack is None:
            return values
        data = values.astype(np.uint8).tobytes()
        if len(data) % self._pack.itemsize:
            raise FrameError(f"{path.text}: {len(data)} bytes; valid: two for each value")
        return np.frombuffer(data, self._pack)


def _stamp_of(message: Mapping[str, Any]) -> float | None:
    """The stamp [s] of the message's header; None without one, and for one that was left at 0."""
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    if not isinstance(stamp, Mapping):
        return None
    return float(stamp["sec"]) + 1e-9 * float(stamp["nanosec"]) or None
