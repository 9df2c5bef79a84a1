"""Pressure image, contact shape, shear and events of a simulated touch."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.body.tactile import contact_shape, pressure_image, shear_force, touch_events
from tci.errors import TciError
from tci.messages import JointReading, Perception, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.joint_map import initial_position

PATCH = "left_forearm"
RATE = 100.0
Feel = Callable[[np.ndarray], Perception]


def three_axes() -> tci.Robot:
    """Returns a NAO with one skin sleeve, whose taxels measure three axes with 16 bits."""
    nao = tci.load_robot("nao")
    patch = nao.patch(PATCH)
    sensor = patch.sensor.model_copy(
        update={"axes": 3, "rest": 30000.0, "lowest": 0.0, "highest": 65535.0, "pascal_per_count": 4.0,
                "shear_pascal_per_count": 4.0}
    )  # fmt: skip
    skin = patch.model_copy(update={"sensor": sensor, "channels": 3 * patch.channels})
    return nao.model_copy(update={"patches": (skin,)})


@pytest.fixture(scope="module")
def body() -> GenericBody:
    return GenericBody(three_axes())


@pytest.fixture
def feel(body: GenericBody) -> Feel:
    """Returns a function that converts stresses (taxels, 3) [Pa], along x, along y and normal to the skin, to
    a perception."""
    perceiver, count = Perceiver(body), 0
    still = read_only(initial_position(body.robot))
    channels = body.skin.surfaces[PATCH].channels

    def perceive(stress: np.ndarray) -> Perception:
        nonlocal count
        count += 1
        raw = np.full(body.robot.patch(PATCH).channels, 30000.0)
        for axis in range(3):
            raw[3 * channels + axis] += np.round(stress[:, axis] / 4.0)
        frame = SkinFrame(PATCH, count / RATE, count, raw)
        joints = JointReading(count / RATE, count, still, read_only(np.zeros(len(still))))
        return perceiver.step(Reading(joints, (frame,)), count / RATE)

    perceive(np.zeros((len(channels), 3)))
    return perceive


def stress(body: GenericBody, *, along: float, around: float, shear: float = 0.0) -> np.ndarray:
    """Returns the stresses (taxels, 3) [Pa] of a Gaussian touch with these standard deviations [m] and a
    shear along x as a fraction of the pressure."""
    surface = body.skin.surfaces[PATCH]
    middle = surface.positions[130]
    image = pressure_image(untouched(body), body, PATCH)
    apart = image.places - image.places[130]
    pressure = 40e3 * np.exp(-((apart[:, 0] / around) ** 2 + (apart[:, 1] / along) ** 2) / 2.0)
    pressure[np.linalg.norm(surface.positions - middle, axis=1) > 0.05] = 0.0
    return np.column_stack([shear * pressure, 0.0 * pressure, pressure])


def untouched(body: GenericBody) -> Perception:
    still = read_only(initial_position(body.robot))
    joints = JointReading(0.0, 0, still, read_only(np.zeros(len(still))))
    return Perceiver(body).step(Reading(joints, ()), 0.0)


def test_the_image_shows_the_touch_where_its_taxels_are(body: GenericBody, feel: Feel) -> None:
    pressed = stress(body, along=0.006, around=0.006)
    seen = feel(pressed)
    image = pressure_image(seen, body, PATCH, pixel=0.001)
    row, column = np.unravel_index(np.nanargmax(image.pressure), image.pressure.shape)
    up = image.corner[1] + (image.pressure.shape[0] - 0.5 - row) * image.pixel
    across = image.corner[0] + (column + 0.5) * image.pixel
    assert np.hypot(*(np.array([across, up]) - image.places[pressed[:, 2].argmax()])) < 0.007
    assert np.nanmax(image.pressure) == pytest.approx(pressed[:, 2].max(), abs=4.0)
    felt = np.nansum(image.pressure) * image.pixel**2
    assert felt == pytest.approx(seen.contacts[0].force, rel=0.2)


@pytest.mark.parametrize("robot", ["nao", "icub"])
@pytest.mark.parametrize("patch", ["left_forearm", "right_forearm", "left_upper_arm", "right_upper_arm"])
def test_both_arms_are_seen_from_outside(robot: str, patch: str) -> None:
    body = GenericBody(tci.load_robot(robot))
    places = pressure_image(untouched(body), body, patch).places
    corners = places[body.skin.surfaces[patch].faces]
    corners = corners[np.ptp(corners[:, :, 0], axis=1) < 0.03]  # not across the cut
    (p, q), (r, s) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    assert len(corners) > 100
    assert (p * s - q * r).min() > 0.0, "corners run anticlockwise"
    _, theta, _ = body.skin.limb(patch, untouched(body).joints)
    lateral = places[(theta > 0.5) & (theta < 2.5), 0]
    assert (lateral > 0.0).all() if patch.startswith("left") else (lateral < 0.0).all()


@pytest.mark.parametrize("patch", ["left_forearm", "left_thigh"])
def test_each_taxel_has_its_own_area_also_at_the_cut(patch: str) -> None:
    """Beyond the cut the next taxel is on the other side of the image."""
    whole = GenericBody(tci.load_robot("nao-whole"))
    seen, surface = untouched(whole), whole.skin.surfaces[patch]
    assert seen.skin is not None
    own, count = whole.layout.taxels[whole.layout.places[patch]], len(surface.areas)
    numbered = dataclasses.replace(
        seen,
        skin=dataclasses.replace(
            seen.skin, begin=np.where(np.arange(len(seen.skin.begin)) > whole.layout.places[patch], count, 0),
            active=np.arange(count, dtype=np.int32), pressure=1.0 + np.arange(count),
        ),
    )  # fmt: skip
    assert own.stop - own.start == count
    image = pressure_image(numbered, whole, patch, pixel=0.0005)
    found = np.bincount(image.pressure[np.isfinite(image.pressure)].astype(int) - 1, minlength=count)
    across = image.places[:, 1]
    inner = (across > across.min() + 0.01) & (across < across.max() - 0.01)
    np.testing.assert_allclose(
        found[inner] * image.pixel**2, np.median(found[inner]) * image.pixel**2, rtol=0.15
    )


@pytest.mark.parametrize("patch", ["left_thigh", "head_skin", "left_hand"])
def test_skin_around_another_part_is_unrolled_too(patch: str) -> None:
    whole = GenericBody(tci.load_robot("nao-whole"))
    places = pressure_image(untouched(whole), whole, patch).places
    surface = whole.skin.surfaces[patch]
    apart = np.linalg.norm(surface.positions[:, None] - surface.positions, axis=2)
    flat = np.linalg.norm(places[:, None] - places, axis=2)
    assert flat[apart > 0.03].min() > 0.01, "its two sides do not lie on each other"
    corners = places[surface.faces]
    (p, q), (r, s) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    whole_ones = np.ptp(corners[:, :, 0], axis=1) < 0.03  # not across the cut
    assert (p * s - q * r)[whole_ones].min(initial=0.0) >= 0.0, "seen from outside"


@pytest.mark.parametrize(("along", "around"), [(0.014, 0.005), (0.005, 0.014)])
def test_the_shape_has_the_touch_axes(body: GenericBody, feel: Feel, along: float, around: float) -> None:
    (contact,) = feel(stress(body, along=along, around=around)).contacts
    shape = contact_shape(contact, body)
    assert shape.axes[0] > 1.6 * shape.axes[1]
    assert abs(shape.directions @ contact.n_L).max() < 1e-6
    segment = body.skin.segment_pose("left_arm", "forearm", *_posture(body))
    link = body.skin.link_pose(body.skin.surfaces[PATCH].link, _posture(body)[0])
    axis = link[:3, :3].T @ segment[:3, 2]
    assert (abs(shape.directions[0] @ axis) > 0.9) == (along > around)
    assert shape.area == pytest.approx(np.pi * shape.axes[0] * shape.axes[1])


def _posture(body: GenericBody) -> tuple[JointReading, np.ndarray]:
    still = read_only(initial_position(body.robot))
    joints = JointReading(0.0, 0, still, read_only(np.zeros(len(still))))
    return joints, body.posture(joints)["left_arm"]


def test_shear_is_told_apart_from_pressure(body: GenericBody, feel: Feel) -> None:
    (contact,) = feel(stress(body, along=0.006, around=0.006, shear=0.3)).contacts
    shear = shear_force(contact, body)
    assert shear is not None
    assert shear.ratio == pytest.approx(0.3, abs=0.05)
    assert shear.tangential @ contact.n_T == pytest.approx(0.0, abs=1e-9)
    assert shear_force(contact, GenericBody(tci.load_robot("nao"))) is None


def test_events_have_the_stamps_of_their_frames(body: GenericBody, feel: Feel) -> None:
    touch = [stress(body, along=0.006, around=0.006, shear=shear) for shear in (0.0, 0.3, 0.7, 0.7, 0.1)]
    told, before = [], None
    for pressed in [*touch, *[0.0 * touch[0]] * 2]:
        now = feel(pressed)
        told += [(one.kind, round(RATE * one.stamp)) for one in touch_events(before, now, body)]
        before = now
    assert told == [("onset", 2), ("slip", 4), ("end", 7)]


def test_a_contact_that_vanishes_for_a_moment_returns_and_begins_only_once(
    body: GenericBody, feel: Feel
) -> None:
    touch = stress(body, along=0.006, around=0.006)
    told, before = [], None
    # the contact vanishes for 30 ms and later for 150 ms
    for pressed in (0.0, 1.0, 0.0, 0.0, 1.0, 1.0, *[0.0] * 15, 1.0):
        now = feel(pressed * touch)
        told += [(one.kind, one.contact, round(RATE * one.stamp)) for one in touch_events(before, now, body)]
        before = now
    first, second = told[0][1], told[-1][1]
    assert first != second
    assert told == [
        ("onset", first, 3), ("end", first, 4), ("return", first, 6), ("end", first, 8), ("onset", second, 23)
    ]  # fmt: skip


def test_impossible_questions_are_refused(body: GenericBody, feel: Feel) -> None:
    seen = feel(stress(body, along=0.006, around=0.006))
    with pytest.raises(TciError, match="pixel 0"):
        pressure_image(seen, body, PATCH, pixel=0.0)
    for pixel in (1e-6, 1e-300):
        with pytest.raises(TciError, match=r"pixel 1e-.* m; valid: 4.*e-05 m or more on left_forearm"):
            pressure_image(seen, body, PATCH, pixel=pixel)
    with pytest.raises(TciError, match="friction -1"):
        touch_events(None, seen, body, friction=-1.0)
    with pytest.raises(TciError, match="without skin"):
        pressure_image(tci.Perception(0.0, {}, seen.contacts), body, PATCH)
