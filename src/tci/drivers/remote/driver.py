"""Driver in the behaviour's process for the protocol `remote`, over any middleware."""

from __future__ import annotations

import math
import os
import secrets
import socket
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.drivers.remote.commanders import LEASE
from tci.drivers.remote.protocol import MOST_ORDERS, Commander, Orders, SessionFrame, State
from tci.errors import DriverError
from tci.gate.gate import Gate
from tci.gate.safe_command import GateState, SafeCommand
from tci.gate.settings import OVER_A_WIRE, GateSettings
from tci.messages import PlatformOrder, Reading, SkinFrame
from tci.messages.clock import Clock, MonotonicClock
from tci.reasons import Code, Reason, text_of
from tci.robot.description import Robot

TIMEOUT = 3.0
"""Time [s] within which a robot must answer when a driver is opened. Assumed: a served robot sends a state in
every period."""
STARTING = 30.0
"""Time [s] within which a robot must answer if the robot's process is known to run. This time is longer than
TIMEOUT, because a process that has just started may first compile code. Assumed: compiling takes less time.
"""
SKIN = 2.0
"""Time [s] that a driver waits for the first skin frames after the first state. Assumed: every patch has a
shorter period than this. If a patch sends no frame in this time, the driver opens without the frame, and the
conditioning detects that the patch is dead."""
WINDOW = 1.0
"""Length [s] of the time window that determines the normal delay of the transport. The normal delay is the
shortest delay of all states that arrived in the window. A state with a longer delay has arrived late. A gap
between two states that is longer than the gate's `stale_after` [s] counts as `stale_after`, so delays from
before the gap stay in the window. Assumed: many states arrive in this time."""


