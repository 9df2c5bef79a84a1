"""A counter of unknown ticks, as a finger counts, and one that no clock has."""

from __future__ import annotations

import numpy as np
import pytest

from tci.sources.robotiq.ticks import Ticks


@pytest.mark.parametrize("tick", [1e-6, 1e-4, 1e-3, 1.0])
def test_ticks_are_the_power_of_ten_that_uneven_arrivals_show(tick: float) -> None:
    ticks, rng = Ticks(), np.random.default_rng(0)
    found = [
        (now, ticks.seconds(int(now / tick) + 12345, 50.0 + now + rng.uniform(0.0, 0.008)))
        for now in np.arange(0.0, 300.0 if tick == 1.0 else 3.0, 1 / 60)
    ]
    known = [(now, stamp) for now, stamp in found if stamp is not None]
    assert len(known) > 60
    errors = [stamp - now for now, stamp in known]
    assert np.ptp(errors) <= tick + 1e-9, "times between frames are the device's own"


def test_a_counter_that_stands_still_or_fits_no_clock_is_no_time() -> None:
    for counts in (np.zeros(600, int), np.arange(600) * 333):
        ticks = Ticks()
        assert not any(ticks.seconds(int(count), k / 60) for k, count in enumerate(counts))
