"""Simulated worlds are independent: the distribution of worlds over processes does not change the results."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

import tci
import tci.lab
from tci.errors import TciError
from tci.lab.experiments.simulate import WorldRun


def facts(runs: tuple[WorldRun, ...]) -> list[dict[str, object]]:
    return [{k: v for k, v in asdict(run).items() if k not in ("took", "positions")} for run in runs]


def test_cores_do_not_matter_and_seeds_do() -> None:
    one = tci.lab.simulate("nao", worlds=4, duration=0.3, cores=1, noise=0.5)
    two = tci.lab.simulate("nao", worlds=4, duration=0.3, cores=2, noise=0.5)
    assert facts(one) == facts(two)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.positions, b.positions)
    assert [run.world for run in one] == [0, 1, 2, 3]
    assert len({(run.part, run.site, run.first_contact) for run in one}) > 1
    # A world is defined only by its number: the second world with seed 0 equals the first world with seed 1.
    (alone,) = tci.lab.simulate("nao", worlds=1, duration=0.3, noise=0.5, seed=1)
    np.testing.assert_array_equal(alone.positions, one[1].positions)


def test_the_reflex_answers_and_nothing_answers_without_it() -> None:
    with_it = tci.lab.simulate("icub", worlds=2, duration=0.3, cores=1)
    assert all(run.first_contact is not None and run.first_command is not None for run in with_it)
    without = tci.lab.simulate("icub", tci.WithdrawalReflex(fields=()), worlds=2, duration=0.3, cores=1)
    assert all(run.first_contact is not None and run.first_command is None for run in without)


@pytest.mark.parametrize("options", [{"worlds": 0}, {"cores": 0}, {"sites": ()}])
def test_nothing_to_do_is_an_error(options: dict[str, object]) -> None:
    with pytest.raises(TciError, match="at least one of each"):
        tci.lab.simulate("nao", **options)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_no_time_is_an_error(duration: float) -> None:
    with pytest.raises(TciError, match="valid: above 0 s"):
        tci.lab.simulate("nao", duration=duration)
