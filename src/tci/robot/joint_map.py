"""Maps between the joints of a generic part and the robot's servos. The description defines the
transforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.messages import JointReading
from tci.messages.frames import Array, frozen, read_only
from tci.robot.description import GenericPart, Robot
from tci.robot.kernels.joints import combine_servos
from tci.robot.like import RobotLike, as_robot
from tci.robot.per_robot import per_robot
from tci.robot.transforms import KINDS, Coupled, Linear, Retarget, Synergy, Table, Transform, servo_speeds

WAYPOINTS = 65
"""Number of postures on the way of a command with a speed at which the largest speeds of the servos are
computed. Assumed: between two of them a servo turns by less than 3 degrees, and the derivative is near its
largest value."""
HORIZON, MOMENTS = 0.2, 5
"""Time [s] for which a velocity must not become too fast although its derivative changes, and number of
postures at which this is checked. Assumed: a joint lags behind its reference by less, and the next velocity
comes sooner."""


class JointMap:
    """The map of all joints of one generic part."""

    def __init__(self, robot: Robot, part: GenericPart) -> None:
        """Creates the map. Raises the errors that the transforms raise."""
        mapped = [joint for joint in part.servos if joint.servo is not None]
        of = {kind: [joint for joint in mapped if joint.transform == kind] for kind in KINDS}
        transforms: list[Transform] = []
        if of["linear"]:
            transforms.append(Linear(of["linear"]))
        transforms += [Table(joint) for joint in of["table"]]
        if of["coupled"]:
            transforms.append(Coupled(of["coupled"]))
        if of["synergy"]:
            transforms.append(Synergy(of["synergy"]))
        if of["retarget"]:
            transforms.append(Retarget(robot, part, of["retarget"]))
        self.transforms = transforms
        self.fixed = np.array([joint.fixed for joint in part.servos])
        none = np.zeros(0, dtype=np.intp)
        self.ids: NDArray[np.intp] = np.concatenate([none, *(t.ids for t in transforms)])
        """Generic ids (m,) of the joints that the robot has."""
        self.servos: NDArray[np.intp] = frozen(np.concatenate([none, *(t.servos for t in transforms)]))
        """Servos (k,) that move the joints `ids`; read-only. There are as many servos as joints, except
        possibly in a synergy (see `tci.robot.transforms`)."""
        self.unlimited: Array = frozen(np.full(len(self.servos), np.inf))
        """Speeds (k,) [rad/s] for a command that requests no speed: all are infinite; read-only."""
        self.exact = not of["synergy"]
        """True if each joint has one servo, so that all postures of the joints can be commanded."""
        self._speeds = np.array([np.inf if joint.speed is None else joint.speed for joint in part.servos])
        # If the map consists of one linear transform: id, offset and scale of each joint.
        self._lines: list[tuple[int, float, float]] | None = None
        if len(transforms) == 1 and isinstance(line := transforms[0], Linear):
            self._lines = [*zip(line.ids.tolist(), line.offset.tolist(), line.scale.tolist(), strict=True)]
        self._slope: Array | None = None
        self._limits: Array | None = None
        if all(t.constant for t in transforms):
            self._slope = frozen(self.slope(np.zeros(len(robot.servos))))
        if all(t.steady for t in transforms):
            self._limits = self.speeds(np.zeros(len(robot.servos)))

    def to_generic(self, position: Array) -> Array:
        """Returns the generic angles (n,) [rad] of the part, for the `position` (n_servos,) [rad] of all
        servos."""
        generic = self.fixed.copy()
        for transform in self.transforms:
            generic[transform.ids] = transform.generic(position[transform.servos])
        return generic

    def to_robot(self, generic: Array, position: Array) -> Array:
        """Returns the angles (k,) [rad] of `servos` for generic angles (n,) [rad]. If there are several
        solutions, returns the solution nearest to `position` (n_servos,) [rad]."""
        if self._lines is not None:  # Python's own code is always in the processor's caches
            angles = generic.tolist()
            return np.array([(angles[joint] - offset) / scale for joint, offset, scale in self._lines])
        parts = [t.robot(generic.take(t.ids), position.take(t.servos)) for t in self.transforms]
        return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0), *parts])

    def goal(self, generic: Array, position: Array) -> Array:
        """The angles (..., k) [rad] to ask of `servos` for generic angles (..., n) [rad]: those of
        `to_robot`, but a shoulder that has to stop at a limit goes where it comes nearest from `position`
        (n_servos,) [rad]."""
        if self._lines is not None and generic.ndim == 1:
            return self.to_robot(generic, position)
        parts = [t.goal(generic.take(t.ids, -1), position.take(t.servos)) for t in self.transforms]
        return np.concatenate([generic[..., :0], *parts], axis=-1)

    def slope(self, position: Array) -> Array:
        """Returns the derivative d generic / d servo (m, k) at `position` (n_servos,) [rad]: one row for each
        joint in `ids`, one column for each servo in `servos`.

        Raises CommandError if a transform has no derivative at this position.
        """
        if self._slope is not None:
            return self._slope
        result = np.zeros((len(self.ids), len(self.servos)))
        row = column = 0
        for transform in self.transforms:
            rows, columns = row + len(transform.ids), column + len(transform.servos)
            result[row:rows, column:columns] = transform.slope(position[transform.servos])
            row, column = rows, columns
        return result

    def per_servo(self, values: Array, position: Array) -> Array:
        """Returns the rates (k,) of the servos at which the part's joints `self.ids` have the rates `values`
        (m,), at `position` (n_servos,) [rad]. If joints share servos (a synergy), the joints' rates may
        differ from `values`, with the least sum of squared errors. Raises CommandError if a transform has no
        derivative at this position."""
        slope = self.slope(position)
        if self.exact:
            return np.array(np.linalg.solve(slope, values))
        result: Array = np.linalg.pinv(slope) @ values
        return result

    @property
    def tied(self) -> tuple[tuple[int, ...], ...]:
        """Groups of generic joints. The joints of a group share servos, so none of them can move alone."""
        shared = np.eye(len(self.ids)) if self._slope is None else np.abs(self._slope) @ np.abs(self._slope).T
        together = np.linalg.matrix_power(shared > 0.0, len(self.ids) + 1)
        return tuple(dict.fromkeys(tuple(self.ids[row].tolist()) for row in together))

    def shares(self, values: Array) -> Array:
        """Converts stiffness or damping, as fractions for all joints (n,), to fractions for the servos (k,).
        If joints share servos (a synergy), a servo gets the mean of the values for the joints that it moves,
        weighted by how far it moves them."""
        if self.exact or self._slope is None:
            return values[self.ids]
        weight = np.abs(self._slope)
        result: Array = (values[self.ids] @ weight) / weight.sum(axis=0)
        return result

    def speeds(self, position: Array) -> Array:
        """Returns the speed (k,) [rad/s] at which each of `servos` may move to a target.

        At these speeds, and with all servos at `position` (n_servos,) [rad], no generic joint exceeds its
        speed in the description. In a retargeted shoulder, the speeds in the description limit the servos,
        not the generic joints, because generic angles jump near 90 degrees of abduction.
        """
        if self._limits is not None:
            return self._limits
        parts = [t.speeds(position.take(t.servos), self._speeds.take(t.ids)) for t in self.transforms]
        return frozen(np.concatenate([np.zeros(0), *parts]))

    def speeds_on_way(self, position: Array, target: Array, most: Array) -> Array:
        """Returns speeds (k,) [rad/s] of `servos` at which no generic joint exceeds `most` (n,) [rad/s] on
        the way to `target` (k,) [rad], however the servos share the way.

        All servos are at `position` (n_servos,) [rad]. Raises CommandError if a transform has no derivative
        somewhere on the way.
        """
        slopes = self._slopes(position, target - position[self.servos], WAYPOINTS)
        return servo_speeds(slopes, most[self.ids])

    def rates_within(self, rates: Array, position: Array, most: Array) -> Array:
        """Returns the `rates` (k,) [rad/s] of `servos`, all reduced by one factor so that no generic joint
        exceeds `most` (n,) [rad/s] now and in the next moments, nor while the servos accelerate one after the
        other. Raises CommandError if a transform has no derivative here."""
        moved = self._slopes(position, HORIZON * rates, MOMENTS) * rates
        pushed, pulled = np.maximum(moved, 0.0).sum(axis=2), np.maximum(-moved, 0.0).sum(axis=2)
        fastest = np.maximum(pushed, pulled).max(axis=0)
        share: float = np.min(most[self.ids] / np.maximum(fastest, 1e-300), initial=1.0)
        return share * rates

    def _slopes(self, position: Array, way: Array, count: int) -> Array:
        """Returns the derivatives (p, m, k) d generic / d servo on the straight `way` (k,) [rad] from
        `position` (n_servos,) [rad]: at `count` postures, or at one if they are equal."""
        if self._slope is not None:
            return self._slope[None]
        path = position[self.servos] + np.linspace(0.0, 1.0, count)[:, None] * way
        result = np.zeros((count, len(self.ids), len(self.servos)))
        row = column = 0
        for transform in self.transforms:
            rows, columns = row + len(transform.ids), column + len(transform.servos)
            result[:, row:rows, column:columns] = transform.slopes(path[:, column:columns])
            row, column = rows, columns
        return result

    def driven_speeds(self, position: Array) -> Array:
        """Returns the largest permitted speeds (k,) [rad/s] of `servos` in velocity and torque mode.

        At these speeds, no generic joint exceeds its speed in the description, also in a retargeted shoulder.
        Raises CommandError if a transform has no derivative at `position` (n_servos,) [rad].
        """
        if self._slope is not None:
            return self.speeds(position)
        return frozen(servo_speeds(self.slope(position)[None], self._speeds[self.ids]))


class Postures:
    """The maps of all generic parts together. One compiled loop computes the angles of all joints whose
    transform is linear, which are nearly all joints."""

    def __init__(self, robot: Robot) -> None:
        """Creates the maps. Raises DescriptionError if a retargeted shoulder does not fit the kinematic
        model, or if there is no model."""
        maps = [joint_map(robot, part.name) for part in robot.parts]
        ends = np.cumsum([0, *(len(part.servos) for part in robot.parts)]).tolist()
        self._slices = {
            part.name: slice(begin, end)
            for part, begin, end in zip(robot.parts, ends, ends[1:], strict=False)
        }
        self._fixed = np.concatenate([np.zeros(0), *(one.fixed for one in maps)])
        placed = [(begin, t) for begin, one in zip(ends, maps, strict=False) for t in one.transforms]
        # Each such joint is a sum over few servos, so that an invalid angle reaches no other joint.
        ids, offsets, sums = list[int](), list[float](), list[tuple[list[int], list[float]]]()
        for begin, t in placed:
            if t.constant:
                zero = np.zeros(len(t.servos))
                ids += (begin + t.ids).tolist()
                offsets += t.generic(zero).tolist()
                for row in t.slope(zero):
                    terms = np.flatnonzero(row) if row.any() else np.zeros(1, np.intp)
                    sums.append((t.servos[terms].tolist(), row[terms].tolist()))
        self._constant = (
            np.array(ids, np.int64),
            np.cumsum([0, *(len(servos) for servos, _ in sums)]).astype(np.int64),
            np.array([servo for servos, _ in sums for servo in servos], np.int64),
            np.array([factor for _, factors in sums for factor in factors]),
            np.array(offsets),
        )
        self._others = [(begin + t.ids, t) for begin, t in placed if not t.constant]

    def to_generic(self, position: Array) -> dict[str, Array]:
        """Returns the generic angles (n,) [rad] of every part, by the name of the part, for the `position`
        (n_servos,) [rad] of all servos. The arrays are read-only."""
        generic: Array = self._fixed.copy()
        combine_servos(np.ascontiguousarray(position, np.float64), *self._constant, generic)
        for ids, transform in self._others:
            generic[ids] = transform.generic(position[transform.servos])
        generic.setflags(write=False)
        return {name: generic[place] for name, place in self._slices.items()}


@per_robot
def joint_map(robot: Robot, name: str) -> JointMap:
    """Returns the map of a generic part by its name. Raises UnknownNameError if there is no such part, and
    DescriptionError if a retargeted shoulder does not fit the kinematic model."""
    return JointMap(robot, robot.part(name))


@per_robot
def postures(robot: Robot) -> Postures:
    """Returns the maps of all generic parts. Raises the errors that the transforms raise."""
    return Postures(robot)


def generic_posture(robot: Robot, joints: JointReading) -> dict[str, Array]:
    """Returns the generic angles (n,) [rad] of every part, by the name of the part (eq. 2).

    Raises FrameError if the number of joints in the reading differs from the number of servos.
    """
    if joints.position.shape != (len(robot.servos),):
        raise FrameError(
            f"joint reading of shape {joints.position.shape}; {robot.name} has {len(robot.servos)} servos"
        )
    return postures(robot).to_generic(joints.position)


def initial_position(robot: RobotLike) -> Array:
    """Returns the angle (n_servos,) [rad] of every servo in the initial posture (inverse of eq. 1). A servo
    that no generic part uses gets the angle 0, or the limit nearest to 0. Raises the errors that the
    transforms raise."""
    return _initial_position(as_robot(robot))


@per_robot
def _initial_position(robot: Robot) -> Array:
    position = np.array([min(max(0.0, s.limits.lower or 0.0), s.limits.upper or 0.0) for s in robot.servos])
    for part in robot.parts:
        joints = joint_map(robot, part.name)
        position[joints.servos] = joints.to_robot(part.initial_posture, position)
    return read_only(position)
