"""What the robots of many worlds measure, as Warp kernels: angles of servos and limbs, and the forces on
taxels as sensors tell them. The loops are those of `posture` and `loops`, written a second time in single
precision. Tests tie both, but for response curves of sensors. The formulas are the same.
"""

from __future__ import annotations

import warp as wp

from tci.batch.clusters import Region
from tci.batch.posture import ANGLES as _ANGLES
from tci.robot import formulas
from tci.support.one_source import made_with

wp.set_module_options({"enable_backward": False})
_f = made_with(wp.func, formulas, wp)
turned, shoulder_of = _f.turned, _f.shoulder_of
ANGLES = wp.constant(_ANGLES)


@wp.struct
class Limb:
    """See `posture.LIMB`."""

    offset: wp.vec4
    first: int
    second: int
    third: int
    side: float
    axes: wp.mat33
    at_zero: wp.mat33
    R_TM: wp.mat33


@wp.struct
class Sensed:
    """How the angle of one servo follows from its joint; `address` is -1 without one."""

    address: int
    ratio: float
    shift: float


@wp.kernel
def measure(
    servos: wp.array(dtype=Sensed),
    qpos: wp.array2d(dtype=float),
    states: wp.array2d(dtype=wp.vec3),
    angles: wp.array2d(dtype=float),
):
    """`Worlds.joints` of one servo of one world: one without a joint is at its set-point."""
    w, i = wp.tid()
    angles[w, i] = states[w, i][0]
    if servos[i].address >= 0:
        angles[w, i] = (qpos[w, servos[i].address] - servos[i].shift) / servos[i].ratio


@wp.kernel
def postures(
    angles: wp.array2d(dtype=float),
    weights: wp.array3d(dtype=float),
    limbs: wp.array(dtype=Limb),
    posture: wp.array2d(dtype=wp.vec4),
):
    """`posture.postures` of one limb of one world."""
    w, p = wp.tid()
    one = limbs[p]
    out = one.offset
    for i in range(ANGLES):
        for servo in range(angles.shape[1]):
            out[i] += weights[p, i, servo] * angles[w, servo]
    if one.first >= 0:
        a = angles[w, one.first]
        b = angles[w, one.second]
        c = angles[w, one.third]
        R = wp.mat33()
        for k in range(3):
            x, y, z = turned(
                one.at_zero[0, k], one.at_zero[1, k], one.at_zero[2, k], one.axes[2, 0], one.axes[2, 1],
                one.axes[2, 2], c,
            )  # fmt: skip
            x1, y1, z1 = turned(x, y, z, one.axes[1, 0], one.axes[1, 1], one.axes[1, 2], b)
            x2, y2, z2 = turned(x1, y1, z1, one.axes[0, 0], one.axes[0, 1], one.axes[0, 2], a)
            R[0, k] = x2
            R[1, k] = y2
            R[2, k] = z2
        R = wp.transpose(one.R_TM) * R
        pitch, roll, yaw = shoulder_of(
            R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 2], one.side
        )
        out[0] = pitch
        out[1] = roll
        out[2] = yaw
    posture[w, p] = out


@wp.func
def on_curve(
    x: float, nodes: wp.array2d(dtype=float), given: int, wanted: int, begin: int, end: int
) -> float:
    """Value of the row `wanted` of a response curve where its row `given` is `x`; both rows increase."""
    k = int(begin)
    while k < end - 2 and x > nodes[given, k + 1]:
        k += 1
    slope = (nodes[wanted, k + 1] - nodes[wanted, k]) / (nodes[given, k + 1] - nodes[given, k])
    return nodes[wanted, k] + slope * (x - nodes[given, k])


@wp.kernel
def unload(due: wp.array(dtype=int), loaded: wp.array2d(dtype=int)):
    w, p = wp.tid()
    if due[p] != 0:
        loaded[w, p] = 0


@wp.kernel
def read(
    due: wp.array(dtype=int),
    owner: wp.array(dtype=int),
    regions: wp.array(dtype=Region),
    pressed: wp.array(dtype=float),
    areas: wp.array(dtype=float),
    gains: wp.array(dtype=float),
    nodes: wp.array2d(dtype=float),
    offset: wp.array(dtype=float),
    threshold: wp.array(dtype=float),
    force: wp.array2d(dtype=float),
    felt: wp.array2d(dtype=float),
    loaded: wp.array2d(dtype=int),
):
    """`loops._read` of one taxel of one world: the force `felt` [N] on it, as its sensor tells it. Patches
    with such a taxel are `loaded`. The simulated taxel has the area `pressed` [m2], where perception assumes
    `areas`."""
    w, k = wp.tid()
    one = regions[owner[k]]
    if due[owner[k]] == 0:
        return
    pressure = force[w, k] / pressed[k]
    if pressure == 0.0:
        felt[w, k] = 0.0
        return
    counts = pressure / wp.abs(one.per_count)
    if one.node < one.nodes:
        counts = on_curve(wp.max(pressure, nodes[1, one.node]), nodes, 1, 0, one.node, one.nodes)
    raw = wp.clamp(wp.rint(one.rest + one.sign * counts), one.lowest, one.highest)
    deviation = one.sign * (raw - one.rest) - offset[k]
    if deviation <= 0.0 or deviation < threshold[k]:
        felt[w, k] = 0.0
        return
    if one.node < one.nodes:
        deviation = on_curve(deviation, nodes, 0, 1, one.node, one.nodes)
    felt[w, k] = gains[k] * deviation * areas[k]
    loaded[w, owner[k]] = 1
