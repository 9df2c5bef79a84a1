"""Compiled loops for the force of a blow, and for what is behind it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, record, returns, views, writes

STEP = 5e-4
"""[s]: a hand of 0.6 kg on 75 N/mm still swings over 30 steps."""
LONGEST = 0.25
"""[s]: every blow has its peak by then."""
HALVINGS = 7
"""Halvings of the range in which a speed is looked for: to 1 %."""
STANDS = 1e-3
"""Speed [m/s] up to which a link strikes nobody."""


class Posed(NamedTuple):
    """MuJoCo's arrays in one posture of a model with n degrees of freedom, b bodies and j joints."""

    inertia: Array
    """(n, n) [kg m2] of the links."""
    centres: Array
    """Centres of mass (b, 3) [m] in the world frame."""
    anchors: Array
    """A point (j, 3) [m] of each axis, in the world frame."""
    axes: Array
    """(j, 3) in the world frame."""


class Links(NamedTuple):
    """Those l links of a model that may strike somebody."""

    bodies: NDArray[np.int64]
    """(l,)."""
    carries: NDArray[np.bool_]
    """True (l, n) for each degree of freedom with which a servo moves the link."""
    joints: NDArray[np.int64]
    """Joint (n,) of each degree of freedom."""
    slides: NDArray[np.bool_]
    """True (n,) for a prismatic joint."""


class Drives(NamedTuple):
    """What the servos of n degrees of freedom can do, by the robot's description."""

    torques: Array
    """(n,) [N m] at most."""
    accelerations: Array
    """(n,) [rad/s2] that each reaches at least."""
    rotor: float
    """Inertia of a motor as a fraction of the links' own."""
    bandwidth: float
    """Natural frequency [rad/s] of a servo."""


Blow = tuple[float, float, float, float, float, float, float]
"""Place [m] and speed [m/s] of what strikes and of what is struck, the largest force [N] so far, the spring
[N/m] between them, 0 once they parted, and by how much [m/s] a newton changes the speed of the struck."""
NOBODY: Blow = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_DRIVES = record(Drives, reads(1), reads(1), float64, float64)


@inlined
def _begun(speed: float, spring: float, struck: float) -> Blow:
    return 0.0, speed, 0.0, 0.0, 0.0, spring, STEP / struck


@inlined
def _next(
    blow: Blow, stiffness: float, damping: float, stall: float, own: float, goes: float, reference: float
) -> Blow:
    x, v, y, w, most, spring, other = blow
    push = stiffness * (reference - x) + damping * (goes - v)
    push = min(max(push, -stall), stall)
    force = max(spring * (x - y), 0.0)
    v += (push - force) * own
    w += force * other
    x += v * STEP
    y += w * STEP
    return x, v, y, w, max(most, force), spring if x >= y else 0.0, other


@inlined
def _largest(blow: Blow) -> float:
    return blow[4] if np.isfinite(blow[4]) else np.inf


@inlined
def _peak(
    mass: float, stiffness: float, damping: float, stall: float, speed: float, spring: float, struck: float,
    reaction: float,
) -> float:  # fmt: skip
    own, reference, blow = STEP / mass, 0.0, _begun(speed, spring, struck)
    for i in range(int(LONGEST / STEP)):
        goes = speed if i * STEP < reaction else 0.0
        reference += goes * STEP
        blow = _next(blow, stiffness, damping, stall, own, goes, reference)
        if blow[5] == 0.0:
            break
    return _largest(blow)


@inlined
def _three_peaks(
    mass: float, stiffness: float, damping: float, stall: float, speed: float, people: Array, first: int,
    reaction: float,
) -> tuple[float, float, float]:  # fmt: skip
    """`_peak` on three people from `first` on, 0 where there is none: each waits only for its own last step,
    so three take little longer than one."""
    count, own, reference = len(people), STEP / mass, 0.0
    a = _begun(speed, people[first, 0], people[first, 1])
    b = _begun(speed, people[first + 1, 0], people[first + 1, 1]) if first + 1 < count else NOBODY
    c = _begun(speed, people[first + 2, 0], people[first + 2, 1]) if first + 2 < count else NOBODY
    for i in range(int(LONGEST / STEP)):
        goes = speed if i * STEP < reaction else 0.0
        reference += goes * STEP
        a = _next(a, stiffness, damping, stall, own, goes, reference)
        b = _next(b, stiffness, damping, stall, own, goes, reference)
        c = _next(c, stiffness, damping, stall, own, goes, reference)
        if a[5] + b[5] + c[5] == 0.0:
            break
    return _largest(a), _largest(b), _largest(c)


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


