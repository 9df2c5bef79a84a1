"""Compiled loops for the force of a blow, and for what is behind it."""

from __future__ import annotations

import numpy as np
from numba import boolean, float64

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, returns, views, writes

STEP = 5e-4
"""[s]: a hand of 0.6 kg on 75 N/mm still swings over 30 steps."""
LONGEST = 0.25
"""[s]: every blow has its peak by then."""
HALVINGS = 7
"""Halvings of the range in which a speed is looked for: to 1 %."""


@inlined
def _peak(
    mass: float, stiffness: float, damping: float, stall: float, speed: float, spring: float, struck: float,
    reaction: float,
) -> float:  # fmt: skip
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
    return _peak(mass, stiffness, damping, stall, speed, spring, struck, reaction)


@compiled(boolean(views(2), views(1), reads(1), reads(1), float64, float64, writes(2), writes(1)))
def behind(
    inertia: Array, moved: Array, torques: Array, accelerations: Array, rotor: float, bandwidth: float,
    room: Array, found: Array,
) -> bool:  # fmt: skip
    """What is behind a place along one direction: effective mass [kg], stiffness [N/m], damping [N s/m] and
    stall force [N] in `found` (4,). False if no servo moves the place.

    Args:
        inertia: (n, n) [kg m2] of the links.
        moved: (n,) [m/rad] by which the servos move the place along the direction.
        torques: (n,) [N m] most of each servo by its description.
        accelerations: (n,) [rad/s2] which each servo reaches at least.
        rotor: Inertia of a motor as a fraction of the links' own.
        bandwidth: Natural frequency [rad/s] of the servos.
        room: (n, n + 1), overwritten.
        found: (4,), overwritten.
    """
    # mass = 1 / (row^T M^-1 row), with M = L L^T: |L^-1 row|^2; L and L^-1 row are in `room`
    n = len(moved)
    gives, bends, stall = 0.0, 0.0, np.inf
    for i in range(n):
        if not (abs(moved[i]) > 1e-6 and inertia[i, i] > 0.0):
            room[i, i] = 0.0  # left out
            continue
        half = moved[i]
        for k in range(i):
            if room[k, k] == 0.0:
                continue
            value = inertia[i, k]
            for c in range(k):
                if room[c, c] != 0.0:
                    value -= room[i, c] * room[k, c]
            room[i, k] = value / room[k, k]
            half -= room[i, k] * room[k, n]
        own = (1.0 + rotor) * inertia[i, i]
        value = own
        for c in range(i):
            if room[c, c] != 0.0:
                value -= room[i, c] * room[i, c]
        room[i, i] = np.sqrt(value)
        room[i, n] = half / room[i, i]
        gives += room[i, n] * room[i, n]
        bends += moved[i] * moved[i] / own
        stall = min(stall, max(torques[i], own * accelerations[i]) / abs(moved[i]))
    if bends == 0.0:
        return False
    stiffness = bandwidth * bandwidth / bends
    found[0], found[1], found[2], found[3] = 1.0 / gives, stiffness, 2.0 * stiffness / bandwidth, stall
    return True


@compiled(returns(float64, float64)(reads(2), reads(2), float64, float64))
def spare(blows: Array, people: Array, margin: float, reaction: float) -> tuple[float, float]:
    """The largest share of their speeds, at most 1, at which `margin` times the force of no blow is more than
    people may get, and the largest force [N] of any blow at that share, without the margin.

    Args:
        blows: (m, 5) with mass, stiffness, damping and stall force as `behind` finds them, and speed [m/s].
        people: (p, 3) with stiffness [N/m], mass [kg] and permitted force [N].
        margin: Factor on the predicted force.
        reaction: [s].
    """
    share = 1.0
    for i in range(len(blows)):
        mass, stiffness, damping, stall, speed = blows[i]
        for j in range(len(people)):
            spring, struck, most = people[j]
            low, high = 0.0, share
            force = _peak(mass, stiffness, damping, stall, share * speed, spring, struck, reaction)
            if margin * force <= most:
                continue
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                force = _peak(mass, stiffness, damping, stall, middle * speed, spring, struck, reaction)
                if margin * force <= most:
                    low = middle
                else:
                    high = middle
            share = low
    largest = 0.0
    for i in range(len(blows)):
        mass, stiffness, damping, stall, speed = blows[i]
        for j in range(len(people)):
            spring, struck, _ = people[j]
            force = _peak(mass, stiffness, damping, stall, share * speed, spring, struck, reaction)
            largest = max(largest, force)
    return share, largest