class RemoteDriver(Driver):
    """Driver of a robot that another TCI process owns and serves.

    There are two gates. This driver's gate, in the behaviour's process, refuses invalid commands early. The
    gate in the robot's process also checks collisions and following errors. If one of the two gates is in the
    state HOLD, the other gate also changes to HOLD.

    A subclass transfers messages in `_poll` and `_put`, and calls `_wait` at the end of its `__init__`.
    Stamps of readings are on this process's clock. If the transport delivers data late, the stamp is the time
    of measurement, not the time of arrival.
    """

    def __init__(
        self, robot: Robot, *, middleware: str, place: str, arm: bool, clock: Clock | None = None
    ) -> None:
        """Prepares the connection. `place` is the robot's address in messages to the user.

        Raises UnknownNameError if the robot's description has no binding to `middleware`.
        """
        self.client = secrets.randbits(62) + 1
        """Random number that identifies this driver in messages."""
        super().__init__(
            DriverInfo.of(
                robot, middleware, clock=MonotonicClock() if clock is None else clock, armed=arm,
                # the robot's process has the lease on the robot
                lease_name=f"{middleware}:{robot.name}:{self.client}",
                settings=GateSettings(self_collision=None, monitor=None, contact=None),
                streams=True,  # the gate in the robot's process brakes where the robot needs it
            )
        )  # fmt: skip
        self.place = place
        self.name = f"{socket.gethostname()}, process {os.getpid()}"
        self.refusals: deque[Reason] = deque(maxlen=100)
        """Reasons for which the robot's process refused orders, the latest last."""
        self.rejected = 0
        """Number of messages that were rejected because they were damaged, out of order or for another
        robot."""
        self.strangers = 0
        """Number of messages that were ignored because they belong to another session of the robot's
        process."""
        self._state: State | None = None
        self._delays: deque[tuple[float, float]] = deque()
        self._shift = self._connected_time = 0.0
        self._arrival = -math.inf
        self._skin: dict[str, SkinFrame] = {}
        self._lost: Reason | None = None
        self._pending: deque[tuple[float, PlatformOrder]] = deque()
        self._next, self._sequence, self._refused = 1, 0, 0

    @abstractmethod
    def _poll(self) -> Iterable[State | SessionFrame]:
        """Returns the latest states and skin frames that have arrived from the robot's process, at most a
        fixed number."""

    @abstractmethod
    def _put(self, orders: Orders) -> None:
        """Sends orders to the robot's process."""

    def _use_full_gate(self, lease_name: str) -> None:
        """Prepares the driver for a robot that no TCI process owns.

        This process then makes all checks of the gate, and must hold the lease `lease_name`.
        """
        gate = Gate(self.robot, period=self.period, stale_after=self.gate.stale_after, settings=OVER_A_WIRE)
        self.info = replace(self.info, gate=gate, lease_name=lease_name)

    def _starting(self) -> bool:
        """Returns True if the robot's process is known to run. In this case, the driver waits longer for the
        first state."""
        return False

    @abstractmethod
    def _why_silent(self) -> str:
        """Returns the probable reason why no state has arrived, for the error message."""

    def diagnose(self) -> tuple[Finding, ...]:
        """Returns findings about the gate and the commanders of the robot's process.

        Raises DriverError if this driver is closed.
        """
        self._check_open()
        self._take()
        state = self._state
        assert state is not None
        running = state.gate == GateState.RUN.value
        said = f"the gate of the robot's process: {state.gate}" + (
            f", {state.reason}" if state.reason else ""
        )
        advice = "" if running else "a hold ends by itself; after a stop check the robot, then serve it again"
        found = [Finding(Level.OK if running else Level.WARNING, "gate", said, advice)]
        for commander in state.commanders:
            words = f"commanded by {commander.name}"
            found.append(Finding(Level.NOTE, "commander", words, "its joints can't be commanded from here"))
        if self.rejected:
            words = f"{self.rejected} messages rejected: damaged, out of order or for another robot"
            advice = "check that no other robot is served under this name"
            found.append(Finding(Level.WARNING, "messages", words, advice, {"rejected": self.rejected}))
        if self.strangers:
            words = f"{self.strangers} messages ignored: not sent by the robot's process"
            advice = "if two robots have one name, serve each under its own: NAME@..."
            found.append(Finding(Level.WARNING, "strangers", words, advice, {"strangers": self.strangers}))
        return tuple(found)

    def _wait(self) -> None:
        """Waits for the first state of the robot, then for the first frame of every patch. Raises DriverError
        if no state arrives in time; missing frames are no error."""
        begin = time.monotonic()
        while self._state is None:
            self._take()
            waited = time.monotonic() - begin
            if self._state is None and waited > TIMEOUT and not (waited < STARTING and self._starting()):
                raise DriverError(f"{self.robot.name} does not answer at {self.place}: {self._why_silent()}")
            time.sleep(0.002)
        end = time.monotonic() + SKIN
        while len(self._skin) < len(self.robot.skin) and time.monotonic() < end:
            self._take()
            time.sleep(0.002)

    def _receive(self) -> Reading:
        self._take()
        state = self._state
        assert state is not None
        if self._lost is not None:
            self.gate.stop(self._lost)
        if state.gate != GateState.RUN.value:
            self.gate.hold(Reason(Code.OWNER_HOLDS, f"the robot's process: {text_of(state.reason)}"))
        self.gate.tell_met(state.met)
        for commander in state.commanders:
            if commander.client == self.client:
                self._process_entry(commander)
        joints = replace(state.joints, stamp=state.joints.stamp + self._shift)
        skin = (replace(frame, stamp=frame.stamp + self._shift) for frame in self._skin.values())
        return Reading(joints, tuple(skin))

    def _send(self, safe: SafeCommand) -> None:
        state = self._state
        assert state is not None
        now = self.clock.now()
        if safe.state is not GateState.RUN:
            self._pending.clear()
            self.gate.drop()
        self._pending.extend((now, order) for order in safe.orders)
        self._next += len(safe.orders)
        if self._pending and (
            now - self._pending[0][0] > self.gate.stale_after or len(self._pending) > MOST_ORDERS
        ):
            self._pending.clear()
            self.gate.hold(
                Reason(
                    Code.OWNER_SILENT,
                    f"{self.robot.name} has not acknowledged orders for {1e3 * self.gate.stale_after:.0f} ms",
                )
            )
        # If the gate holds for a reason of the robot's process, this reason is not sent back. Otherwise both
        # processes would hold for ever, each because of the other process.
        theirs = safe.reason is None or safe.reason.code in (Code.OWNER_HOLDS, Code.OWNER_REFUSES)
        self._send_orders(state, None if theirs else safe.reason, leaving=False)

    def _halt(self) -> None:
        """Drops orders that are not acknowledged yet. Asks the robot's process to hold, and waits until it
        holds, at most `stale_after` [s].

        If the connection is lost, the robot's process holds without being asked.
        """
        if self._state is None or not self._sequence:
            return
        self._pending.clear()
        end = self.clock.now() + self.gate.stale_after
        while self.clock.now() < end:
            self._send_orders(self._state, Reason(Code.HALTED, "halted"), leaving=False)
            self.clock.sleep_until(self.clock.now() + self.period)
            self._take()
            if self._state.gate != GateState.RUN.value:
                return

    def _close(self) -> None:
        if self._state is not None and self._sequence:
            self._pending.clear()
            # after a failure, the robot's process detects that no more messages arrive
            with suppress(DriverError):
                self._take()  # a message that refers to an old state would be rejected
                self._send_orders(self._state, None, leaving=True)

    def _send_orders(self, state: State, halt: Reason | None, *, leaving: bool) -> None:
        self._sequence += 1
        self._put(
            Orders(
                session=state.session, seen=state.sent, client=self.client, name=self.name,
                sequence=self._sequence, halt=halt, leaving=leaving,
                first=self._next - len(self._pending),
                orders=tuple(order for _, order in self._pending),
            )
        )  # fmt: skip

    def _take(self) -> None:
        for message in self._poll():
            if self._state is None:
                if isinstance(message, State):  # frames before the first state have an unknown session
                    self._accept(message)
            elif message.session != self._state.session:
                self.strangers += 1
                # States of another session end this driver's session only if the robot's process of this
                # session has sent nothing for the time LEASE.
                if isinstance(message, State) and self.clock.now() - self._arrival > LEASE:
                    words = f"the process that owns {self.robot.name} was restarted; connect again"
                    self._lost = Reason(Code.OWNER_RESTARTED, words)
            elif isinstance(message, SessionFrame):
                self._accept_skin(message.frame)
            elif message.sequence <= self._state.sequence:
                self.rejected += 1
            else:
                self._accept(message)

    def _accept_skin(self, frame: SkinFrame) -> None:
        before = self._skin.get(frame.patch)
        if before is not None and frame.sequence <= before.sequence:
            self.rejected += 1
        else:
            self._skin[frame.patch] = frame

    def _accept(self, state: State) -> None:
        self._state = state
        arrival = self.clock.now()
        self._connected_time += min(arrival - self._arrival, self.gate.stale_after)
        self._arrival = arrival
        delay, begin = arrival - state.sent, self._connected_time - WINDOW
        while self._delays and (self._delays[0][0] < begin or self._delays[-1][1] >= delay):
            self._delays.popleft() if self._delays[0][0] < begin else self._delays.pop()
        self._delays.append((self._connected_time, delay))
        # The shift converts the robot's time to this process's clock, with the shortest delay of all states.
        self._shift = state.sent + self._delays[0][1] - state.now

    def _process_entry(self, commander: Commander) -> None:
        """Processes which of this driver's orders the robot's process has acknowledged or refused. After a
        refusal, this driver's gate holds. Raises DriverError if the reason is that another process commands
        the robot."""
        while self._pending and self._next - len(self._pending) <= commander.acknowledged:
            self._pending.popleft()
        if commander.refused > self._refused:
            self._refused = commander.refused
            reason = commander.reason or Reason(Code.OTHER, "without a reason")
            self.refusals.append(reason)
            if reason.code is Code.OTHER_COMMANDER:
                raise DriverError(reason.text, code=reason.code)
            self.gate.hold(Reason(Code.OWNER_REFUSES, f"refused by the robot's process: {reason}"))
