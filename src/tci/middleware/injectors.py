"""What can be made to fail, one class per fault. Each works on any link, unless it says otherwise."""

from __future__ import annotations

import os
import signal
import threading
import time
from abc import ABC
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tci.errors import LinkError
from tci.frames import Array, read_only
from tci.messages import JointReading, Mode, Reading, SkinFrame
from tci.middleware.link import Link

HOUR = 3600.0
THREAD = "rehearsal"
"""Name of a thread that fails on purpose."""
INJECTORS: dict[str, type[Injector]] = {}
"""Every injector by its name."""


class Injector(ABC):
    """One fault while it lasts."""

    number: ClassVar[int]
    """Its number in the catalogue."""
    says: ClassVar[str]
    """What happens, for `tci fault list`."""
    shows_after: ClassVar[float] = 0.0
    """How long [s] it may take until anybody can know."""

    def __init__(self, link: Link, first: Reading) -> None:
        """The fault begins: `first` is the last sound reading."""
        self.link = link
        self.first = first
        self.begin()

    def __init_subclass__(cls, *, name: str = "") -> None:
        if name:
            INJECTORS[name] = cls

    def begin(self) -> None:
        """What is done once, at the beginning."""
        return

    def read(self, reading: Reading) -> Reading:
        """The reading that the loop gets instead."""
        return Reading(self.joints(reading.joints), tuple(map(self.frame, reading.skin)))

    def joints(self, joints: JointReading) -> JointReading:
        """The joints that the loop gets instead."""
        return joints

    def frame(self, frame: SkinFrame) -> SkinFrame:
        """The skin frame that the loop gets instead."""
        return frame

    def end(self) -> None:
        """The fault is over."""
        return


class _Taxels(Injector):
    """Changes raw values of the first patch."""

    def frame(self, frame: SkinFrame) -> SkinFrame:
        if frame.patch != self.link.robot.patches[0].name:
            return frame
        if frame.values.dtype.kind not in "uif":
            return frame  # another fault spoilt it already
        values = frame.values.astype(float)
        sensor = self.link.robot.patches[0].sensor
        pressed = sensor.lowest if sensor.pascal_per_count < 0.0 else sensor.highest
        return replace(frame, values=self.change(values, float(pressed), float(sensor.rest)))

    def change(self, values: Array, pressed: float, rest: float) -> NDArray[np.generic]:
        """The values (channels,) instead; `pressed` is the hardest touch, `rest` none."""
        raise NotImplementedError


class StuckHigh(_Taxels, name="taxel-stuck-high"):
    """One taxel."""

    number = 1
    says = "one taxel of the first patch reports the hardest touch for ever"
    shows_after = 62.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[0] = pressed
        return values


class StuckLow(_Taxels, name="taxel-stuck-low"):
    """One taxel."""

    number = 2
    says = "one taxel of the first patch reports rest for ever"
    shows_after = 62.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[0] = rest
        return values


class DeadPatch(_Taxels, name="dead-patch"):
    """All taxels of a patch."""

    number = 3
    says = "the first patch reports zeros"
    shows_after = 62.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        return np.zeros_like(values)


class NaNTaxel(_Taxels, name="nan-taxel"):
    """A tenth of the taxels."""

    number = 4
    says = "every tenth taxel of the first patch is not a number"

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[::10] = np.nan
        return values


class Saturated(_Taxels, name="saturated-taxel"):
    """A few taxels at the end of their range."""

    number = 5
    says = "twelve neighbouring channels of the first patch are at the end of their range"

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        values[:12] = pressed
        return values


class BaselineStep(_Taxels, name="baseline-step"):
    """All rest values change."""

    number = 7
    says = "all taxels of the first patch read a fifth of their range more than before"
    shows_after = 32.0

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        stepped: Array = values + 0.2 * (pressed - rest)
        return stepped


class WrongCount(_Taxels, name="wrong-taxel-count"):
    """A frame of another length."""

    number = 15
    says = "frames of the first patch lack their last value"

    def change(self, values: Array, pressed: float, rest: float) -> Array:
        return values[:-1]


class WrongType(_Taxels, name="wrong-type"):
    """A frame of text."""

    number = 35
    says = "frames of the first patch hold text instead of numbers"

    def change(self, values: Array, pressed: float, rest: float) -> NDArray[np.generic]:
        return np.array(["touch"] * len(values))


class Dropped(Injector, name="dropped-frames"):
    """Nothing new arrives."""

    number = 10
    says = "the robot sends nothing new: joints and skin stay as they were, with their old stamps"

    def read(self, reading: Reading) -> Reading:
        return self.first


class SkinSilent(Injector, name="skin-silent"):
    """Only the joints go on."""

    number = 10
    says = "the skin sends nothing new, while the joints go on"

    def read(self, reading: Reading) -> Reading:
        return replace(reading, skin=self.first.skin)


