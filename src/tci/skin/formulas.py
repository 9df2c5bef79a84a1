"""Places, widths and forces of contacts as scalar functions in plain Python, which numba and Warp compile as
they are (`tci.support.one_source`)."""

from __future__ import annotations

from math import log, log2

from tci.robot.limb import RHO
from tci.skin.fill_factor import WIDTHS

NARROW = 0.5
"""Least width of a touch, in distances of neighbouring taxels, for the computation of the fill factor. A
narrower touch presses too few taxels to measure the width, and this width is used instead. Assumed: on skins
with distances of 6 to 10 mm between taxels, touches of 3 to 5 mm width then get about the right width."""
SEPARATE = 1.5
"""A touch counts as several places that are pressed, such as finger tips, if its second moment is more than
this many times that of one place. Assumed: a spread of 20 % between the taxels' gains makes a palm's places
look smaller by this factor; twice as much counts three finger tips as a palm."""
LEAST_FILL = 0.15
"""Least fill factor by which forces are divided. A smaller factor is replaced by this value. Assumed: on
sparser skin the correction of the force would be unreliable."""
MOST_HIDDEN = 0.5
"""Largest fraction of a contact's force that is assumed to act at the edge of the touch, where the pressure
is too small to be measured. Assumed: a larger correction would be unreliable."""
FIRST, LAST = float(WIDTHS[0]), float(len(WIDTHS) - 1)
"""Least width [m] for which fill factors are known, and the number of doublings to the largest."""


def variance_of(
    total: float, square: float, x: float, y: float, z: float, own: float, beside: float, apart: float
) -> float:
    """Variance [m2] of a touch along the skin, before it is limited from below (`column_of`).

    Args:
        total, square: Sums over its taxels of the force f [N], and of f times the squared position.
        x, y, z: Mean position [m], weighted with f.
        own, beside, apart: Sums over pairs of neighbours of p p, p p', and p p times the squared distance, of
            pressures p [Pa].
    """
    variance = (square / total - x * x - y * y - z * z) / 2.0
    if beside > 0.0 and beside < own:
        # The second moment is that of a whole touch, so several fingers on one cluster would count as a palm.
        # The pressure of a Gaussian of width v has at a distance d the autocorrelation exp(-d^2 / 4 v^2),
        # however many there are.
        variance = min(variance, SEPARATE * apart / own / (4.0 * log(own / beside)))
    return variance


def column_of(variance: float, area: float, taxels: float) -> float:
    """Place of a touch of that variance [m2] among the columns of fill factors, whose widths double; `area`
    [m2] is that of its `taxels`."""
    variance = max(variance, NARROW * NARROW * area / taxels)
    return min(max(log2(variance / (FIRST * FIRST)) / 2.0, 0.0), LAST)


def force_of(total: float, filled: float, hidden: float, pressure: float) -> float:
    """Force [N] of a touch.

    Args:
        total, filled: Sums over its taxels of the force [N], and of the force times the fill factor.
        hidden: Pressure [Pa] below which its edge is not felt.
        pressure: Largest pressure [Pa].
    """
    return total / (max(filled / total, LEAST_FILL) * (1.0 - min(hidden / pressure, MOST_HIDDEN)))


def on_limb(x: float, y: float, z: float, length: float) -> tuple[float, float, float]:
    """Coordinates (u, y, z), in limb lengths, on the surface of the generic limb of the point (x, y, z) [m]
    in the frame of a segment of `length` [m], mirrored on the right (eqs 4, 6)."""
    r = (x * x + y * y) ** 0.5
    if r == 0.0:
        return -z / length, 0.0, RHO
    return -z / length, RHO * y / r, RHO * x / r


def precedes(force: float, u: float, theta: float, other: float, other_u: float, other_theta: float) -> bool:
    """True if a contact is stronger than another, or equally strong and nearer to the proximal end of the
    limb."""
    if force != other:
        return force > other
    if u != other_u:
        return u < other_u
    return theta < other_theta


def corner_weights(uu: float, uv: float, vv: float, wu: float, wv: float) -> tuple[float, float]:
    """Weights of the second and the third corner for the point of a triangle that is nearest to a given point
    (Ericson 2004, 5.1.5).

    The arguments are dot products of three vectors from the first corner: u to the second corner, v to the
    third corner, and w to the given point.
    """
    if wu <= 0.0 and wv <= 0.0:
        return 0.0, 0.0
    bu, bv = wu - uu, wv - uv
    if bu >= 0.0 and bv <= bu:
        return 1.0, 0.0
    vc = wu * bv - bu * wv
    if vc <= 0.0 and wu >= 0.0 and bu <= 0.0:
        return wu / uu, 0.0
    cu, cv = wu - uv, wv - vv
    if cv >= 0.0 and cu <= cv:
        return 0.0, 1.0
    vb = cu * wv - wu * cv
    if vb <= 0.0 and wv >= 0.0 and cv <= 0.0:
        return 0.0, wv / vv
    va = bu * cv - cu * bv
    if va <= 0.0 and bv - bu >= 0.0 and cu - cv >= 0.0:
        share = (bv - bu) / ((bv - bu) + (cu - cv))
        return 1.0 - share, share
    total = va + vb + vc
    return vb / total, vc / total


def wins(square: float, face: int, best: float, chosen: int, alike: float) -> bool:
    """True if a face whose squared distance from a point is `square` [m2] is nearer than the face `chosen` at
    `best` [m2], or as near and listed before it.

    Below an edge two faces are equally near, with nearest points up to 0.1 mm apart: two of three pokes onto
    one taxel end so. Without `alike`, the relative difference of squares that is rounding, each processor
    would choose by its own.
    """
    if face < chosen:
        return square < best * (1.0 + alike)
    return square < best * (1.0 - alike)
