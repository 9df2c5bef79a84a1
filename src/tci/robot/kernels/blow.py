"""Compiled loop for the force of a blow."""

from __future__ import annotations

import numpy as np
from numba import float64

from tci.support.compiled import compiled

STEP = 5e-4
"""[s]: a hand of 0.6 kg on 75 N/mm still swings over 30 steps."""
LONGEST = 0.25
"""[s]: every blow has its peak by then."""


@compiled(float64(float64, float64, float64, float64, float64, float64, float64, float64))
def peak(
    mass: float, stiffness: float, damping: float, stall: float, speed: float, spring: float, struck: float,
    reaction: float,
) -> float:  # fmt: skip
    """Largest force [N] between a servo-driven mass and a struck mass on a spring.

    Args:
        mass: [kg] of what strikes.
        stiffness: [N/m] of its servos.
        damping: [N s/m] of its servos.
        stall: Most force [N] of its servos.
        speed: [m/s] before the blow; the servos' reference goes on with it until `reaction`.
        spring: [N/m] of the struck body's surface.
        struck: [kg] of the struck body.
        reaction: [s].
    """
    x, v, y, w, reference, most = 0.0, speed, 0.0, 0.0, 0.0, 0.0
    for i in range(int(LONGEST / STEP)):
        goes = speed if i * STEP < reaction else 0.0
        reference += goes * STEP
        push = stiffness * (reference - x) + damping * (goes - v)
        push = min(max(push, -stall), stall)
        force = max(spring * (x - y), 0.0)
        v += (push - force) / mass * STEP
        w += force / struck * STEP
        x += v * STEP
        y += w * STEP
        most = max(most, force)
        if x < y:
            break
    return most if np.isfinite(most) else np.inf
