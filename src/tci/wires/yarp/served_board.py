"""One robot part served as a control board: answers calls, and converts commands to orders.

YARP 3 and YARP 4 both use this module. Angles are in degrees in YARP, and in radians in TCI.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.acceptance import SLOWEST, check_limits
from tci.messages import JointReading, Mode, Order, PlatformCommand, PlatformSwitch
from tci.messages.frames import Array
from tci.robot.description import Servo
from tci.wires.yarp import call_arguments
from tci.wires.yarp.board_modes import MODES, MOVING, STREAMING, BoardModes, JointMode
from tci.wires.yarp.order_book import OrderBook
from yarpwire.board import COMPLIANT, DIRECT, IDLE, STIFF, Stream
from yarpwire.board_service import BoardService
from yarpwire.errors import CallError
from yarpwire.state import BoardState
from yarpwire.values import Vocab

FULL_STIFFNESS = 1.0
"""Stiffness [N m/deg] on YARP that corresponds to the full stiffness of a servo. Assumed: the value has no
effect, since TCI sets only fractions of the full stiffness, but YARP needs a value with a unit."""
FULL_DAMPING = 0.1
"""Damping [N m s/deg] on YARP that corresponds to the full damping of a servo. Assumed: the value has no
effect, since TCI sets only fractions of the full damping, but YARP needs a value with a unit."""
SPEED = 10.0
"""Speed [deg/s] of a joint's moves until a client sets another speed. The value is that of an iCub."""
ACCELERATION = 50.0
"""Acceleration [deg/s2] that clients read until they set another acceleration. Assumed: the value has no
effect, since the gate uses the limits in the description."""
OVERTAKES = 0.005
"""Longest time [s] for which streamed set-points wait for the call that switches the joint to their mode. The
call arrives on another connection, possibly after the set-points. Assumed: the call arrives within half of a
period of iCub's boards."""
ARRIVED = 1e-4
"""Largest distance [rad] between a joint's target and reference at which the joint counts as arrived.
Assumed: an encoder does not resolve this distance."""
AT_REST = float(np.deg2rad(1.0))
"""Speed [rad/s] below which a joint counts as resting and may change its mode. Assumed: the gate then counts
the joint as resting too, although it estimates the speed in another way."""
COMES_TO_REST = 1.5
"""Longest time [s] that a change of mode waits for moving joints to stop. Assumed: the arms of iCub and NAO
stop from full speed in less time, and clients wait longer for an answer."""
COMMANDS = {Stream.POSITION: Mode.POSITION, Stream.VELOCITY: Mode.VELOCITY, Stream.TORQUE: Mode.TORQUE}


