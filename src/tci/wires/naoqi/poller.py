"""A thread that requests joints, skin and touch from NAOqi, and reconnects after a lost connection."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError, FrameError
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.clock import Clock
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.wires.naoqi import words
from tci.wires.naoqi.currents import Currents
from tci.wires.naoqi.session import Address, Services, answer

ANSWER = 0.05
"""Longest time [s] to wait for an answer after connecting. Assumed: a connected robot answers within 2.5
periods of ALMotion."""
GONE = 1.0
"""Time [s] without an answer after which the connection counts as lost. Assumed: a connected robot answers
within a twentieth of this time (`ANSWER`)."""
AGAIN = 0.3
"""Time [s] between two attempts to reconnect. Assumed: attempts cost little, and a robot needs seconds to
start."""
IDLE = 0.1
"""Longest time [s] between two requests while no call of `read` waits. Assumed: this rate detects a lost
connection at little cost."""
EARLY, LATE = 0.0005, 0.0025
"""A skin frame is requested from EARLY [s] before its expected time until LATE [s] after it. Assumed: a
longer window causes more requests, a shorter window misses late frames."""
STEP = 0.001
"""Assumed upper bound [s] of the age of a skin frame when a request returns it for the first time. The poller
uses the bound to estimate when the next frame is due."""
FIRST = 0.003
"""If a skin frame is expected within this time [s] and the latest joint data is recent, the poller requests
only the skin, and returns it with this joint data. Assumed: a request for joints and skin takes less time."""
SLOW = 0.05
"""Time [s] between two requests for stiffness. Assumed: stiffness changes slowly."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensed:
    """The data that one request returned."""

    reading: Reading
    stiffness: Array
    """Stiffness 0..1 of each servo (n,)."""


