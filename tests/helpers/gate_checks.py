"""A robot for tests of the gate, and an independent check of the gate's output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from helpers import HELPERS
from tci.gate.gate import Gate, SafeCommand
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder
from tci.messages.frames import Array, read_only
from tci.robot.description import Coupling, GenericPart, GenericServo, Limits, Model, Robot, Servo

MODEL = HELPERS / "tester.xml"
PERIOD = 0.002
LIMITS = Limits(lower=-1.0, upper=2.0, velocity=3.0, acceleration=40.0, jerk=4000.0)


def make_robot(
    *,
    count: int = 6,
    limits: Limits = LIMITS,
    coupled: bool = True,
    modes: tuple[Mode, ...] = (Mode.POSITION,),
) -> Robot:
    """Returns a robot part with `count` servos. The first two servos are coupled. The last servo belongs to
    no generic part. Only torque mode needs a model: up to 6 joints of 0.125 kg m2."""
    has_model = Mode.TORQUE in modes
    servos = tuple(
        Servo(
            index=i,
            robot_part="arm",
            id=i,
            name=f"joint{i}",
            limits=limits,
            modes=modes,
            joint=f"joint{i}" if has_model else None,
        )
        for i in range(count)
    )
    generic = tuple(
        GenericServo(id=i, name=f"g{i}", servo=i, scale=(-1.0) ** i, offset=0.1 * i) for i in range(5)
    )
    coupling = Coupling(name="cable", servos=(0, 1), coefficients=(1.0, -1.0), lower=-0.8, upper=0.8)
    return Robot(
        name="tester",
        source="tester.xml",
        digest="0",
        model=Model(format="mjcf", path=str(MODEL), torso_link="base") if has_model else None,
        servos=servos,
        couplings=(coupling,) if coupled else (),
        parts=(GenericPart(name="left_arm", kind="arm", side="left", servos=generic),),
    )


def reading(position: Sequence[float] | Array, stamp: float = 0.0) -> JointReading:
    position = read_only(position)
    sequence = round(stamp / PERIOD) if np.isfinite(stamp) else 0
    return JointReading(stamp, sequence, position, read_only(np.zeros(len(position))))


def position_command(
    servos: Sequence[int], values: Sequence[float], speed: float = np.inf
) -> PlatformCommand:
    return PlatformCommand(
        Mode.POSITION,
        np.array(servos, dtype=np.intp),
        np.array(values, dtype=float),
        np.full(len(servos), speed),
    )


class Driven:
    """A gate and a robot that follows its commands exactly. Records all outputs of the gate."""

    def __init__(self, robot: Robot, start: Sequence[float], *, streams: bool = False) -> None:
        self.robot = robot
        self.gate = Gate(robot, period=PERIOD, stale_after=0.05, streams=streams)
        self.angles = np.array(start, dtype=float)
        self.speed = np.zeros(len(self.angles))
        self.time = 0.0
        self.path: list[Array] = [self.angles.copy()] * 3

    def step(self, *commands: PlatformOrder) -> SafeCommand:
        joints = replace(reading(self.angles, self.time), velocity=read_only(self.speed.copy()))
        safe = self.gate.step(commands, joints, self.time)
        self.gate.check_out(safe)
        self.angles[safe.servos], self.speed[safe.servos] = safe.position, safe.velocity
        self.path.append(self.angles.copy())
        self.time += PERIOD
        return safe

    def settle(self, limit: int = 5000) -> None:
        for _ in range(limit):
            self.step()
            if np.array_equal(self.path[-1], self.path[-2]):
                return
        raise AssertionError("it never came to rest")

    def assert_within_limits(self) -> None:
        """Checks position, velocity, acceleration, jerk and couplings. Uses only the recorded path."""
        path = np.array(self.path)
        for servo in self.robot.servos:
            limits, angles = servo.limits, path[:, servo.index]
            if np.ptp(angles) == 0.0:
                continue
            assert limits.lower is not None
            assert limits.upper is not None
            start = angles[0]
            assert angles.min() >= min(limits.lower, start) - 1e-9
            assert angles.max() <= max(limits.upper, start) + 1e-9
            for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
                assert bound is not None
                assert np.abs(np.diff(angles, order)).max(initial=0.0) / PERIOD**order <= bound * (1 + 1e-6)
        for coupling in self.robot.couplings:
            value = path[:, list(coupling.servos)] @ np.array(coupling.coefficients)
            assert value.min() >= min(coupling.lower, value[0]) - 1e-9
            assert value.max() <= max(coupling.upper, value[0]) + 1e-9
