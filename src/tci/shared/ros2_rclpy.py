"""A ROS 2 node that uses the rclpy of the installed ROS 2, with the middleware (rmw) that is configured for
this ROS 2."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import rclpy
import rclpy.context
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tci.errors import DriverError
from tci.recording.rosmsg.cdr import MessageType, decode, encode
from tci.shared.ros_node import LIFESPAN, Callback, Publish, RosNode

BEFORE_RANGES = ("foxy", "galactic", "humble")
"""Distributions of ROS 2 that have ROS_LOCALHOST_ONLY instead of ROS_AUTOMATIC_DISCOVERY_RANGE."""


class RclpyNode(RosNode):
    """A node of rclpy in a context of its own. A separate thread passes received messages to the
    callbacks."""

    def __init__(self, name: str, namespace: str = "", *, reach: str = "LOCALHOST") -> None:
        """Opens the node. `reach` is the range in which nodes discover each other, a value of
        ROS_AUTOMATIC_DISCOVERY_RANGE. Raises DriverError if rclpy refuses the value of an environment
        variable.
        """
        super().__init__()
        self._context = rclpy.context.Context()
        try:
            with _ranging(reach):
                rclpy.init(context=self._context, signal_handler_options=rclpy.SignalHandlerOptions.NO)
            self._node = rclpy.create_node(
                name, namespace=namespace or "/", context=self._context, enable_rosout=False,
                start_parameter_services=False,
            )  # fmt: skip
        except Exception as error:  # rclpy has no common base class of its errors
            raise DriverError(f"no ROS 2 node: {error}") from error
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._thread.start()
        self._open = True

    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        qos = _qos(1, latched=latched, reliable=True)
        # latched messages have no lifespan, since a lifespan would depend on the reader's clock
        if not latched:
            qos.lifespan = Duration(seconds=LIFESPAN)
        publisher = self._node.create_publisher(_type(kind), topic, qos)

        def send(values: Sequence[Any]) -> None:
            publisher.publish(encode(kind, values))

        return send

    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        def received(data: bytes) -> None:
            self._pass_on(topic, lambda: decode(kind, data), callback)

        qos = _qos(keep, latched=latched, reliable=latched)
        self._node.create_subscription(_type(kind), topic, received, qos, raw=True)

    def types_of(self, topic: str) -> tuple[str, ...]:
        return tuple(sorted({info.topic_type for info in self._node.get_publishers_info_by_topic(topic)}))

    def topics(self) -> dict[str, tuple[str, ...]]:
        return {name: tuple(sorted(kinds)) for name, kinds in self._node.get_topic_names_and_types()}

    def supports(self, kind: MessageType) -> bool:
        try:
            _type(kind)
        except DriverError:
            return False
        return True

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        self._executor.shutdown(timeout_sec=1.0)
        self._node.destroy_node()
        self._context.try_shutdown()
        self._thread.join(timeout=1.0)

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return


@contextmanager
def _ranging(reach: str) -> Iterator[None]:
    """Limits the discovery of nodes in the `with` block to `reach`, a value of ROS_AUTOMATIC_DISCOVERY_RANGE,
    by environment variables.

    rclpy reads these variables only at the start of a context.
    """
    names = {"ROS_AUTOMATIC_DISCOVERY_RANGE": reach}
    if reach == "LOCALHOST" and os.environ.get("ROS_DISTRO") in BEFORE_RANGES:
        names["ROS_LOCALHOST_ONLY"] = "1"
    before = {name: os.environ.get(name) for name in names}
    os.environ |= names
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _type(kind: MessageType) -> Callable[[], Any]:
    """Returns the class of messages of `kind` from the installed ROS package.

    Raises DriverError if the package is missing.
    """
    package, _, name = kind.name.split("/")
    try:
        found: Callable[[], Any] = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise DriverError(f"this ROS 2 lacks {kind.name}; install the package {package}") from error
    return found


def _qos(depth: int, *, latched: bool, reliable: bool) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
