"""A driver by any ROS: to a robot that another TCI process shows, or to one that speaks ROS itself.

Which of them it is shows when it opens. From a TCI process come states, and it gets orders (`remote`); its
own gate makes the motion. A robot that speaks ROS itself gets the set-points of the gate here.
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
from tci.drivers.ros.messages import BYTES, NO_LAYOUT
from tci.drivers.ros.names import Names
from tci.drivers.ros.native import NativeRobot
from tci.drivers.ros.node import Hear, Publish, RosNode
from tci.errors import DriverError, FrameError
from tci.gate.safe_command import SafeCommand
from tci.messages import Reading
from tci.recording.schemas import JOINTS
from tci.robot.description import Robot

WAIT = 5.0
"""How long [s] a driver waits for the robot's joints when it opens. Ours."""
STATE_WAIT = 0.5
"""How long [s] joints are offered and states are not, before the robot counts as one of ROS. Ours."""
SKIN_WAIT = 2.0
"""How long [s] it then waits for patches that have sent nothing yet. Ours."""


class RosDriver(RemoteDriver):
    """A driver of a robot by a node of any ROS, which is closed with it."""

    def __init__(
        self, robot: Robot, node: RosNode, *, middleware: str, namespace: str, arm: bool, wait: float = WAIT
    ) -> None:
        """Raises DriverError when no joints come within `wait` [s]."""
        self._node = node
        try:
            super().__init__(robot, middleware=middleware, place=namespace or "/", arm=arm)
            names = self._names = Names(robot, middleware, namespace)
            now = self.clock.now
            self._native: NativeRobot | None = None
            self._away = False
            self._received: dict[str, bytes] = {}
            node.subscribe(names.state, BYTES, self._keep(names.state))
            for patch in robot.patches:
                topic = names.frames(patch.name)
                node.subscribe(topic, BYTES, self._keep(topic))
            self._out: Publish | None = None
            self._why = ""
            if not self._is_tci(wait):
                self._be_only_gate(f"{middleware}:{namespace}:{robot.name}")
                self._native = NativeRobot(robot, node, names, arm=arm, period=self.period, now=now)
                self._wait_for_joints(wait)
            elif arm:
                self._out = node.advertise(names.orders, BYTES)
                self._be_heard(wait)
        except BaseException:
            node.close()
            raise

    @property
    def is_native(self) -> bool:
        """Whether the robot speaks ROS itself."""
        return self._native is not None

    def diagnose(self) -> tuple[Finding, ...]:
        whose = "a robot's own topics" if self.is_native else "a TCI process"
        found = [Finding(Level.OK, "dialect", f"{whose} in namespace {self.place}")]
        for reason, count in self._node.rejected.items():
            found.append(Finding(Level.WARNING, "messages", f"{count} of no use: {reason}"))
        for node in sorted(self._node.silent):
            advice = "if it died: rosnode cleanup; if not: can its name be resolved here?"
            found.append(Finding(Level.NOTE, "node", f"{node} is registered and does not answer", advice))
        return tuple(found)

    def _receive(self) -> Reading:
        if self._native is None:
            return super()._receive()
        self._node.poll()
        reading = self._native.reading()
        was_away, self._away = self._away, self.clock.now() - reading.joints.stamp > self.gate.stale_after
        if was_away and not self._away:  # it may stand elsewhere now, and gets nothing that was meant before
            self.gate.drop()
            self._native.forget()
        return reading

    def _send(self, safe: SafeCommand) -> None:
        if not self._native:
            super()._send(safe)
        elif not self._away or np.any(
            safe.velocity
        ):  # it stops, whether it tells or not; then it is left alone
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
        assert self._out is not None  # armed
        self._out((NO_LAYOUT, np.frombuffer(orders_bytes(self.robot, orders), dtype=np.uint8)))

    def _nobody(self) -> str:
        return self._why or "its process sends no states"

    def _keep(self, topic: str) -> Hear:
        def keep(fields: Mapping[str, Any]) -> None:
            self._received[topic] = bytes(fields["data"])  # the latest of each topic

        return keep

    def _where_else(self) -> str:
        """How a robot that nobody publishes may be found after all."""
        return ""

    def _is_tci(self, wait: float) -> bool:
        """Whether a TCI process shows the robot. Raises DriverError when nobody does anything."""
        begin = time.monotonic()
        plain_since = np.inf
        while True:
            self._node.poll()
            if self._received:
                self._wait()
                return True
            # A TCI process offers its states before its joints, so this is the order to look in.
            joints = JOINTS.name in self._node.types_of(self._names.joints)
            shown = bool(self._node.types_of(self._names.state))
            now = time.monotonic()
            plain_since = min(plain_since, now) if joints and not shown else np.inf
            if now - plain_since > STATE_WAIT:
                return False
            if now - begin > (max(wait, STARTING) if shown else wait):
                silent = f"{self._names.state} is offered, but {self._nobody()}"
                raise DriverError(silent if shown else self._why_not(wait))
            time.sleep(0.01)

    def _be_heard(self, seconds: float) -> None:
        """Wait until the robot's process knows this one: topics of ROS take a moment to be connected."""
        end = time.monotonic() + seconds
        while True:
            self._take()
            assert self._state is not None  # waited for
            if any(commander.client == self.client for commander in self._state.commanders):
                return
            if time.monotonic() > end:
                raise DriverError(f"the process of {self.robot.name} does not hear {self._names.orders}")
            self._say(self._state, "", leaving=False)
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
            advice = f"is the robot on, and in this ROS domain and namespace?{self._where_else()}"
            return f"nobody publishes {topic} {where}{silent}; {advice}"
        if JOINTS.name not in offered:
            return f"{topic} is {', '.join(offered)}; valid: {JOINTS.name}"
        if self._node.rejected:
            return f"{topic} is of no use: {next(iter(self._node.rejected))}"
        missing = self._native.joints.missing if self._native else []
        if not missing or len(missing) == len(self.robot.servos):
            return f"{topic} is offered, but no joint of {self.robot.name} came {where}"
        return f"{topic} lacks joints of {self.robot.name} {where}: {', '.join(missing)}"
