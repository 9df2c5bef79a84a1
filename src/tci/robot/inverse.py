"""Inverse kinematics: servo angles that bring a point of a link to a position or a pose.

The method is damped least squares (Wampler 1986; Nakamura and Hanafusa 1986) on the model's Jacobian, with
the damping of Sugihara 2011. Each step is projected onto the limits of the servos. All settings are assumed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import CommandError
from tci.messages.frames import Array, read_only
from tci.reasons import Code
from tci.robot.kinematics import KinematicChain
from tci.robot.like import RobotLike, as_robot
from tci.support.engine import mujoco


@dataclass(frozen=True, slots=True)
class InverseSettings:
    """Tolerances below which a target counts as reached, and bounds on the search. All values are assumed."""

    position_tolerance: float = 1e-5
    """Largest position error [m] at which a target counts as reached."""
    angle_tolerance: float = 1e-4
    """Largest angle error [rad] at which a target counts as reached."""
    iterations: int = 60
    """Largest number of steps from one starting posture."""
    starts: int = 20
    """Largest number of starting postures. The first starting posture is the present posture."""
    slides: int = 4
    """Largest number of attempts to find a solution nearer to the present posture."""
    damping: float = 1e-8
    """Damping [m2/rad2] of the least-squares steps at zero error. A larger error increases the damping."""
    length: float = 0.1
    """Characteristic length [m]: an angle error of 1 rad has as much weight as a position error of this
    length."""


DEFAULTS = InverseSettings()
SWEEPS = 30
"""Largest number of projections onto couplings for one posture; this number bounds the computing time.
Assumed: the projections usually end earlier."""
ROOM = 1e-9
"""Distance [rad] that solutions keep from the bounds of couplings. Assumed: above rounding errors, and far
below the resolution of any encoder."""


@dataclass(frozen=True, slots=True)
class InverseAnswer:
    """Result of one search. If `reached` is False, the result contains the best attempt."""

    position: Array
    """Angles (n_servos,) [rad] of all servos. Servos that were not chosen for the search keep their present
    angles."""
    reached: bool
    """True if the position error and the angle error are within their tolerances."""
    error: float
    """Distance [m] between the point and its target."""
    angle_error: float
    """Angle [rad] between the link's orientation and the target's orientation; 0 if only a position was
    requested."""
    iterations: int
    """Number of steps taken from all starting postures together."""


class InverseKinematics:
    """Brings one point of one link to a target by moving chosen servos.

    The solution is within the limits of the servos and satisfies the couplings. Servos that are not chosen do
    not move.
    """

    def __init__(
        self,
        robot: RobotLike,
        kinematics: KinematicChain,
        link: str,
        *,
        point: Iterable[float] = (0.0, 0.0, 0.0),
        servos: Iterable[int] | None = None,
        settings: InverseSettings = DEFAULTS,
    ) -> None:
        """Prepares the search for one point and the servos that may move it.

        `point` (3,) [m] is given in the frame of `link`. `servos` are indices into `Robot.servos`; by default
        they are all servos between torso and link. The servos of a generic part are `[s.servo for s in
        part.servos if s.servo is not None]`.

        Raises UnknownNameError if the link is unknown. Raises CommandError if a servo does not move the link,
        appears twice, or has no limits.
        """
        robot = as_robot(robot)
        self._kinematics, self._link, self._settings = kinematics, link, settings
        self._point = read_only(list(point))
        if self._point.shape != (3,) or not np.isfinite(self._point).all():
            raise CommandError(f"point {self._point}; valid: three finite numbers [m]")
        chain = kinematics.chain(link)
        self.servos: tuple[int, ...] = chain if servos is None else tuple(servos)
        """Indices of the servos that may move."""
        wrong = [servo for servo in self.servos if servo not in chain]
        if wrong or not self.servos or len(set(self.servos)) != len(self.servos):
            raise CommandError(f"servos {self.servos} to move {link!r}; valid: some of {chain}, each once")
        limits = [robot.servos[servo].limits for servo in self.servos]
        lower = [np.nan if limit.lower is None else limit.lower for limit in limits]
        upper = [np.nan if limit.upper is None else limit.upper for limit in limits]
        self._lower, self._upper = read_only(lower), read_only(upper)
        unlimited = np.flatnonzero(np.isnan(self._lower + self._upper))
        if unlimited.size:
            names = ", ".join(robot.servos[self.servos[i]].name for i in unlimited)
            words = f"no limits of {names}; valid: a lower and an upper limit of each servo"
            raise CommandError(words, code=Code.LIMITS_UNKNOWN)
        self._chosen: NDArray[np.intp] = np.array(self.servos, dtype=np.intp)
        rows, lower_sum, upper_sum = robot.coupling_rows
        named = rows[:, self._chosen].any(axis=1)
        self._rows, self._least, self._most = rows[named], lower_sum[named], upper_sum[named]

    def solve(self, target: ArrayLike, present: ArrayLike) -> InverseAnswer:
        """Finds angles that bring the point to `target` and are near to `present` (n_servos,) [rad].

        `target` is a position (3,) [m] or a pose (4, 4) in the torso frame. The search starts at the present
        posture. If this search fails, the search starts again at other postures, first at those nearest to
        the present posture. For a redundant limb, the solution is then moved along the null space towards the
        present posture. The result is near to the present posture, but not always the nearest solution.
        Raises CommandError if an argument has another shape or contains values that are not finite.
        """
        target, present = np.asarray(target, np.float64), np.asarray(present, np.float64)
        if target.shape not in ((3,), (4, 4)) or not np.isfinite(target).all():
            raise CommandError(f"target of shape {target.shape}; valid: finite (3,) [m] or (4, 4)")
        if target.shape == (4, 4) and not _is_pose(target):
            raise CommandError("target (4, 4) is no pose; valid: a rotation, a position, and 0 0 0 1")
        if present.shape != (self._kinematics.n_servos,) or not np.isfinite(present).all():
            valid = f"finite ({self._kinematics.n_servos},) [rad]"
            raise CommandError(f"present posture of shape {present.shape}; valid: {valid}")
        first = self._inside(present[self._chosen], present)
        best = self._descend(target, present, first)
        steps = best.iterations
        if not best.reached:
            for start in self._starts(first):
                answer = self._descend(target, present, self._inside(start, present))
                steps += answer.iterations
                if answer.reached or self._size(answer) < self._size(best):
                    best = answer
                if best.reached:
                    break
        if best.reached:
            best, more = self._come_nearer(target, present, first, best)
            steps += more
        return InverseAnswer(best.position, best.reached, best.error, best.angle_error, steps)

    def _come_nearer(
        self, target: Array, present: Array, first: Array, answer: InverseAnswer
    ) -> tuple[InverseAnswer, int]:
        """Brings the solution `answer` nearer to the posture `first` (k,) [rad] of the servos that may move,
        while the point stays at the target. Returns the new solution and the number of steps."""
        steps = 0
        for _ in range(self._settings.slides):
            angles = answer.position[self._chosen]
            away = first - angles
            _, jacobian = self._error(target, answer.position)
            slide = away - np.linalg.lstsq(jacobian, jacobian @ away, rcond=1e-6)[0]
            if np.linalg.norm(slide) < 1e-2:
                break
            start = self._inside(angles + slide, present)
            nearer = self._descend(target, present, start)
            steps += nearer.iterations
            gain = np.linalg.norm(away) - np.linalg.norm(first - nearer.position[self._chosen])
            if not nearer.reached or gain <= 0:
                break
            answer = nearer
            if gain < 1e-3:
                break
        return answer, steps

    def _starts(self, first: Array) -> Array:
        """Returns the postures (m, k) [rad] of the k servos at which the search starts again if it fails from
        the posture `first` (k,) [rad]. They are random within the limits, but equal in all runs, and sorted
        by their distance from `first`."""
        shares = np.random.default_rng(0).random((self._settings.starts - 1, len(first)))
        starts = self._lower + shares * (self._upper - self._lower)
        order: Array = starts[np.argsort(np.linalg.norm(starts - first, axis=1))]
        return order

    def _descend(self, target: Array, present: Array, start: Array) -> InverseAnswer:
        """Searches for angles that bring the point to `target`, from the posture `start` (k,) [rad] of the
        servos that may move, by damped least squares. Returns the best posture, also if the target was not
        reached."""
        s = self._settings
        position = present.copy()
        angles = start
        identity = np.eye(len(angles))
        position[self._chosen] = angles
        error, jacobian = self._error(target, position)
        cost = float(error @ error)
        damping = 1.0
        step = 0
        while step < s.iterations and not self._reached(error):
            step += 1
            gradient = jacobian.T @ error
            stuck = ((angles <= self._lower) & (gradient < 0)) | ((angles >= self._upper) & (gradient > 0))
            free = np.where(stuck, 0.0, 1.0)
            moving = jacobian * free
            normal = moving.T @ moving + (damping * cost + s.damping) * identity
            wanted = self._inside(angles + np.linalg.solve(normal, gradient * free), present)
            position[self._chosen] = wanted
            next_error, next_jacobian = self._error(target, position)
            next_cost = float(next_error @ next_error)
            if next_cost < cost:
                stalled = cost - next_cost < 1e-6 * cost
                angles, error, jacobian, cost = wanted, next_error, next_jacobian, next_cost
                damping = max(0.3 * damping, 1e-3)
                if stalled:
                    break
            else:
                damping *= 8.0
                if damping > 1e8:
                    break
        position[self._chosen] = angles
        angle = float(np.linalg.norm(error[3:])) / s.length
        distance = float(np.linalg.norm(error[:3]))
        return InverseAnswer(read_only(position), self._reached(error), distance, angle, step)

    def _inside(self, angles: Array, present: Array) -> Array:
        """Returns the `angles` (k,) [rad] of the servos that may move, changed so that they are within limits
        and couplings."""
        angles = np.clip(angles, self._lower, self._upper)
        if not len(self._rows):
            return angles
        position = present.copy()
        for _ in range(SWEEPS):
            position[self._chosen] = angles
            sums = self._rows @ position
            off = sums - np.clip(sums, self._least + ROOM, self._most - ROOM)
            worst = int(np.argmax(np.abs(off)))
            if abs(off[worst]) <= ROOM / 2:
                break
            row = self._rows[worst, self._chosen]
            angles = np.clip(angles - off[worst] * row / (row @ row), self._lower, self._upper)
        return angles

    def _error(self, target: Array, position: Array) -> tuple[Array, Array]:
        """Returns the difference between `target` and the present place of the point, and the Jacobian of the
        point for the k servos that may move. The shapes are (3,) and (3, k) for a target position [m], (6,)
        and (6, k) for a target pose (4, 4). For a pose, the angular parts [rad] are multiplied by the setting
        `length` [m]."""
        T_TP, jacobian = self._kinematics.pose_and_jacobian(position, self._link, point=self._point)
        jacobian = jacobian[:, self._chosen]
        if target.shape == (3,):
            return target - T_TP[:3, 3], jacobian[:3]
        turn, quaternion = np.zeros(3), np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, (target[:3, :3] @ T_TP[:3, :3].T).ravel())
        mujoco.mju_quat2Vel(turn, quaternion, 1.0)
        jacobian[3:] *= self._settings.length
        return np.concatenate([target[:3, 3] - T_TP[:3, 3], self._settings.length * turn]), jacobian

    def _reached(self, error: Array) -> bool:
        s = self._settings
        near = float(error[:3] @ error[:3]) <= s.position_tolerance**2
        return near and float(error[3:] @ error[3:]) <= (s.length * s.angle_tolerance) ** 2

    def _size(self, answer: InverseAnswer) -> float:
        return float(np.hypot(answer.error, self._settings.length * answer.angle_error))


def _is_pose(target: Array) -> bool:
    """Returns True if `target` (4, 4) is a rigid transform without reflection, within a tolerance of 1e-6."""
    R = target[:3, :3]
    right = np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-6) and np.linalg.det(R) > 0
    return bool(right and np.allclose(target[3], [0.0, 0.0, 0.0, 1.0]))
