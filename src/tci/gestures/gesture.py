"""Gestures: postures over time, recorded on one robot and fitted to any other.

Arm angles of a gesture are relative to the torso frame. So the arms of all robots point in the same direction
relative to the torso, although the shoulders of the robots differ. Fitting finds for every instant the
nearest posture within the robot's limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from tci.body.posture import speed_limits
from tci.body.retarget import in_torso, lacks_a_joint, retarget, with_retargeting
from tci.errors import CommandError, TciError
from tci.messages.frames import Array, read_only
from tci.robot.description import GenericPart, Robot
from tci.robot.joint_map import JointMap, initial_position, joint_map
from tci.robot.like import RobotLike, as_robot

SAMPLE = 0.02
"""Time [s] between two postures of a fitted gesture. Assumed: this time is short enough for linear
interpolation."""
SHARE = 0.8
"""Fraction of the speed limits that a fitted gesture uses. Assumed: the robot needs the rest of the speed to
correct tracking errors."""
FORCE = 0.2
"""Fraction of the acceleration limits that a fitted gesture uses. Assumed: the robot needs the rest of the
acceleration to follow the gesture closely."""
LONGEST = 3600.0
"""Longest duration [s] of a gesture. Assumed: no gesture lasts longer than one hour."""


@dataclass(frozen=True, slots=True, eq=False)
class Gesture:
    """Generic postures over time."""

    times: Array
    """Times (k,) [s], increasing from 0."""
    postures: Mapping[str, Array]
    """Generic angles (k, joints) [rad] of each part at the k `times`, by the part's name. Arm angles are
    relative to the torso frame. In a fitted gesture, arm angles are the angles of the generic joints of the
    robot for which the gesture was fitted."""

    if TYPE_CHECKING:  # what it takes; the fields are what it keeps

        def __init__(self, times: ArrayLike, postures: Mapping[str, ArrayLike]) -> None: ...

    def __post_init__(self) -> None:
        times = np.asarray(self.times, np.float64)
        postures = {part: np.asarray(angles, np.float64) for part, angles in self.postures.items()}
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "postures", postures)
        good = times.ndim == 1 and times.size >= 2 and np.isfinite(times).all() and times[0] == 0.0
        if not good or not np.all(np.diff(times) > 0.0) or times[-1] > LONGEST:
            raise TciError(f"gesture times: valid are 2 or more, rising from 0 to at most {LONGEST:g} s")
        if not self.postures:
            raise TciError("a gesture without parts; valid: at least one")
        for part, angles in self.postures.items():
            if angles.ndim != 2 or len(angles) != times.size or not np.isfinite(angles).all():
                raise TciError(
                    f"gesture of {part}: shape {angles.shape}; valid: ({times.size}, joints), finite"
                )

    @property
    def duration(self) -> float:
        """Duration [s] of the gesture."""
        return float(self.times[-1])

    def at(self, time: float) -> dict[str, Array]:
        """Returns the generic angles (n,) [rad] of each part at `time` [s], interpolated linearly."""
        last = len(self.times) - 1
        index = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, last - 1))
        begin, end = self.times[index], self.times[index + 1]
        share = float(np.clip((time - begin) / (end - begin), 0.0, 1.0))
        return {
            part: read_only(angles[index] * (1.0 - share) + angles[index + 1] * share)
            for part, angles in self.postures.items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A gesture that a given robot can perform."""

    gesture: Gesture
    """The motion in this robot's generic joints, with arm angles relative to the robot's mounts."""
    targets: Gesture
    """Targets for the gate. The gate plans to stop at every target, which would delay the motion. Therefore
    the targets are ahead of the gesture by half the stopping time."""
    slower: float
    """Duration of the fitted gesture divided by the duration of the original gesture. The value is above 1 if
    the original gesture is too fast for the robot."""
    missed: Mapping[str, float]
    """Largest error [rad] of each joint, by `part.joint`. The cause of these errors is the robot's limits.
    The entry `part.upper_arm` is the error of the upper arm's direction."""
    left_out: tuple[str, ...]
    """Names of the gesture's parts that the robot does not have."""


class TorsoView:
    """Computes a robot's posture in generic angles, with arm angles relative to the torso frame."""

    def __init__(self, robot: Robot) -> None:
        """Prepares the conversion. Raises DescriptionError for an arm whose mount is rotated in the torso
        frame, if the kinematic model lacks the shoulder of this arm."""
        self._maps: dict[str, JointMap] = {}
        self._turned: dict[str, GenericPart] = {}
        for part in robot.parts:
            if part.kind == "arm" and lacks_a_joint(part):
                self._turned[part.name] = part
            exact = any(part.mount) and part.name not in self._turned
            self._maps[part.name] = joint_map(
                with_retargeting(robot, part.name) if exact else robot, part.name
            )

    def posture(self, position: Array) -> dict[str, Array]:
        """Returns the generic angles (n,) [rad] of each part, with the servos at `position` (n_servos,)
        [rad]."""
        postures = {name: joints.to_generic(position) for name, joints in self._maps.items()}
        return postures | {name: in_torso(part, postures[name]) for name, part in self._turned.items()}


def record(robot: Robot, times: Array, positions: Array) -> Gesture:
    """Returns the recorded motion of a robot as a gesture.

    `positions` (k, n_servos) [rad] are the servos' angles at the `times` (k,) [s]. Parts that no servo moves
    are left out. Raises TciError if the times are invalid.
    """
    view = TorsoView(robot)
    postures = [view.posture(position) for position in positions]
    parts = [part.name for part in robot.parts if any(joint.servo is not None for joint in part.servos)]
    return Gesture(
        times=read_only(np.asarray(times) - times[0]),
        postures={part: read_only([posture[part] for posture in postures]) for part in parts},
    )


