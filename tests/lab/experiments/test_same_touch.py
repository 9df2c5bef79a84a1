"""Equal pressure on the skins of five robots is perceived as equal force, and the reflex responds equally."""

from __future__ import annotations

import numpy as np
import pytest

from tci.body.generic_body import GenericBody
from tci.capabilities.fields import default_fields
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.same_touch import FORCES, PROBES, same_touch
from tci.robot.catalogue import load_robot

ROBOTS = ("nao", "icub", "g1", "talos", "alex")


@pytest.fixture(scope="module")
def bodies() -> list[GenericBody]:
    return [GenericBody(load_robot(name)) for name in ROBOTS]


def differences(bodies: list[GenericBody], reflex: WithdrawalReflex) -> tuple[float, float, int]:
    """Returns the largest ratio between the forces of two robots, the largest difference between their gains,
    and the number of touches that all skins can measure."""
    touches: dict[tuple[float, float], list[tuple[float, float]]] = {}
    for row in same_touch(bodies, reflex):
        print(row)
        if row.heavy:
            touches.setdefault((row.probe_mm, row.pressed_n), []).append((row.force_n, row.gain))
    felt = np.array([*touches.values()])
    assert felt.shape[1:] == (len(ROBOTS), 2)
    low, high = felt.min(axis=1), felt.max(axis=1)
    return float((high[:, 0] / low[:, 0]).max()), float((high[:, 1] - low[:, 1]).max()), len(touches)


def test_five_skins_perceive_the_same_touch_alike(bodies: list[GenericBody]) -> None:
    """Three touches are left out, because they change the values of iCub's forearm by only 1.1, 0.3 and 0.9
    counts: 0.3 N on 10 mm, and 0.3 N and 1 N on 20 mm."""
    ratio, gain, felt = differences(bodies, WithdrawalReflex())
    assert ratio <= 1.10
    assert gain <= 0.05
    assert felt == len(PROBES) * len(FORCES) - 3


def test_the_mean_of_eq_7_follows_the_area_of_a_taxel(bodies: list[GenericBody]) -> None:
    """Shows that the test of equal gains can fail."""
    _, gain, _ = differences(bodies, WithdrawalReflex(fields=default_fields(measure="weighted")))
    assert gain > 0.10
