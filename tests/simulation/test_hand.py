"""A person's hand: it holds the asked force at the asked place, and goes away."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

import tci
from tci.errors import CommandError, TciError, UnknownNameError
from tci.simulation import HandPath, PersonModel
from tci.simulation.hand import Hand
from tci.simulation.world import World
from tci.skin.fill_factor import fill_factors


@pytest.fixture(scope="module")
def nao() -> World:
    return World("nao", people=1)


def touch_anywhere(
    world: World,
    hand: Hand,
    random: np.random.Generator,
    times: ArrayLike,
    forces: ArrayLike,
    pad: str = "index",
) -> bool:
    """Touches a random taxel; False if there is no room."""
    name = str(random.choice(list(world.surfaces)))
    surface = world.surfaces[name]
    taxel = int(random.integers(len(surface.positions)))
    world.reset()
    try:
        hand.touch(
            HandPath(
                link=surface.link, times=times, points=surface.positions[taxel],
                normals=surface.normals[taxel], forces=forces, pads=(pad,),
            )
        )  # fmt: skip
    except TciError:
        return False
    return True


def test_it_holds_the_asked_force_on_a_resting_arm_anywhere(nao: World) -> None:
    random, hand, done = np.random.default_rng(3), nao.person().right, 0
    for trial in range(16):
        force = float(np.exp(random.uniform(np.log(0.5), np.log(6.0))))
        if not touch_anywhere(nao, hand, random, [0.0, 1.0], [force, force], ("index", "palm")[trial % 2]):
            continue
        nao.advance(1.6)
        time, _, felt = hand.trace[:, :3].T
        assert hand.first_contact is not None
        late = (time > hand.first_contact + 0.3) & (time < hand.first_contact + 0.85)
        assert felt[late] == pytest.approx(force, rel=0.1), (trial, force)
        assert not hand.busy
        assert hand.force == 0.0
        done += 1
    assert done >= 8


def test_what_presses_skin_is_felt_by_it_where_hulls_stick_out() -> None:
    """The convex hulls of iCub's covers are above two thirds of its taxels."""
    world, random, done = World("icub", people=1), np.random.default_rng(6), 0
    hand = world.person().left
    for _ in range(12):
        if touch_anywhere(world, hand, random, [0.0, 0.5], [3.0, 3.0], str(random.choice(["index", "palm"]))):
            world.advance(0.6)
            assert sum(world.contact_truth(name).force for name in world.surfaces) == pytest.approx(
                3.0, rel=0.1
            )
            done += 1
    assert done >= 6


def test_a_grip_is_felt_by_the_pad_on_skin_though_the_other_presses_a_bare_side() -> None:
    world = World("icub", skin=["right_forearm"], people=1)
    skin, hand, done = world.surfaces["right_forearm"], world.person().left, 0
    across = skin.positions.mean(axis=0)
    for taxel in np.random.default_rng(4).permutation(len(skin.positions))[:60].tolist():
        place, out = skin.positions[taxel], skin.normals[taxel]
        other = place - 2.0 * float((place - across) @ out) * out
        if np.linalg.norm(skin.positions - other, axis=1).min() < 0.03:
            continue
        world.reset()
        path = HandPath(
            link=skin.link, times=[0.0, 0.5], points=[[place, other]] * 2, normals=[[out, -out]] * 2,
            forces=[[3.0, 3.0]] * 2, pads=("thumb", "index"),
        )  # fmt: skip
        try:
            hand.touch(path)
        except TciError:
            continue
        world.advance(0.4)
        assert hand.force > 3.0
        assert world.contact_truth("right_forearm").force == pytest.approx(0.5 * hand.force, rel=0.1), taxel
        done += 1
    assert done >= 3