class Poller:
    """Requests data of one robot whenever a call of `read` waits, and otherwise at a low rate."""

    def __init__(
        self, robot: Robot, address: Address, clock: Clock, *, joints: bool, skin: bool,
        greet: Callable[[Services], None], glance: Callable[[], None],
    ) -> None:  # fmt: skip
        """Connects, and requests data once. Raises DriverError if the robot does not answer. After each
        reconnection, the thread calls `greet`. The robot counts as connected when `greet` has returned. If
        `greet` raises DriverError, the thread connects again. After each answer, the thread calls `glance`
        for tasks that are not urgent.
        """
        self.robot, self.address, self.clock = robot, address, clock
        self._greet, self._glance = greet, glance
        binding = robot.binding(words.MIDDLEWARE)
        self.names = [binding.address(servo.name, servo.name) for servo in robot.servos]
        """The robot's own names of its joints, in the description's order."""
        self.keys = words.skin_keys(robot, binding) if skin else {}
        """ALMemory keys of each patch that is read: one key for the patch, or one key per channel."""
        self.trips: deque[float] = deque(maxlen=1000)
        """Durations [s] of the latest requests."""
        self.counts: Counter[str] = Counter()
        """Counts of requests (`polls`), `failures`, `reconnections` and invalid skin frames (`bad`)."""
        self.trouble = ""
        """Reason why the robot does not answer at present. The text is empty if the robot answers."""
        self._joints = joints
        self._currents = Currents(robot, self.names)
        self._channels = {patch.name: patch.channels for patch in robot.skin}
        self._every = {patch.name: 1.0 / patch.rate for patch in robot.skin}
        self._period, self._until = 1.0 / binding.rate, -np.inf
        self._frames: dict[str, SkinFrame] = {}
        self._seen: dict[str, float] = {}
        self._missed: dict[str, float] = {}
        self._due: dict[str, float] = {}
        self._stiffness = np.ones(len(robot.servos))
        self._stiffness_due = -np.inf
        self._before: JointReading | None = None
        self.services = Services(address, motion=joints)
        try:
            self._asks = words.find_keys(self.keys, self._try)
            for key in self._currents.keys if joints else ():
                if self._try(key) is words.REFUSED:
                    raise DriverError(f"{robot.name} has no {key}; valid: amperes of joints that have one")
            self.latest = self._ask()
        except BaseException:
            self.services.close()
            raise
        self._known, self._look, self._back = dict(self._asks), -np.inf, np.inf
        self.generation = 0
        """Counter that increases after each reconnection, and after each interval without answers that is
        longer than `stale_after`."""
        self._wanted, self._fresh = threading.Event(), threading.Event()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"naoqi {address.host}", daemon=True)
        self._thread.start()

    def read(self, patience: float) -> Sensed:
        """Requests data and returns the answer. If no answer arrives in time, returns the previous data.
        Waits at most `patience` [s] for the answer, plus `LATE` [s] if a skin frame is due in this time."""
        self._fresh.clear()
        self._until = self.clock.now() + patience
        self._wanted.set()
        self._fresh.wait(patience + (LATE if self._next_frame() is not None else 0.0))
        return self.latest

    def end(self, patience: float) -> None:
        """Ends the thread. Waits at most `patience` [s] until the thread has ended, since the thread may be
        connecting."""
        self._end.set()
        self._wanted.set()
        self._thread.join(timeout=patience)

    def close(self) -> None:
        """Ends the thread and the session."""
        self.end(2.0)
        self.services.close()

    def _run(self) -> None:
        answered, missed = self.clock.now(), False
        stale = self.robot.binding(words.MIDDLEWARE).stale_after
        while not self._end.is_set():
            self._wanted.wait(IDLE)
            self._wanted.clear()
            if self._end.is_set():
                return
            try:
                if again := bool(self.trouble):
                    self._reconnect()
                sensed = self.latest if self._skin_first() else self._ask()
                while (due := self._next_frame()) is not None and not self._end.is_set():
                    self._end.wait(max(0.0, due - EARLY - self.clock.now()))
                    sensed = self._ask(sensed.reading.joints)
                if again or (missed and self.clock.now() - answered > stale):
                    # the session is new, or the robot did not answer for longer than `stale_after`
                    self.generation += 1
                self.latest = sensed
                # set after `generation`, so that a thread that reads the empty `trouble` also reads the new
                # `generation`
                self.trouble = ""
                answered, missed = self.clock.now(), False
                self._fresh.set()
                self._glance()
                self._look_again()
            except DriverError as error:
                self.counts["failures"] += 1
                missed = True
                late = self.clock.now() - answered < GONE
                if not self.trouble and late and self.services.session.isConnected():
                    continue  # the answer is only late; the gate holds if joint data becomes too old
                self.trouble = str(error)
                self.services.close()
                self._end.wait(AGAIN)

    def _next_frame(self) -> float | None:
        """Returns the time [s] at which the next skin frame is expected; None if none is expected before
        `read` stops waiting."""
        now = self.clock.now()
        due = (seen + self._every[patch] for patch, seen in self._seen.items())
        return min((one for one in due if now - LATE < one < self._until), default=None)

    def _skin_first(self) -> bool:
        """Returns True if the next request is for the skin only, because a skin frame is expected soon and
        the joint data of the previous period is recent enough."""
        due, before = self._next_frame(), self._before
        now, longest = self.clock.now(), 2.0 * self._period
        return due is not None and before is not None and due - now < FIRST and now - before.stamp < longest

    def _reconnect(self) -> None:
        self.services = Services(self.address, motion=self._joints)
        self._asks = words.find_keys(self.keys, self._try)
        self._before, self._stiffness_due, self._back = None, -np.inf, self.clock.now()
        self._greet(self.services)
        self.counts["reconnections"] += 1

    def _look_again(self) -> None:
        """Searches again for patches that are missing since a reconnection. The program that publishes these
        patches may start later than NAOqi."""
        lost = {p: self.keys[p] for p, keys in self._known.items() if self._asks.get(p) != keys}
        if lost and self.clock.now() >= self._look:
            self._look = self.clock.now() + GONE
            here = {p for p in lost if p in self._frames and self._frames[p].stamp > self._back}
            self._asks |= words.find_keys(lost, self._try)
            # the patch is published again, possibly under another key
            self._known |= {p: self._asks[p] for p in here}

    def _try(self, key: str) -> Any:
        """Returns the value of a key of ALMemory, None if there is no value, or `words.REFUSED` if NAOqi
        refuses the request."""
        try:
            return self._values(self.services.memory.getListData([key], _async=True), [key], 1.0)[0]
        except DriverError:
            if not self.services.session.isConnected():
                raise
            return words.REFUSED

    @staticmethod
    def _values(future: Any, keys: list[str], timeout: float) -> list[Any]:
        values = answer(future, "ALMemory.getListData", timeout=timeout)
        if not isinstance(values, list | tuple) or len(values) != len(keys):
            raise DriverError(f"ALMemory answers {str(values)[:60]!r} for {len(keys)} keys")
        return list(values)

    def _ask(self, joints: JointReading | None = None) -> Sensed:
        """Requests joint data and skin once and returns the answer. If `joints` are given, requests only the
        skin, and returns it with `joints`. Raises DriverError if the answer is late or invalid."""
        begin = self.clock.now()
        motion, memory = self.services.motion, self.services.memory
        asked = {patch: keys for patch, keys in self._asks.items() if begin >= self._due.get(patch, -np.inf)}
        keys = [key for some in asked.values() for key in some]
        whole = joints is None and self._joints
        angles = motion.getAngles(self.names, True, _async=True) if whole else None
        driven = self._currents.keys if whole else []
        values = memory.getListData([*keys, *driven], _async=True)
        stiff = None
        if whole and begin >= self._stiffness_due:
            stiff = motion.getStiffnesses(self.names, _async=True)
            self._stiffness_due = begin + SLOW
        joints = self._read_joints(angles, begin) if joints is None else joints
        answers = iter(self._values(values, [*keys, *driven], ANSWER))
        for patch, some in asked.items():
            found = [next(answers) for _ in some]
            try:
                frame = self._frame(patch, begin, found)
            except FrameError:
                self.counts["bad"] += 1
                continue
            if frame is not None:
                self._frames[patch] = frame
                # patches that a program publishes, not switches
                if len(some) <= 2 and self._every[patch] > self._period:
                    missed = self._missed.get(patch, -np.inf)
                    self._seen[patch] = max((missed + begin) / 2.0, begin - STEP)
            else:
                self._missed[patch] = begin
        if driven:
            joints = replace(joints, torque=self._currents.torque([*answers], joints.position))
        if stiff is not None:
            self._stiffness = self._numbers(
                answer(stiff, "ALMotion.getStiffnesses", timeout=ANSWER), "stiffness"
            )
        self.counts["polls"] += 1
        if whole or not self._joints:
            self.trips.append(self.clock.now() - begin)
        reading = Reading(joints, tuple(self._frames[name] for name in self.keys if name in self._frames))
        return Sensed(reading, self._stiffness)

    def _read_joints(self, angles: Any, begin: float) -> JointReading:
        count = len(self.robot.servos)
        if angles is None:
            return JointReading(begin, self.counts["polls"], np.zeros(count), np.zeros(count))
        position = self._numbers(answer(angles, "ALMotion.getAngles", timeout=ANSWER), "angles")
        before, velocity = self._before, np.zeros(count)
        if before is not None and begin > before.stamp:
            velocity = (position - before.position) / (begin - before.stamp)
        # The stamp is the time of the request, since the measurement may be that old.
        joints = JointReading(begin, self.counts["polls"], read_only(position), read_only(velocity))
        self._before = joints
        return joints

    def _numbers(self, values: Any, what: str) -> Array:
        count = len(self.robot.servos)
        try:
            numbers = np.array(values, dtype=float)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        if numbers.shape != (count,):
            raise DriverError(f"ALMotion sends {str(values)[:60]!r} as {what} of {count} joints")
        return numbers

    def _frame(self, patch: str, stamp: float, found: list[Any]) -> SkinFrame | None:
        """Returns a skin frame made of `found`, the values of the patch's keys in ALMemory; None if the
        values are missing or those of the previous frame. Raises FrameError if they are invalid."""
        old = self._frames.get(patch)
        if len(self.keys[patch]) > 1:
            self._due[patch] = stamp + 0.9 * self._every[patch]
            if not all(isinstance(value, int | float) for value in found):
                return None  # the robot lacks these sensors
            # Switches are read directly, so each reading of switches is a new frame.
            return SkinFrame(patch, stamp, 0 if old is None else old.sequence + 1, _vector(patch, found))
        value, number = found[0], found[1] if len(found) > 1 else None
        if isinstance(value, str):
            if old is not None and value.startswith(f"{old.sequence} "):
                return None
            sequence, values = words.unpack(value, self._channels[patch])
            return SkinFrame(patch, stamp, sequence, read_only(values, values.dtype))
        if not isinstance(value, list | tuple):
            return None
        self._due[patch] = stamp + 0.5 * self._every[patch]
        values = _vector(patch, value)
        if isinstance(number, int):
            new = old is None or number != old.sequence
            return SkinFrame(patch, stamp, number, values) if new else None
        if old is not None and np.array_equal(values, old.values):
            return None
        return SkinFrame(patch, stamp, 0 if old is None else old.sequence + 1, values)


def _vector(patch: str, value: list[Any] | tuple[Any, ...]) -> NDArray[np.generic]:
    """Converts a patch's value in ALMemory to a skin frame's values. Raises FrameError if the value is not a
    vector of numbers."""
    try:
        values = np.array(value)
    except ValueError:
        values = np.array([""])
    if values.ndim != 1 or values.dtype.kind not in "uif":
        raise FrameError(f"{patch}: {str(value)[:60]!r}; valid: a vector of numbers")
    return read_only(values, values.dtype)
