"""Client of one control board: reads its state and sends set-points to the joints of one robot part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tci.drivers.remote.source_clock import SourceClock
from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.description import Servo
from tci.wires.yarp.axes import find_axes, names_of
from tci.wires.yarp.driver_errors import raises_driver_errors
from yarpwire.board import (
    COMPLIANT,
    DIRECT,
    MIXED,
    POSITION,
    STIFF,
    TORQUE,
    VELOCITY,
    VELOCITY_DIRECT,
    AxisLimits,
    Board,
    Stream,
    find_board,
)
from yarpwire.dialect import Dialect
from yarpwire.errors import WireError, YarpError
from yarpwire.feed import Feed
from yarpwire.incoming import Delivery
from yarpwire.network import Network, Writer
from yarpwire.state import BoardState, decode_state

MOVING: Mapping[int, Mode] = {
    POSITION: Mode.POSITION, DIRECT: Mode.POSITION, MIXED: Mode.POSITION,
    VELOCITY: Mode.VELOCITY, VELOCITY_DIRECT: Mode.VELOCITY, TORQUE: Mode.TORQUE,
}  # fmt: skip
"""YARP's control modes in which a joint follows commands, with TCI's mode for each. In all other modes of
YARP (idle, fault, calibrating) the servo is off."""
WORDS = {Mode.POSITION: DIRECT, Mode.IMPEDANCE: DIRECT, Mode.VELOCITY: VELOCITY, Mode.TORQUE: TORQUE}
STREAMS = {
    Mode.POSITION: Stream.POSITION, Mode.IMPEDANCE: Stream.POSITION,
    Mode.VELOCITY: Stream.VELOCITY, Mode.TORQUE: Stream.TORQUE,
}  # fmt: skip

AHEAD = 0.02
"""Lead time [s] of set-points: the driver sends the position that the gate has planned for the present time
plus AHEAD. Without a lead time, a servo could reach its set-point early, and the board would stop it.
Assumed: two set-points never arrive more than 20 ms apart."""
SWITCHING = 0.0005
"""Longest time [s] to wait for the board's answer to a change of mode. If the answer arrives in time, the
driver sends the set-points of this period again, since a board ignores set-points that arrive before the
change. Assumed: the loop can spare this time, a tenth of a period of 5 ms."""


class BoardDriver:
    """The joints of one robot part on a control board. Methods raise DriverError if the board refuses a call
    or can't be reached."""

    @raises_driver_errors
    def __init__(
        self,
        prefix: str,
        servos: Sequence[Servo],
        network: Network,
        *,
        own: str,
        carrier: str,
        dialect: Dialect | None,
    ) -> None:
        """Connects, and finds the board's axis for each servo in `servos`.

        The names of the board's ports begin with `prefix` (`/icub/left_arm`). The names of the driver's ports
        begin with `own`. Raises DriverError if the board can't be reached, or if its axes do not fit the
        servos.
        """
        self.prefix = prefix
        self._network, self._own = network, own
        self.board: Board = find_board(network, prefix, f"{own}/rpc:o", dialect)
        self.feed: Feed[BoardState] | None = None
        self._output: Writer | None = None
        try:
            self.axes = find_axes(self.board, servos)
            self.feed = Feed(
                f"{prefix}/stateExt:o",
                network,
                self.board.dialect,
                self._decode,
                own=f"{own}/stateExt:i",
                carrier=carrier,
                clock=SourceClock(),
            )
            self._connect_commands()
        except BaseException:
            self.close()
            raise
        self._requested = {servo.index: servo.modes[0] for servo in self.axes.servos}
        self._mine = {s.index: axis for s, axis in zip(self.axes.servos, self.axes.numbers, strict=True)}
        self._direct: dict[int, bool] = {}
        self._impedance: dict[int, tuple[float, float]] = {}
        self._switching: dict[int, Mode] = {}

    def close(self) -> None:
        """Closes all connections."""
        self.board.close()
        if self.feed is not None:
            self.feed.close()
        if self._output is not None:
            self._output.close()

    def state(self, at: float | None = None) -> tuple[BoardState, float]:
        """Returns a state of the board, and the time [s] of this state. Returns the latest state or, if `at`
        is given, the state nearest to the time `at` [s]. Angles are in degrees, in the order of the board's
        axes. Raises DriverError before the first state."""
        found = None
        if self.feed is not None:
            found = self.feed.latest if at is None else self.feed.at(at)
        if found is None:
            raise DriverError(f"{self.prefix} has sent no state yet")
        return found.value, found.stamp

    @property
    def switches(self) -> bool:
        """True while the board has not answered a request for a change of modes."""
        return bool(self._switching)

    def number(self) -> int:
        """Number of the latest state; 0 before the first one."""
        latest = self.feed.latest if self.feed is not None else None
        return latest.sequence if latest is not None else 0

    def modes(self, state: BoardState) -> list[tuple[Mode | None, bool]]:
        """Returns for each servo its control mode in `state`, and True if the servo is on. A servo that is
        off, for example idle or in fault, has the mode None."""
        found: list[tuple[Mode | None, bool]] = []
        for axis in self.axes.numbers:
            mode = MOVING.get(state.modes[axis] if state.modes is not None else POSITION)
            if (
                mode is Mode.POSITION
                and state.interactions is not None
                and state.interactions[axis] == COMPLIANT
            ):
                mode = Mode.IMPEDANCE
            found.append((mode, mode is not None))
        return found

    @raises_driver_errors
    def limits(self) -> list[AxisLimits]:
        """Returns the range of angles [deg] that the board reports for each servo."""
        return [self.board.limits(axis) for axis in self.axes.numbers]

    @raises_driver_errors
    def send(self, safe: SafeCommand, ahead: Array) -> None:
        """Switches the board's servos to the modes in a command, then sends their set-points.

        `ahead` (k,) [rad] are the planned positions of the command's servos at the present time plus the lead
        time `AHEAD`. The board may take a period to answer a change of mode. Therefore, if the board refuses
        a mode, a later call of `send` raises DriverError.
        """
        self._settle()
        mine = self._mine
        self._set_shares(safe, mine)
        chosen = [(place, servo) for place, servo in enumerate(safe.servos.tolist()) if servo in mine]
        if not chosen:
            return
        reported = dict(zip(mine, self.modes(self.state()[0]), strict=True))
        wanted = {servo: safe.modes[place] for place, servo in chosen}
        changes = {s: m for s, m in wanted.items() if self._must_switch(s, m, *reported[s])}
        asked = self._switch(changes, mine)
        obeying = [
            (place, servo) for place, servo in chosen if self._obeys(servo, wanted[servo], reported[servo][0])
        ]
        self._stream_all(safe, ahead, obeying, mine)
        if asked and self._settle(SWITCHING):
            # Set-points that arrived before the change of mode had no effect.
            self._stream_all(safe, ahead, obeying, mine)

    @raises_driver_errors
    def send_torques_only(self, safe: SafeCommand) -> None:
        """Sends only the torques of servos in torque mode. Used while no states arrive from the board. The
        gate then reduces the torques to zero, but without messages the board would keep the last torques."""
        mine = self._mine
        loose = [
            (place, servo)
            for place, (servo, mode) in enumerate(zip(safe.servos.tolist(), safe.modes, strict=True))
            if mode is Mode.TORQUE and servo in mine
        ]
        self._stream_all(safe, safe.position, loose, mine)

    @raises_driver_errors
    def halt(self) -> None:
        """Switches all joints to position mode, and stops them at the present angles. Raises DriverError if
        the call fails."""
        self.board.set_modes(list(self.axes.numbers), POSITION)
        self.board.stop()
        self._direct.clear()

    def forget(self) -> None:
        """Deletes the list of joints in direct mode, and closes the connection for calls. Used when the
        driver connects again."""
        self._direct.clear()
        self.board.close()

    @raises_driver_errors
    def reconnect(self) -> None:
        """Connects again to the board's ports for state, calls and commands.

        Raises DriverError if connecting fails. Also raises DriverError if the board now has other axes, since
        commands would move wrong joints.
        """
        assert self.feed is not None
        fresh = find_board(self._network, self.prefix, f"{self._own}/rpc:o", self.board.dialect)
        try:
            names = names_of(fresh)
            if names != self.axes.names:
                self.feed.last_error = (
                    f"{self.prefix} came back with the axes {', '.join(names)}; "
                    f"valid: {', '.join(self.axes.names)}, or a new connection"
                )
                raise DriverError(self.feed.last_error)
        except BaseException:
            fresh.close()
            raise
        self.board.close()
        self.board = fresh
        self.forget()
        self._connect_commands()
        self.feed.reconnect()

    @raises_driver_errors
    def renew_commands(self) -> None:
        """Connects again if the board has closed the connection for commands. Boards with authentication
        close this connection after 2 s without a command. Raises DriverError if connecting fails."""
        output = self._output  # read only once, since the loop's thread may set `_output` to None
        if output is None or output.is_over():
            self._connect_commands()

    def _must_switch(self, servo: int, mode: Mode, reported: Mode | None, on: bool) -> bool:
        """Returns True if the driver must request `mode` for a servo. `reported` is the servo's mode in the
        board's latest state; `on` is True if the servo is on. If another program has changed the mode, the
        driver does not change it back."""
        if mode is not self._requested[servo]:
            return True
        return (
            on and reported is mode and mode in (Mode.POSITION, Mode.IMPEDANCE) and servo not in self._direct
        )

    def _obeys(self, servo: int, mode: Mode, reported: Mode | None) -> bool:
        return reported is mode or servo in self._direct or mode in (Mode.VELOCITY, Mode.TORQUE)

    def _switch(self, wanted: dict[int, Mode], mine: dict[int, int]) -> bool:
        """Requests the `wanted` modes by servo index, unless a request is pending. `mine` are the board's
        axes by servo index. Returns True if a request was sent."""
        if not wanted or self._switching:
            return False
        for servo, mode in wanted.items():
            if mode in (Mode.POSITION, Mode.IMPEDANCE) and mode is not self._requested[servo]:
                soft = COMPLIANT if mode is Mode.IMPEDANCE else STIFF
                self.board.send_call(self.board.interaction_call(mine[servo], soft))
        for mode in dict.fromkeys(wanted.values()):
            axes = [mine[servo] for servo, other in wanted.items() if other is mode]
            self.board.send_call(self.board.modes_call(axes, WORDS[mode]))
        self._switching = {servo: self._requested[servo] for servo in wanted}
        for servo, mode in wanted.items():
            self._requested[servo] = mode
            self._direct.pop(servo, None)
            if mode in (Mode.POSITION, Mode.IMPEDANCE):
                self._direct[servo] = True
        return True

    def _settle(self, patience: float = 0.0) -> bool:
        """Waits up to `patience` [s] for pending changes of modes. Returns True if none is pending any more.
        Raises YarpError if the board refused a change."""
        try:
            answered = self.board.settle(patience)
            if answered:
                self._switching = {}
            return answered
        except YarpError:
            self._requested |= self._switching
            for servo in self._switching:
                self._direct.pop(servo, None)
            self._switching = {}
            raise

    def _set_shares(self, safe: SafeCommand, mine: dict[int, int]) -> None:
        """Sets the stiffness and damping in a command. They are fractions of the values that the board had
        before the first such command."""
        shares = [(0, safe.stiffness), (1, safe.damping)]
        for servo in {servo for _, values in shares for servo in values if servo in mine}:
            if Mode.IMPEDANCE not in next(s.modes for s in self.axes.servos if s.index == servo):
                continue
            if servo not in self._impedance:
                self._impedance[servo] = self.board.impedance(mine[servo])
            full = self._impedance[servo]
            now = list(full)
            for place, values in shares:
                if servo in values:
                    now[place] = full[place] * values[servo]
            self.board.set_impedance(mine[servo], *now)

    def _stream_all(
        self, safe: SafeCommand, ahead: Array, chosen: Sequence[tuple[int, int]], mine: dict[int, int]
    ) -> None:
        """Sends the set-points of the `chosen` servos: angles from `ahead` [rad], velocities or torques, as
        the mode of each servo requires. Each entry of `chosen` has the servo's indices in the command and in
        `Robot.servos`."""
        for stream, values in (
            (Stream.POSITION, np.rad2deg(ahead)),
            (Stream.VELOCITY, np.rad2deg(safe.velocity)),
            (Stream.TORQUE, safe.torque),
        ):
            those = [(place, servo) for place, servo in chosen if STREAMS[safe.modes[place]] is stream]
            if those:
                places, servos = zip(*those, strict=True)
                self._stream(stream, [mine[servo] for servo in servos], values[list(places)])

    def _stream(self, stream: Stream, joints: Sequence[int], values: Array) -> None:
        if self._output is None:
            return
        output = self._output
        try:
            output.offer(self.board.command(stream, joints, values), self.board.dialect)
        except YarpError:
            output.close()
            if self._output is output:
                self._output = None  # no command is queued; `renew_commands` connects again

    def _connect_commands(self) -> None:
        if self._output is not None:
            self._output.close()
            self._output = None
        self._output = self._network.writer(f"{self.prefix}/command:i", f"{self._own}/command:o")

    def _decode(self, delivery: Delivery) -> BoardState:
        dialect = self.board.dialect
        state = decode_state(delivery.items(dialect), dialect)
        if len(state.position) != len(self.axes.names):
            raise WireError(
                f"{self.prefix} sends {len(state.position)} joints and has {len(self.axes.names)}"
            )
        return state
