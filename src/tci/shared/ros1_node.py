"""A node of ROS 1 (noetic), through the rospy that is installed on the machine.

rospy is not on PyPI. Install it with ROS 1 or, on Debian, with `apt-get install python3-rospy
python3-sensor-msgs python3-trajectory-msgs`. TCI looks for rospy in the folders of ROS 1 and of Debian.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from http.client import HTTPConnection
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlsplit
from xmlrpc.client import ServerProxy, Transport

import numpy as np

from tci.drivers.remote.hosts import numeric
from tci.errors import DriverError, MissingExtraError
from tci.recording.rosmsg.cdr import NUMBERS, MessageType
from tci.shared.own_sockets import ConnectionMonitor, listening
from tci.shared.ros_node import Callback, Publish, RosNode
from tci.shared.ros_trees import Trees
from yarpwire.connection_limit import MOST

PLACES = ("/opt/ros/noetic/lib/python3/dist-packages", "/usr/lib/python3/dist-packages")
"""Folders in which ROS 1 and Debian install their Python packages."""
HOW = (
    "install ROS 1, or on Debian: apt-get install python3-rospy python3-sensor-msgs python3-trajectory-msgs, "
    "with a Python of the system's version"
)
MASTER_TIMEOUT = 3.0
"""Time [s] within which the ROS master or a node must answer. Assumed: on a local network, both answer within
a second."""
BUFFER = 1 << 20
"""Largest number of bytes that a subscriber reads in one step. If many messages wait, the subscriber reads
them all in one step and uses only the newest. Assumed: hundreds of messages have fewer bytes."""
MASTER = "http://localhost:11311"
"""Address of the ROS master if ROS_MASTER_URI is not set."""
NEEDED = ("rospy", "sensor_msgs.msg", "trajectory_msgs.msg")
"""Python modules of ROS 1 that are needed. The other modules that TCI imports are installed together with
rospy."""
NAMES = ("ROS_IP", "ROS_HOSTNAME")
"""Environment variables with the name under which other machines reach this machine."""
FLUSH, SENT = 0.2, 0.005
"""Waiting times [s] when a node closes. The node waits at most FLUSH until its message queues are empty, then
SENT until the network has the messages. Assumed: shorter times may lose the last message, longer times delay
the end of a program."""


def load_rospy() -> Any:
    """Imports the needed modules of ROS 1 and returns rospy. Raises MissingExtraError if a module is
    missing."""
    if find_spec("rospy") is None:
        for place in PLACES:
            if Path(place, "rospy").is_dir():
                sys.path.append(place)  # appended, so that it replaces none of the installed packages
                break
    try:
        found, *_ = map(import_module, NEEDED)
    except ModuleNotFoundError as error:
        raise MissingExtraError("the driver 'ros1'", str(error.name), HOW) from error
    return found


class Ros1Node(RosNode):
    """Access to the ROS 1 node of this process. rospy has one node per process, which ends with the
    process."""

    def __init__(self, name: str) -> None:
        """Starts the process's node if there is none yet.

        Raises DriverError if no ROS master answers, MissingExtraError if rospy is not installed.
        """
        super().__init__()
        _stay_here()
        self._rospy = load_rospy()
        self._master = import_module("rosgraph").Master("/tci")
        before = socket.getdefaulttimeout()
        socket.setdefaulttimeout(MASTER_TIMEOUT)
        try:
            self._master.getPid()
        except Exception as error:
            uri = self._master.master_uri
            raise DriverError(
                f"no ROS master at {uri} ({error}); start roscore, or set ROS_MASTER_URI"
            ) from error
        finally:
            socket.setdefaulttimeout(before)
        if not self._rospy.core.is_initialized():
            others = listening()
            self._rospy.init_node(name, anonymous=True, disable_signals=True)
            self._serve_in_threads()
            for port in listening() - others:
                ConnectionMonitor(port)  # the monitor and the node run until the end of this process
        self._topics: list[Any] = []

    def _serve_in_threads(self) -> None:
        """Makes rospy accept each connection in a thread of its own.

        Otherwise one client that sends nothing would block all new connections.
        """
        server = import_module("rospy.impl.tcpros_base").init_tcpros_server()  # returns the existing server
        server.start_server()
        tcp = server.tcp_ros_server
        greet = tcp.inbound_handler
        tcp.inbound_handler = lambda *found: Thread(target=greet, args=found, daemon=True).start()
        tcp.server_sock.listen(MOST)

    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        publisher = self._rospy.Publisher(topic, _type(kind), queue_size=1, latch=latched, tcp_nodelay=True)
        self._topics.append(publisher)

        def send(values: Sequence[Any]) -> None:
            try:
                publisher.publish(_trees(kind).grow(kind, values))
            except self._rospy.ROSException as error:
                raise DriverError(f"{topic} can't be sent: {error}") from error

        return send

    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        def received(message: Any) -> None:
            self._pass_on(topic, partial(_trees(kind).flatten, kind, message), callback)

        subscriber = self._rospy.Subscriber(
            topic, _type(kind), received, queue_size=keep, buff_size=BUFFER, tcp_nodelay=True
        )
        self._topics.append(subscriber)

    def watch(self, topic: str, type_: str, definitions: str, callback: Callback, *, keep: int = 1) -> None:
        """Takes the definition that the publisher sends, so it needs no package and no `definitions`."""

        def received(message: Any) -> None:
            self._pass_on(topic, partial(_fields_of_any, message), callback)

        subscriber = self._rospy.Subscriber(
            topic, self._rospy.AnyMsg, received, queue_size=keep, buff_size=BUFFER, tcp_nodelay=True
        )
        self._topics.append(subscriber)

    def topics(self) -> dict[str, tuple[str, ...]]:
        found: dict[str, tuple[str, ...]] = {}
        with suppress(Exception):  # without an answer of the master, the result is empty
            found = {topic: (_ros2_name(type_),) for topic, type_ in self._master.getPublishedTopics("")}
        return found

    def types_of(self, topic: str) -> tuple[str, ...]:
        nodes: Sequence[str] = ()
        with suppress(Exception):  # without an answer of the master, the result is empty
            nodes = dict(self._master.getSystemState()[0]).get(topic, ())
        found = {dict(self._publications(node)).get(topic, "") for node in nodes} - {""}
        return tuple(sorted(map(_ros2_name, found)))

    def _publications(self, node: str) -> Sequence[tuple[str, str]]:
        """Asks a node for its published topics and returns each topic with its type. The result is empty if
        the node does not answer.

        The master's list is not used, since it also contains nodes that were killed.
        """
        uri = ""
        with suppress(Exception):
            uri = self._master.lookupNode(node)
            with ServerProxy(uri, transport=_Brief()) as asked:
                answer: Any = asked.getPublications("/tci")
                return [(topic, type_) for topic, type_ in answer[2]]
        self.silent.add(f"{node} ({uri})")
        return ()

    def close(self) -> None:
        self._flush()
        while self._topics:
            self._topics.pop().unregister()
        self._master = None  # deleting the proxy closes the connection to the master

    def _flush(self) -> None:
        """Waits until rospy's threads have sent all published messages. Otherwise, closing the node would
        lose these messages."""
        publishers = [topic for topic in self._topics if isinstance(topic, self._rospy.Publisher)]
        queued = [connection for publisher in publishers for connection in publisher.impl.connections]
        until = time.monotonic() + FLUSH
        while any(getattr(one, "_queue", ()) for one in queued) and time.monotonic() < until:
            time.sleep(1e-3)
        if queued:
            time.sleep(SENT)


def _stay_here() -> None:
    """Makes rospy listen on the loopback interface only, unless the user has chosen a network.

    A user chooses a network by ROS_IP, by ROS_HOSTNAME, or by a remote master in ROS_MASTER_URI. Otherwise
    this function sets ROS_IP to 127.0.0.1.
    """
    if is_here() and not any(map(os.environ.get, NAMES)):
        os.environ["ROS_IP"] = "127.0.0.1"


def is_here() -> bool:
    """Returns True if other machines can't reach the node, because ROS_MASTER_URI, ROS_IP and ROS_HOSTNAME
    are loopback addresses or not set."""
    asked = urlsplit(os.environ.get("ROS_MASTER_URI") or MASTER).hostname, *map(os.environ.get, NAMES)
    return all(numeric(host) == "127.0.0.1" for host in asked if host)


class _Brief(Transport):
    """HTTP transport whose calls end with an error if no answer arrives within some seconds."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = MASTER_TIMEOUT
        return connection


