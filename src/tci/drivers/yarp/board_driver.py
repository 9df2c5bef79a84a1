"""One control board behind a driver: its state comes in, set-points go out, to named joints only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tci.drivers.remote.source_clock import SourceClock
from tci.drivers.yarp.driver_errors import raises_driver_errors
from tci.errors import DriverError
from tci.frames import Array
from tci.gate.safe_command import SafeCommand
from tci.messages import Mode
from tci.robot.description import Servo
from yarpwire.board import (
    COMPLIANT,
    DIRECT,
    POSITION,
    STIFF,
    TORQUE,
    VELOCITY,
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
from yarpwire.values import Vocab

MOVING: Mapping[int, Mode] = {
    POSITION: Mode.POSITION, DIRECT: Mode.POSITION, Vocab("mix"): Mode.POSITION,
    VELOCITY: Mode.VELOCITY, Vocab("veld"): Mode.VELOCITY, TORQUE: Mode.TORQUE,
}  # fmt: skip
"""Control modes in which a joint obeys; in any other (idle, faulty, calibrating) its servo counts as off."""
WORDS = {Mode.POSITION: DIRECT, Mode.IMPEDANCE: DIRECT, Mode.VELOCITY: VELOCITY, Mode.TORQUE: TORQUE}
STREAMS = {
    Mode.POSITION: Stream.POSITION, Mode.IMPEDANCE: Stream.POSITION,
    Mode.VELOCITY: Stream.VELOCITY, Mode.TORQUE: Stream.TORQUE,
}  # fmt: skip

AHEAD = 0.02
"""How far ahead [s] of its reference a servo is sent, on the way that the gate has planned: a board may come
to rest at each set-point unless the next one is there before. Ours."""
SWITCHING = 0.0005
"""How long [s] the answer to a change of mode is waited for, to send the set-points again: a board may have
ignored those that came before it had changed. Ours."""


class BoardDriver:
    """The joints of one robot part. Methods raise DriverError when the board refuses or is not there."""

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
        """Connect and see which axis is which joint: by name where the board has them, else by number."""
        self.servos = tuple(servos)
        self.prefix = prefix
        self._network, self._own = network, own
        self.board: Board = find_board(network, prefix, f"{own}/rpc:o", dialect)
        self.axes: tuple[str, ...] = ()
        """The board's own names, by axis."""
        self.feed: Feed[BoardState] | None = None
        self._output: Writer | None = None
        try:
            self.axes = tuple(self.board.name(axis) for axis in range(self.board.axes()))
            self.axis = self._match()
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
        self._told = {servo.index: servo.modes[0] for servo in self.servos}
        self._direct: dict[int, bool] = {}
        self._impedance: dict[int, tuple[float, float]] = {}
        self._switching: dict[int, Mode] = {}

    def close(self) -> None:
        """Let go of all connections."""
        self.board.close()
        if self.feed is not None:
            self.feed.close()
        if self._output is not None:
            self._output.close()

    def state(self, at: float | None = None) -> tuple[BoardState, float]:
        """The latest state, or the nearest to a time [s], in the board's order and degrees; and its time."""
        found = None
        if self.feed is not None:
            found = self.feed.latest if at is None else self.feed.at(at)
        if found is None:
            raise DriverError(f"{self.prefix} has sent no state yet")
        return found.value, found.stamp

    @property
    def switches(self) -> bool:
        """Whether the board has not answered yet to a change of modes."""
        return bool(self._switching)

    def number(self) -> int:
        """Of the latest state."""
        latest = self.feed.latest if self.feed is not None else None
        return latest.sequence if latest is not None else 0

    def modes(self, state: BoardState) -> list[tuple[Mode | None, bool]]:
        """Control mode and whether it is on, of each servo."""
        found: list[tuple[Mode | None, bool]] = []
        for axis in self.axis:
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
        """How far each servo may go, by the board [deg]."""
        return [self.board.limits(axis) for axis in self.axis]

    @raises_driver_errors
    def send(self, safe: SafeCommand, ahead: Array) -> None:
        """Switch modes as the gate did, then send set-points to its servos that are under command.

        `ahead` (k,) [rad] is where the command's servos will be AHEAD later. The board's answer is told in a
        later call: it may take a period of its own.
        """
        self._settle()
        mine = {servo.index: axis for servo, axis in zip(self.servos, self.axis, strict=True)}
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
            # What came before the board had the new modes moved nothing.
            self._stream_all(safe, ahead, obeying, mine)

    @raises_driver_errors
    def let_go(self, safe: SafeCommand) -> None:
        """Send the torques of its servos in torque mode, and nothing else: to a board whose state does not
        come. It may still hear, and would keep the last ones; the gate ends torques that nobody watches."""
        mine = {servo.index: axis for servo, axis in zip(self.servos, self.axis, strict=True)}
        loose = [
            (place, servo)
            for place, (servo, mode) in enumerate(zip(safe.servos.tolist(), safe.modes, strict=True))
            if mode is Mode.TORQUE and servo in mine
        ]
        self._stream_all(safe, safe.position, loose, mine)

    @raises_driver_errors
    def halt(self) -> None:
        """The board's own stop, in position mode: its joints stay where they are. Raises DriverError."""
        self.board.set_modes(list(self.axis), POSITION)
        self.board.stop()
        self._direct.clear()

    def forget(self) -> None:
        """The board was away: its joints are in whatever mode they started in."""
        self._direct.clear()
        self.board.close()

    @raises_driver_errors
    def reconnect(self) -> None:
        """Connect again. Raises DriverError."""
        assert self.feed is not None
        fresh = find_board(self._network, self.prefix, f"{self._own}/rpc:o", self.board.dialect)
        self.board.close()
        self.board = fresh
        self.forget()
        self._connect_commands()
        self.feed.reconnect()

    @raises_driver_errors
    def mind_commands(self) -> None:
        """Connect again where the board has closed the connection that commands take: one that authenticates
        does so after 2 s without any. Raises DriverError."""
        output = self._output  # the loop lets go of it too
        if output is None or output.is_over():
            self._connect_commands()

    def _must_switch(self, servo: int, mode: Mode, reported: Mode | None, on: bool) -> bool:
        """By order of the gate, or from position to position-direct. A mode that somebody else set stays."""
        if mode is not self._told[servo]:
            return True
        return (
            on and reported is mode and mode in (Mode.POSITION, Mode.IMPEDANCE) and servo not in self._direct
        )

    def _obeys(self, servo: int, mode: Mode, reported: Mode | None) -> bool:
        return reported is mode or servo in self._direct or mode in (Mode.VELOCITY, Mode.TORQUE)

    def _switch(self, wanted: dict[int, Mode], mine: dict[int, int]) -> bool:
        """Ask the board for other modes, one question at a time; whether it was asked."""
        if not wanted or self._switching:
            return False
        for servo, mode in wanted.items():
            if mode in (Mode.POSITION, Mode.IMPEDANCE) and mode is not self._told[servo]:
                soft = COMPLIANT if mode is Mode.IMPEDANCE else STIFF
                self.board.ask(self.board.interaction_call(mine[servo], soft))
        for mode in dict.fromkeys(wanted.values()):
            axes = [mine[servo] for servo, other in wanted.items() if other is mode]
            self.board.ask(self.board.modes_call(axes, WORDS[mode]))
        self._switching = {servo: self._told[servo] for servo in wanted}
        for servo, mode in wanted.items():
            self._told[servo] = mode
            self._direct.pop(servo, None)
            if mode in (Mode.POSITION, Mode.IMPEDANCE):
                self._direct[servo] = True
        return True

    def _settle(self, patience: float = 0.0) -> bool:
        """True if all changes of modes are answered. Raises DriverError when the board refused one."""
        try:
            answered = self.board.settle(patience)
            if answered:
                self._switching = {}
            return answered
        except YarpError:
            self._told |= self._switching
            for servo in self._switching:
                self._direct.pop(servo, None)
            self._switching = {}
            raise

    def _set_shares(self, safe: SafeCommand, mine: dict[int, int]) -> None:
        """Shares of the stiffness and damping that the board had when it was first asked."""
        shares = [(0, safe.stiffness), (1, safe.damping)]
        for servo in {servo for _, values in shares for servo in values if servo in mine}:
            if Mode.IMPEDANCE not in next(s.modes for s in self.servos if s.index == servo):
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
        """Send the set-points of the `chosen` places and servos of a command, each by its mode."""
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
                self._output = None  # nothing queues; whoever watches connects again

    def _connect_commands(self) -> None:
        if self._output is not None:
            self._output.close()
            self._output = None
        self._output = self._network.writer(f"{self.prefix}/command:i", f"{self._own}/command:o")

    def _decode(self, delivery: Delivery) -> BoardState:
        dialect = self.board.dialect
        state = decode_state(delivery.items(dialect), dialect)
        if len(state.position) != len(self.axes):
            raise WireError(f"{self.prefix} sends {len(state.position)} joints and has {len(self.axes)}")
        return state

    def _match(self) -> tuple[int, ...]:
        """The board's axis of each servo. Raises DriverError when there is none for one."""
        known = {name: axis for axis, name in enumerate(self.axes)}
        names = [servo.name for servo in self.servos]
        if len(known) == len(self.axes) and all(name in known for name in names):
            return tuple(known[name] for name in names)
        strangers = [servo for servo in self.servos if not 0 <= servo.id < len(self.axes)]
        mixed = [s.name for s in self.servos if known.get(s.name, s.id) != s.id]
        if strangers or mixed:
            raise DriverError(
                f"{self.prefix} has the axes {', '.join(self.axes)}; the description's "
                f"{', '.join(mixed or [servo.name for servo in strangers])} is not where its id says; "
                "valid: a description whose servos have the board's names, or its numbers"
            )
        return tuple(servo.id for servo in self.servos)
