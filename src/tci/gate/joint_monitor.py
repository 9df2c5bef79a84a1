"""Checks that the robot follows its reference. If the robot does not follow its reference, the gate stops the
robot until an operator resets the gate.

The monitor detects faults that limits do not show: a stalled or powerless servo, a motion opposite to the
command, an encoder that jumps or freezes, or identical data with new stamps.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.gate.kernels.motion import (
    DEAF,
    DISAGREES,
    FOLLOWS,
    JUMPED,
    LATE,
    OPPOSED,
    Been,
    Drifts,
    Kinds,
    Limits,
    Monitor,
    Motions,
    Readings,
    Sent,
    Settings,
    judge_reading,
)
from tci.messages import JointReading, Mode
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot

JUDGED = (Mode.POSITION, Mode.VELOCITY)
"""Modes in which the measured motion must follow the reference. In other modes a joint may yield to forces,
so the monitor checks instead that the measured angle agrees with the measured velocity and the torque."""


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """Thresholds above which a deviation is a fault. All values are assumed: with smaller values, healthy
    robots that lag or vibrate would stop; with larger values, a fault is detected later."""

    following_error: float = np.deg2rad(6.0)
    """Largest distance [rad] that a servo may keep from a reference that is at rest."""
    lag: float = 0.1
    """Time [s] by which a servo may lag behind a moving reference, until its own lag is known."""
    patience: float = 0.15
    """Time [s] for which the distance from the reference may be larger than `following_error` and `lag`
    allow."""
    opposing: float = 0.1
    """Time [s] for which a servo may move in the direction opposite to its reference, once it has had the
    time by which it lags."""
    least_speed: float = np.deg2rad(3.0)
    """Speed [rad/s] below which a servo counts as not moving."""
    encoder_step: float = np.deg2rad(2.0)
    """Angle [rad] by which the angle of a joint may change between two readings, in addition to the motion at
    the joint's speed limit."""
    frozen: float = 0.1
    """Time [s] for which an angle may stay exactly constant while its reference is away from where it was by
    half of `frozen_travel`, or for which a reading may be repeated with new stamps."""
    frozen_travel: float = np.deg2rad(3.0)
    """The encoder counts as frozen if the measured angle stays exactly constant, although the joint moves by
    more than this angle [rad] according to its reference or its measured velocity."""
    drift: float = 2.0
    """The monitor compares the measured angle with the integral of the measured velocity. Their difference
    decays with this time constant [s]; otherwise the offset of a velocity sensor would add up."""
    push: float = 0.1
    """In torque mode the encoder counts as frozen if more than this fraction of the torque limit was added
    long enough while angle and velocity stayed exactly constant. Twice the usual dry friction: so much may
    be added before a joint that rests on it moves."""
    mode_change: float = 0.5
    """Time [s] after a mode switch within which the robot must report the new mode."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"monitor: {field.name} {value}; valid: above 0 and finite")


class Reference(NamedTuple):
    """Latest references of the servos under command."""

    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    modes: tuple[Mode, ...]
    """Control mode (k,) of each servo."""
    position: Array
    """Position reference (k,) [rad]."""
    velocity: Array
    """Velocity reference (k,) [rad/s]."""
    acceleration: Array
    """[rad/s2] (k,)."""


class JointMonitor:
    """Compares each new joint reading with the reference. Each gate needs its own monitor, because the
    monitor stores the history of the readings."""

    def __init__(self, robot: Robot, settings: MonitorSettings | None = None) -> None:
        self.settings = settings or MonitorSettings()
        self._names = [servo.name for servo in robot.servos]
        self._numbers = Settings(*(float(getattr(self.settings, name)) for name in Settings._fields))
        self._worst = np.zeros(2)
        limits = [servo.limits for servo in robot.servos]
        # A servo without a torque limit has no torque mode.
        self._limits = Limits(
            torque=np.array([x.torque or np.inf for x in limits], float),
            velocity=np.array([np.inf if x.velocity is None else x.velocity for x in limits], float),
        )
        self.misled = False
        """True after a fault that makes the joint data untrustworthy, until `reset`."""
        self.forget()

    def reset(self) -> None:
        """Deletes all history and trusts new data again. The gate calls this method when an operator resets
        the gate."""
        self.misled = False
        self.forget()

    def forget(self) -> None:
        """Deletes the history of motion. After a fault that makes the joint data untrustworthy, the data
        stays untrustworthy until `reset`."""
        count = len(self._names)
        self._before: JointReading | None = None
        self._modes: tuple[Mode, ...] = ()
        self._kinds = Kinds(np.zeros(0, bool), np.zeros(0, bool))
        self._fresh = np.inf
        memory = np.full((7, count), np.inf)
        memory[2:4] = -np.inf
        self._monitor = Monitor(
            self._limits,
            self._numbers,
            Readings(*np.zeros((4, count))),
            Been(np.full(count, np.inf), np.full(count, -np.inf)),
            Motions(*memory),
            Drifts(np.zeros(count)),
            self._worst,
        )
        self._other_mode: dict[int, float] = {}

    def step(
        self,
        joints: JointReading,
        reference: Reference,
        unanswered: Array | None = None,
        *,
        lags: Array | None = None,
        excused: frozenset[int] = frozenset(),
    ) -> Reason | None:
        """Checks a usable reading. Returns the reason why the robot must stop; None if the robot follows its
        reference.

        `reference` must be that of the time when the reading was taken. `unanswered` (k,) [N m] are torques
        that were added without an answer in the readings. Joints lag by `lags` (n_servos,) [s] at most,
        by that of the settings if nobody measures it. The servos in `excused` need not
        follow now: they met something, and the gate moves them away from it.
        Call this method once per control period.
        """
        before, self._before = self._before or joints, joints
        elapsed = joints.stamp - before.stamp
        if reference.modes != self._modes:
            self._sort(reference.modes)
        pushed = np.zeros(len(reference.servos)) if unanswered is None else unanswered
        kinds = self._kinds
        if excused:
            kinds = kinds._replace(follows=kinds.follows & ~np.isin(reference.servos, [*excused]))
        sent = Sent(*np.array([reference.position, reference.velocity]))
        longest = np.full(len(self._names), self.settings.lag) if lags is None else lags
        found = judge_reading(
            self._monitor, reference.servos, kinds, sent, pushed, longest, joints.position, joints.velocity,
            joints.stamp, elapsed,
        )  # fmt: skip
        if not elapsed > 0.0:
            self._fresh = min(self._fresh, joints.stamp)
            return self._fault_of_state(joints, reference)
        if joints.sequence != before.sequence:
            self._fresh = joints.stamp
        elif joints.stamp - self._fresh > self.settings.frozen:
            self.misled = True
            words = f"joint data is frozen: reading {joints.sequence} comes again under fresh stamps"
            return Reason(Code.JOINTS_REPEATED, words)
        if found == JUMPED:
            return self._jumped(elapsed)
        if found in (DISAGREES, DEAF):
            return self._misled_by(found, reference)
        fault = self._fault_of_state(joints, reference)
        return fault if fault is not None or found == FOLLOWS else self._fault_of_motion(found, reference)

    def _jumped(self, elapsed: float) -> Reason:
        """Returns the reason to stop for an angle that changed too much within `elapsed` [s]."""
        worst, change = int(self._worst[0]), self._worst[1]
        self.misled = True
        allowed = self._limits.velocity[worst] * elapsed + self.settings.encoder_step
        return Reason(
            Code.ENCODER_JUMPED,
            f"the angle of {self._names[worst]} jumped by {np.rad2deg(change):.1f} degrees; "
            f"possible: {np.rad2deg(allowed):.1f}",
        )

    def _fault_of_state(self, joints: JointReading, reference: Reference) -> Reason | None:
        """Returns the reason to stop if a servo is off, or if it is in another mode than commanded; else
        None."""
        servos = reference.servos
        if joints.powered is not None and False in joints.powered[servos].tolist():
            off = servos[int(np.argmin(joints.powered[servos]))]
            return Reason(Code.SERVO_OFF, f"{self._names[off]} is under command and its servo is off")
        if joints.modes is None:
            return None
        modes = [joints.modes[servo] for servo in servos.tolist()]
        if tuple(modes) == reference.modes:
            self._other_mode.clear()
            return None
        others = [
            (servo, mode, reported)
            for servo, mode, reported in zip(servos.tolist(), reference.modes, modes, strict=True)
            if reported is not None and reported is not mode
        ]
        self._other_mode = {servo: self._other_mode.get(servo, joints.stamp) for servo, _, _ in others}
        for servo, mode, reported in others:
            if joints.stamp - self._other_mode[servo] > self.settings.mode_change:
                words = f"{self._names[servo]} reports mode {reported.value}; commanded in {mode.value}"
                return Reason(Code.SERVO_MODE, words)
        return None

    def _fault_of_motion(self, found: int, reference: Reference) -> Reason:
        """Returns the reason to stop for a servo that does not follow its reference. `found` is its fault:
        LATE, OPPOSED or FROZEN."""
        name, way = self._names[reference.servos[int(self._worst[0])]], np.rad2deg(self._worst[1])
        if found == LATE:
            causes = "held or pushed, blocked, stalled or limp"
            words = f"{name} does not follow: {way:.1f} degrees from its reference; {causes}"
            return Reason(Code.FOLLOWING_ERROR, words)
        if found == OPPOSED:
            causes = "pushed or pulled; if nothing touches it, the sign of its gamma is wrong"
            return Reason(Code.OPPOSED_MOTION, f"{name} moves against its command; {causes}")
        self.misled = True
        words = f"the encoder of {name} stands still while its reference moved by {way:.1f} degrees"
        return Reason(Code.ENCODER_FROZEN, words)

    def _misled_by(self, found: int, reference: Reference) -> Reason:
        """Returns the reason to stop if a servo's angle contradicts its measured velocity (`found` is
        DISAGREES) or its torque (DEAF)."""
        self.misled = True
        name, worst = self._names[reference.servos[int(self._worst[0])]], self._worst[1]
        if found == DISAGREES:
            words = f"the angle of {name} is {np.rad2deg(worst):.1f} degrees from where its velocity leads"
            return Reason(Code.ENCODER_DISAGREES, words)
        words = f"the encoder of {name} stands still whatever the torque; {worst:.0%} of the most were added"
        return Reason(Code.ENCODER_FROZEN, words)

    def _sort(self, modes: tuple[Mode, ...]) -> None:
        """Stores which of k servos must follow a reference, and which are in torque mode, according to their
        control modes."""
        self._modes = modes
        self._kinds = Kinds(
            follows=np.array([mode in JUDGED for mode in modes], bool),
            loose=np.array([mode is Mode.TORQUE for mode in modes], bool),
        )