class OutOfOrder(Injector, name="out-of-order"):
    """Every second frame of the skin is an old one."""

    number = 11
    says = "every second skin frame is an old one"

    def begin(self) -> None:
        self._count = 0
        self._old = {frame.patch: frame for frame in self.first.skin}

    def read(self, reading: Reading) -> Reading:
        self._count += 1
        return super().read(reading) if self._count % 2 else reading

    def frame(self, frame: SkinFrame) -> SkinFrame:
        return self._old.get(frame.patch, frame)


class Duplicates(Injector, name="duplicates"):
    """Frames come twice."""

    number = 12
    says = "every skin frame comes twice in one reading"

    def read(self, reading: Reading) -> Reading:
        return replace(reading, skin=reading.skin + reading.skin)


class Frozen(Injector, name="frozen-source"):
    """Old joints under fresh stamps."""

    number = 14
    says = "the joint data stays the same under fresh stamps"

    def joints(self, joints: JointReading) -> JointReading:
        return replace(self.first.joints, stamp=joints.stamp)


class _OneServo(Injector):
    """Changes the angle of each servo under command, or of all when there is none."""

    def joints(self, joints: JointReading) -> JointReading:
        age = joints.stamp - self.first.joints.stamp
        return replace(joints, position=read_only(self.angles(joints.position, age)))

    def angles(self, position: Array, age: float) -> Array:
        """Angles (n,) [rad] instead, `age` [s] after the beginning."""
        raise NotImplementedError


class WrongDirection(_OneServo, name="wrong-direction"):
    """Measured motion has the wrong sign."""

    number = 19
    says = "all joints move against their commands (the sign of gamma)"

    def angles(self, position: Array, age: float) -> Array:
        return 2.0 * self.first.joints.position - position


class StaleEncoder(_OneServo, name="stale-encoder"):
    """Angles that do not change."""

    number = 20
    says = "all angles stay the same to the bit, under fresh stamps and numbers"

    def angles(self, position: Array, age: float) -> Array:
        return self.first.joints.position.copy()


class Stall(_OneServo, name="stall"):
    """Angles that only tremble."""

    number = 21
    says = "all joints are blocked where they are, and tremble"

    def angles(self, position: Array, age: float) -> Array:
        trembling: Array = self.first.joints.position + 1e-5 * np.sin(300.0 * age)
        return trembling


class EncoderStep(_OneServo, name="encoder-step"):
    """A jump of the first servo."""

    number = 25
    says = "the first encoder jumps by 10 degrees"

    def angles(self, position: Array, age: float) -> Array:
        stepped = position.copy()
        stepped[0] += np.deg2rad(10.0)
        return stepped


class ServoOff(Injector, name="servo-off"):
    """Power lost."""

    number = 22
    says = "all servos report that they are off; simulated ones go limp"

    def begin(self) -> None:
        self._world = getattr(self.link, "world", None)
        self._all = np.arange(len(self.link.robot.servos))
        if self._world is not None:
            self._world.set_power(self._all, on=False)

    def joints(self, joints: JointReading) -> JointReading:
        return replace(joints, powered=read_only(np.zeros(len(self._all)), np.bool_))

    def end(self) -> None:
        if self._world is not None:
            self._world.set_power(self._all, on=True)


class ModeMismatch(Injector, name="mode-mismatch"):
    """Another mode than the commanded one."""

    number = 23
    says = "all servos report torque mode"

    def joints(self, joints: JointReading) -> JointReading:
        return replace(joints, modes=(Mode.TORQUE,) * len(joints.position))


class NaNAngle(_OneServo, name="nan-angle"):
    """An angle that is none."""

    number = 4
    says = "the angle of the first servo is not a number"

    def angles(self, position: Array, age: float) -> Array:
        spoilt = position.copy()
        spoilt[0] = np.nan
        return spoilt


class ClockJump(Injector, name="clock-jump"):
    """The date changes by an hour."""

    number = 13
    says = "the date of this process jumps by an hour; the monotonic clock does not"

    def begin(self) -> None:
        self._time: Callable[[], float] = time.time
        time.time = lambda: self._time() + HOUR

    def end(self) -> None:
        time.time = self._time


class Overrun(Injector, name="overrun"):
    """One period takes five."""

    number = 41
    says = "one period takes as long as five"

    def begin(self) -> None:
        self.link.clock.sleep_until(self.link.clock.now() + 5.0 * self.link.period)


class Terminated(Injector, name="sigterm"):
    """The operating system asks the process to end."""

    number = 42
    says = "the process gets SIGTERM"

    def begin(self) -> None:
        os.kill(os.getpid(), signal.SIGTERM)


class ThreadFails(Injector, name="thread-fails"):
    """An exception in a thread."""

    number = 45
    says = "a thread beside the loop raises an exception"

    def begin(self) -> None:
        def fail() -> None:
            raise RuntimeError("a thread failed on purpose")

        thread = threading.Thread(target=fail, name=THREAD)
        thread.start()
        thread.join()


class LinkLost(Injector, name="link-lost"):
    """The wire is cut."""

    number = 28
    says = "reading from the robot fails"

    def read(self, reading: Reading) -> Reading:
        raise LinkError(f"the link to {self.link.robot.name} is lost, on purpose")
