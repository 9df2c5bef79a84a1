"""Generic angles of the limbs of many worlds, which say where on a limb a contact is."""

from __future__ import annotations

import numpy as np
from numba import from_dtype, int64
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.messages.frames import Array
from tci.robot import formulas
from tci.robot.joint_map import JointMap
from tci.robot.shoulder import shoulder_of as shoulder_of_arm
from tci.robot.transforms import Retarget
from tci.skin.kernels.arrays import Records
from tci.support.compiled import compiled, inlined, reads, writes
from tci.support.one_source import made_with

ANGLES = 4
"""Generic angles of a limb that say where its segments are: shoulder and elbow."""
LIMB = np.dtype(
    [
        ("offset", np.float64, (ANGLES,)), ("shoulder", np.int64, (3,)), ("side", np.float64),
        ("axes", np.float64, (3, 3)), ("at_zero", np.float64, (3, 3)), ("R_TM", np.float64, (3, 3)),
        ("tabled", np.int64),
    ],
    align=True,
)  # fmt: skip
"""How the angles of one limb follow from its servos: angles [rad] at zero, and for a shoulder of any axes its
servos (else -1), side (+1 left, -1 right), axes and upper arm at zero, and mount, as in `Shoulder`. 1 for a
limb whose angles follow from tables instead (`tabled`)."""
_f = made_with(inlined, formulas)
_turned, _shoulder = _f.turned, _f.shoulder_of


class LimbTables:
    """Tables from which `postures` computes the angles of all limbs of a body."""

    def __init__(self, body: GenericBody) -> None:
        parts, robot = body.layout.parts, body.robot
        self.limbs = np.zeros(max(len(parts), 1), LIMB)
        self.limbs["shoulder"] = -1
        self.weights: Array = np.zeros((len(self.limbs), ANGLES, len(robot.servos)))
        """Weights of all servos in each angle."""
        self.tabled: list[tuple[int, JointMap]] = []
        """Limbs with a table of angles, which is not among these tables."""
        for row, part in enumerate(parts):
            joints, one = body.joint_maps[part], self.limbs[row]
            one["offset"][: len(joints.fixed)] = joints.fixed[:ANGLES]
            for transform in joints.transforms:
                own = transform.ids < ANGLES
                if isinstance(transform, Retarget):
                    shoulder, arm = shoulder_of_arm(robot, part), robot.part(part)
                    one["shoulder"], one["side"] = transform.servos, 1.0 if arm.side == "left" else -1.0
                    one["axes"], one["at_zero"] = shoulder.axes, shoulder.rotation(np.zeros(3))
                    one["R_TM"] = arm.R_TM
                elif transform.constant:
                    none = np.zeros(len(transform.servos))
                    one["offset"][transform.ids[own]] = transform.generic(none)[own]
                    rows = self.weights[row]
                    rows[np.ix_(transform.ids[own], transform.servos)] = transform.slope(none)[own]
                elif own.any():
                    self.tabled.append((row, joints))
                    one["tabled"] = 1

    def fill(self, angles: Array, worlds: NDArray[np.intp], posture: Array) -> None:
        """Writes the angles [rad] of all limbs of some `worlds` (k,) into `posture` (N, parts, 4), given
        those of their servos, `angles` (k, n) [rad]."""
        postures(angles, worlds, self.weights, self.limbs, posture)
        for row, joints in self.tabled:
            posture[worlds, row] = [joints.to_generic(one)[:ANGLES] for one in angles]


@compiled(int64(reads(2), reads(1, int64), reads(3), reads(1, from_dtype(LIMB)), writes(3)))
def postures(angles: Array, worlds: NDArray[np.int64], weights: Array, limbs: Records, posture: Array) -> int:
    """`LimbTables.fill` without limbs that have tables."""
    for j in range(len(worlds)):
        limb_angles(angles[j], weights, limbs, posture[worlds[j]])
    return len(worlds)


@inlined
def limb_angles(angles: Array, weights: Array, limbs: Records, out: Array) -> None:
    """Writes the angles [rad] of the limbs of one world without tables into `out` (parts, 4)."""
    for p in range(len(limbs)):
        one = limbs[p]
        if one.tabled:
            continue
        for i in range(ANGLES):
            out[p, i] = one.offset[i]
            for servo in range(len(angles)):
                out[p, i] += weights[p, i, servo] * angles[servo]
        if one.shoulder[0] >= 0:
            x, y, z = _axis(0, angles, one), _axis(1, angles, one), _axis(2, angles, one)
            out[p, 0], out[p, 1], out[p, 2] = _shoulder(x[0], y[0], z[0], x[1], y[1], z[1], z[2], one.side)


@inlined
def _axis(k: int, angles: Array, one: Records) -> tuple[float, float, float]:
    """An axis of the upper arm, in the frame of its mount."""
    R = one.R_TM
    x, y, z = one.at_zero[0, k], one.at_zero[1, k], one.at_zero[2, k]
    for servo in range(2, -1, -1):
        about, angle = one.axes[servo], angles[one.shoulder[servo]]
        x, y, z = _turned(x, y, z, about[0], about[1], about[2], angle)
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )
