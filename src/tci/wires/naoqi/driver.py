"""`naoqi://HOST`: driver of a NAO over the manufacturer's protocol."""

from __future__ import annotations

import socket
import warnings
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.drivers.remote.hosts import numeric
from tci.errors import DriverError
from tci.gate.gate import SafeCommand
from tci.messages import Reading
from tci.messages.clock import MonotonicClock
from tci.messages.frames import read_only
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.wires.naoqi import autonomy, words
from tci.wires.naoqi.diagnose import examine
from tci.wires.naoqi.poller import Poller
from tci.wires.naoqi.session import Services, answer, parse_address, service
from tci.wires.naoqi.stream import AHEAD, Stream

PATIENCE = 0.9
"""Fraction of a period for which `read` waits for a new reading before it returns the previous reading.
Assumed: the loop computes in the rest of the period."""
SWITCH_ON = 0.3
"""For this time [s] after a stiffness command, a servo counts as powered, although it may still report zero
stiffness. Assumed: several times `poller.SLOW`, the time between two stiffness requests."""
LAST = 10.0
"""Longest time [s] for which `close` waits for a reconnection in progress. The reconnection may switch
autonomous motions off, and `close` can switch them on again only after the reconnection. Assumed: a
reconnection takes at most twice as long as the switching of one motion may take (`autonomy.PATIENCE`)."""


