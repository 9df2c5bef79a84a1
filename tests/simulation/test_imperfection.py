"""Cross-talk, creep, hysteresis and thermal drift of a simulated sensor."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from helpers.flat_skin import skin_patch
from tci.errors import TciError
from tci.messages import Reading
from tci.robot.catalogue import load_robot
from tci.simulation.imperfection import Imperfection, ImperfectTaxels
from tci.simulation.world import World

NEIGHBOURS = np.array([[0, 1], [1, 2], [2, 3]])


def taxels(**values: float) -> ImperfectTaxels:
    """Returns four taxels in a row with these imperfections."""
    surface = skin_patch(
        load_robot("nao").patch("left_forearm").sensor, np.arange(4), neighbours=NEIGHBOURS
    ).surface
    return ImperfectTaxels(surface, Imperfection(**values))


def test_a_perfect_sensor_shows_what_presses_it() -> None:
    pressed = np.array([0.0, 40.0, 7.0, 0.0])
    np.testing.assert_array_equal(taxels().signal(pressed, 3.0), pressed)


def test_cross_talk_appears_on_the_neighbours() -> None:
    signal = taxels(cross_talk=0.1).signal(np.array([0.0, 40.0, 0.0, 0.0]), 0.0)
    np.testing.assert_allclose(signal, [2.0, 40.0, 2.0, 0.0])


def test_creep_grows_under_a_load_and_outlasts_it() -> None:
    one, load = taxels(creep=0.1, creep_time=2.0), np.array([0.0, 100.0, 0.0, 0.0])
    grown = [one.signal(load, now)[1] for now in np.arange(0.0, 20.0, 0.5)]
    assert grown[0] == 100.0
    assert (np.diff(grown) > 0.0).all()
    assert grown[-1] == pytest.approx(110.0, abs=0.1)
    assert 5.0 < one.signal(0.0 * load, 20.5)[1] < 10.0


def test_hysteresis_keeps_a_share_while_the_load_falls() -> None:
    one, load = taxels(hysteresis=0.05), np.array([0.0, 100.0, 0.0, 0.0])
    felt = [one.signal(share * load, now)[1] for now, share in enumerate((0.4, 1.0, 0.4, 0.0))]
    np.testing.assert_allclose(felt, [40.0, 100.0, 43.0, 0.0])


def test_warmth_moves_the_ends_of_a_patch_apart() -> None:
    one = taxels(gradient=10.0, gradient_time=60.0)
    assert not one.signal(np.zeros(4), 0.0).any()
    warm = np.sort(one.signal(np.zeros(4), 600.0))
    assert warm[0] == pytest.approx(0.0, abs=1e-6)
    assert warm[-1] == pytest.approx(10.0, abs=0.01)


def test_a_simulated_skin_has_them_in_its_frames() -> None:
    robot, values = load_robot("nao"), {}
    for name, imperfection in (("perfect", None), ("usual", Imperfection.usual())):
        world = World(robot, imperfection=imperfection)
        world.finger.poke("left_forearm", 130, speed=0.1, depth=0.005)
        world.advance(0.25)
        (frame,) = (one for one in world.frames() if one.patch == "left_forearm")
        values[name] = 240.0 - np.asarray(frame.values, float)
    assert values["usual"].sum() > values["perfect"].sum() > 0.0
    assert values["usual"].max() > values["perfect"].max()


def test_usual_imperfections_are_no_touch() -> None:
    robot = load_robot("nao")
    world, seen = World(robot, noise=0.5, imperfection=Imperfection.usual()), 0
    perceiver = tci.Perceiver(tci.GenericBody(robot))
    for period in range(1, 200):
        world.advance(0.02 * period)
        contacts = perceiver.step(Reading(world.joints(), world.frames()), world.time).contacts
        # Noise of half a count changes the state of switches.
        seen += sum(one.segment != "" for one in contacts) if period > 100 else 0
    assert seen == 0


@pytest.mark.parametrize(
    ("name", "value"), [("cross_talk", 1.0), ("creep", -0.1), ("creep_time", 0.0), ("gradient", np.inf)]
)
def test_impossible_imperfections_are_refused(name: str, value: float) -> None:
    with pytest.raises(TciError, match=f"imperfection: {name}"):
        Imperfection(**{name: value})
