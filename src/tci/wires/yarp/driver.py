"""`yarp`: driver of a robot on YARP, such as iCub. Uses the robot's control boards and skin ports."""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding
from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.drivers.remote.hosts import numeric
from tci.drivers.remote.source_clock import SourceClock
from tci.errors import DriverError
from tci.gate.gate import SafeCommand
from tci.gate.partial_gate import PartialGate
from tci.messages import JointReading, Mode, Reading, SkinFrame
from tci.messages.clock import MonotonicClock
from tci.messages.frames import read_only
from tci.reasons import Code, Reason
from tci.robot.description import Robot, wire_name
from tci.robot.joint_map import initial_position
from tci.wires.yarp import address as addresses
from tci.wires.yarp.address import EVENTS, board_ports
from tci.wires.yarp.board_driver import AHEAD, BoardDriver
from tci.wires.yarp.diagnose import examine, probe
from tci.wires.yarp.driver_errors import raises_driver_errors
from tci.wires.yarp.skin_events import EventForm, SkinEvent, decode_events
from tci.wires.yarp.skin_ports import read_skin
from yarpwire.dialect import Dialect
from yarpwire.errors import UnknownNameError, YarpError
from yarpwire.feed import Feed
from yarpwire.network import Network

FIRST = 3.0
"""Longest time [s] to wait for the first message of every port when the driver opens. Assumed: ports send at
least 20 messages per second, and connecting takes less than a second."""
AWAY = 0.3
"""Time [s] without a message after which the driver connects to a port again. Assumed: gaps in the data on a
busy network are shorter."""
LOOK = 0.25
"""Time [s] between two checks for silent ports. Assumed: it is soon enough if the driver connects again at
most 0.55 s (AWAY + LOOK) after a port's last message."""
REGISTER_AGAIN = 1.0
"""Time [s] between two checks that the driver's ports are still registered. A name server that restarts
forgets the ports. Assumed: a second is soon enough, since data between ports does not need the name
server."""
PATIENCE = 0.9
"""Largest fraction of a period for which `read` waits for skin frames that are due. Assumed: the rest of the
period is enough for the computation."""
REFUSED = 3.0
"""Time [s] for which a board may refuse or not answer a change of mode, before `write` raises an error.
Assumed: a board that is starting, or that holds its joints itself, accepts modes again within this time."""
_numbers = itertools.count()


