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
from tci.errors import DriverError
from tci.recording.rosmsg.cdr import MessageType
from tci.robot.description import Robot
from tci.shared.ros_node import Callback, Publish, RosNode, namespace_of
from tci.shared.ros_trees import Trees
from tci.wires.ros.driver import WAIT, RosDriver
from tci.wires.ros.server import RosServer

PORT = 9090
"""Default port of the server."""
TIMEOUT = 5.0
"""Time [s] within which a server must answer. Assumed: on a local network, servers answer within a second."""
RETRY = 5.0
"""Longest time [s] between two attempts to reconnect. roslibpy's default is an hour, which is too long for a
robot. Assumed: an attempt every few seconds costs little."""
MOST_WAITING = 1 << 20
"""Largest number of bytes that may wait until a slow server reads them. While more bytes wait, this node
drops new messages. Assumed: the limit keeps the memory and the delay of messages small."""
ADDRESS = re.compile(
    r"(?P<host>[A-Za-z0-9_.-]*|\[[0-9a-fA-F:]+\])(:(?P<port>[0-9]{1,5}))?(?P<namespace>/.*)?"
)
TIMES = {"secs": "sec", "nsecs": "nanosec"}
"""Names of the two fields in a message's time: the keys are the names in ROS 1, the values the names in ROS
2."""


class RosbridgeNode(RosNode):
    """A client of a rosbridge server. roslibpy's thread passes received messages to the callbacks."""

    def __init__(self, host: str, port: int) -> None:
        """Connects. Raises DriverError if no rosbridge server with rosapi answers at `host` and `port`."""
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
            # ROS 1 and ROS 2 report the time with different field names, so the answer shows which ROS this
            # is.
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
        """Sends a message. Drops it if there is no connection or the server reads too slowly, so that old
        commands are never sent later. Call this method only in roslibpy's thread.
        """
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
        # these types work only if the server has the package tci_msgs
        return not kind.name.startswith("tci_msgs/")

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
        factory._stop = True  # otherwise the factory continues to reconnect
        # also closes a connection that is opening
        factory.on_ready(lambda connection: connection.send_close())
        if connected:
            gone.wait(TIMEOUT)

    def _ask(self, name: str, type_: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Calls the service `name` of the node rosapi, and returns the answer. Raises DriverError if rosapi
        does not answer."""
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
        """Connects to the robot. Raises DriverError if no joints arrive within `wait` [s]."""
        host, port, namespace = parse(address)
        node = RosbridgeNode(host, port)
        super().__init__(robot, node, middleware="rosbridge", namespace=namespace, arm=arm, wait=wait)


class RosbridgeServer(RosServer):
    """A server that makes a robot available in the ROS system behind a rosbridge server."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Connects. Raises DriverError if no rosbridge server with rosapi answers at `address`."""
        host, port, namespace = parse(address)
        node = RosbridgeNode(host, port)
        super().__init__(driver, address, node, middleware="rosbridge", namespace=namespace)


def parse(address: str) -> tuple[str, int, str]:
    """Returns host, port and namespace of an address. Raises DriverError for an invalid address."""
    found = ADDRESS.fullmatch(address)
    if found is None or int(found["port"] or PORT) > 65535:
        raise DriverError(
            f"{address!r} is no address; valid: rosbridge:HOST:PORT/NAMESPACE, each may be left out"
        )
    return found["host"] or "127.0.0.1", int(found["port"] or PORT), namespace_of(found["namespace"] or "")


def _short(kind: MessageType) -> str:
    """Returns the type's name as `package/Name`, which rosbridge accepts in ROS 1 and in ROS 2."""
    return kind.name.replace("/msg/", "/")


def _new(type_: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the fields of a message as a JSON object, with bytes encoded in base64."""
    return {
        name: base64.b64encode(value).decode() if isinstance(value, bytes) else value
        for name, value in fields.items()
    }


def _get(found: Mapping[str, Any], name: str) -> Any:
    return found[name] if name in found else found[TIMES.get(name, name)]
