"""What a robot feels of a person's touches is what the hand does; pressure laid without physics agrees."""

from __future__ import annotations

import pytest

from tci.lab.experiments.felt_touches import FeltTouch, measure_touches

KINDS = ("poke", "pat", "press", "stroke", "squeeze", "scratch", "pinch")


@pytest.fixture(scope="module", params=["nao", "g1", "talos"])
def felt(request: pytest.FixtureRequest) -> dict[str, FeltTouch]:
    return {row.kind: row for row in measure_touches(request.param, KINDS)}


def test_force_place_and_speed_are_felt_as_they_are(felt: dict[str, FeltTouch]) -> None:
    assert set(felt) == set(KINDS)
    for row in felt.values():
        assert not row.note
        assert row.felt_n == pytest.approx(row.hand_n, rel=0.1), row
        assert row.place_mm is not None
        assert row.place_mm < 5.0, row
    stroke = felt["stroke"]
    assert stroke.hand_cm_s is not None
    assert stroke.felt_cm_s == pytest.approx(stroke.hand_cm_s, abs=2.0)
    assert stroke.hand_cm_s == pytest.approx(6.3, abs=0.7)  # the middle of the kind's range


def test_the_hand_does_what_it_is_asked_for_and_laid_pressure_agrees(felt: dict[str, FeltTouch]) -> None:
    for row in felt.values():
        assert row.hand_n == pytest.approx(row.asked_n, rel=0.2), row
        # each by the force that pressed: a hand does what it is asked for within 20 %
        assert row.laid_n / row.asked_n == pytest.approx(row.felt_n / row.hand_n, rel=0.1), row
        assert row.laid_mm is not None
        assert row.laid_mm < 5.0, row