def fit(robot: RobotLike, gesture: Gesture, *, exact: bool = True, share: float = SHARE) -> Fitted:
    """Fits a gesture to a robot, so that the motion respects the robot's limits and couplings.

    With `exact`, the arms' directions relative to the torso are kept (retargeting). Without `exact`, the
    generic angles are used unchanged. `share` is the fraction of the speed limits to use.

    Raises CommandError if the robot has none of the gesture's parts, or if the numbers of joints of a part
    differ between gesture and robot.
    """
    robot = as_robot(robot)
    names = {part.name for part in robot.parts if any(joint.servo is not None for joint in part.servos)}
    used = [part for part in gesture.postures if part in names]
    if not used:
        raise CommandError(
            f"{robot.name} has none of {', '.join(gesture.postures)}; valid: {', '.join(names)}"
        )
    count = max(2, int(np.ceil(gesture.duration / SAMPLE)) + 1)
    times = np.linspace(0.0, gesture.duration, count)
    positions = np.tile(initial_position(robot), (count, 1))
    missed: dict[str, float] = {}
    for name in used:
        part = robot.part(name)
        angles = gesture.postures[name]
        if angles.shape[1] != len(part.servos):
            raise CommandError(
                f"gesture of {name} has {angles.shape[1]} joints, the robot's {len(part.servos)}"
            )
        smooth = PchipInterpolator(gesture.times, angles)(times)
        _fit_part(robot, part, smooth, positions, missed, exact=exact and part.kind == "arm")
    slower = _slower(robot, used, times, positions, share)
    own = {
        name: read_only([joint_map(robot, name).to_generic(position) for position in positions])
        for name in used
    }
    left_out = tuple(part for part in gesture.postures if part not in names)
    fitted = Gesture(read_only(times * slower), own)
    targets = {name: _leading(robot, name, fitted, positions) for name in used}
    return Fitted(fitted, Gesture(fitted.times, targets), slower, missed, left_out)


def _leading(robot: Robot, part: str, gesture: Gesture, positions: Array) -> Array:
    """Returns targets (k, n) [rad] for the n joints of a part at the k times of a gesture. Each target is
    ahead of the gesture by the distance that the joint would need to stop. `positions` (k, n_servos) [rad]
    are the servo angles of the gesture.
    """
    servos = joint_map(robot, part).servos
    limits = [robot.servos[servo].limits for servo in servos]
    speed = np.abs(np.gradient(positions[:, servos], gesture.times, axis=0))
    stop = np.zeros(len(positions))
    for column, limit in enumerate(limits):
        if limit.acceleration is not None and limit.jerk is not None:
            time = speed[:, column] / limit.acceleration + limit.acceleration / limit.jerk
            stop = np.maximum(stop, np.where(speed[:, column] > 0.0, time, 0.0))
    angles = gesture.postures[part]
    return read_only(angles + 0.5 * stop[:, None] * np.gradient(angles, gesture.times, axis=0))


def _fit_part(
    robot: Robot, part: GenericPart, angles: Array, positions: Array, missed: dict[str, float], *, exact: bool
) -> None:
    """Converts the generic angles of one part at k times to servo angles, and writes these into `positions`
    (k, n_servos) [rad]. Writes the largest error [rad] of each joint that has one into `missed`. If `exact`
    is True, an arm's limbs keep their directions; otherwise each angle is converted and clamped by itself."""
    joints = joint_map(robot, part.name)
    limits = [robot.servos[servo].limits for servo in joints.servos]
    lower = np.array([-np.inf if limit.lower is None else limit.lower for limit in limits])
    upper = np.array([np.inf if limit.upper is None else limit.upper for limit in limits])
    errors: dict[str, float] = {}

    def note(joint: str, error: float) -> None:
        errors[joint] = max(errors.get(joint, 0.0), error)

    before = np.array(positions[0])
    for position, wanted in zip(positions, angles, strict=True):
        before[:] = np.where(np.isin(np.arange(len(before)), joints.servos), before, position)
        if exact:
            answer = retarget(robot, part.name, wanted, before)
            position[joints.servos] = answer.position[joints.servos]
            note("upper_arm", answer.upper_arm_error)
            for joint, error in zip(part.servos[3:], answer.joint_errors, strict=True):
                note(joint.name, float(abs(error)))
        else:
            position[joints.servos] = np.clip(joints.to_robot(wanted, before), lower, upper)
            error = np.abs(joints.to_generic(position) - wanted)
            for joint in part.servos:
                note(joint.name, float(error[joint.id]))
        before = np.array(position)
    missed.update({f"{part.name}.{joint}": error for joint, error in errors.items() if error > 1e-9})


def _slower(robot: Robot, parts: list[str], times: Array, positions: Array, share: float) -> float:
    """Returns the factor (1 or more) by which the duration of a motion must be multiplied, so that the motion
    meets the limits of acceleration, and the fraction `share` of the limits of speed."""
    speed = np.abs(np.gradient(positions, times, axis=0))
    acceleration = np.abs(np.gradient(np.gradient(positions, times, axis=0), times, axis=0))
    slower = 1.0
    for name in parts:
        servos = joint_map(robot, name).servos
        for step, position in enumerate(positions):
            most = speed_limits(robot, name, position)
            for servo, described in zip(servos, most, strict=True):
                limits = robot.servos[servo].limits
                top = share * min(described, np.inf if limits.velocity is None else limits.velocity)
                slower = max(slower, speed[step, servo] / top)
                if limits.acceleration is not None:
                    force = acceleration[step, servo] / (FORCE * limits.acceleration)
                    slower = max(slower, float(np.sqrt(force)))
    return float(slower)
