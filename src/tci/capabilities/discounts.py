"""The force-distance model (eqs 5 and 6), one function per factor.

Equation 5 is printed without parentheses, as phi F psi d Theta. If d were a factor of a product, the response
would be zero at the centre of a field and largest at the edge, which contradicts the text of the paper.
`phi` and `psi` compute phi(F) psi(d) Theta, in agreement with the text; `printed` is the equation as printed.
"""

from __future__ import annotations


def phi(force: float, threshold: float, saturation: float) -> float:
    """Returns the force discount, 0 to 1 (eq. 5): (F - delta_f) / (F_sat - delta_f), clipped.

    All arguments are in [N], with saturation > threshold. The result is 0 up to the threshold, 1 from the
    saturation on, and 0 for NaN.
    """
    if not force > threshold:
        return 0.0
    return min((force - threshold) / (saturation - threshold), 1.0)


def psi(distance: float, radius: float) -> float:
    """Returns the distance discount, 0 to 1 (eqs 5-6): 1 - d / r.

    Distance and radius have the same unit, and the radius is above 0. The result is 1 at the centre, 0 from
    the edge of the field on, and 0 for NaN.
    """
    return 1.0 - distance / radius if distance < radius else 0.0


def printed(force: float, threshold: float, saturation: float, distance: float, radius: float) -> float:
    """The factor of the base motion by eqs 5-6 as printed, without parentheses: phi F psi d, with the factors
    phi = 1 / F_sat and psi = 1 / r, and F at most F_sat, so that it stays between 0 and 1.

    It is 0 at the centre and largest at the edge; 0 for forces up to the threshold, beyond the edge and for
    NaN. Forces in [N], distance and radius in one unit.
    """
    if not force > threshold or not distance < radius:
        return 0.0
    return min(force / saturation, 1.0) * distance / radius
