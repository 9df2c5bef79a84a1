"""Conversion of simulated contacts to skin frames: the kernel, the raw values, and pokes on all of the
skin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from helpers import kernel_oracle, pressing
from helpers.pokes import frame_of, poke_anywhere, pressures, straight_arms
from helpers.pressing import with_pad
from tci.errors import TciError
from tci.robot.catalogue import load_robot
from tci.simulation import sampling as at
from tci.simulation.kernel import spread, width
from tci.simulation.sampling import SLOTS
from tci.simulation.touch import skin_geom
from tci.simulation.world import World

PITCH = 0.0065
GRID = np.array([[PITCH * (i + 0.5 * (j % 2)), 0.866 * PITCH * j, 0.0] for i in range(12) for j in range(12)])
MIDDLE = GRID.mean(axis=0)
UP = np.array([0.0, 0.0, 1.0])
SIGMA = width(np.full(len(GRID), 0.866 * PITCH**2))
numbers = st.floats(-1.0, 1.0)


@given(numbers, numbers, numbers)
def test_shares_are_never_negative_and_sum_to_one(x: float, y: float, z: float) -> None:
    shares = spread(GRID, MIDDLE + 0.1 * np.array([x, y, z]), UP, SIGMA)
    assert (shares >= 0.0).all()
    assert shares.sum() == pytest.approx(1.0, abs=1e-12)


@given(numbers, numbers, st.floats(0.0, 0.004))
def test_inside_the_skin_the_centre_is_the_contact(x: float, y: float, height: float) -> None:
    point = MIDDLE + np.array([0.02 * x, 0.02 * y, height])
    centre = spread(GRID, point, UP, SIGMA) @ GRID
    assert np.linalg.norm((centre - point)[:2]) < 1e-4


@given(st.floats(0.0, 0.02), numbers)
def test_beyond_the_edge_the_centre_lies_at_the_edge(beyond: float, y: float) -> None:
    edge = GRID[:, 0].max()
    point = np.array([edge + beyond, MIDDLE[1] + 0.02 * y, 0.0])
    centre = spread(GRID, point, UP, SIGMA) @ GRID
    assert edge - 0.6 * PITCH < centre[0] <= edge + 1e-12
    assert abs(centre[1] - point[1]) < 0.25 * PITCH


@given(st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=5), st.permutations(range(3)))
def test_any_few_taxels_will_do(places: list[tuple[float, float, float]], axes: list[int]) -> None:
    positions = 0.05 * np.array(places)
    shares = spread(positions, np.zeros(3), np.eye(3)[axes[0]], SIGMA)
    assert np.isfinite(shares).all()
    assert shares.sum() == pytest.approx(1.0, abs=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_taxels_does_not_matter(seed: int) -> None:
    generator = np.random.default_rng(seed)
    point = MIDDLE + generator.uniform(-0.04, 0.04, 3) * (1.0, 1.0, 0.05)
    order = generator.permutation(len(GRID))
    assert np.allclose(
        spread(GRID, point, UP, SIGMA)[order], spread(GRID[order], point, UP, SIGMA), atol=1e-9
    )


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_pokes_anywhere_give_the_physics_force_and_place(name: str) -> None:
    robot = load_robot(name)
    pokes, refused = poke_anywhere(World(robot, posture=straight_arms(robot)), 200, seed=1)
    errors = np.array([poke.error for poke in pokes]) * 1e3
    assert refused <= 0.02 * len(pokes)
    assert all(poke.force > 4.0 for poke in pokes)
    assert np.median(errors) <= 1.0
    assert np.percentile(errors, 95) <= 3.0
    assert sum(poke.edge for poke in pokes) >= 10
    assert np.percentile([poke.error * 1e3 for poke in pokes if poke.edge], 95) <= 3.0
    # A taxel that is pressed beyond its sensor's range sends its largest value, so the excess is unknown.
    unclipped = [poke for poke in pokes if not poke.saturated]
    assert len(unclipped) >= 0.97 * len(pokes)
    # Taxels do not measure forces on the gaps between them or beyond the border of the skin.
    shares = np.array([poke.felt / poke.force for poke in unclipped])
    assert shares.max() <= 1.02
    assert np.median(shares) >= 0.7
    assert np.percentile(shares, 5) >= 0.5


def test_without_contact_every_channel_is_at_rest(world: World) -> None:
    world.advance(0.1)
    for patch, frame in zip(world.robot.patches, world.frames(), strict=True):
        assert frame.patch == patch.name
        assert frame.values.shape == (patch.channels,)
        assert (frame.values == round(patch.sensor.rest)).all()
        assert world.contact_truth(patch.name).force == 0.0


def test_frames_come_at_each_patch_s_own_rate(world: World) -> None:
    seen = {patch.name: [frame_of(world, patch.name)] for patch in world.robot.patches}
    for step in range(1, 101):
        world.advance(step * 0.001)
        for frame in world.frames():
            if frame is not seen[frame.patch][-1]:
                seen[frame.patch].append(frame)
                assert frame.stamp == world.time
    for patch in world.robot.patches:
        frames = seen[patch.name]
        assert [frame.sequence for frame in frames] == list(range(round(0.1 * patch.rate) + 1))
        assert [frame.stamp for frame in frames] == pytest.approx(
            [i / patch.rate for i in range(len(frames))]
        )


def test_only_the_poked_patch_feels_it_and_only_where_taxels_are(world: World) -> None:
    poked = world.robot.patches[0]
    surface = world.surfaces[poked.name]
    world.finger.poke(poked.name, len(surface.positions) // 2)
    world.advance(0.2)
    for patch, frame in zip(world.robot.patches, world.frames(), strict=True):
        felt = pressures(patch, world.surfaces[patch.name], frame) > 0.0
        assert felt.any() == (patch is poked)
        taxels = world.surfaces[patch.name].channels
        others = np.setdiff1d(np.arange(patch.channels), taxels)
        assert (frame.values[others] == round(patch.sensor.rest)).all()


def test_a_touch_on_the_end_of_a_limb_s_skin_is_not_felt() -> None:
    """The end has no taxels. In an earlier version the taxels of the side felt the touch, so a NAO's reflex
    took it for a touch on the side of the thigh, and pressed the thigh into the finger by 0.04 N."""
    world = World(load_robot("nao-whole"), posture={"right_leg": np.array([-0.4, 0.8, 0.0, 1.9, -0.9, 0.1])})
    place = 0.5 * world.surfaces["right_thigh"].positions[-1]
    place[2] = world.surfaces["right_thigh"].positions[:, 2].min()
    world.finger.poke("right_thigh", place, normal=np.array([0.0, 0.0, -1.0]))
    world.advance(0.2)
    assert world.contact_truth("right_thigh").force > 1.0
    assert (
        frame_of(world, "right_thigh").values == round(world.robot.patch("right_thigh").sensor.rest)
    ).all()


TILTS = [(0.0, True), (40.0, True), (70.0, True), (90.0, False), (180.0, False)]


@pytest.mark.parametrize(("tilt", "felt"), TILTS)
def test_a_skin_of_one_taxel_feels_its_face_and_not_its_rim_or_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tilt: float, felt: bool
) -> None:
    """In an earlier version a touch from behind was felt as a touch from the front, so a reflex would have
    moved towards it."""
    monkeypatch.setattr(pressing, "SHEET", 1)
    normal = np.array([0.0, 0.0, 1.0])
    robot = with_pad(load_robot("icub"), "torso", "chest", tmp_path, centre=0.3 * normal, normal=normal)
    world = World(robot, skin=("pad",))
    angle, surface = np.deg2rad(tilt), world.surfaces["pad"]
    way = np.array([np.sin(angle), 0.0, np.cos(angle)])
    rim = 0.5 * np.sqrt(surface.areas[0] / np.pi) * np.array([np.sin(angle), 0.0, 0.0])
    world.finger.poke("pad", surface.positions[0] + rim, way, depth=0.005)
    world.advance(0.2)
    assert world.contact_truth("pad").force > 1.0
    assert (frame_of(world, "pad").values[0] != robot.patch("pad").sensor.rest) == felt


def test_a_poke_is_refused_that_would_also_press_the_end_of_a_limb_s_skin(tmp_path: Path) -> None:
    """In an earlier version the finger was caught between a pad and the end of an iCub's shank, which bore 8
    of 9 N unfelt. The shank moved away from the pad, and the force rose by 3.9 N."""
    end, normal = -0.0138, np.array([0.0, 1.0, 0.0])
    robot = with_pad(
        load_robot("icub-whole"), "right_leg", "r_lower_leg", tmp_path,
        centre=np.array([0.008, -0.016, end]), normal=normal, segment="shank",
    )  # fmt: skip
    world = World(robot, skin=("pad", "right_shank"))
    with pytest.raises(TciError, match="no room for the finger: right_shank would touch it too"):
        world.finger.poke("pad", 2, depth=0.005)
    assert world.finger.pose is None
    world.finger.poke("pad", 3, depth=0.005)
    world.advance(0.2)
    assert world.contact_truth("pad").force == pytest.approx(4.0, rel=0.05)


def test_raw_values_stop_at_the_sensor_s_range(nao: World) -> None:
    patch = nao.robot.patches[0]
    nao.finger.poke(patch.name, 100, depth=0.03)
    nao.advance(0.4)
    frame = frame_of(nao, patch.name)
    assert nao.contact_truth(patch.name).force > 15.0
    assert frame.values.min() == patch.sensor.lowest
    assert frame.values.max() <= patch.sensor.highest


def test_frames_can_not_be_written_to(nao: World) -> None:
    with pytest.raises(ValueError, match="read-only"):
        nao.frames()[0].values[0] = 1


def test_more_contacts_than_slots_are_an_error_not_a_smaller_force(nao: World) -> None:
    patch = nao.robot.patches[0].name
    nao.refresh()
    nao.data.sensordata[nao.model.sensor(skin_geom(patch)).adr[0]] = SLOTS + 1
    with pytest.raises(TciError, match=rf"{SLOTS + 1} contacts on .* valid: up to {SLOTS}"):
        nao.taxels.vectors(patch)


def test_noise_presses_no_switch() -> None:
    world = World("nao-plain", noise=0.5)
    for _ in range(50):
        world.advance(world.time + 0.02)
        assert all((frame.values == 0.0).all() for frame in world.frames())


def test_noise_comes_from_the_seed() -> None:
    robot = load_robot("nao")
    first, same, other = (World(robot, noise=1.0, seed=seed) for seed in (3, 3, 4))
    for world in (first, same, other):
        world.advance(0.02)
    assert (first.frames()[0].values == same.frames()[0].values).all()
    assert (first.frames()[0].values != other.frames()[0].values).any()
    again = [frame.values for frame in first.frames()]
    first.reset()
    first.advance(0.02)
    assert all((a == b.values).all() for a, b in zip(again, first.frames(), strict=True))
    assert 0.7 < np.std(first.frames()[0].values.astype(float)) < 1.3


@given(st.integers(0, 100_000))
def test_the_compiled_loop_equals_numpy(seed: int) -> None:
    """Places are on a sheet, on a cone and beside the edge. At larger distances, where no contact is
    possible, Newton's method ends at the rounding error of its line search."""
    random = np.random.default_rng(seed)
    positions = random.uniform(-0.05, 0.05, (random.integers(1, 300), 3)) * [
        1.0,
        1.0,
        random.choice([0.0, 0.4]),
    ]
    point = random.uniform(-0.06, 0.06, 3)
    normal = random.normal(size=3)
    normal /= np.linalg.norm(normal)
    shares, expected = (f(positions, point, normal, SIGMA) for f in (spread, kernel_oracle.spread))
    assert shares.sum() == pytest.approx(1.0)
    offset = (expected @ positions - point) / SIGMA
    assume(np.linalg.norm(offset - (offset @ normal) * normal) < 2.0)
    np.testing.assert_allclose(shares, expected, atol=1e-6)


def test_a_list_of_taxels_around_a_contact_hides_none(nao: World) -> None:
    """The finger slides over the skin while the skin turns under the finger."""
    patch = nao.robot.patches[0]
    nao.finger.poke(patch.name, len(nao.surfaces[patch.name].positions) // 2, speed=0.1)
    spots = nao.taxels.arrays[10]
    centres = set()
    for step in range(100, 700):
        nao.advance(step * 0.001)
        if step % 100 == 0:
            nao.set_position_targets(np.arange(5), nao.joints().position[:5] + 0.1 * (-1) ** (step // 100))
        felt = nao.taxels.vectors(patch.name)
        centres.add(tuple(spots[0, :3]))
        spots[:, at.RADIUS] = -np.inf
        assert (felt == nao.taxels.vectors(patch.name)).all()
    assert nao.finger.touching
    assert len(centres) > 1
