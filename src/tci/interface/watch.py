"""The watch: whether the robot does what it is told. Where it does not, it stops until an operator resets it.

It knows the faults that limits can't see: a stalled or limp servo, a motion against its command, an
encoder that jumps or stands still, data that repeats under fresh stamps.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array
from tci.messages import JointReading, Mode
from tci.model.description import Robot

JUDGED = (Mode.POSITION, Mode.VELOCITY)
"""Modes in which the measured motion must be the commanded one. Elsewhere a joint yields legitimately."""


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """When a deviation is a fault. All figures are ours."""

    following_error: float = np.deg2rad(6.0)
    """Distance [rad] from the reference at rest that a servo may have for long."""
    lag: float = 0.1
    """A servo may be this far [s] behind a moving reference."""
    patience: float = 0.15
    """How long [s] the following error may be larger."""
    opposing: float = 0.1
    """How long [s] a servo may move against its reference."""
    least_speed: float = np.deg2rad(3.0)
    """Speeds [rad/s] below this one are no motion."""
    encoder_step: float = np.deg2rad(2.0)
    """Change [rad] between two readings beyond what the speed limit allows."""
    frozen: float = 0.1
    """How long [s] one angle may repeat to the bit, or a reading come again under fresh stamps."""
    frozen_travel: float = np.deg2rad(3.0)
    """A reference that moves this far [rad] while the angle repeats shows that the encoder stands still."""
    mode_change: float = 0.5
    """How long [s] a robot may take to report the mode that it was switched to."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"watch: {field.name} {value}; valid: above 0 and finite")


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """What the servos under command were told last."""

    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos`."""
    modes: tuple[Mode, ...]
    """Control mode of each (k,)."""
    position: Array
    """Where each should be (k,) [rad]."""
    velocity: Array
    """How fast each should move (k,) [rad/s]."""


class Watch:
    """Compares each new joint reading with the reference. It has memory; one serves one gate."""

    def __init__(self, robot: Robot, settings: WatchSettings | None = None) -> None:
        self.settings = settings or WatchSettings()
        self._robot = robot
        self._names = [servo.name for servo in robot.servos]
        speeds = [servo.limits.velocity for servo in robot.servos]
        self._fastest = np.array([np.inf if speed is None else speed for speed in speeds])
        self.reset()

    def reset(self) -> None:
        """Forget all that was seen."""
        never = np.full(len(self._names), np.inf)
        self._before: JointReading | None = None
        self._modes: tuple[Mode, ...] = ()
        self._judged = np.zeros(0, dtype=bool)
        self._fresh = np.inf
        self._late = never.copy()
        self._opposed = never.copy()
        self._repeats = never.copy()
        self._origin = np.zeros(len(self._names))
        self._other_mode = never.copy()

    def step(self, joints: JointReading, reference: Reference) -> str:
        """Why the robot must stop, given a usable reading; empty while it does what it is told.

        `reference` is what was handed out for this reading's time. Call it once per control period.
        """
        before, self._before = self._before, joints
        if before is None or joints.stamp <= before.stamp:
            self._fresh = min(self._fresh, joints.stamp)
            return self._fault_of_state(joints, reference)
        if joints.sequence != before.sequence:
            self._fresh = joints.stamp
        elif joints.stamp - self._fresh > self.settings.frozen:
            return f"joint data is frozen: reading {joints.sequence} comes again under fresh stamps"
        return (
            self._fault_of_encoders(joints, before)
            or self._fault_of_state(joints, reference)
            or self._fault_of_motion(joints, before, reference)
        )

    def _fault_of_encoders(self, joints: JointReading, before: JointReading) -> str:
        change = np.abs(joints.position - before.position)
        if change.max(initial=0.0) <= self.settings.encoder_step:
            return ""
        allowed = self._fastest * (joints.stamp - before.stamp) + self.settings.encoder_step
        if (change > allowed).any():
            worst = int(np.argmax(change - allowed))
            return (
                f"the angle of {self._names[worst]} jumped by {np.rad2deg(change[worst]):.1f} degrees; "
                f"possible: {np.rad2deg(allowed[worst]):.1f}"
            )
        return ""

    def _fault_of_state(self, joints: JointReading, reference: Reference) -> str:
        """Servos that are off, or in another mode than they were switched to."""
        servos = reference.servos
        if joints.powered is not None and not joints.powered[servos].all():
            off = servos[int(np.argmin(joints.powered[servos]))]
            return f"{self._names[off]} is under command and its servo is off"
        if joints.modes is None:
            return ""
        for servo, mode in zip(servos.tolist(), reference.modes, strict=True):
            reported = joints.modes[servo]
            if reported is None or reported is mode:
                self._other_mode[servo] = np.inf
                continue
            self._other_mode[servo] = min(self._other_mode[servo], joints.stamp)
            if joints.stamp - self._other_mode[servo] > self.settings.mode_change:
                return f"{self._names[servo]} reports mode {reported.value}; commanded in {mode.value}"
        return ""

    def _fault_of_motion(self, joints: JointReading, before: JointReading, reference: Reference) -> str:
        s, now = self.settings, joints.stamp
        servos = reference.servos
        if not servos.size:
            return ""
        judged = self._judges(reference.modes)
        measured = joints.position[servos]
        moved = measured - before.position[servos]

        # What holds for no servo at all is seen from one number: that is nearly always so, and quicker.
        error = np.abs(reference.position - measured)
        if error.max() <= s.following_error:
            self._late[servos] = np.inf
        elif (since := self._late_for(servos, judged, error, reference.velocity, now)).max() > s.patience:
            worst = int(np.argmax(since))
            return (
                f"{self._names[servos[worst]]} does not follow: {np.rad2deg(error[worst]):.1f} degrees "
                "from its reference; stalled, blocked or limp"
            )

        speed = moved / (now - before.stamp)
        if np.abs(speed).max() <= s.least_speed or np.abs(reference.velocity).max() <= s.least_speed:
            self._opposed[servos] = np.inf
        elif (since := self._opposed_for(servos, judged, speed, reference.velocity, now)).max() > s.opposing:
            return (
                f"{self._names[servos[int(np.argmax(since))]]} moves against its command; "
                "check the sign of its scale (gamma)"
            )

        if np.count_nonzero(moved) == moved.size:
            self._repeats[servos] = np.inf
            self._origin[servos] = reference.position
            return ""
        repeats = judged & (moved == 0.0)
        begin = np.where(repeats, np.minimum(self._repeats[servos], now), np.inf)
        self._repeats[servos] = begin
        self._origin[servos] = np.where(begin < now, self._origin[servos], reference.position)
        since = now - begin
        if since.max() <= s.frozen:
            return ""
        travel = np.abs(reference.position - self._origin[servos])
        frozen = (since > s.frozen) & (travel > s.frozen_travel)
        if frozen.any():
            worst = int(np.argmax(frozen))
            return (
                f"the encoder of {self._names[servos[worst]]} stands still while its reference moved by "
                f"{np.rad2deg(travel[worst]):.1f} degrees"
            )
        return ""

    def _judges(self, modes: tuple[Mode, ...]) -> NDArray[np.bool_]:
        """Which servos (k,) are in modes that are judged."""
        if modes != self._modes:
            self._modes = modes
            self._judged = np.array([mode in JUDGED for mode in modes], dtype=bool)
        return self._judged

    def _late_for(
        self, servos: NDArray[np.intp], judged: NDArray[np.bool_], error: Array, velocity: Array, now: float
    ) -> Array:
        """For how long (k,) [s] servos were farther from their reference than its speed explains."""
        late = judged & (error > self.settings.following_error + self.settings.lag * np.abs(velocity))
        return self._last(self._late, servos, late, now)

    def _opposed_for(
        self, servos: NDArray[np.intp], judged: NDArray[np.bool_], speed: Array, velocity: Array, now: float
    ) -> Array:
        """For how long (k,) [s] servos moved against their reference."""
        opposed = judged & (velocity * speed < 0.0)
        opposed &= np.minimum(np.abs(speed), np.abs(velocity)) > self.settings.least_speed
        return self._last(self._opposed, servos, opposed, now)

    @staticmethod
    def _last(since: Array, servos: NDArray[np.intp], holds: NDArray[np.bool_], now: float) -> Array:
        """For how long (k,) [s] a condition holds without a break; -inf where it does not."""
        begin = np.where(holds, np.minimum(since[servos], now), np.inf)
        since[servos] = begin
        lasted: Array = now - begin
        return lasted
