"""Arms of a G1 with the vendor's gains are where they should be, and nobody is met there."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from helpers.dds_domains import DOMAINS
from helpers.g1_motors import G1
from tci.messages import Order
from tci.runtime.moment import Tick

pytestmark = pytest.mark.live
POSTURES = np.deg2rad([[90.0, 30.0, 0.0, 30.0, 0.0], [20.0, 60.0, 0.0, 0.0, 0.0]])
REACH = np.deg2rad([[-30.0, 5.0, -60.0, 0.0, -60.0], [120.0, 100.0, 60.0, 110.0, 60.0]])
HOLDS = 500
"""Periods for which each posture is asked for: 2 s."""


class Raise(tci.Capability[int]):
    def init(self, body: tci.GenericBody) -> int:
        return 0

    def step(
        self, memory: int, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], int]:
        if memory % HOLDS:
            return (), memory + 1
        posture = POSTURES[memory // HOLDS % len(POSTURES)]
        arms = ("left_arm", "right_arm")
        return tuple(tci.GenericCommand(arm, tci.Mode.POSITION, posture) for arm in arms), memory + 1


def test_arms_do_not_sag_and_their_weight_is_nobody() -> None:
    """With stiffness alone they hung 5 degrees too low, and a joint that does so is held."""
    domain, ticks = next(DOMAINS), list[Tick]()
    with G1(domain), tci.connect("g1", f"unitree:lo/{domain}", arm=True) as driver:
        result = tci.run(driver, Raise(), duration=4.0, observe=ticks.append)
    assert result
    assert not result.went_back
    for tick in (ticks[HOLDS - 1], ticks[-1]):
        sags = tick.sent.position - tick.reading.joints.position[tick.sent.servos]
        assert np.rad2deg(np.abs(sags).max()) < 2.0


class Swing(tci.Capability[float]):
    """Moves both arms at full speed to postures drawn at random, at times drawn at random."""

    def __init__(self) -> None:
        self.random = np.random.default_rng(3)

    def init(self, body: tci.GenericBody) -> float:
        return -np.inf

    def step(
        self, memory: float, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], float]:
        if perception.stamp < memory:
            return (), memory
        arms = ("left_arm", "right_arm")
        orders = (tci.GenericCommand(arm, tci.Mode.POSITION, self.random.uniform(*REACH)) for arm in arms)
        return tuple(orders), perception.stamp + self.random.uniform(0.3, 2.4)


def test_arms_at_full_speed_neither_meet_anybody_nor_stop() -> None:
    """With what holds their weight only, the robot was stopped: a joint moved against its command, as its
    neighbours accelerated."""
    domain, ticks = next(DOMAINS), list[Tick]()
    with G1(domain), tci.connect("g1", f"unitree:lo/{domain}", arm=True) as driver:
        result = tci.run(driver, Swing(), duration=15.0, observe=ticks.append)
    assert result, result.reason
    assert not result.went_back
    behind = [
        float(np.abs(tick.sent.position - tick.reading.joints.position[tick.sent.servos]).max())
        for tick in ticks
        if len(tick.sent.servos)
    ]
    assert np.rad2deg(np.quantile(behind, 0.999)) < 6.0
