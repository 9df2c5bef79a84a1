"""Positions of the skin in coordinates of link, limb and torso; conversion of frames to skin states."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from helpers import small_robot
from helpers.felt_skin import FeltSkin
from helpers.robot_groups import two_armed
from helpers.small_robot import LOWER, PASCAL, RADIUS, TAXELS, frame, joints, reading
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.body.places import find_place
from tci.errors import FrameError, TciError, UnknownNameError
from tci.messages import JointReading, SkinFrame
from tci.messages.frames import rotation_z
from tci.robot.catalogue import load_robot
from tci.robot.generic_arm import Side, forearm_rotation, side_sign, upper_arm_rotation
from tci.robot.joint_map import initial_position
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin
from tci.skin.surfaces import find_neighbours

postures = hnp.arrays(np.float64, 10, elements=st.floats(-1.5, 1.5))


@pytest.fixture(scope="module")
def skin(tmp_path_factory: pytest.TempPathFactory) -> FeltSkin:
    return FeltSkin(small_robot.build(tmp_path_factory.mktemp("robot")))


@pytest.fixture
def fresh(skin: FeltSkin) -> FeltSkin:
    return FeltSkin(skin.robot)


def turned(angle: np.ndarray) -> np.ndarray:
    """Returns the equivalent angle in the range -pi..pi."""
    return np.angle(np.exp(1j * angle))


# Frames to states


def test_pressure_and_force_of_a_pressed_taxel(fresh: FeltSkin) -> None:
    state = fresh.update(reading(frame("left_arm_forearm", {7: 10})))
    felt = state["left_arm_forearm"]
    surface = fresh.surfaces["left_arm_forearm"]
    taxel = int(np.flatnonzero(surface.channels == 7)[0])
    assert np.flatnonzero(felt.pressure).tolist() == [taxel]
    assert felt.pressure[taxel] == 10 * PASCAL
    assert felt.force[taxel] == pytest.approx(10 * PASCAL * surface.areas[taxel])


def test_patch_that_has_not_sent_is_absent(fresh: FeltSkin) -> None:
    assert not fresh.update(reading())
    assert list(fresh.update(reading(frame("left_arm_forearm", {})))) == ["left_arm_forearm"]


def test_links_are_those_of_skin_and_segments(fresh: FeltSkin) -> None:
    assert set(fresh.layout.links) == {"l_4", "l_1", "r_3", "torso", "l_2", "r_2"}


def test_nothing_new_is_the_same_state(fresh: FeltSkin) -> None:
    twice = reading(frame("left_arm_forearm", {7: 10}, sequence=3))
    fresh.update(twice)
    first = fresh.conditioner.state
    fresh.update(twice)
    assert fresh.conditioner.state is first
    assert fresh.conditioner.late == 0


def test_late_frame_is_not_used_and_counted(fresh: FeltSkin) -> None:
    fresh.update(reading(frame("left_arm_forearm", {7: 10}, sequence=5)))
    newest = fresh.conditioner.state
    fresh.update(reading(frame("left_arm_forearm", {9: 99}, sequence=4)))
    assert fresh.conditioner.state is newest
    assert fresh.conditioner.late == 1


def test_restarted_sender_is_heard_again(fresh: FeltSkin) -> None:
    fresh.update(reading(frame("left_arm_forearm", {}, sequence=5000, stamp=50.0)))
    state = fresh.update(reading(frame("left_arm_forearm", {7: 10}, sequence=0, stamp=53.0)))
    assert state["left_arm_forearm"].sequence == 0


@given(st.permutations(range(6)))
def test_of_frames_in_any_order_the_newest_stays(skin: FeltSkin, order: list[int]) -> None:
    subject = FeltSkin(skin.robot)
    for sequence in order:
        state = subject.update(reading(frame("right_arm_forearm", {sequence: 50}, sequence=sequence)))
    assert state["right_arm_forearm"].sequence == 5


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            SkinFrame("left_arm_forearm", 0.1, 9, np.zeros(TAXELS - 1, np.uint8)),
            [f"({TAXELS},)", f"({TAXELS - 1},)"],
        ),
        (SkinFrame("tail", 0.1, 9, np.zeros(TAXELS, np.uint8)), ["'tail'", "left_arm_forearm"]),
    ],
)
def test_wrong_frame_is_refused_and_changes_nothing(
    fresh: FeltSkin, wrong: SkinFrame, words: list[str]
) -> None:
    fresh.update(reading(frame("left_arm_forearm", {7: 10}, sequence=1)))
    newest = fresh.conditioner.state
    good = frame("right_arm_forearm", {7: 10}, sequence=1)
    with pytest.raises(FrameError) as caught:
        fresh.update(reading(good, wrong))
    assert all(word in str(caught.value) for word in words)
    fresh.update(reading(frame("left_arm_forearm", {7: 10}, sequence=1)))
    assert fresh.conditioner.state is newest


def test_joints_of_another_robot_are_refused(skin: FeltSkin) -> None:
    with pytest.raises(FrameError, match=r"\(9,\)"):
        Perceiver(GenericBody(skin.robot)).step(reading(position=np.zeros(9)), 0.0)


def test_dropped_values_are_counted(fresh: FeltSkin) -> None:
    values = np.full(TAXELS, 240.0)
    values[3] = np.nan
    state = fresh.update(reading(SkinFrame("left_arm_forearm", 0.0, 0, values)))
    assert not state["left_arm_forearm"].force.any()
    assert fresh.conditioner.dropped == 1


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_frames_of_bytes_are_felt_like_any_numbers(name: str) -> None:
    """Frames of bytes and frames of floats give equal pressures: on all kinds of patches, with missing or
    late frames, after a restart of the sender, and with values out of range."""
    robot = load_robot(name)
    quick, slow = FeltSkin(robot), FeltSkin(robot)
    random = np.random.default_rng(1)
    sequences = {patch.name: 0 for patch in robot.patches}
    for k in range(300):
        frames = []
        for patch in robot.patches:
            if random.random() < 0.1:
                continue
            least, most = patch.sensor.lowest, patch.sensor.highest
            values = np.full(patch.channels, patch.sensor.rest)
            if random.random() < 0.5:
                values[: random.integers(1, 20)] = random.integers(least, most + 1)
            if k == 200:
                values[0] = 200.0  # larger than the largest value of a switch
            jump = int(random.choice([1, 1, 1, 1, 2, -2, -90]))
            sequences[patch.name] += jump
            values = np.clip(values, 0.0, 255.0)
            frames.append((patch.name, 0.02 * k + 2.0 * (jump == -90), sequences[patch.name], values))
        both = [
            subject.update(
                reading(
                    *[SkinFrame(n, t, s, v.astype(kind)) for n, t, s, v in frames],
                    position=np.array(initial_position(robot)),
                )
            )
            for subject, kind in ((quick, np.uint8), (slow, np.float64))
        ]
        assert list(both[0]) == list(both[1])
        for patch_name, state in both[0].items():
            other = both[1][patch_name]
            assert (state.stamp, state.sequence) == (other.stamp, other.sequence)
            np.testing.assert_array_equal(state.pressure, other.pressure)
            np.testing.assert_array_equal(state.force, other.force)
            np.testing.assert_array_equal(state.masked, other.masked)
    assert quick.conditioner.dropped == slow.conditioner.dropped
    assert quick.conditioner.late == slow.conditioner.late > 0
    assert quick.conditioner.health == slow.conditioner.health


def test_two_frames_of_a_patch_at_once_are_taken_in_turn() -> None:
    robot = load_robot("nao")
    together, apart = FeltSkin(robot), FeltSkin(robot)
    frames = [
        SkinFrame("left_forearm", 0.02 * k, k, np.full(240, 240 - 30 * (k % 2), np.uint8)) for k in range(6)
    ]
    state = together.update(reading(*frames, position=np.array(initial_position(robot))))
    for one in frames:
        expected = apart.update(reading(one, position=np.array(initial_position(robot))))
    np.testing.assert_array_equal(state["left_forearm"].pressure, expected["left_forearm"].pressure)
    assert together.conditioner.health == apart.conditioner.health


def test_nobody_can_change_a_state_also_after_pickling(fresh: FeltSkin) -> None:
    fresh.update(reading(frame("left_arm_forearm", {7: 10})))
    state = fresh.conditioner.state
    for one in (state, pickle.loads(pickle.dumps(state)), copy.deepcopy(state)):
        for array in (one.stamp, one.sequence, one.begin, one.active, one.pressure, one.on(0)):
            assert not array.flags.writeable
        assert one.pressure.tolist() == [10 * PASCAL]


# Places


def test_link_frame_is_the_surface(skin: FeltSkin) -> None:
    surface = skin.surfaces["left_arm_forearm"]
    at = joints(np.full(10, 0.7))
    np.testing.assert_array_equal(skin.positions("left_arm_forearm", at), surface.positions)
    np.testing.assert_array_equal(skin.normals("left_arm_forearm", at), surface.normals)


@given(postures)
def test_torso_frame_follows_the_arm(skin: FeltSkin, position: np.ndarray) -> None:
    at = joints(position)
    surface = skin.surfaces["left_arm_forearm"]
    upper_arm = upper_arm_rotation(position[:5], "left", axial=True)
    elbow = np.array([0.0, 0.1, 0.0]) + upper_arm @ [0.0, 0.0, -small_robot.UPPER]
    rotation = forearm_rotation(position[:5], "left", axial=True)
    expected = surface.positions @ rotation.T + elbow
    np.testing.assert_allclose(skin.positions("left_arm_forearm", at, frame="torso"), expected, atol=1e-12)
    normals = skin.normals("left_arm_forearm", at, frame="torso")
    np.testing.assert_allclose(normals, surface.normals @ rotation.T, atol=1e-12)


@given(postures)
def test_distances_are_the_same_in_every_frame(skin: FeltSkin, position: np.ndarray) -> None:
    at = joints(position)
    for patch, surface in skin.surfaces.items():
        for name in ("limb", "torso"):
            points = skin.positions(patch, at, frame=name)
            np.testing.assert_allclose(
                np.linalg.norm(points - points[0], axis=1),
                np.linalg.norm(surface.positions - surface.positions[0], axis=1),
                atol=1e-12,
            )


@given(postures)
def test_limb_coordinates_are_the_cone(skin: FeltSkin, position: np.ndarray) -> None:
    for patch, length in (
        ("left_arm_forearm", LOWER),
        ("right_arm_forearm", LOWER),
        ("left_arm_upper_arm", small_robot.UPPER),
    ):
        u, _, r = skin.limb(patch, joints(position))
        np.testing.assert_allclose(r, RADIUS, rtol=1e-9)
        np.testing.assert_allclose(u * length, -skin.surfaces[patch].positions[:, 2], atol=1e-9)


@given(postures)
def test_theta_turns_with_pronation_only_where_the_skin_does(skin: FeltSkin, position: np.ndarray) -> None:
    rest, at = joints(np.zeros(10)), joints(position)
    still = skin.limb("right_arm_forearm", at)[1] - skin.limb("right_arm_forearm", rest)[1]
    np.testing.assert_allclose(turned(still), 0.0, atol=1e-9)
    turning = skin.limb("left_arm_forearm", at)[1] - skin.limb("left_arm_forearm", rest)[1]
    np.testing.assert_allclose(turned(turning + position[4]), 0.0, atol=1e-9)
    upper = skin.limb("left_arm_upper_arm", at)[1] - skin.limb("left_arm_upper_arm", rest)[1]
    np.testing.assert_allclose(turned(upper), 0.0, atol=1e-9)


@given(hnp.arrays(np.float64, 5, elements=st.floats(-1.5, 1.5)))
def test_one_place_is_mirrored_on_the_other_arm(skin: FeltSkin, posture: np.ndarray) -> None:
    """Positions with equal (u, theta, r) on the left and right arm differ by a mirror image and by the
    mount."""
    at = joints(np.concatenate([posture, posture]))
    beside = {}
    sides: tuple[tuple[Side, float], ...] = (("left", 0.0), ("right", small_robot.MOUNT))
    for side, mount in sides:
        patch = f"{side}_arm_forearm"
        u, theta, _ = skin.limb(patch, at)
        shoulder = np.array([0.0, 0.1 * side_sign(side), 0.0])
        points = (skin.positions(patch, at, frame="torso") - shoulder) @ rotation_z(mount)
        beside[side] = u, theta, points * [1.0, side_sign(side), 1.0]
    u, theta, points = beside["left"]
    frame_at = np.array([-u * LOWER, RADIUS * np.sin(theta), RADIUS * np.cos(theta)]).T
    u, theta, others = beside["right"]
    other_at = np.array([-u * LOWER, RADIUS * np.sin(theta), RADIUS * np.cos(theta)]).T
    # The same rigid motion maps the limb's coordinates to the coordinates beside the body on each side.
    motion, *_ = np.linalg.lstsq(np.c_[frame_at, np.ones(TAXELS)], points, rcond=None)
    np.testing.assert_allclose(np.c_[other_at, np.ones(TAXELS)] @ motion, others, atol=1e-9)


def test_unknown_names_list_the_valid_ones(skin: FeltSkin) -> None:
    at = joints(np.zeros(10))
    with pytest.raises(UnknownNameError, match="left_arm_forearm"):
        skin.positions("tail", at)
    with pytest.raises(UnknownNameError, match="link, limb, torso"):
        skin.normals("left_arm_forearm", at, frame="world")
    with pytest.raises(UnknownNameError, match="upper_arm, forearm"):
        skin.segment_pose("left_arm", "hand", at, np.zeros(5))


@pytest.mark.parametrize("name", [*two_armed(), "so101"])
def test_the_projection_of_each_taxel_is_the_taxel(name: str) -> None:
    skin = Skin(load_robot(name))
    for patch in skin.robot.patches:
        surface = skin.surfaces[patch.name]
        there = surface.project(surface.positions)[0]
        assert np.linalg.norm(there - surface.positions, axis=1).max() <= 1e-6


def test_neighbours_are_as_far_apart_as_the_description_or_the_lattice_says(tmp_path: Path) -> None:
    """On a dense skin two touches at a distance of 12 mm are two contacts. An earlier version used 15 mm for
    every skin and joined them."""
    x, y = np.meshgrid(np.arange(12) * 3e-3, np.arange(12) * 3e-3)
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(144)])
    normals = np.tile([0.0, 0.0, 1.0], (144, 1))

    def widest(distance: float | None) -> float:
        one, other = find_neighbours(places, normals, distance).T
        return float(np.linalg.norm(places[one] - places[other], axis=1).max())

    assert 6e-3 <= widest(None) < 9e-3
    assert 9e-3 <= widest(9.1e-3) <= 9.1e-3
    robot = small_robot.build(tmp_path)
    patch = robot.patches[0].model_copy(update={"neighbours": 0.05})
    wide = FeltSkin(robot.model_copy(update={"patches": (patch,), "digest": "wide"})).surfaces[patch.name]
    default = FeltSkin(robot).surfaces[patch.name]
    assert len(wide.neighbours) > len(default.neighbours)


@pytest.mark.filterwarnings("error")
def test_a_line_of_taxels_has_no_faces(tmp_path: Path) -> None:
    robot = small_robot.build(tmp_path)
    patch = robot.patches[0]
    cone = patch.surface.model_copy(update={"per_ring": 1})
    line = patch.model_copy(update={"surface": cone, "channels": small_robot.RINGS})
    surface = FeltSkin(robot.model_copy(update={"patches": (line,), "digest": "line"})).surfaces[patch.name]
    assert surface.faces.shape == (0, 3)
    for near, place in zip(*surface.project(surface.positions + 1e-3 * surface.normals), strict=True):
        assert np.linalg.norm(place) == pytest.approx(1.0)
        assert (surface.positions == near).all(axis=1).any()


def test_a_leg_has_no_places_of_the_generic_limb() -> None:
    robot = load_robot("nao-whole")
    skin, at = FeltSkin(robot), JointReading(0.0, 0, initial_position(robot), np.zeros(len(robot.servos)))
    with pytest.raises(
        TciError, match="the thigh of left_leg is on no generic limb; valid: segments of an arm"
    ):
        find_place(skin, "left_leg", "thigh", 0.5, 0.0, at)
    with pytest.raises(TciError, match="the foot of right_leg is on no generic limb"):
        skin.segment_pose("right_leg", "foot", at, np.zeros(6))


def test_skin_that_is_on_no_limb_has_no_place_on_one(tmp_path: Path) -> None:
    robot = small_robot.build(tmp_path)
    part = robot.parts[0].model_copy(update={"kind": "leg"})
    skin = FeltSkin(robot.model_copy(update={"parts": (part, robot.parts[1])}))
    at = joints(np.zeros(10))
    assert skin.positions("left_arm_forearm", at, frame="torso").shape[1] == 3
    with pytest.raises(TciError, match="no limb; valid frames: link, torso"):
        skin.limb("left_arm_forearm", at)


# The robots that come with TCI


@pytest.fixture(scope="module", params=["nao", "icub"])
def packaged(request: pytest.FixtureRequest) -> FeltSkin:
    return FeltSkin(load_robot(request.param))


def at_zero(skin: FeltSkin) -> JointReading:
    count = len(skin.robot.servos)
    return JointReading(0.0, 0, np.zeros(count), np.zeros(count))


def test_packaged_skin_lies_on_its_segment(packaged: FeltSkin) -> None:
    at = at_zero(packaged)
    for patch in filter(packaged.robot.limb_segment, packaged.robot.patches):
        u, _, r = packaged.limb(patch.name, at)
        assert -0.3 < u.min() < u.max() < 1.3, patch.name
        assert 0.015 < r.min() <= r.max() < 0.07, patch.name


def test_packaged_skin_looks_outward(packaged: FeltSkin) -> None:
    at = at_zero(packaged)
    for patch in filter(packaged.robot.limb_segment, packaged.robot.patches):
        normals = packaged.normals(patch.name, at, frame="limb")
        points = packaged.positions(patch.name, at, frame="limb")
        outward = np.einsum("ij,ij->i", normals[:, :2], points[:, :2]) / np.hypot(*points[:, :2].T)
        assert outward.min() > 0.0, patch.name
        assert np.median(outward) > 0.9, patch.name


@settings(max_examples=20)
@given(share=st.floats(0.1, 0.9))
def test_forearm_skin_rides_as_facts_say(packaged: FeltSkin, share: float) -> None:
    """The skin of iCub's forearm turns with pronation, and the skin of its upper arm turns with the yaw. The
    sleeves of NAO do not turn."""
    robot = packaged.robot
    low, high = at_zero(packaged), at_zero(packaged)
    for patch in filter(robot.limb_segment, robot.patches):
        axial = robot.part(patch.part).servos[4 if patch.segment == "forearm" else 2]
        assert axial.servo is not None
        limits = robot.servos[axial.servo].limits
        assert limits.lower is not None
        assert limits.upper is not None
        high.position[axial.servo] = limits.lower + share * (limits.upper - limits.lower)
        gain = axial.scale * high.position[axial.servo]
        turn = turned(packaged.limb(patch.name, high)[1] - packaged.limb(patch.name, low)[1])
        expected = -gain if robot.name == "icub" else 0.0
        np.testing.assert_allclose(turned(turn - expected), 0.0, atol=1e-6, err_msg=patch.name)
        high.position[axial.servo] = 0.0


def test_a_response_curve_continues_beyond_its_last_point_in_every_place() -> None:
    robot = load_robot("nao")
    patch = robot.patch("left_forearm")
    sensor = patch.sensor.model_copy(update={"response": ((0.0, 0.0), (50.0, 1e3), (100.0, 5e3))})
    curved = patch.model_copy(update={"sensor": sensor})
    others = tuple(curved if one.name == patch.name else one for one in robot.patches)
    layout = SkinLayout.of_robot(robot.model_copy(update={"patches": others, "digest": "curved"}))
    one = next(one for one in layout.patches if one.description.name == patch.name)
    counts = np.array([0.0, 25.0, 100.0, 150.0])
    np.testing.assert_allclose(one.response(counts) * one.gain[0], [0.0, 5e2, 5e3, 9e3])
    np.testing.assert_allclose(sensor.pressure(counts), [0.0, 5e2, 5e3, 9e3])