def test_a_palm_at_the_edge_of_a_skin_presses_no_taxel_with_what_lies_beside_it() -> None:
    world = World("icub", skin=["right_forearm"], people=1)
    skin, hand, wide, done = world.surfaces["right_forearm"], world.person().left, 0.01, 0
    at_edges = np.argsort(fill_factors(skin)[:, -1])[:60]
    for taxel in np.random.default_rng(1).permutation(at_edges)[:8].tolist():
        world.reset()
        path = HandPath(
            link=skin.link, times=[0.0, 1.0], points=skin.positions[taxel], normals=skin.normals[taxel],
            forces=[8.0, 8.0], pads=("palm",), spread=wide,
        )  # fmt: skip
        try:
            hand.touch(path)
        except TciError:
            continue
        world.advance(0.8)
        felt = world.taxels.vectors("right_forearm")[:, 2]
        assert 0.3 * hand.force < felt.sum() < 0.9 * hand.force
        assert (felt / skin.areas).max() < 1.6 * hand.force / (2.0 * np.pi * wide**2)
        done += 1
    assert done >= 4


def test_the_peaks_of_blows_are_those_asked_for(nao: World) -> None:
    random, hand, done = np.random.default_rng(8), nao.person().right, 0
    for _ in range(14):
        duration = float(random.choice([0.06, 0.1, 0.3]))  # hit, tap, poke
        peak = float(random.uniform(10.0, 15.0) if duration < 0.1 else random.uniform(1.0, 6.0))
        times = np.arange(0.0, duration + 1e-9, 0.005)
        forces = peak * np.sin(np.pi * times / times[-1]).clip(0.0)
        if touch_anywhere(nao, hand, random, times, forces):
            nao.advance(duration + 0.6)
            assert hand.peak_force == pytest.approx(peak, rel=0.2), (duration, peak)
            done += 1
    assert done >= 7


def test_it_follows_an_arm_that_moves_away_and_lets_one_go_that_starts_to() -> None:
    world = World("g1", period=0.02, skin=["left_forearm"], people=[PersonModel(hands=["right"])])
    hand, surface, random = world.person().right, world.surfaces["left_forearm"], np.random.default_rng(2)
    servo = world.robot.part("left_arm").servos[0].servo
    assert servo is not None
    world.refresh()
    joint = world.model.joint(world.robot.servos[servo].joint).id
    axis, anchor = world.data.xaxis[joint].copy(), world.data.xanchor[joint].copy()
    places = [world.skin_point_in_world("left_forearm", k) for k in range(len(surface.positions))]
    ways = [np.cross(axis, point - anchor) for point, _ in places]
    away = [-(way @ normal) / np.linalg.norm(way) for way, (_, normal) in zip(ways, places, strict=True)]
    chosen = random.permutation(np.argsort(away)[-60:]).tolist()
    home, done = world.joints().position[servo], [0, 0]
    while min(done) < 2:
        taxel, starts = chosen.pop(), done[0] < done[1]
        world.reset()
        force, begins = float(random.uniform(2.0, 6.0)), 0.7 if starts else 0.0
        hand.touch(
            HandPath(
                link=surface.link, times=[0.0, 1.0], points=surface.positions[taxel],
                normals=surface.normals[taxel], forces=[force, force], pads=("index",),
            ), start=0.1,
        )  # fmt: skip
        rate = 0.2 / float(np.linalg.norm(ways[taxel]))
        for tick in range(1, 45):
            world.advance(0.02 * tick)
            moved = rate * max(0.02 * (tick + 1) - begins, 0.0)
            world.set_position_targets([servo], [home + moved])
        if hand.missed:
            continue  # no room
        done[not starts] += 1
        time, _, felt = hand.trace[:, :3].T
        if starts:
            # what starts to move at 0.2 m/s is gone before the person sees it
            assert felt[(time > begins + 0.1) & (time < begins + 0.15)].max() < 0.2 * force
        else:
            assert hand.first_contact is not None
            late = felt[time > hand.first_contact + 0.3] / force
            assert np.median(late) == pytest.approx(1.0, abs=0.1)
            assert np.percentile(late, [5.0, 95.0]) == pytest.approx(1.0, abs=0.2)


