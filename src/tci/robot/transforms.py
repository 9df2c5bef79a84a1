"""Transforms between joints of a generic part and the servos that move them. GS is the angle of a generic
joint, DS the angle of a servo; the other letters are constants of the description.

- linear: GS = gamma DS + sigma (eq. 1).
- table: piecewise linear between pairs of angles, extrapolated beyond the ends of the table.
- coupled: GS = M DS + sigma. A generic joint is a linear combination of several servos.
- synergy: as coupled, but the numbers of joints and servos may differ. The pseudo-inverse of M converts
  generic angles to servo angles.
- retarget: converts the angles of the three shoulder joints so that the robot's upper arm has the same
  rotation in the torso frame as the generic upper arm.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.messages.frames import Array
from tci.robot.description import GenericPart, GenericServo, Robot
from tci.robot.kernels.joints import limit_servos

KINDS = ("linear", "table", "coupled", "synergy", "retarget")
"""Kinds of transforms of a joint."""


class Transform(ABC):
    """The relation between some joints of a part (k,) and the servos (k,) that move them. Only in a synergy,
    the number of joints (m,) may differ from the number of servos."""

    ids: NDArray[np.intp]
    """Generic ids (k,) of the joints that this transform converts."""
    servos: NDArray[np.intp]
    """Indices (k,) into `Robot.servos` of the servos that move these joints."""

    def __init__(self, joints: list[GenericServo]) -> None:
        self.ids = np.array([joint.id for joint in joints], dtype=np.intp)
        self.servos = np.array([joint.servo for joint in joints], dtype=np.intp)

    @abstractmethod
    def generic(self, angles: Array) -> Array:
        """Returns the generic angles (k,) [rad] of servo `angles` (k,) [rad]."""

    @abstractmethod
    def robot(self, generic: Array, near: Array) -> Array:
        """Returns the servo angles (..., k) [rad] for generic angles (..., k) [rad]. If there are several
        solutions, returns the solution nearest to `near` (k,) [rad]."""

    def goal(self, generic: Array, near: Array) -> Array:
        """The angles (..., k) [rad] to ask of the servos: those of `robot`, unless a shoulder has to stop at
        a limit."""
        return self.robot(generic, near)

    @abstractmethod
    def slope(self, angles: Array) -> Array:
        """Returns the derivative d generic / d servo (k, k) at servo `angles` (k,) [rad]."""

    def slopes(self, angles: Array) -> Array:
        """Returns the derivatives (p, k, k) at p postures `angles` (p, k) [rad]. Raises CommandError where
        there is none."""
        if self.constant:
            slope = self.slope(angles[0])
            return np.broadcast_to(slope, (len(angles), *slope.shape))
        return np.array([self.slope(one) for one in angles])

    def speeds(self, angles: Array, most: Array) -> Array:
        """Returns the speed (k,) [rad/s] at which each servo may move to a target, with all servos at
        `angles` (k,) [rad]. `most` (k,) [rad/s] are the largest speeds of the generic joints, as given in the
        description."""
        return servo_speeds(self.slope(angles)[None], most)

    constant = False
    """True if `slope` returns the same result for all postures."""
    steady = False
    """True if `speeds` returns the same result for all postures."""


class Linear(Transform):
    """Joints with one servo each, mapped by eq. 1 of the paper: GS = gamma DS + sigma."""

    constant = steady = True

    def __init__(self, joints: list[GenericServo]) -> None:
        super().__init__(joints)
        self.scale = np.array([joint.scale for joint in joints])
        self.offset = np.array([joint.offset for joint in joints])

    def generic(self, angles: Array) -> Array:
        result: Array = self.scale * angles + self.offset
        return result

    def robot(self, generic: Array, near: Array) -> Array:
        result: Array = (generic - self.offset) / self.scale
        return result

    def slope(self, angles: Array) -> Array:
        return np.diag(self.scale)


class Table(Transform):
    """One joint that is mapped by a table of pairs of angles. Both columns of the table are strictly
    monotonic."""

    def __init__(self, joint: GenericServo) -> None:
        super().__init__([joint])
        self._servo, self._generic = np.array(joint.table).T

    def generic(self, angles: Array) -> Array:
        return _interpolate(angles, self._servo, self._generic)

    def robot(self, generic: Array, near: Array) -> Array:
        if self._generic[0] > self._generic[-1]:
            return _interpolate(generic, self._generic[::-1], self._servo[::-1])
        return _interpolate(generic, self._generic, self._servo)

    def slope(self, angles: Array) -> Array:
        piece = _piece(angles, self._servo)
        slopes: Array = np.diff(self._generic) / np.diff(self._servo)
        return np.diag(slopes[piece])


class Coupled(Transform):
    """Joints that are linear combinations of the angles of several servos."""

    constant = steady = True

    def __init__(self, joints: list[GenericServo]) -> None:
        super().__init__(joints)
        servos = self._moved(joints)
        self.servos = np.array(servos, dtype=np.intp)
        self._matrix = np.zeros((len(joints), len(servos)))
        for row, joint in enumerate(joints):
            for term in joint.terms:
                self._matrix[row, servos.index(term.servo)] = term.factor
        self._offset = np.array([joint.offset for joint in joints])
        self._inverse = self._invert()

    def generic(self, angles: Array) -> Array:
        result: Array = self._matrix @ angles + self._offset
        return result

    def robot(self, generic: Array, near: Array) -> Array:
        result: Array = (generic - self._offset) @ self._inverse.T
        return result

    def slope(self, angles: Array) -> Array:
        return self._matrix

    def _moved(self, joints: list[GenericServo]) -> list[int]:
        """Returns the indices of the servos that move `joints`. The transform uses this order in all of its
        arrays."""
        return [joint.servo for joint in joints if joint.servo is not None]

    def _invert(self) -> Array:
        return np.array(np.linalg.inv(self._matrix))


class Synergy(Coupled):
    """Joints and servos in a group: one servo may move several joints, or several servos may move one joint
    together.

    If commanded joint angles contradict each other, the servos move to the angles with the least sum of
    squared errors. If several motions of the servos are possible, the smallest motion is used
    (Moore-Penrose).
    """

    def _moved(self, joints: list[GenericServo]) -> list[int]:
        return list(dict.fromkeys(term.servo for joint in joints for term in joint.terms))

    def _invert(self) -> Array:
        return np.array(np.linalg.pinv(self._matrix))


class Retarget(Transform):
    """The three joints of a shoulder, which may have any axes."""

    steady = True

    def __init__(self, robot: Robot, part: GenericPart, joints: list[GenericServo]) -> None:
        """Creates the transform. Raises the errors that Shoulder raises."""
        from tci.robot.shoulder import shoulder_of  # only this transform needs the model

        super().__init__(joints)
        self._shoulder = shoulder_of(robot, part.name)
        self._R_TM = np.ascontiguousarray(part.R_TM)
        self._name = part.name

    def generic(self, angles: Array) -> Array:
        return self._shoulder.generic(self._shoulder.rotation(angles), self._R_TM)

    def robot(self, generic: Array, near: Array) -> Array:
        return self._shoulder.best(self._shoulder.wanted(generic, self._R_TM), near)

    def goal(self, generic: Array, near: Array) -> Array:
        return self._shoulder.goal(self._shoulder.wanted(generic, self._R_TM), near)

    def slope(self, angles: Array) -> Array:
        """Returns the derivative d generic / d servo (3, 3). Raises CommandError at 90 degrees of abduction,
        where the generic shoulder is singular."""
        return np.array(self.slopes(angles[None])[0])

    def slopes(self, angles: Array) -> Array:
        slopes = self._shoulder.slopes(angles, self._R_TM)
        if slopes is None:
            raise CommandError(f"{self._name}: at 90 degrees of abduction no generic velocity is defined")
        return slopes

    def speeds(self, angles: Array, most: Array) -> Array:
        """Returns `most` (k,) [rad/s], the speeds in the description, unchanged: in a retargeted shoulder
        they limit the servos instead of the generic joints. The speeds of generic angles are no useful
        bounds, because generic angles jump near 90 degrees of abduction."""
        return most


def servo_speeds(slopes: Array, most: Array) -> Array:
    """Returns servo speeds (k,) [rad/s] at which no joint exceeds `most` (m,) [rad/s] in any of p postures,
    even if all servos move this joint at once. `slopes` (p, m, k) are d generic / d servo."""
    sizes, speeds = np.empty((2, slopes.shape[2]))
    limit_servos(np.ascontiguousarray(slopes), most, sizes, speeds)
    return speeds


def _piece(values: Array, nodes: Array) -> NDArray[np.intp]:
    """Returns, for each of `values` (k,), the index of the section between two `nodes` that contains the
    value or is nearest to it. The nodes must increase."""
    return np.clip(np.searchsorted(nodes, values) - 1, 0, len(nodes) - 2)


def _interpolate(values: Array, nodes: Array, results: Array) -> Array:
    """Returns the value of a piecewise linear function at each of `values` (k,). The function goes through
    the points (`nodes[i]`, `results[i]`), and continues linearly beyond the ends. The nodes must increase."""
    piece = _piece(values, nodes)
    share = (values - nodes[piece]) / (nodes[piece + 1] - nodes[piece])
    result: Array = results[piece] + share * (results[piece + 1] - results[piece])
    return result