def where_seen() -> str:
    """Where nodes are looked for, in words."""
    return f"ROS master {os.environ.get('ROS_MASTER_URI') or MASTER}"


def _ros2_name(type_: str) -> str:
    return type_.replace("/", "/msg/", 1)


def _fields_of_any(message: Any) -> dict[str, Any]:
    """The fields of a message that was received as rospy's AnyMsg."""
    header = message._connection_header
    found = _class_of(header["type"], header["message_definition"])()
    found.deserialize(message._buff)
    return _fields(found)


@cache
def _class_of(type_: str, definition: str) -> Any:
    return import_module("genpy.dynamic").generate_dynamic(type_, definition)[type_]


def _fields(message: Any) -> dict[str, Any]:
    return {
        name: _value(type_, getattr(message, name))
        for name, type_ in zip(message.__slots__, message._slot_types, strict=True)
    }


def _value(type_: str, value: Any) -> Any:
    item, _, many = type_.partition("[")
    if many:
        if isinstance(value, bytes):
            return np.frombuffer(value, np.uint8)
        return np.array(value) if item in NUMBERS else [_value(item, one) for one in value]
    if item in ("time", "duration"):
        return {"sec": value.secs, "nanosec": value.nsecs}
    return _fields(value) if hasattr(value, "_slot_types") else value


@cache
def _type(kind: MessageType) -> Any:
    """Returns rospy's Python class for messages of `kind`.

    The class is the one that is installed with ROS, so that the checksums of publisher and subscriber are
    equal. Only classes of the package tci_msgs are generated, and need no installation.
    """
    package, _, name = kind.name.split("/")
    if package != "tci_msgs":
        return _installed(f"{package}/{name}")
    own = kind.definition.partition("=" * 80)[0].replace("std_msgs/Header", "Header")
    header = "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    found: dict[str, Any] = import_module("genpy.dynamic").generate_dynamic(
        f"{package}/{name}", f"{own}{'=' * 80}\n{header}"
    )
    return found[f"{package}/{name}"]


@cache
def _installed(type_: str) -> Any:
    """Returns the class of the message type `package/Name` from an installed package."""
    package, _, name = type_.partition("/")
    if package == "builtin_interfaces":
        return getattr(import_module("genpy"), name)
    return getattr(import_module(f"{package}.msg"), name)


@cache
def _trees(kind: MessageType) -> Trees:
    """Returns an object that converts between rospy's messages of `kind` and the values of their fields."""

    def new(type_: str, fields: Mapping[str, Any]) -> Any:
        return (_installed(type_) if type_ else _type(kind))(**fields)

    return Trees(new, getattr, ("secs", "nsecs"))