def test_it_gives_way_to_an_arm_that_swings_against_it(nao: World) -> None:
    """A hand that held its place with the stiffness of an arm would press with more than 100 N."""
    nao.reset()
    nao.touch("press 'left forearm' 10N")
    tci.run(tci.connect("nao", "sim", world=nao), tci.WithdrawalReflex(), duration=1.8)
    peak = max(hand.trace[:, 2].max() for hand in nao.people[0].hands if len(hand.trace))
    assert 9.0 < peak < 60.0


def test_a_wrong_path_or_hand_says_what_is_valid(nao: World) -> None:
    one = {"link": "LForeArm", "times": [0.0, 1.0], "points": [0.0, 0.0, 0.0], "normals": [0.0, 0.0, 1.0],
           "forces": [1.0, 1.0]}  # fmt: skip
    for change, words in (
        ({"times": [0.0, 0.0]}, "rising"), ({"forces": [-1.0, 1.0]}, "at least 0 N"),
        ({"points": [0.0, 0.0]}, "valid: "), ({"normals": [0.0, 0.0, 0.0]}, "above 0"),
    ):  # fmt: skip
        with pytest.raises(CommandError, match=words):
            HandPath(**{**one, **change})  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="palm"):
        HandPath(**one, pads=("toe",))  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="link"):
        nao.person().left.touch(HandPath(**{**one, "link": "Wing"}))  # type: ignore[arg-type]
    with pytest.raises(CommandError, match="people=1"):
        tci.World("nao", skin=False).person()


@pytest.mark.parametrize(
    ("name", "poke"), [("nao", "poke 'left forearm' 4N"), ("icub", "stroke 'left forearm' 3N")]
)
def test_it_lets_an_arm_go_that_jerks_away(name: str, poke: str) -> None:
    """It chased the arm with up to 1 m/s, and struck it with 20 N where it had come to rest."""
    with tci.connect(name, "sim", people=1) as driver:
        driver.world.touch(poke)
        result = tci.run(driver, tci.WithdrawalReflex(), duration=2.5)
        peak = driver.world.person().right.trace[:, 2].max()
    assert result.moved
    assert 1.0 < peak < 15.0


@pytest.mark.parametrize("robot", ["nao", "icub"])
def test_a_pad_presses_on_an_area_that_grows_up_to_what_is_planned(robot: str) -> None:
    """What taxels measure has the width of the pad, and of what the skin's cover adds to a point. A touch of
    a palm is wider than one of a fingertip; the cube root of the force says how much of it lies flat."""
    world, widths = World(robot, people=1), []
    for line in ("poke 'left forearm' 6N", "press 'left forearm' 6N", "press 'left forearm' 1.5N"):
        world.reset()
        (planned,) = world.touch(line)
        world.advance(float(planned.times.mean()))
        patch, surface = world.robot.patch(planned.patch), world.surfaces[planned.patch]
        frame = next(one for one in world.frames() if one.patch == planned.patch)
        forces = np.abs(frame.values.astype(float) - patch.sensor.rest)[surface.channels] * surface.areas
        shares = forces / forces.sum()
        apart = surface.positions - shares @ surface.positions
        width = float(np.sqrt(shares @ (apart * apart).sum(axis=1) / 2.0))
        point = np.hypot(3e-3, np.sqrt(surface.areas.mean() / 12.0))  # a force at a point, on this skin
        flat = min(world.person().right.force + world.person().left.force, 5.0) / 5.0
        soft = planned.radius[0] / 1.5 * flat ** (1.0 / 3.0)
        assert width == pytest.approx(np.hypot(soft, point), rel=0.15)
        widths.append(width)
    assert widths[1] > 1.6 * widths[0]
    assert widths[1] > 1.2 * widths[2]