@inlined
def _behind(inertia: Array, moved: Array, drives: Drives, room: Array, found: Array) -> bool:
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
        own = (1.0 + drives.rotor) * inertia[i, i]
        value = own
        for c in range(i):
            if room[c, c] != 0.0:
                value -= room[i, c] * room[i, c]
        room[i, i] = np.sqrt(value)
        room[i, n] = half / room[i, i]
        gives += room[i, n] * room[i, n]
        bends += moved[i] * moved[i] / own
        stall = min(stall, max(drives.torques[i], own * drives.accelerations[i]) / abs(moved[i]))
    if bends == 0.0:
        return False
    stiffness = drives.bandwidth * drives.bandwidth / bends
    found[0], found[1], found[2], found[3] = 1.0 / gives, stiffness, 2.0 * stiffness / drives.bandwidth, stall
    return True


@compiled(boolean(views(2), views(1), _DRIVES, writes(2), writes(1)))
def behind(inertia: Array, moved: Array, drives: Drives, room: Array, found: Array) -> bool:
    """What is behind a place along one direction: effective mass [kg], stiffness [N/m], damping [N s/m] and
    stall force [N] in `found` (4,). False if no servo moves the place.

    Args:
        inertia: (n, n) [kg m2] of the links.
        moved: (n,) [m/rad] by which the servos move the place along the direction.
        drives: What the servos can do.
        room: (n, n + 1), overwritten.
        found: (4,), overwritten.
    """
    some: bool = _behind(inertia, moved, drives, room, found)
    return some


@compiled(
    int64(
        record(Posed, *[reads(2)] * 4),
        record(Links, reads(1, int64), reads(2, boolean), reads(1, int64), reads(1, boolean)),
        _DRIVES, reads(1), writes(3), writes(2), writes(2),
    )
)  # fmt: skip
def strikes(
    posed: Posed, links: Links, drives: Drives, rates: Array, moved: Array, room: Array, found: Array
) -> int:
    """Writes what is behind the centre of each link that moves, along its velocity, and its speed into rows
    of `found` (l, 5), and returns their number.

    Args:
        posed: The robot in the posture in which the links strike.
        links: Which links.
        drives: What the servos can do.
        rates: Speeds (n,) [rad/s].
        moved: (2, 3, n), overwritten.
        room: (n, n + 1), overwritten.
        found: Mass, stiffness, damping and stall force as `behind` finds them, and speed [m/s].
    """
    count, n = 0, len(rates)
    columns, along = moved[0], moved[1, 0]
    for one in range(len(links.bodies)):
        velocity = (0.0, 0.0, 0.0)
        for i in range(n):
            x, y, z = 0.0, 0.0, 0.0
            if links.carries[one, i]:
                joint = links.joints[i]
                axis, anchor, centre = (
                    posed.axes[joint],
                    posed.anchors[joint],
                    posed.centres[links.bodies[one]],
                )
                a, b, c = centre[0] - anchor[0], centre[1] - anchor[1], centre[2] - anchor[2]
                if links.slides[i]:
                    x, y, z = axis[0], axis[1], axis[2]
                else:
                    x = axis[1] * c - axis[2] * b
                    y = axis[2] * a - axis[0] * c
                    z = axis[0] * b - axis[1] * a
            columns[0, i], columns[1, i], columns[2, i] = x, y, z
            velocity = velocity[0] + x * rates[i], velocity[1] + y * rates[i], velocity[2] + z * rates[i]
        speed = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2)
        if not speed > STANDS:
            continue
        for i in range(n):
            way = velocity[0] * columns[0, i] + velocity[1] * columns[1, i] + velocity[2] * columns[2, i]
            along[i] = way / speed
        if _behind(posed.inertia, along, drives, room, found[count]):
            found[count, 4] = speed
            count += 1
    return count


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
    share, largest, i, j = 1.0, 0.0, 0, 0
    left = len(blows) * len(people)  # so many are not yet known at this share
    while left > 0:
        mass, stiffness, damping, stall, speed = blows[i]
        forces = _three_peaks(mass, stiffness, damping, stall, share * speed, people, j, reaction)
        for k in range(min(3, len(people) - j, left)):
            (spring, struck, most), force = people[j], forces[k]
            j, left, slower = j + 1, left - 1, not margin * force <= most
            if slower:
                low, high, force = 0.0, share, 0.0
                for _ in range(HALVINGS):
                    middle = 0.5 * (low + high)
                    peak = _peak(mass, stiffness, damping, stall, middle * speed, spring, struck, reaction)
                    if margin * peak <= most:
                        low, force = middle, peak
                    else:
                        high = middle
                share, largest, left = low, 0.0, len(blows) * len(people) - 1
            largest = max(largest, force)
            if slower:
                break
        if j == len(people):
            i, j = (i + 1) % len(blows), 0
    return share, largest
