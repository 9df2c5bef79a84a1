"""Motions limited in velocity, acceleration and jerk, as scalar functions in plain Python.

Numba and Warp compile these lines as they are, so both engines plan alike. A motion from speed v and
acceleration a to rest at a distance d consists of eight pieces of constant jerk: a ramp, a change of speed
to vp (three pieces), cruising, and a change from vp to rest (three pieces). The motion is mirrored so that
a <= 0. Then it is one of

- a way to a peak speed vp at which the acceleration is zero; d grows with vp outside of the speeds between
  rest and the speed at which the acceleration would end by itself,
- or braking that is eased first: a ramp up to an acceleration below zero, then the change to rest.

Units: [rad], [rad/s], [rad/s2], [rad/s3]; the functions take any consistent ones.
"""

from __future__ import annotations

HALVINGS = 48
"""Of the interval in which the peak speed lies: less than rounding."""


def side_of(v: float, a: float, end: float, jerk: float) -> float:
    """Direction, 1 or -1, of the jerk with which a change of speed from `v` to `end` begins."""
    return 1.0 if end >= v + a * abs(a) / (2.0 * jerk) else -1.0


def peak_of(v: float, a: float, end: float, jerk: float) -> float:
    """Size of the acceleration at which a change of speed would turn if accelerations had no limit."""
    side = side_of(v, a, end, jerk)
    square = side * (end - v) * jerk + 0.5 * a * a
    return square**0.5 if square > 0.0 else 0.0


def rise_of(v: float, a: float, end: float, most: float, jerk: float) -> float:
    """Duration [s] of the first piece of a change of speed: up to the largest acceleration."""
    rise = (min(peak_of(v, a, end, jerk), most) - side_of(v, a, end, jerk) * a) / jerk
    return rise if rise > 0.0 else 0.0


def hold_of(v: float, a: float, end: float, most: float, jerk: float) -> float:
    """Duration [s] of the second piece: at the largest acceleration."""
    if peak_of(v, a, end, jerk) <= most:
        return 0.0
    side = side_of(v, a, end, jerk)
    return (side * (end - v) - (2.0 * most * most - a * a) / (2.0 * jerk)) / most


def fall_of(v: float, a: float, end: float, most: float, jerk: float) -> float:
    """Duration [s] of the third piece: back to zero acceleration."""
    return min(peak_of(v, a, end, jerk), most) / jerk


def way_of(v: float, a: float, end: float, most: float, jerk: float) -> float:
    """Distance of a change of speed from `v` to `end`."""
    j = side_of(v, a, end, jerk) * jerk
    rise = rise_of(v, a, end, most, jerk)
    hold = hold_of(v, a, end, most, jerk)
    fall = fall_of(v, a, end, most, jerk)
    way = rise * (v + rise * (a / 2.0 + rise * j / 6.0))
    v = v + rise * (a + rise * j / 2.0)
    a = a + rise * j
    way = way + hold * (v + hold * a / 2.0)
    v = v + hold * a
    return way + fall * (v + fall * (a / 2.0 - fall * j / 6.0))


def over_peak(v: float, a: float, peak: float, most: float, jerk: float) -> float:
    """Distance of a way to rest over the speed `peak`, without cruising."""
    return way_of(v, a, peak, most, jerk) + way_of(peak, 0.0, 0.0, most, jerk)


def eased_way(v: float, a: float, eased: float, most: float, jerk: float) -> float:
    """Distance of braking to rest that is first eased to the acceleration `eased`, from `a` to 0."""
    t = (eased - a) / jerk
    way = t * (v + t * (a / 2.0 + t * jerk / 6.0))
    return way + way_of(v + t * (a + t * jerk / 2.0), eased, 0.0, most, jerk)


def is_eased(d: float, v: float, a: float, most: float, jerk: float) -> bool:
    """True if the way `d` to rest is braking that is eased first, for `a` <= 0."""
    ends = v - a * a / (2.0 * jerk)
    if ends <= 0.0:
        return False
    return way_of(v, a, 0.0, most, jerk) < d and d < over_peak(v, a, ends, most, jerk)


def ease_of(d: float, v: float, a: float, most: float, jerk: float) -> float:
    """Acceleration to which braking is eased so that it ends at the distance `d`."""
    low, high = a, 0.0 * a  # a plain 0.0 would be a constant to Warp
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if eased_way(v, a, middle, most, jerk) < d:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def speed_of(d: float, v: float, a: float, fastest: float, most: float, jerk: float) -> float:
    """Peak speed, within `fastest`, of the way to rest at the distance `d`, for `a` <= 0."""
    ends = v - a * a / (2.0 * jerk)
    low, high = max(ends, 0.0), max(fastest, ends)
    if d <= way_of(v, a, 0.0, most, jerk):
        low, high = min(-fastest, ends), min(ends, 0.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if over_peak(v, a, middle, most, jerk) < d:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
