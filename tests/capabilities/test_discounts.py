"""Force discount phi and distance discount psi of equation 5."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tci.capabilities.discounts import phi, psi, psi_cosine

Discount = Callable[[float, float], float]
BOTH = pytest.mark.parametrize("discount", [psi, psi_cosine])
forces = st.floats(0.0, 1e3)
shares = st.floats(0.0, 2.0)
radii = st.floats(1e-3, 10.0)


def test_phi_at_the_points_that_define_it() -> None:
    assert phi(1.0, 1.0, 3.0) == 0.0
    assert phi(2.0, 1.0, 3.0) == 0.5
    assert phi(3.0, 1.0, 3.0) == 1.0


@given(forces, st.floats(0.0, 10.0), st.floats(0.01, 10.0))
def test_phi_is_zero_up_to_the_threshold_and_one_from_saturation_on(
    force: float, threshold: float, span: float
) -> None:
    result = phi(force, threshold, threshold + span)
    assert 0.0 <= result <= 1.0
    assert (result == 0.0) if force <= threshold else (result > 0.0)
    if force >= threshold + span:
        assert result == pytest.approx(1.0)


@given(forces, forces)
def test_phi_does_not_fall_with_force(force: float, other: float) -> None:
    assert phi(min(force, other), 1.0, 3.0) <= phi(max(force, other), 1.0, 3.0)


@BOTH
def test_psi_at_the_points_that_define_it(discount: Discount) -> None:
    assert discount(0.0, 0.3) == 1.0
    assert discount(0.15, 0.3) == pytest.approx(0.5)
    assert discount(0.3, 0.3) == 0.0


@BOTH
@given(radii, shares)
def test_psi_is_zero_from_the_edge_on(discount: Discount, radius: float, share: float) -> None:
    result = discount(share * radius, radius)
    assert 0.0 <= result <= 1.0
    if share * radius >= radius:
        assert result == 0.0


@BOTH
@given(radii, shares, shares)
def test_psi_does_not_rise_with_distance(discount: Discount, radius: float, a: float, b: float) -> None:
    assert discount(max(a, b) * radius, radius) <= discount(min(a, b) * radius, radius)


@BOTH
@given(radii, st.floats(1e-12, 1e-3))
def test_psi_is_continuous_at_the_edge(discount: Discount, radius: float, inside: float) -> None:
    assert discount(radius * (1.0 - inside), radius) <= 1.01 * inside


@BOTH
def test_nan_gets_no_response(discount: Discount) -> None:
    assert phi(float("nan"), 1.0, 3.0) == 0.0
    assert discount(float("nan"), 0.3) == 0.0
