"""Compiled loop for the force of a blow with several joints behind it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64

from tci.messages.frames import Array
from tci.robot.kernels.blow import LONGEST, STEP
from tci.support.compiled import compiled, reads, record, writes


class Carried(NamedTuple):
    """What n joints do for the place that they move, in one posture."""

    gives: Array
    """Inverse (n, n) [1/(kg m2)] of the inertia of links and motors."""
    stiffness: Array
    """(n,) [N m/rad] of the servos."""
    damping: Array
    """(n,) [N m s/rad] of the servos."""
    torque: Array
    """(n,) [N m] at most."""
    brakes: Array
    """(n,) [rad/s2] by which references brake."""
    moved: Array
    """(n,) [m/rad] by which each joint moves the place along the direction of the blow."""


@compiled(
    float64(record(Carried, reads(2), *[reads(1)] * 5), reads(1), float64, float64, float64, writes(2)),
    seldom=True,
)
def coupled_peak(
    carried: Carried, rates: Array, spring: float, struck: float, reaction: float, room: Array
) -> float:
    """Largest force [N] on a struck mass on a spring. A place that bounces off may come back.

    Args:
        carried: What strikes.
        rates: Speeds (n,) [rad/s] before the blow; the servos' references go on with them until `reaction`,
            and then brake. One that stood at once would tear a fast joint off the struck body, which joints
            that lag then throw back there.
        spring: [N/m] of the struck body's surface.
        struck: [kg] of the struck body.
        reaction: [s].
        room: (5, n), overwritten.
    """
    n = len(rates)
    bent, speeds, torques, gone, goes = room[0], room[1], room[2], room[3], room[4]
    for i in range(n):
        bent[i], speeds[i], gone[i], goes[i] = 0.0, rates[i], 0.0, rates[i]
    place, struck_place, struck_speed, most = 0.0, 0.0, 0.0, 0.0
    for step in range(int(LONGEST / STEP)):
        force = max(spring * (place - struck_place), 0.0)
        most = max(most, force)
        for i in range(n):
            torque = carried.stiffness[i] * (gone[i] - bent[i])
            torque += carried.damping[i] * (goes[i] - speeds[i])
            most_torque = carried.torque[i]
            torques[i] = min(max(torque, -most_torque), most_torque) - carried.moved[i] * force
        place = 0.0
        for i in range(n):
            for k in range(n):
                speeds[i] += carried.gives[i, k] * torques[k] * STEP
            bent[i] += speeds[i] * STEP
            gone[i] += goes[i] * STEP
            if step * STEP >= reaction:
                side = np.sign(rates[i])
                goes[i] = side * max(side * goes[i] - carried.brakes[i] * STEP, 0.0)
            place += carried.moved[i] * bent[i]
        struck_speed += force / struck * STEP
        struck_place += struck_speed * STEP
    return most
