"""A driver over any kind of ROS, for robots that a TCI process serves and for robots with their own ROS
topics. A new driver detects which of these two kinds the robot is. If a TCI process serves the robot, that
process sends states and accepts orders (see `tci.drivers.remote`), and its gate plans the motion. If the
robot has its own ROS topics, the gate in the driver's process plans the motion, and the driver sends
set-points to the robot.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.remote.driver import STARTING, RemoteDriver
from tci.drivers.remote.encoding import orders_bytes, to_skin, to_state
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.errors import DriverError, FrameError
from tci.gate.safe_command import SafeCommand
from tci.messages import Reading
from tci.recording.schemas import CLOUD, JOINTS, SKIN
from tci.robot.description import Robot
from tci.shared.ros_node import Callback, Publish, RosNode, list_topics
from tci.wires.ros.messages import BYTES, NO_LAYOUT
from tci.wires.ros.names import Names
from tci.wires.ros.native import NativeRobot

WAIT = 5.0
"""Time [s] that a new driver waits for the robot's joint data. Assumed: discovery of nodes takes a few
seconds."""
STATE_WAIT = 0.5
"""Time [s] to wait for the topic of states that a TCI process offers, after the topic of joints has appeared.
If no such topic appears, the robot counts as one with its own ROS topics. Assumed: a TCI process offers the
topic of states first, so it appears much sooner."""
SKIN_WAIT = 2.0
"""Longest time [s] that a new driver waits for the first frame of every patch, if the robot has its own ROS
topics. Assumed: every patch has a shorter period than this."""


class RosDriver(RemoteDriver):
    """A driver that uses a node of ROS 1, ROS 2 or rosbridge. `close` also closes the node."""

    def __init__(
        self, robot: Robot, node: RosNode, *, middleware: str, namespace: str, arm: bool, wait: float = WAIT
    ) -> None:
        """Connects to the robot. Raises DriverError if no joints arrive within `wait` [s]."""
        self._node = node
        try:
            super().__init__(robot, middleware=middleware, place=namespace or "/", arm=arm)
            names = self._names = Names(robot, middleware, namespace)
            now = self.clock.now
            self._native: NativeRobot | None = None
            self._away = False
            self._received: dict[str, bytes] = {}
            node.subscribe(names.state, BYTES, self._keep(names.state))
            for patch in robot.skin:
                topic = names.frames(patch.name)
                node.subscribe(topic, BYTES, self._keep(topic))
            self._out: Publish | None = None
            self._why = ""
            if not self._is_tci(wait):
                self._use_full_gate(f"{middleware}:{namespace}:{robot.name}")
                self._native = NativeRobot(robot, node, names, arm=arm, period=self.period, now=now)
                self._wait_for_joints(wait)
            elif arm:
                self._out = node.advertise(names.orders, BYTES)
                self._wait_for_discovery(wait)
        except BaseException:
            node.close()
            raise

    @property
    def is_native(self) -> bool:
        """True if the robot has its own ROS topics, False if a TCI process serves the robot."""
        return self._native is not None

    def diagnose(self) -> tuple[Finding, ...]:
        whose = "a robot's own topics" if self.is_native else "a TCI process"
        found = [Finding(Level.OK, "dialect", f"{whose} in namespace {self.place}")]
        for reason, count in self._node.rejected.items():
            found.append(Finding(Level.WARNING, "messages", f"{count} unusable: {reason}"))
        for node in sorted(self._node.silent):
            advice = "if it has ended: rosnode cleanup; else make its host name known to this machine"
            found.append(Finding(Level.NOTE, "node", f"{node} is registered and does not answer", advice))
        found += self._unfit_skin()
        return tuple(found)

    def _unfit_skin(self) -> Iterator[Finding]:
        """Patches of which nothing has arrived, and what is published at their topics instead."""
        for patch, arrivals in (self._native.skin if self._native else {}).items():
            if arrivals.latest is not None:
                continue
            frames, points = self._names.skin(patch), self._names.points(patch)
            offered = {topic: self._node.types_of(topic) for topic in (frames, points)}
            other = [kind for kind in offered[frames] if kind != SKIN.name]
            if other:
                said = (
                    f"{frames} is {', '.join(other)}; valid: {SKIN.name} there, or {CLOUD.name} at {points}"
                )
                advice = f'or take its numbers: --via "... + array:ros2://{frames},patch={patch}"'
            elif any(offered.values()):
                said, advice = f"no frame of {frames} arrived yet", "see that its publisher sends"
            else:
                said = f"nobody publishes {frames} or {points}{self._seen(frames)}"
                advice = "start the publisher, or give the patch its <address> in the binding"
            yield Finding(Level.WARNING, patch, said, advice)

    def _receive(self) -> Reading:
        if self._native is None:
            return super()._receive()
        self._node.poll()
        reading = self._native.reading()
        was_away, self._away = self._away, self.clock.now() - reading.joints.stamp > self.gate.stale_after
        if was_away and not self._away:  # the robot's posture may have changed
            self.gate.drop()
            self._native.forget()
        return reading

    def _send(self, safe: SafeCommand) -> None:
        if not self._native:
            super()._send(safe)
        # if no data arrives, send only until the commanded speeds are zero
        elif not self._away or np.any(safe.velocity):
            self._native.send(safe)

    def _halt(self) -> None:
        super()._halt()
        if self._native:
            self._native.forget()

    def _close(self) -> None:
        super()._close()
        self._node.close()

    def _poll(self) -> Iterator[State | SessionFrame]:
        self._node.poll()
        while self._received:
            topic, data = self._received.popitem()
            try:
                is_state = topic == self._names.state
                yield to_state(self.robot, data) if is_state else to_skin(self.robot, data)
            except FrameError as error:
                self.rejected += 1
                self._why = str(error)

    def _put(self, orders: Orders) -> None:
        assert self._out is not None  # armed drivers have a publisher
        self._out((NO_LAYOUT, np.frombuffer(orders_bytes(self.robot, orders), dtype=np.uint8)))

    def _why_silent(self) -> str:
        return self._why or "its process sends no states"

    def _keep(self, topic: str) -> Callback:
        def keep(fields: Mapping[str, Any]) -> None:
            self._received[topic] = bytes(fields["data"])  # keeps the latest message of each topic

        return keep

    def _seen(self, like: str) -> str:
        """The topics that there are, for an error message."""
        topics = self._node.topics()
        return f"; seen: {list_topics(topics, like=like)}" if topics else ""

    def _where_else(self) -> str:
        """Returns an addition to the error message that no node publishes the robot's joints."""
        return ""

    def _is_tci(self, wait: float) -> bool:
        """Returns True if a TCI process serves the robot, False if the robot has its own ROS topics.

        Raises DriverError if no node publishes the joints within `wait` [s], if their topic has another type
        than JointState, or if a TCI process offers its topics but sends no state.
        """
        begin = time.monotonic()
        plain_since = np.inf
        while True:
            self._node.poll()
            if self._received:
                self._wait()
                return True
            # The joints are checked first, since a TCI process offers the topic of states before the topic of
            # joints.
            offered = self._node.types_of(self._names.joints)
            shown = bool(self._node.types_of(self._names.state))
            now = time.monotonic()
            plain_since = min(plain_since, now) if offered and not shown else np.inf
            if now - plain_since > STATE_WAIT:
                if JOINTS.name not in offered:
                    raise DriverError(self._why_not(wait))
                return False
            if now - begin > (max(wait, STARTING) if shown else wait):
                silent = f"{self._names.state} is offered, but {self._why_silent()}"
                raise DriverError(silent if shown else self._why_not(wait))
            time.sleep(0.01)

    def _wait_for_discovery(self, seconds: float) -> None:
        """Waits until the robot's process receives orders from this process, since ROS takes time to connect
        the two. Raises DriverError after `seconds` [s]."""
        end = time.monotonic() + seconds
        while True:
            self._take()
            assert self._state is not None  # `_is_tci` has waited for it
            if any(commander.client == self.client for commander in self._state.commanders):
                return
            if time.monotonic() > end:
                raise DriverError(f"the process of {self.robot.name} does not receive {self._names.orders}")
            self._send_orders(self._state, None, leaving=False)
            time.sleep(self.period)

    def _wait_for_joints(self, seconds: float) -> None:
        assert self._native is not None
        begin = time.monotonic()
        while not self._native.complete:
            waited = time.monotonic() - begin
            if self._native.joints.latest is None and waited > seconds:
                raise DriverError(self._why_not(seconds))
            if self._native.joints.latest is not None and waited > SKIN_WAIT:
                return
            time.sleep(0.005)
            self._node.poll()

    def _why_not(self, seconds: float) -> str:
        topic, where = self._names.joints, f"within {seconds:g} s"
        offered = self._node.types_of(topic)
        if not offered:
            silent = "".join(f"; {node} is registered and does not answer" for node in self._node.silent)
            advice = f"check that the robot is on, and its ROS domain and namespace{self._where_else()}"
            return f"no node publishes {topic} {where}{silent}{self._seen(topic)}; {advice}"
        if JOINTS.name not in offered:
            return f"{topic} is {', '.join(offered)}; valid: {JOINTS.name}"
        if self._node.rejected:
            return f"the messages of {topic} are unusable: {next(iter(self._node.rejected))}"
        missing = self._native.joints.missing if self._native else []
        if not missing or len(missing) == len(self.robot.servos):
            return f"{topic} is offered, but no joint of {self.robot.name} arrived {where}"
        return f"{topic} lacks joints of {self.robot.name} {where}: {', '.join(missing)}"
