"""Contact estimator: estimates the contact point and the force on a limb from the residuals of the limb's
joints.

The candidates are all points of the limb's surfaces on which touches are detected through joint torques. For
each candidate point, the force along the inward normal has one unknown: the magnitude. Least squares,
weighted by the errors of the model, determine the magnitude and the likelihood for each candidate. Tangential
forces are neglected, because the number of joints in an arm is too small to determine these forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.joint_touch.observer import Residual
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.skin.surfaces import Surface

REACH = 0.05
"""An estimate counts as right if the estimated contact point is within this distance [m] of the true contact
point. Assumed: half the width of a hand."""
_LIGHT = 1e-4
"""A candidate contact point is ignored if its likelihood is below this fraction of the likelihood of the most
likely point."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """Most likely contact for a given residual."""

    patch: int
    """Index of the patch, in the robot's order of patches."""
    taxel: int
    """Index of the candidate point on the patch."""
    force: float
    """Force [N] along the inward normal."""
    gain: float
    """Component of the residual [standard deviations] in the direction of the joint torques that this contact
    causes."""
    certainty: float
    """Probability (0..1) that the true contact point is within 5 cm (`REACH`) of the estimated point, given
    the errors of the model."""


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Candidate contact points on one patch."""

    patch: int
    link: str
    wrenches: Array
    """Wrench (6, n) of a force of 1 N along the inward normal at each point: force and torque about the
    link's origin, in the link frame."""
    positions: Array
    """Positions (n, 3) [m] in the link frame."""
    area: Array
    """Areas (n,) [m2] of the points. A touch of a point with a larger area is more likely."""


class PartEstimator:
    """Estimates the contact on one generic part from the residual torques of the part's joints."""

    def __init__(
        self, robot: Robot, part: str, surfaces: Mapping[str, Surface], kinematics: KinematicChain
    ) -> None:
        self.part = part
        self._patches: list[_Candidates] = []
        boards: set[str] = set()
        for index, patch in enumerate(robot.patches):
            if patch.part == part and patch.through_joints:
                one = surfaces[patch.name]
                wrenches = -np.column_stack([one.normals, np.cross(one.positions, one.normals)]).T
                self._patches.append(_Candidates(index, patch.link, wrenches, one.positions, one.areas))
                boards |= {robot.servos[servo].robot_part for servo in kinematics.chain(patch.link)}
        own = [s.index for s in robot.servos if s.robot_part in boards and s.joint is not None]
        self._servos: NDArray[np.intp] = np.array(own, np.intp)

    def weigh(
        self, residual: Residual, others: Sequence[Array], forces: Array, share: float
    ) -> tuple[Array, Array]:
        """Uses the joint torques to improve the forces that a skin measures. Returns the improved forces (m,)
        [N] of contacts at known points, and the part (k,) of the external joint torques that these forces do
        not explain (the residual).

        `others` contains, for each of the m points, the joint torques (n_servos,) that a force of 1 N at this
        point causes. `forces` (m,) [N] are the forces that the skin measures at these points, with the
        relative error `share`. The skin's forces and the joint torques are weighted by their precision. The
        residual is in standard deviations of the joint torques.
        """
        weight = 1.0 / residual.deviation[self._servos]
        left = residual.torque[self._servos] * weight
        if not len(others):
            return forces, left
        rows = np.array([torque[self._servos] * weight for torque in others])
        prior = 1.0 / (share * forces) ** 2
        found = np.linalg.solve(rows @ rows.T + np.diag(prior), rows @ left + prior * forces)
        found = np.maximum(found, 0.0)
        return found, left - found @ rows

    def explain(
        self, left: Array, residual: Residual, position: Array, kinematics: KinematicChain, least: float
    ) -> Explanation | None:
        """Returns the contact that most likely causes `left` (k,) [standard deviations], the joint torques
        that the contacts on skin do not explain. Returns None if the component of `left` in the direction of
        this contact's torques is below `least` [standard deviations]. `residual` contains the standard
        deviations.
        """
        if left @ left < least * least:
            return None
        weight = 1.0 / residual.deviation[self._servos]
        gains, sizes = [], []
        for one in self._patches:
            torques = unit_torques(one.wrenches, position, one.link, kinematics)[self._servos]
            torques *= weight[:, None]
            along = np.maximum(left @ torques, 0.0)
            squares = np.maximum(np.einsum("kn,kn->n", torques, torques), np.finfo(float).tiny)
            sizes.append(along / squares)
            gains.append(along * sizes[-1])
        best = max(float(gain.max()) for gain in gains)
        if best < least * least:
            return None
        chances = [
            np.exp(0.5 * (gain - best)) * one.area for gain, one in zip(gains, self._patches, strict=True)
        ]
        k = int(np.argmax([chance.sum() for chance in chances]))
        likely = np.flatnonzero(chances[k] > _LIGHT * chances[k].max())
        points, chance = self._patches[k].positions[likely], chances[k][likely]
        apart = np.linalg.norm(points[:, None] - points, axis=2)
        # Of all candidates, this point has the smallest expected error.
        middle = int(np.argmin(apart @ chance))
        near = chance[apart[middle] < REACH].sum() / sum(float(one.sum()) for one in chances)
        taxel = int(likely[middle])
        return Explanation(
            self._patches[k].patch, taxel, float(sizes[k][taxel]), float(np.sqrt(best)), float(near)
        )


def unit_torques(wrenches: Array, position: Array, link: str, kinematics: KinematicChain) -> Array:
    """Returns the joint torques (n_servos, n) [N m] that `wrenches` (6, n) on a link cause at `position`
    (n_servos,) [rad].

    Each wrench is a force and the torque about the link's origin, in the link's frame.
    """
    pose, jacobian = kinematics.pose_and_jacobian(position, link)
    turned = np.concatenate([pose[:3, :3] @ wrenches[:3], pose[:3, :3] @ wrenches[3:]])
    torques: Array = jacobian.T @ turned
    return torques
