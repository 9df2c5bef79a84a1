"""Paths that would make a robot hit itself are told before they are taken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tci.errors import TciError
from tci.frames import Array
from tci.interface.self_collision import SIGHT, SelfCollision
from tci.model.catalogue import load_robot
from tci.model.clearance import Clearance

NAO = load_robot("nao")
CLEARANCE = Clearance(NAO)
GUARD = SelfCollision(NAO)
INDEX = {servo.name: servo.index for servo in NAO.servos}


def moved(**angles: float) -> Array:
    """The initial posture with some joints elsewhere [degrees]."""
    position = NAO.initial_position.copy()
    for name, angle in angles.items():
        position[INDEX[name]] = np.deg2rad(angle)
    return position


INTO_THE_CHEST = moved(RShoulderPitch=30.0, RShoulderRoll=18.0, RElbowYaw=0.0, RElbowRoll=88.0)


def test_an_arm_that_would_hit_the_chest_is_named() -> None:
    assert CLEARANCE.gap(INTO_THE_CHEST, within=SIGHT).distance < 0.0
    fault = SelfCollision(NAO).fault(np.array([NAO.initial_position, INTO_THE_CHEST]))
    assert "mm near" in fault
    assert "valid: at least 5 mm" in fault


def test_the_way_counts_and_not_only_its_end() -> None:
    across = np.array([NAO.initial_position, INTO_THE_CHEST, NAO.initial_position])
    assert SelfCollision(NAO).fault(across)


def test_a_free_way_is_free() -> None:
    assert SelfCollision(NAO).fault(np.array([NAO.initial_position, moved(RShoulderRoll=-60.0)])) == ""


def test_out_of_a_collision_is_allowed_and_deeper_is_not() -> None:
    deep, way_out = INTO_THE_CHEST, NAO.initial_position - INTO_THE_CHEST
    shares = np.linspace(0.0, 0.2, 20)
    gaps = [CLEARANCE.gap(deep + share * way_out, within=SIGHT).distance for share in shares]
    assert gaps[0] < gaps[10] < gaps[-1]
    inside = deep + shares[10] * way_out
    assert SelfCollision(NAO).fault(np.array([inside, deep + shares[-1] * way_out])) == ""
    assert SelfCollision(NAO).fault(np.array([inside, deep]))


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_let_pass_keeps_the_margin_at_every_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lower = np.array([servo.limits.lower or 0.0 for servo in NAO.servos])
    upper = np.array([servo.limits.upper or 0.0 for servo in NAO.servos])
    start = NAO.initial_position
    path = start + np.linspace(0.0, 1.0, 6)[:, None] * (rng.uniform(lower, upper) - start)
    fine = start + np.linspace(0.0, 1.0, 200)[:, None] * (path[-1] - start)
    least = min(CLEARANCE.gap(point, within=SIGHT).distance for point in fine)
    fault = GUARD.fault(path)
    assert fault == SelfCollision(NAO).fault(path)  # what it was asked before plays no part
    if fault:
        assert least < GUARD.margin + 0.002
    else:
        assert least > GUARD.margin - 0.002


@pytest.mark.parametrize("margin", [-0.001, 0.1, float("nan")])
def test_a_margin_that_makes_no_sense_is_refused(margin: float) -> None:
    with pytest.raises(TciError, match="valid: 0 to 0"):
        SelfCollision(NAO, margin=margin)
