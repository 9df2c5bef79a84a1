"""One robot part served as a control board: its answers to calls, and the orders that commands become.

Both dialects use it. Values of YARP are in degrees, those of TCI in radians.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import numpy as np

from tci.drivers.yarp.order_book import OrderBook
from tci.errors import CommandError
from tci.frames import Array
from tci.messages import JointReading, Mode, Order, PlatformCommand, PlatformSwitch
from tci.robot.description import Servo
from yarpwire.board import COMPLIANT, DIRECT, IDLE, POSITION, STIFF, TORQUE, VELOCITY, Stream
from yarpwire.board_service import BoardService
from yarpwire.errors import CallError, WireError
from yarpwire.state import BoardState
from yarpwire.values import Vocab

FULL_STIFFNESS = 1.0
"""Stiffness [N m/deg] that stands for the full stiffness of a servo. Assumed: TCI sets fractions of it, and
YARP wants a value with a unit."""
FULL_DAMPING = 0.1
"""Damping [N m s/deg] that stands for the full damping of a servo. Assumed, as FULL_STIFFNESS."""
SPEED = 10.0
"""Speed [deg/s] of a joint's moves until a client sets another, as on iCub."""
ACCELERATION = 50.0
"""Acceleration [deg/s2] that clients read until they set another. Assumed; it has no effect, since the gate
uses the limits of the description."""
OVERTAKES = 0.005
"""Longest time [s] that streamed values wait for the change to their mode, which arrives on another
connection and may come later. Assumed: half of a board's period on iCub."""
THERE = 0.5
"""Distance [deg] from its target within which a joint's move counts as done. Assumed: more than encoder noise
and the sag of a servo under gravity."""
MODES = {POSITION: Mode.POSITION, DIRECT: Mode.POSITION, VELOCITY: Mode.VELOCITY, TORQUE: Mode.TORQUE}
STREAMS = {Stream.POSITION: DIRECT, Stream.VELOCITY: VELOCITY, Stream.TORQUE: TORQUE}
COMMANDS = {Stream.POSITION: Mode.POSITION, Stream.VELOCITY: Mode.VELOCITY, Stream.TORQUE: Mode.TORQUE}