class ServedBoard(BoardService):
    """A robot part served as a control board.

    The loop calls `follow` and `update`. The threads of connections call all other methods.
    """

    def __init__(self, part: str, servos: Sequence[Servo]) -> None:
        self.part = part
        self.servos = tuple(servos)
        self.count = len(self.servos)
        self.speeds = np.full(self.count, SPEED)
        """Speed (n_joints,) [deg/s] of moves to a target angle."""
        self.accelerations = np.full(self.count, ACCELERATION)
        """Acceleration (n_joints,) [deg/s2] that clients have set. The value has no effect."""
        self._set_points = {stream: np.zeros(self.count) for stream in Stream}
        self._index = np.array([servo.index for servo in self.servos], dtype=np.intp)
        self._movable = [number for number, servo in enumerate(self.servos) if _is_movable(servo)]
        self._range = np.array([_range(servo) for servo in self.servos])
        self._impedance = np.tile([FULL_STIFFNESS, FULL_DAMPING], (self.count, 1))
        self.book = OrderBook()
        """Orders that wait for the loop, and their results."""
        self._modes = BoardModes(self.servos)
        self._switched: set[int] = set()
        self._stepped = threading.Condition()
        self._moves: NDArray[np.bool_] = np.zeros(self.count, dtype=bool)
        self._early: tuple[float, Stream, list[int], Sequence[float]] | None = None
        self.state = BoardState(np.zeros(self.count))
        """Latest state of the board's joints."""
        self.stamp = 0.0
        """Time [s] at which the latest state was stored, seconds since 1970."""
        self.armed = True
        """True if the board accepts commands. If False, each command raises CallError."""

    @property
    def set_points(self) -> Mapping[Stream, Array]:
        return self._set_points

    def follow(self, targets: Array, references: Array, speeds: Array) -> None:
        """Stores the gate's targets [rad], references [rad] and reference speeds [rad/s] in this period.

        Each array has the shape (n_servos,).
        """
        mine = self._index
        with self._stepped:
            self._set_points[Stream.POSITION] = np.rad2deg(targets[mine])
            away = np.abs(targets[mine] - references[mine]) > ARRIVED
            for number in np.flatnonzero(away).tolist():
                away[number] = self._modes.gate_mode(number) in (Mode.POSITION, Mode.IMPEDANCE)
            self._moves = away | (np.abs(speeds[mine]) > ARRIVED)
            self._stepped.notify_all()

    def update(self, joints: JointReading, modes: Sequence[Mode]) -> None:
        """Stores the joints in this period, and the mode (n_servos,) of every servo at the gate."""
        if not self.book.is_busy():
            for number, servo in enumerate(self._index.tolist()):
                self._modes.catch_up(number, modes[servo])
        powered = joints.powered
        shown = [self._modes.shown(number, modes[servo]) for number, servo in enumerate(self._index.tolist())]
        self.state = BoardState(
            position=np.rad2deg(joints.position[self._index]),
            velocity=np.rad2deg(joints.velocity[self._index]),
            torque=joints.torque[self._index] if joints.torque is not None else None,
            modes=tuple(
                IDLE if powered is not None and not powered[servo] else word
                for servo, (word, _) in zip(self._index.tolist(), shown, strict=True)
            ),
            interactions=tuple(soft for _, soft in shown),
        )
        self.stamp = time.time()

    @contextmanager
    def awaited(self) -> Iterator[None]:
        self.book.begin()
        yield
        try:
            self.book.settle()
        except CommandError as error:
            raise CallError(str(error)) from error
        self._show_switched()

    def _show_switched(self) -> None:
        """Puts modes that a call has just set into the state, so that a client reads them back at once and
        not only after the next published state."""
        chosen, self._switched = self._switched, set()
        modes, interactions = self.state.modes, self.state.interactions
        if not chosen or modes is None or interactions is None:
            return
        words, softs = list(modes), list(interactions)
        for number in chosen:
            words[number] = self._modes.word(number)
            softs[number] = COMPLIANT if self._modes.gate_mode(number) is Mode.IMPEDANCE else STIFF
        self.state = replace(self.state, modes=tuple(words), interactions=tuple(softs))

    def name(self, joint: int) -> str:
        return self.servos[self.joints([joint])[0]].name

    def joints(self, numbers: Sequence[int] | None) -> list[int]:
        if numbers is None:
            return list(range(self.count))
        return call_arguments.joint_numbers(numbers, self.count, self.part)

    def move(self, joints: Sequence[int] | None, angles: Sequence[float], *, relative: bool = False) -> None:
        chosen, values = self._checked(joints, angles)
        values = values + self.state.position[chosen] if relative else values
        self._modes.need(self._obeying(chosen), MOVING)
        self._aim(chosen, values, np.deg2rad(self.speeds[chosen]))

    def stream(self, stream: Stream, joints: Sequence[int] | None, numbers: Sequence[float]) -> None:
        chosen, values = self._checked(joints, numbers)
        obeying = self._obeying(chosen)
        self._early = time.monotonic(), stream, chosen, numbers
        self._modes.need(obeying, STREAMING[stream])
        self._early = None
        if stream is Stream.POSITION:
            self._aim(chosen, values, np.full(len(chosen), np.inf))
            return
        values = values[[chosen.index(number) for number in obeying]]
        self.set_points[stream][obeying] = values
        values = values if stream is Stream.TORQUE else np.deg2rad(values)
        self._order(obeying, COMMANDS[stream], values, np.full(len(obeying), np.inf))

    def stop(self, joints: Sequence[int] | None) -> None:
        chosen = self._obeying(self.joints(joints))
        resting = [number for number in chosen if self._modes.word(number) in (*MOVING, DIRECT)]
        self._aim(resting, self.state.position[resting], np.full(len(resting), np.inf))
        for stream in (Stream.VELOCITY, Stream.TORQUE):
            driven = [number for number in chosen if self._modes.word(number) in STREAMING[stream]]
            if driven:
                self.stream(stream, driven, [0.0] * len(driven))

    def is_done(self, joints: Sequence[int] | None) -> bool:
        return not self._moves[self.joints(joints)].any()

    def set_modes(self, joints: Sequence[int] | None, words: Sequence[int]) -> None:
        chosen, asked = self._asked(joints, words, MODES)
        self._switch(chosen, self._modes.with_words(chosen, asked))
        for stream in (Stream.VELOCITY, Stream.TORQUE):
            self.set_points[stream][chosen] = 0.0
        early, self._early = self._early, None
        if early is not None and time.monotonic() - early[0] < OVERTAKES:
            with suppress(CallError):
                self.stream(*early[1:])

    def set_interactions(self, joints: Sequence[int] | None, words: Sequence[int]) -> None:
        chosen, asked = self._asked(joints, words, (STIFF, COMPLIANT))
        self._switch(chosen, self._modes.with_interactions(chosen, asked))

    def available(self, joint: int) -> list[Vocab]:
        return self._modes.available(self.joints([joint])[0])

    def impedance(self, joint: int) -> Array:
        pair: Array = self._impedance[self.joints([joint])[0]]
        return pair

    def impedance_limits(self, joint: int) -> tuple[float, float]:
        self.joints([joint])
        return FULL_STIFFNESS, FULL_DAMPING

    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        number = self.joints([joint])[0]
        shares = call_arguments.finite([stiffness, damping], 2) / (FULL_STIFFNESS, FULL_DAMPING)
        if not np.all((shares >= 0.0) & (shares <= 1.0)):
            raise CallError(
                f"impedance {stiffness} {damping}; valid: 0 to {FULL_STIFFNESS} N m/deg, 0 to {FULL_DAMPING}"
            )
        self._impedance[number] = stiffness, damping
        for mode, share in zip((Mode.STIFFNESS, Mode.DAMPING), shares, strict=True):
            self._order([number], mode, np.array([share]), np.full(1, np.inf))

    def limits(self, joint: int) -> tuple[float, float]:
        lower, upper = self._range[self.joints([joint])[0]]
        return (float(lower), float(upper)) if np.isfinite([lower, upper]).all() else (0.0, 0.0)

    def speed_limit(self, joint: int) -> float:
        return float(np.rad2deg(self.servos[self.joints([joint])[0]].limits.velocity or 0.0))

    def torque_limit(self, joint: int) -> float:
        return float(self.servos[self.joints([joint])[0]].limits.torque or 0.0)

    def set_speeds(self, joints: Sequence[int] | None, speeds: Sequence[float]) -> None:
        chosen, values = self._checked(joints, speeds)
        if np.any(values < 0.0):
            raise CallError(f"speeds {values.tolist()[:20]}; valid: at least 0")
        self.speeds[chosen] = values

    def set_accelerations(self, joints: Sequence[int] | None, values: Sequence[float]) -> None:
        chosen, numbers = self._checked(joints, values)
        self.accelerations[chosen] = numbers

    def _checked(self, joints: Sequence[int] | None, numbers: Sequence[float]) -> tuple[list[int], Array]:
        chosen = self.joints(joints)
        return chosen, call_arguments.finite(numbers, len(chosen))

    def _asked(
        self, joints: Sequence[int] | None, words: Sequence[Any], valid: Collection[Vocab]
    ) -> tuple[list[int], list[Vocab]]:
        """Returns the joints in a call that can be moved, and the mode in `words` that the call requests for
        each of them."""
        chosen = self.joints(joints)
        found = call_arguments.modes(words, len(chosen), self.part, valid)
        obeying = self._obeying(chosen)
        return obeying, [found[chosen.index(number)] for number in obeying]

    def _obeying(self, chosen: list[int]) -> list[int]:
        """Returns those of the joints `chosen` in a call that the call moves.

        In a call for the whole board, joints that can't be moved are left out and keep the present angles.
        """
        return self._movable if len(chosen) == self.count and self._movable else chosen

    def _aim(self, chosen: Sequence[int], values: Array, speeds: Array) -> None:
        """Orders the joints `chosen` (k,) to move to `values` (k,) [deg] at `speeds` (k,) [rad/s]. Values
        outside a joint's range are clamped.

        A joint with a speed of almost 0 does not move: programs that let all joints arrive together give this
        speed to joints that are already at their targets.
        """
        angles = np.deg2rad(np.clip(values, *self._range[list(chosen)].T)) if len(chosen) else values
        obeying = {*self._obeying(list(chosen))}
        for mode in (Mode.POSITION, Mode.IMPEDANCE):
            mine = [
                place
                for place, number in enumerate(chosen)
                if number in obeying and speeds[place] >= SLOWEST and self._modes.gate_mode(number) is mode
            ]
            if mine:
                self._order([chosen[place] for place in mine], mode, angles[mine], speeds[mine])

    def _switch(self, joints: Sequence[int], wanted: Sequence[JointMode]) -> None:
        """Requests the modes `wanted` for joints from the gate, which changes a mode only while the joint is
        at rest.

        If the gate refuses a mode, the joint's previous mode is restored.
        """
        changing = self._modes.changing(joints, wanted)
        interrupted = self._rest(changing) if self.book.is_awaited and self._is_moving(changing) else {}
        before = self._modes.put(joints, wanted)
        self._switched.update(joints)
        carried = [self._modes.gate_mode(number) for number in joints]
        for mode in dict.fromkeys(carried):
            mine = [place for place, other in enumerate(carried) if other is mode]
            chosen = [joints[place] for place in mine]
            undo = partial(self._modes.put, chosen, [before[place] for place in mine])
            try:
                self._put(PlatformSwitch(servos=self._index[chosen], mode=mode), undo)
            except CallError:
                undo()
                raise
        others = list(interrupted)
        self._aim(others, np.array([*interrupted.values()]), np.deg2rad(self.speeds[others]))

    def _rest(self, joints: Sequence[int]) -> dict[int, float]:
        """Brings `joints` to rest before a change of mode, and also all other joints that move to a target.

        Returns the targets [deg] of these other joints by joint number, with which the caller continues their
        moves.
        """
        others = {
            number: float(self.set_points[Stream.POSITION][number])
            for number in np.flatnonzero(self._moves).tolist()
            if number not in joints and self._modes.word(number) in (*MOVING, DIRECT)
        }
        self.stop([*joints, *others])
        with self._stepped:
            self._stepped.wait_for(lambda: not self._is_moving([*joints, *others]), COMES_TO_REST)
        return others

    def _is_moving(self, joints: Sequence[int]) -> bool:
        chosen, speed = list(joints), self.state.velocity
        fast = False if speed is None else (np.abs(np.deg2rad(speed[chosen])) > AT_REST).any()
        return bool(fast or self._moves[chosen].any())

    def _order(self, joints: Sequence[int], mode: Mode, values: Array, speed: Array) -> None:
        self._put(PlatformCommand(mode=mode, servos=self._index[list(joints)], values=values, speed=speed))

    def _put(self, order: Order, undo: Callable[[], object] | None = None) -> None:
        if not self.armed:
            raise CallError(f"{self.part} is read-only; valid: tci serve --arm")
        self.book.put(order, undo)


def _is_movable(servo: Servo) -> bool:
    """Returns True if the robot's description has all limits that are required to move a servo."""
    try:
        check_limits(servo)
    except CommandError:
        return False
    return True


def _range(servo: Servo) -> tuple[float, float]:
    """Returns the lowest and highest angle [deg] of a servo; -inf and inf if they are unknown."""
    lower, upper = servo.limits.lower, servo.limits.upper
    return np.rad2deg(-np.inf if lower is None else lower), np.rad2deg(np.inf if upper is None else upper)