class NaoqiDriver(Driver):
    """Driver of a NAO. The driver is armed only on request, and never while autonomous motions move the
    robot."""

    def __init__(
        self, robot: Robot, address: str = "", *, arm: bool = False, joints: bool = True, skin: bool = True
    ) -> None:
        """Connects to `address`, such as `//10.0.0.5` or `//nao@10.0.0.5`.

        With `joints=False`, the driver reads only the skin, and moves no joint. With `skin=False`, the driver
        does not read the skin.

        An armed driver does not connect to a robot with autonomous motions (for example autonomous life or
        breathing). With `?life=off` after the address, the driver switches these motions off until it is
        closed. After each reconnection, the driver checks autonomous motions again. If such a motion is on
        and the address lacks `?life=off`, the gate stops all joints. Raises DriverError if the robot can't be
        reached, does not fit the description, or has autonomous motions that are on.
        """
        self.where = parse_address(address)
        clock, lease_name = MonotonicClock(), f"naoqi:{numeric(self.where.host)}:{self.where.port}"
        super().__init__(
            # position and velocity mode are the same stream of target angles for the robot
            DriverInfo.of(
                robot, words.MIDDLEWARE, clock=clock, armed=arm, lease_name=lease_name, streams=True
            )
        )
        self._switched: dict[object, autonomy.Mover] = {}
        self._may_move: list[str] = []
        self._lookout: autonomy.Lookout | None = None
        self._restless: Reason | None = None
        self._generation = 0
        self._poller = Poller(
            robot, self.where, clock, joints=joints, skin=skin, greet=self._greet, glance=self._glance
        )
        try:
            self._stream = self._open_stream() if joints else None
            if arm:
                if not joints:
                    raise DriverError("a driver without joints can't be armed")
                self._quieten(self._poller.services)
        except BaseException:
            self._poller.close()
            raise
        self._on = np.full(len(robot.servos), -np.inf)

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        where = parse_address(address)
        steps = []
        try:
            with socket.create_connection((where.host, where.port), timeout=3.0):
                steps.append(Finding(Level.OK, "network", f"{where.host} listens on port {where.port}"))
        except OSError as error:
            advice = "switch the robot on and ping it; it speaks its address when its chest button is pressed"
            return (Finding(Level.FAULT, "network", f"{where.host}, port {where.port}: {error}", advice),)
        try:
            Services(where, motion=True).close()
        except DriverError as error:
            return (*steps, Finding(Level.FAULT, "NAOqi", str(error), "see docs/nao.md"))
        return (*steps, Finding(Level.OK, "NAOqi", f"a session at {where.url} with ALMotion and ALMemory"))

    def diagnose(self) -> tuple[Finding, ...]:
        self._check_open()
        return examine(self.robot, self._poller, self._stream)

    def _receive(self) -> Reading:
        sensed = self._poller.read(PATIENCE * self.period)
        if self._poller.generation != self._generation:
            self._generation = self._poller.generation
            if self._stream is not None:
                if self.armed:  # after a reconnection, the robot must not continue the last command
                    with suppress(RuntimeError):
                        motion = self._poller.services.motion
                        motion.killTasksUsingResources(self._poller.names, _async=True)
                self._stream.forget()
            self.gate.drop()
        if self._restless:
            self.gate.stop(self._restless)
        reading = sensed.reading
        switching = reading.joints.stamp - self._on < SWITCH_ON
        powered = read_only((sensed.stiffness > 0.0) | switching, np.bool_)
        return replace(reading, joints=replace(reading.joints, powered=powered))

    def _send(self, safe: SafeCommand) -> None:
        if self._poller.trouble or self._poller.generation != self._generation:
            # without a connection, joint data becomes too old, the gate holds, and no command is sent later
            return
        motion = self._poller.services.motion
        try:
            if safe.stiffness:
                names = [self._poller.names[servo] for servo in safe.stiffness]
                values = [float(share) for share in safe.stiffness.values()]
                # Angles must not arrive before the stiffness, since a servo without stiffness does not move.
                answer(motion.setStiffnesses(names, values, _async=True), "setStiffnesses", timeout=1.0)
                self._on[list(safe.stiffness)] = self.clock.now()
            assert self._stream is not None  # armed drivers have a stream
            measured = self._poller.latest.reading.joints.position
            self._stream.send(motion, safe, self.gate.ahead(AHEAD), measured, self.gate.ways_back)
        except (DriverError, RuntimeError) as error:
            if self._poller.services.session.isConnected():
                raise DriverError(f"{self.robot.name} does not take a command: {error}") from error

    def _halt(self) -> None:
        motion = self._poller.services.motion
        answer(motion.killTasksUsingResources(self._poller.names, _async=True), "killing tasks", timeout=1.0)
        assert self._stream is not None  # armed drivers have a stream
        self._stream.forget()

    def _close(self) -> None:
        if self.where.life == "off":
            self._poller.end(LAST)
            self._restore()
        self._poller.close()

    def _open_stream(self) -> Stream:
        """Creates the sender of target angles, with the joint limits that the robot reports. Raises
        DriverError if the robot lacks a joint of the description."""
        motion, names = self._poller.services.motion, self._poller.names
        limits = answer(motion.getLimits("Body", _async=True), "ALMotion.getLimits", timeout=3.0)
        known = answer(motion.getBodyNames("Body", _async=True), "ALMotion.getBodyNames", timeout=3.0)
        table = dict(zip(known, limits, strict=False))
        missing = [name for name in names if name not in table]
        if missing:
            raise DriverError(
                f"this robot has no {', '.join(missing)} (an H21?); valid: a description without them. "
                f"It has {', '.join(known)}"
            )
        lower, upper, fastest = np.array([table[name][:3] for name in names], dtype=float).T
        return Stream(names, lower, upper, fastest)

    def _greet(self, services: Services) -> None:
        """Checks after a reconnection of an armed driver that no autonomous motion is on; otherwise the gate
        stops. Runs in the thread that requests data."""
        if not self.armed:
            return
        for name in self._may_move:
            service(services.session, name)  # NAOqi may still be starting the service
        try:
            self._quieten(services)
            self._restless = None
        except DriverError as error:
            if not services.session.isConnected():
                raise
            self._restless = Reason(Code.MOVED_BY_ITSELF, f"after a new connection {error}")

    def _glance(self) -> None:
        """Makes the gate stop if a person or another program has switched autonomous life on. Runs in the
        thread that requests data."""
        if self._lookout is not None and (state := self._lookout.look(self.clock.now())):
            words = f"autonomous life has been switched on ({state}); valid: end that and connect again"
            self._restless = Reason(Code.MOVED_BY_ITSELF, words)

    def _quieten(self, services: Services) -> None:
        """Switches autonomous motions off if the address contains `?life=off`; otherwise raises DriverError
        if one is on. Also raises DriverError if switching off fails."""
        chains = list(dict.fromkeys(servo.robot_part for servo in self.robot.servos))
        self._may_move = self._may_move or autonomy.present(services.session)
        found = autonomy.movers(services.session, services.motion, chains)
        if found and self.where.life == "refuse":
            names = ", ".join(mover.name for mover in found)
            raise DriverError(
                f"the robot moves by itself: {names}; valid: end that and connect again, or connect with "
                "?life=off behind the address, which switches it off until the driver is closed"
            )
        autonomy.switch_off(services.session, found)
        for mover in found:
            self._switched.setdefault(mover.switch, mover)  # stores the state before the first switch
        was_off = all(mover.service != autonomy.LIFE for mover in found)
        self._lookout = autonomy.Lookout(services.session, was_off=was_off)

    def _restore(self) -> None:
        """Switches on the autonomous motions that this driver switched off. If the session has ended, opens a
        new session. Warns about motions that stay off."""
        found, services = list(self._switched.values()), self._poller.services
        left: list[str] = []
        try:
            if found and not services.session.isConnected():
                services = self._poller.services = Services(self.where, motion=True)
            left = autonomy.switch_on(services.session, found)
        except DriverError as error:
            left = [f"{', '.join(mover.name for mover in found)} ({error})"]
        if left:
            warnings.warn(
                f"still off on {self.robot.name}: {'; '.join(left)}; it was on before: switch it on by hand, "
                "or restart the robot", RuntimeWarning, stacklevel=4,
            )  # fmt: skip
