"""The compiled contact loops give the same results as NumPy, on the packaged skins and on unusual skins."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import float64, int64, void

from helpers import contact_oracle
from helpers.felt_skin import AT_ONCE, FeltSkin, contacts_of, patches, skin_state
from tci.messages import JointReading, SkinState
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import generic_posture
from tci.skin.contacts import ContactFinder
from tci.skin.kernels.arrays import LAYOUT, LayoutArrays
from tci.skin.kernels.nearest import nearest
from tci.skin.layout import SkinLayout
from tci.skin.surfaces import Surface
from tci.skin.tracking import TrackSettings
from tci.support.compiled import compiled, writes

SETTINGS = AT_ONCE


@cache
def skin_of(name: str) -> FeltSkin:
    return FeltSkin(load_robot(name))


def touched(skin: FeltSkin, seed: int) -> tuple[SkinState, JointReading]:
    """Presses random groups of taxels, single taxels and wide grips on all patches, in a random posture."""
    random = np.random.default_rng(seed)
    position = random.uniform(-1.0, 1.0, len(skin.robot.servos))
    pressures = {}
    for name, surface in limbs(skin).items():
        force = np.zeros(len(surface.positions))
        for _ in range(random.integers(0, 7)):
            distance = np.linalg.norm(surface.positions - random.choice(surface.positions), axis=1)
            size = random.choice([1e-6, 0.01, 0.02, 0.06])
            force[distance <= size] += random.uniform(0.0, 1.0, np.count_nonzero(distance <= size))
        pressures[name] = force / surface.areas
    state = skin_state(skin.layout, pressures, stamp=1.0, sequence=seed)
    return state, JointReading(0.0, 0, position, np.zeros(len(position)))


def limbs(skin: FeltSkin) -> dict[str, Surface]:
    """Returns the patches that the NumPy implementation supports, which are those on limbs."""
    robot = skin.robot
    return {patch.name: skin.surfaces[patch.name] for patch in robot.patches if robot.limb_segment(patch)}


@pytest.mark.parametrize("robot", ["nao", "icub"])
@given(seed=st.integers(0, 100_000))
def test_contacts_equal_numpy(robot: str, seed: int) -> None:
    skin = skin_of(robot)
    state, joints = touched(skin, seed)
    found = contacts_of(skin, state, joints)
    posture = generic_posture(skin.robot, joints)
    expected = contact_oracle.contacts(skin, patches(skin, state), joints, posture, SETTINGS)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        surface = skin.surfaces[one.patch]
        mean = np.average(surface.positions[one.taxels], axis=0, weights=one.taxel_forces)
        # Two points of a skin may have equal distances to the mean position inside the limb.
        apart = [np.linalg.norm(contact.p_L - mean) for contact in (one, other)]
        assert apart[0] == pytest.approx(apart[1], abs=1e-12)
        twin = np.linalg.norm(one.p_L - other.p_L) > 1e-9
        for name in vars(other):
            if not twin or name not in ("p_L", "n_L", "p_T", "n_T", "f_T", "u", "theta"):
                a, b = getattr(one, name), getattr(other, name)
                if name in ("theta", "taxel_theta"):  # pi is -pi
                    a, b = np.exp(1j * a), np.exp(1j * b)
                if isinstance(a, str):
                    assert a == b
                else:
                    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("robot", ["nao", "icub"])
@given(seed=st.integers(0, 100_000))
def test_identities_equal_python(robot: str, seed: int) -> None:
    """Touches continue, appear and disappear on all patches. Some patches send no new frame."""
    skin, random = skin_of(robot), np.random.default_rng(seed)
    settings = TrackSettings()
    finder = ContactFinder(skin.layout, AT_ONCE)
    oracle = contact_oracle.Tracks(settings.reach, settings.linger)
    stamps, joints = np.zeros(len(skin.layout.sites)), touched(skin, seed)[1]
    states = [touched(skin, seed + k)[0] for k in range(3)]
    for frame in range(40):
        stamps[random.random(len(stamps)) < 0.8] = 0.02 * frame
        state = replace(states[int(random.integers(3))], stamp=stamps.copy())
        found = contacts_of(skin, state, joints, finder=finder)
        first = found.taxel[found.begin[:-1]]
        expected = oracle.follow(found.site, found.p_L, first, stamps) if len(found) else []
        rows = zip(found.identity.tolist(), found.onset.tolist(), found.displacement.tolist(), strict=True)
        for row, other in zip(rows, expected, strict=True):
            assert row[:2] == other[:2]
            assert row[2] == pytest.approx(other[2], abs=1e-15)


def test_memory_of_one_frame_does_not_reach_the_next() -> None:
    skin = skin_of("icub")
    finder = ContactFinder(skin.layout, AT_ONCE)
    first = touched(skin, 1)
    before = [contact.taxels.tolist() for contact in contacts_of(skin, *first, finder=finder)]
    for seed in range(2, 40):
        contacts_of(skin, *touched(skin, seed), finder=finder)
    assert [contact.taxels.tolist() for contact in contacts_of(skin, *first, finder=finder)] == before
    clusters = finder._clusters
    assert not clusters.force.any()
    assert not clusters.label.any()


@compiled(void(float64, float64, float64, int64, LAYOUT, writes(1), writes(1)))
def project(
    x: float, y: float, z: float, p: int, layout: LayoutArrays, p_L: np.ndarray, n_L: np.ndarray
) -> None:
    nearest((x, y, z), p, layout, p_L, n_L)


@pytest.mark.parametrize("patch", ["left_upper_arm", "left_forearm"])
@pytest.mark.parametrize("robot", ["nao", "icub"])
@given(seed=st.integers(0, 100_000))
def test_nearest_point_is_that_of_the_whole_surface(robot: str, patch: str, seed: int) -> None:
    """The tested points are inside the surface, outside and far away."""
    skin = skin_of(robot)
    surface, random = skin.surfaces[patch], np.random.default_rng(seed)
    point = surface.positions.mean(axis=0) + random.normal(size=3) * random.choice([1e-3, 0.03, 0.1, 2.0])
    p_L, n_L = np.empty(3), np.empty(3)
    project(*point, skin.layout.places[patch], skin.layout.arrays, p_L, n_L)
    (expected,), (normal,) = surface.project(point[None])
    assert np.linalg.norm(p_L - point) == pytest.approx(np.linalg.norm(expected - point), rel=1e-9)
    assert np.linalg.norm(n_L) == pytest.approx(1.0)
    if np.linalg.norm(p_L - expected) < 1e-9:
        np.testing.assert_allclose(n_L, normal, atol=1e-6)


def test_skin_without_faces_has_its_nearest_taxel() -> None:
    skin = FeltSkin(load_robot("nao"))
    place = skin.layout.places["left_forearm"]
    surface = replace(skin.surfaces["left_forearm"], faces=np.zeros((0, 3), np.intp))
    patches = [*skin.layout.patches]
    patches[place] = replace(patches[place], surface=surface)
    skin.layout = SkinLayout.of(patches)
    pressure = np.zeros(len(surface.positions))
    pressure[7] = 0.5 / surface.areas[7]
    state = skin_state(skin.layout, {"left_forearm": pressure})
    (contact,) = contacts_of(skin, state, touched(skin_of("nao"), 0)[1])
    np.testing.assert_allclose(contact.p_L, surface.positions[7], atol=1e-15)