class YarpDriver(Driver):
    """A driver of a robot on YARP. The driver is armed only on request.

    After a restart of the name server, a board or the robot, the driver connects again automatically. Until
    the driver has connected again, the joint data is old, and the gate holds.
    """

    @raises_driver_errors
    def __init__(
        self, robot: Robot, address: str = "", *, arm: bool = False, joints: bool = True, skin: bool = True
    ) -> None:
        """Connects to every board and every patch. docs/yarp.md describes the `address`.

        With `joints=False`, the driver reads only the skin. With `skin=False`, the driver reads only the
        joints. Skin ports do not show the robot's dialect, so with `joints=False` the address must contain
        the dialect.

        Raises DriverError if a port does not exist, sends nothing, or sends values that do not fit the
        description. Raises MissingExtraError if the address requests YARP's own bindings and they are not
        installed.
        """
        options = addresses.parse(address)
        clock = MonotonicClock()
        super().__init__(DriverInfo.of(robot, "yarp", clock=clock, armed=arm))
        self.network: Network = options.network()
        self.prefix = options.robot or wire_name(robot.name)
        host, port = self.network.address
        self.info = replace(
            self.info, lease_name=f"yarp:{numeric(host)}:{port}/{self.prefix}", left_out=options.without
        )
        own = f"/tci/{os.getpid()}/{next(_numbers)}"
        self.boards: dict[str, BoardDriver] = {}
        self.skin: dict[str, Feed[NDArray[np.float64]]] = {}
        self._events: Feed[tuple[SkinEvent, ...]] | None = None
        self._own, self._carrier = own, options.carrier
        self._events_port, self._form = options.events or EVENTS, EventForm(robot)
        self._dialect = dialect = options.dialect or self.network.dialect
        self._joints: JointReading | None = None
        self._home = initial_position(robot)
        self._away: set[str] = set()
        self._reconnected = threading.Event()
        self._refused: dict[str, tuple[float, DriverError]] = {}
        self._closed = threading.Event()
        try:
            if joints:
                self._open_boards(dialect)
                self._leave_out_absent_servos()
            elif dialect is None:
                raise DriverError(
                    f"skin alone over yarp:{address} needs dialect=3 or dialect=4 in its address"
                )
            for patch in options.patches(robot) if skin else ():
                self.skin[patch.name] = read_skin(
                    robot, patch, self.prefix, self.network, self.dialect,
                    own=own, carrier=options.carrier, compensated=options.skin == "comp",
                )  # fmt: skip
            self._wait_for_all()
        except UnknownNameError as error:
            self._close()
            raise DriverError(
                f"{error}; a patch that the robot lacks can be left out: yarp:...,without=PATCH"
            ) from error
        except BaseException:
            self._close()
            raise
        threading.Thread(target=self._watch, name="yarp watch", daemon=True).start()

    @property
    def dialect(self) -> Dialect:
        """Dialect of the robot's protocol: YARP 3 or YARP 4."""
        if self._dialect is not None:
            return self._dialect
        return next(iter(self.boards.values())).board.dialect

    @raises_driver_errors
    def skin_events(self) -> tuple[SkinEvent, ...]:
        """Returns the latest contacts that the robot's own skinManager has published, with vectors in the
        frames of the robot's links (`SkinEvent.frame`).

        Raises DriverError if skinManager is not running.
        """
        if self._events is None:
            try:
                self._events = Feed(
                    self._events_port, self.network, self.dialect,
                    lambda d: decode_events(d.items(self.dialect)),
                    own=f"{self._own}/skin_events:i", carrier=self._carrier, clock=SourceClock(),
                )  # fmt: skip
            except UnknownNameError as error:
                raise DriverError(f"no skinManager: {error}") from error
            self._events.wait(AWAY)
        latest = self._events.latest
        return self._form.in_links(latest.value) if latest is not None else ()

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        return probe(robot, address)

    def diagnose(self) -> tuple[Finding, ...]:
        self._check_open()
        return examine(self.dialect, self.boards, self.skin)

    def _receive(self) -> Reading:
        until = time.monotonic() + PATIENCE * self.period
        stamp = min((board.state()[1] for board in self.boards.values()), default=self.clock.now())
        if self._joints is None or stamp != self._joints.stamp:
            self._joints = self._joints_at(stamp)
        back = self._away and self.clock.now() - stamp <= self.gate.stale_after
        if back or self._reconnected.is_set():  # the robot may have moved while no data arrived
            self._away.clear()
            self._reconnected.clear()
            self.gate.drop()
        # the driver waits for skin last, so that skin data is as recent as possible
        for feed in self.skin.values():
            feed.await_due(until, self.period)
        return Reading(joints=self._joints, skin=tuple(self._frames()))

    def _joints_at(self, stamp: float) -> JointReading:
        """Returns the joint data of all boards at the time `stamp` [s]: each board's state nearest to this
        time."""
        count = len(self.robot.servos)
        position, velocity, torque = np.full((3, count), np.nan)
        modes: list[Mode | None] = [None] * count
        powered = np.ones(count, dtype=bool)
        for board in self.boards.values():
            state, _ = board.state(stamp)
            servos, axes = [servo.index for servo in board.axes.servos], list(board.axes.numbers)
            position[servos] = np.deg2rad(state.position[axes])
            if state.velocity is not None:
                velocity[servos] = np.deg2rad(state.velocity[axes])
            if state.torque is not None:
                torque[servos] = state.torque[axes]
            for servo, (mode, on) in zip(servos, board.modes(state), strict=True):
                modes[servo], powered[servo] = mode, on
            absent = [servo.index for servo in board.axes.absent]
            position[absent], velocity[absent], powered[absent] = self._home[absent], 0.0, False
        return JointReading(
            stamp=float(stamp),
            sequence=self._number(),
            position=read_only(position),
            velocity=read_only(velocity),
            torque=None if np.isnan(torque).all() else read_only(torque),
            modes=tuple(modes),
            powered=read_only(powered, np.bool_),
        )

    def _number(self) -> int:
        """The number of a new combination. Boards count on their own, so it rises with every new stamp, and
        with the busiest board, which tells how much was missed."""
        sent = max((board.number() for board in self.boards.values()), default=0)
        return sent if self._joints is None else max(self._joints.sequence + 1, sent)

    def _frames(self) -> list[SkinFrame]:
        frames = []
        for name, feed in self.skin.items():
            if (latest := feed.latest) is not None:
                frames.append(SkinFrame(name, latest.stamp, latest.sequence, latest.value))
        return frames

    def _send(self, safe: SafeCommand) -> None:
        now, ahead = self.clock.now(), self.gate.ahead(AHEAD)
        for part, board in self.boards.items():
            if now - board.state()[1] > self.gate.stale_after:
                self._away.add(part)
                self._refused.pop(part, None)
            if part in self._away:
                board.send_torques_only(safe)
                continue
            try:
                board.send(safe, ahead)
            except DriverError as error:
                self._refused.setdefault(part, (now, error))
            else:
                if not board.switches:
                    self._refused.pop(part, None)
        self._tolerate_refusals(now)

    def _tolerate_refusals(self, now: float) -> None:
        """Makes the gate hold while a board refuses a change of mode; `now` [s] is the present time.

        A board refuses for a short time while it starts, or while the robot's own software holds the joints.
        Raises DriverError if a board refuses for too long.
        """
        for since, error in self._refused.values():
            if now - since > REFUSED:
                raise DriverError(
                    f"{error}, for {now - since:.1f} s now; "
                    "end what holds the robot on its own side; `tci doctor` shows its state"
                ) from error
            self.gate.hold(Reason(Code.ROBOT_REFUSES, str(error)))

    def _halt(self) -> None:
        for board in self.boards.values():
            board.halt()

    @raises_driver_errors
    def _close(self) -> None:
        self._closed.set()
        for connection in (*self.boards.values(), *self.skin.values(), self._events):
            if connection is not None:
                connection.close()

    def _open_boards(self, dialect: Dialect | None) -> None:
        for part, where in board_ports(self.robot, self.prefix).items():
            self.boards[part] = BoardDriver(
                where, self.robot.servos_of(part), self.network,
                own=f"{self._own}/{wire_name(part)}", carrier=self._carrier, dialect=dialect,
            )  # fmt: skip
            dialect = self.boards[part].board.dialect

    def _leave_out_absent_servos(self) -> None:
        """Makes the gate refuse commands to servos for which no board has an axis."""
        absent = {
            servo.index: f"{board.board.prefix} has no axis for it"
            for board in self.boards.values()
            for servo in board.axes.absent
        }
        if absent:
            gate = PartialGate(self.robot, absent, period=self.period, stale_after=self.gate.stale_after)
            self.info = replace(self.info, gate=gate, unreached=absent)

    def _wait_for_all(self) -> None:
        until = time.monotonic() + FIRST
        for board in self.boards.values():
            assert board.feed is not None
            self._wait_for(board.feed, until)
        for feed in self.skin.values():
            self._wait_for(feed, until)

    def _wait_for(self, feed: Feed[Any], until: float) -> None:
        if feed.wait(max(0.0, until - time.monotonic())):
            return
        why = feed.last_error or feed.port.last_error or f"no message within {FIRST:g} s"
        raise DriverError(
            f"{feed.source}: {why}; valid: data that fits the description of {self.robot.name}. "
            "A patch can be left out: yarp:...,without=PATCH"
        )

    def _watch(self) -> None:
        """Restores lost connections until the driver closes. Connects again to ports that send nothing, and
        registers the driver's ports again if the name server has restarted.
        """
        due = time.monotonic() + REGISTER_AGAIN
        while not self._closed.wait(LOOK):
            now = time.monotonic()
            for board in self.boards.values():
                if board.feed is not None and board.feed.silent(now) > AWAY:
                    with contextlib.suppress(DriverError):
                        board.reconnect()
                        self._reconnected.set()
                else:
                    with contextlib.suppress(DriverError):
                        board.renew_commands()
            for feed in self._feeds(boards=False):
                if feed.silent(now) > AWAY:
                    with contextlib.suppress(YarpError):
                        feed.reconnect()
            if now > due:
                due = now + REGISTER_AGAIN
                with contextlib.suppress(YarpError):
                    known = {contact.name for contact in self.network.list()}
                    for feed in self._feeds():
                        if feed.port.name not in known and not self._closed.is_set():
                            feed.port.register()

    def _feeds(self, *, boards: bool = True) -> list[Feed[Any]]:
        states = [board.feed for board in self.boards.values()] if boards else []
        return [feed for feed in (*states, *self.skin.values(), self._events) if feed is not None]