class ServedBoard(BoardService):
    """A robot part as a control board. The loop calls `update`, connections call the other methods."""

    def __init__(self, part: str, servos: Sequence[Servo]) -> None:
        self.part = part
        self.servos = tuple(servos)
        self.count = len(self.servos)
        self.speeds = np.full(self.count, SPEED)
        """Speed (n_joints,) [deg/s] of moves."""
        self.accelerations = np.full(self.count, ACCELERATION)
        """Acceleration (n_joints,) [deg/s2] that clients have set; it has no effect."""
        self._index = np.array([servo.index for servo in self.servos], dtype=np.intp)
        self.book = OrderBook()
        """Orders that wait for the loop."""
        self._words = dict.fromkeys(range(self.count), POSITION)
        self._compliant = [False] * self.count
        self._impedance = np.tile([FULL_STIFFNESS, FULL_DAMPING], (self.count, 1))
        self._targets = np.full(self.count, np.nan)
        self._early: tuple[float, Stream, list[int], Sequence[float]] | None = None
        self.state = BoardState(np.zeros(self.count))
        """Latest state of the joints."""
        self.stamp = 0.0
        """Time [s] since 1970 at which the state was stored."""
        self.armed = True
        """True if the board accepts commands; otherwise it refuses each with CallError."""

    def update(self, joints: JointReading, modes: Sequence[Mode]) -> None:
        """Stores the joints of this period, and the gate's control mode (n_servos,) of every servo of the
        robot."""
        if not self.book.is_busy():
            self._catch_up(modes)
        powered = joints.powered
        words = [
            IDLE if powered is not None and not powered[servo] else self._word(number, modes[servo])
            for number, servo in enumerate(self._index.tolist())
        ]
        self.state = BoardState(
            position=np.rad2deg(joints.position[self._index]),
            velocity=np.rad2deg(joints.velocity[self._index]),
            torque=joints.torque[self._index] if joints.torque is not None else None,
            modes=tuple(words),
            interactions=tuple(
                COMPLIANT if modes[servo] is Mode.IMPEDANCE else STIFF for servo in self._index.tolist()
            ),
        )
        self.stamp = time.time()

    def _catch_up(self, modes: Sequence[Mode]) -> None:
        """Takes over the gate's mode of each joint for which it differs from the mode that clients have
        set."""
        for number, servo in enumerate(self._index.tolist()):
            mode = modes[servo]
            if self._mode(number, MODES[self._words[number]]) is not mode:
                self._compliant[number] = mode is Mode.IMPEDANCE
                self._words[number] = {Mode.VELOCITY: VELOCITY, Mode.TORQUE: TORQUE}.get(mode, POSITION)

    def _word(self, number: int, mode: Mode) -> Vocab:
        if mode in (Mode.VELOCITY, Mode.TORQUE):
            return VELOCITY if mode is Mode.VELOCITY else TORQUE
        wanted = self._words[number]
        return wanted if wanted in (POSITION, DIRECT) else POSITION

    @contextmanager
    def awaited(self) -> Iterator[None]:
        self.book.begin()
        yield
        try:
            self.book.settle()
        except CommandError as error:
            raise CallError(str(error)) from error

    def name(self, joint: int) -> str:
        return self.servos[self.joints([joint])[0]].name

    def joints(self, numbers: Sequence[int] | None) -> list[int]:
        if numbers is None:
            return list(range(self.count))
        chosen = [int(n) for n in _listed(numbers) if isinstance(n, int) and 0 <= n < self.count]
        if not chosen or not len(numbers) == len(chosen) == len(set(chosen)):
            raise CallError(
                f"joints {str(numbers)[:60]} of {self.part}; valid: 0 to {self.count - 1}, each once"
            )
        return chosen

    def move(self, joints: Sequence[int] | None, angles: Sequence[float], *, relative: bool = False) -> None:
        chosen, values = self._checked(joints, angles)
        self._need(chosen, (POSITION,))
        values = values + self.state.position[chosen] if relative else values
        self._targets[chosen] = values
        self._order(chosen, Mode.POSITION, np.deg2rad(values), np.deg2rad(self.speeds[chosen]))

    def stream(self, stream: Stream, joints: Sequence[int] | None, numbers: Sequence[float]) -> None:
        chosen, values = self._checked(joints, numbers)
        self._early = time.monotonic(), stream, chosen, numbers
        self._need(chosen, (STREAMS[stream],))
        self._early = None
        if stream is Stream.POSITION:
            self._targets[chosen] = values
        values = values if stream is Stream.TORQUE else np.deg2rad(values)
        modes = {Mode.IMPEDANCE if self._compliant[n] else COMMANDS[stream] for n in chosen}
        for mode in modes if stream is Stream.POSITION else {COMMANDS[stream]}:
            mine = [k for k, n in enumerate(chosen) if self._mode(n, COMMANDS[stream]) is mode]
            self._order([chosen[k] for k in mine], mode, values[mine], np.full(len(mine), np.inf))

    def stop(self, joints: Sequence[int] | None) -> None:
        chosen = self.joints(joints)
        for number in chosen:
            if self._words[number] in (POSITION, DIRECT):
                here = self.state.position[[number]]
                self._targets[number] = here[0]
                self._order([number], self._mode(number, Mode.POSITION), np.deg2rad(here), np.full(1, np.inf))
            elif self._words[number] == VELOCITY:
                self._order([number], Mode.VELOCITY, np.zeros(1), np.full(1, np.inf))

    def is_done(self, joints: Sequence[int] | None) -> bool:
        chosen = self.joints(joints)
        return not np.any(np.abs(self.state.position[chosen] - self._targets[chosen]) >= THERE)

    def set_modes(self, joints: Sequence[int] | None, words: Sequence[int]) -> None:
        chosen = self.joints(joints)
        asked = self._vocabularies(words, len(chosen), MODES)
        wanted = [self._mode(number, MODES[word]) for number, word in zip(chosen, asked, strict=True)]
        for number, mode in zip(chosen, wanted, strict=True):
            self._can(number, mode)
        before = {number: self._words[number] for number in chosen}
        for number, word in zip(chosen, asked, strict=True):
            self._words[number] = word
            self._targets[number] = np.nan
        self._switch(chosen, wanted, before)
        early, self._early = self._early, None
        if early is not None and time.monotonic() - early[0] < OVERTAKES:
            with suppress(CallError):
                self.stream(*early[1:])

    def set_interactions(self, joints: Sequence[int] | None, words: Sequence[int]) -> None:
        chosen = self.joints(joints)
        asked = self._vocabularies(words, len(chosen), (STIFF, COMPLIANT))
        for number, word in zip(chosen, asked, strict=True):
            if word == COMPLIANT:
                self._can(number, Mode.IMPEDANCE)
        resting = [n for n in chosen if self._words[n] in (POSITION, DIRECT)]
        soft = {number: word == COMPLIANT for number, word in zip(chosen, asked, strict=True)}
        if resting:
            self._switch(resting, [Mode.IMPEDANCE if soft[n] else Mode.POSITION for n in resting])
        for number in chosen:
            self._compliant[number] = soft[number]

    def impedance(self, joint: int) -> Array:
        pair: Array = self._impedance[self.joints([joint])[0]]
        return pair

    def impedance_limits(self) -> tuple[float, float]:
        return FULL_STIFFNESS, FULL_DAMPING

    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        number = self.joints([joint])[0]
        shares = _finite([stiffness, damping], 2) / (FULL_STIFFNESS, FULL_DAMPING)
        if not np.all((shares >= 0.0) & (shares <= 1.0)):
            raise CallError(
                f"impedance {stiffness} {damping}; valid: 0 to {FULL_STIFFNESS} N m/deg, 0 to {FULL_DAMPING}"
            )
        self._impedance[number] = stiffness, damping
        for mode, share in zip((Mode.STIFFNESS, Mode.DAMPING), shares, strict=True):
            self._order([number], mode, np.array([share]), np.full(1, np.inf))

    def limits(self, joint: int) -> tuple[float, float]:
        limits = self.servos[self.joints([joint])[0]].limits
        if limits.lower is None or limits.upper is None:
            return 0.0, 0.0
        return float(np.rad2deg(limits.lower)), float(np.rad2deg(limits.upper))

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

    def available(self, joint: int) -> list[Vocab]:
        servo = self.servos[self.joints([joint])[0]]
        return [word for word, mode in MODES.items() if mode in servo.modes]

    def _checked(self, joints: Sequence[int] | None, numbers: Sequence[float]) -> tuple[list[int], Array]:
        chosen = self.joints(joints)
        return chosen, _finite(numbers, len(chosen))

    def _vocabularies(self, words: Sequence[Any], count: int, valid: Collection[Vocab]) -> list[Vocab]:
        with suppress(WireError):
            found = [Vocab(word) for word in _listed(words)]
            if len(found) == count and all(word in valid for word in found):
                return found
        raise CallError(
            f"modes {str(words)[:60]} for {count} joints of {self.part}; valid, one per joint: "
            + ", ".join(str(word) for word in valid)
        )

    def _need(self, joints: Sequence[int], words: Sequence[Vocab]) -> None:
        for number in joints:
            if self._words[number] not in words:
                raise CallError(
                    f"{self.servos[number].name} is in {self._words[number]}; this command needs {words[0]}"
                )

    def _can(self, number: int, mode: Mode) -> None:
        servo = self.servos[number]
        if mode not in servo.modes:
            valid = ", ".join(known.value for known in servo.modes)
            raise CallError(f"{servo.name} has no {mode.value} mode; valid: {valid}")

    def _mode(self, number: int, mode: Mode) -> Mode:
        return Mode.IMPEDANCE if mode is Mode.POSITION and self._compliant[number] else mode

    def _switch(
        self, joints: Sequence[int], modes: Sequence[Mode], before: Mapping[int, Vocab] | None = None
    ) -> None:
        """Orders new modes for joints. If the gate refuses one, the joint's previous mode from `before` is
        restored."""
        for mode in dict.fromkeys(modes):
            chosen = [number for number, wanted in zip(joints, modes, strict=True) if wanted is mode]
            undo = partial(
                self._words.update, {number: before[number] for number in chosen} if before else {}
            )
            try:
                self._put(PlatformSwitch(servos=self._index[chosen], mode=mode), undo)
            except CallError:
                undo()
                raise

    def _order(self, joints: Sequence[int], mode: Mode, values: Array, speed: Array) -> None:
        self._put(PlatformCommand(mode=mode, servos=self._index[list(joints)], values=values, speed=speed))

    def _put(self, order: Order, undo: Callable[[], None] | None = None) -> None:
        if not self.armed:
            raise CallError(f"{self.part} is read-only; valid: tci serve --arm")
        self.book.put(order, undo)


def _listed(items: object) -> Sequence[Any]:
    """Returns `items` if it is a list, else an empty one."""
    return items if isinstance(items, list | tuple) else ()


def _finite(numbers: Sequence[Any], count: int) -> Array:
    values = [float(number) for number in _listed(numbers) if isinstance(number, int | float)]
    if not len(values) == len(_listed(numbers)) == count or not np.all(np.isfinite(values)):
        raise CallError(f"{str(numbers)[:60]} in place of numbers; valid: {count} finite numbers")
    return np.array(values)
