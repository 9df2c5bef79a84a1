"""Force discount phi and distance discount psi of equation 5."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tci.capabilities.discounts import phi, printed, psi

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


def test_psi_at_the_points_that_define_it() -> None:
    assert psi(0.0, 0.3) == 1.0
    assert psi(0.15, 0.3) == pytest.approx(0.5)
    assert psi(0.3, 0.3) == 0.0


@given(radii, shares)
def test_psi_is_zero_from_the_edge_on(radius: float, share: float) -> None:
    result = psi(share * radius, radius)
    assert 0.0 <= result <= 1.0
    if share * radius >= radius:
        assert result == 0.0


@given(radii, shares, shares)
def test_psi_does_not_rise_with_distance(radius: float, a: float, b: float) -> None:
    assert psi(max(a, b) * radius, radius) <= psi(min(a, b) * radius, radius)


@given(radii, st.floats(1e-12, 1e-3))
def test_psi_is_continuous_at_the_edge(radius: float, inside: float) -> None:
    assert psi(radius * (1.0 - inside), radius) <= 1.01 * inside


def test_nan_gets_no_response() -> None:
    assert phi(float("nan"), 1.0, 3.0) == 0.0
    assert psi(float("nan"), 0.3) == 0.0


def test_the_equation_as_printed_is_nothing_at_the_centre_and_most_at_the_edge() -> None:
    """The text of the paper says the opposite."""
    found = [printed(5.0, 1.0, 3.0, 0.3 * share, 0.3) for share in (0.0, 0.5, 0.999, 1.0)]
    assert found == pytest.approx([0.0, 0.5, 0.999, 0.0])
    assert printed(1.0, 1.0, 3.0, 0.2, 0.3) == printed(float("nan"), 1.0, 3.0, 0.2, 0.3) == 0.0
