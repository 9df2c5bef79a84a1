"""`rosbridge:[HOST][:PORT][/NAMESPACE]`: robots in ROS behind a rosbridge server with rosapi, through
roslibpy."""

from __future__ import annotations

import base64
import json
import re
import threading
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import roslibpy

from tci.drivers.driver import Driver
from tci.drivers.ros.driver import WAIT, RosDriver
from tci.drivers.ros.node import Callback, Publish, RosNode, namespace_of
from tci.drivers.ros.server import RosServer
from tci.drivers.ros.tree import Trees
from tci.errors import DriverError
from tci.robot.description import Robot
from tci.rosmsg.cdr import MessageType

PORT = 9090
"""Default port of the server."""
TIMEOUT = 5.0
"""Time [s] that a server has to answer. Assumed: on a local network it answers within a second."""
RETRY = 5.0
"""Longest time [s] between two attempts to reconnect. Assumed: roslibpy's own value is an hour."""
MOST_WAITING = 1 << 20
"""Bytes that may wait for a slow server before it gets no more. Assumed: bounds memory, and the delay of what
is sent."""
ADDRESS = re.compile(
    r"(?P<host>[A-Za-z0-9_.-]*|\[[0-9a-fA-F:]+\])(:(?P<port>[0-9]{1,5}))?(?P<namespace>/.*)?"
)
TIMES = {"secs": "sec", "nsecs": "nanosec"}
"""Field names of times in ROS 1 and, as values, in ROS 2."""


class RosbridgeNode(RosNode):
    """A client of a rosbridge server. roslibpy's thread passes on what arrives."""

    def __init__(self, host: str, port: int) -> None:
        """Connects. Raises DriverError when nothing answers at `host` and `port`."""
        super().__init__()
        self._where = f"ws://{host}:{port}"
        self._ros = roslibpy.Ros(host, port, transport="asyncio")
        self._ros.factory.maxDelay = RETRY
        self._topics: list[Any] = []
        self._open = True
        try:
            self._ros.run(timeout=TIMEOUT)
        except Exception as error:
            self.close()
            raise DriverError(f"no rosbridge server at {self._where}: {error}") from error
        try:
            # Both kinds of ROS report the time; the names of its fields show which one this is.
            first = "secs" if "secs" in self._ask("get_time", "GetTime", {})["time"] else "sec"
        except DriverError:
            self.close()
            raise
        self._trees = Trees(_new, _get, ("secs", "nsecs") if first == "secs" else ("sec", "nanosec"))

    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        found = roslibpy.Topic(self._ros, topic, _short(kind), latch=latched, queue_size=1)
        found.advertise()
        self._topics.append(found)

        def send(values: Sequence[Any]) -> None:
            message = self._trees.grow(kind, values)
            said = {"op": "publish", "topic": topic, "msg": message, "latch": latched}
            self._ros.factory.manager.loop.call_soon_threadsafe(self._send_message, said)

        return send

    def _send_message(self, said: Mapping[str, Any]) -> None:
        """Sends a message in roslibpy's thread, which also opens and closes connections. Nothing is stored
        for later: old commands are never sent."""
        connection = self._ros.factory._proto
        if connection is not None and connection.transport.get_write_buffer_size() < MOST_WAITING:
            connection.sendMessage(json.dumps(said).encode())

    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        found = roslibpy.Topic(self._ros, topic, _short(kind), queue_length=keep)

        def received(message: Any) -> None:
            self._pass_on(topic, partial(self._trees.flatten, kind, message), callback)

        found.subscribe(received)
        self._topics.append(found)

    def types_of(self, topic: str) -> tuple[str, ...]:
        if not self._ask("publishers", "Publishers", {"topic": topic}).get("publishers"):
            return ()
        type_ = str(self._ask("topic_type", "TopicType", {"topic": topic}).get("type", ""))
        return (type_.replace("/msg/", "/").replace("/", "/msg/", 1),) if type_ else ()

    def supports(self, kind: MessageType) -> bool:
        return not kind.name.startswith("tci_msgs/")  # the server would need the package

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        for topic in self._topics:
            topic.unsubscribe()
            topic.unadvertise()
        self._topics.clear()
        gone, connected = threading.Event(), self._ros.is_connected
        self._ros.on("close", lambda _: gone.set())
        factory = self._ros.factory
        factory._stop = True  # otherwise it keeps trying to reconnect
        factory.on_ready(lambda connection: connection.send_close())  # even if it is just opening
        if connected:
            gone.wait(TIMEOUT)

    def _ask(self, name: str, type_: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Returns an answer of rosapi. Raises DriverError if there is none."""
        service = roslibpy.Service(self._ros, f"/rosapi/{name}", f"rosapi/{type_}")
        try:
            answer: Mapping[str, Any] = service.call(roslibpy.ServiceRequest(request), timeout=TIMEOUT)
        except Exception as error:
            raise DriverError(
                f"rosapi at {self._where} does not answer: {error}; start rosapi beside the rosbridge server"
            ) from error
        return answer


class RosbridgeDriver(RosDriver):
    """A driver of a robot behind a rosbridge server."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False, wait: float = WAIT) -> None:
        """Connects. Raises DriverError when no joints arrive within `wait` [s]."""
        host, port, namespace = parse(address)
        node = RosbridgeNode(host, port)
        super().__init__(robot, node, middleware="rosbridge", namespace=namespace, arm=arm, wait=wait)


class RosbridgeServer(RosServer):
    """Serves a robot in the ROS behind a rosbridge server."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Connects. Raises DriverError when nothing answers at `address`."""
        host, port, namespace = parse(address)
        node = RosbridgeNode(host, port)
        super().__init__(driver, address, node, middleware="rosbridge", namespace=namespace)


def parse(address: str) -> tuple[str, int, str]:
    """Returns host, port and namespace. Raises DriverError for an invalid address."""
    found = ADDRESS.fullmatch(address)
    if found is None or int(found["port"] or PORT) > 65535:
        raise DriverError(
            f"{address!r} is no address; valid: rosbridge:HOST:PORT/NAMESPACE, each may be left out"
        )
    return found["host"] or "127.0.0.1", int(found["port"] or PORT), namespace_of(found["namespace"] or "")


def _short(kind: MessageType) -> str:
    """Returns `package/Name`, which servers of both kinds of ROS accept."""
    return kind.name.replace("/msg/", "/")


def _new(type_: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a JSON object; bytes are encoded in base64."""
    return {
        name: base64.b64encode(value).decode() if isinstance(value, bytes) else value
        for name, value in fields.items()
    }


def _get(found: Mapping[str, Any], name: str) -> Any:
    return found[name] if name in found else found[TIMES.get(name, name)]
