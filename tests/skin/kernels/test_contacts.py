"""The compiled contacts equal their NumPy twin, on the skins that come with TCI and on odd ones."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skin.kernels import contact_oracle
from tci.messages import JointReading, PatchState, SkinState
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import generic_posture
from tci.skin.contacts import ContactSettings, find_contacts
from tci.skin.kernels.nearest import nearest
from tci.skin.live_skin import LiveSkin
from tci.skin.surfaces import Surface

SETTINGS = ContactSettings()


@cache
def skin_of(name: str) -> LiveSkin:
    return LiveSkin(load_robot(name))


def touched(skin: LiveSkin, seed: int) -> tuple[SkinState, dict[str, np.ndarray]]:
    """Blobs, single taxels and grips on all patches, in a random posture."""
    random = np.random.default_rng(seed)
    position = random.uniform(-1.0, 1.0, len(skin.robot.servos))
    reading = JointReading(0.0, 0, position, np.zeros(len(position)))
    patches = {}
    for name, surface in limbs(skin).items():
        force = np.zeros(len(surface.positions))
        for _ in range(random.integers(0, 7)):
            distance = np.linalg.norm(surface.positions - random.choice(surface.positions), axis=1)
            size = random.choice([1e-6, 0.01, 0.02, 0.06])
            force[distance <= size] += random.uniform(0.0, 1.0, np.count_nonzero(distance <= size))
        force[random.random(len(force)) < 0.02] = np.nan
        patches[name] = PatchState(name, 1.0, seed, force / surface.areas, force)
    poses = skin.kinematics.poses(position, skin.kinematics.links)
    return SkinState(patches, poses), generic_posture(skin.robot, reading)


def limbs(skin: LiveSkin) -> dict[str, Surface]:
    """Patches that the oracle knows: those on limbs."""
    robot = skin.robot
    return {patch.name: skin.surfaces[patch.name] for patch in robot.patches if robot.limb_segment(patch)}


@pytest.mark.parametrize("robot", ["nao", "icub"])
@given(seed=st.integers(0, 100_000))
def test_contacts_equal_numpy(robot: str, seed: int) -> None:
    skin = skin_of(robot)
    state, posture = touched(skin, seed)
    found = find_contacts(skin, state, posture)
    expected = contact_oracle.contacts(skin, state, posture, SETTINGS)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        surface = skin.surfaces[one.patch]
        mean = np.average(surface.positions[one.taxels], axis=0, weights=one.taxel_forces)
        # Two points of a skin may be equally near to the mean inside it.
        apart = [np.linalg.norm(contact.p_L - mean) for contact in (one, other)]
        assert apart[0] == pytest.approx(apart[1], abs=1e-12)
        twin = np.linalg.norm(one.p_L - other.p_L) > 1e-9
        for field in fields(one):
            if field.name in ("identity", "began", "moved"):
                continue  # the oracle follows nothing
            if not twin or field.name not in ("p_L", "n_L", "p_T", "n_T", "f_T", "u", "theta"):
                a, b = getattr(one, field.name), getattr(other, field.name)
                if field.name in ("theta", "taxel_theta"):  # pi is -pi
                    a, b = np.exp(1j * a), np.exp(1j * b)
                if isinstance(a, str):
                    assert a == b
                else:
                    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9, err_msg=field.name)


def test_memory_of_one_frame_does_not_reach_the_next() -> None:
    skin = skin_of("icub")
    first = touched(skin, 1)
    before = [contact.taxels.tolist() for contact in find_contacts(skin, *first)]
    for seed in range(2, 40):
        find_contacts(skin, *touched(skin, seed))
    assert [contact.taxels.tolist() for contact in find_contacts(skin, *first)] == before


@pytest.mark.parametrize("patch", ["left_upper_arm", "left_forearm"])
@pytest.mark.parametrize("robot", ["nao", "icub"])
@given(seed=st.integers(0, 100_000))
def test_nearest_point_is_that_of_the_whole_surface(robot: str, patch: str, seed: int) -> None:
    """Inside, outside and far away."""
    skin = skin_of(robot)
    flat, random = skin.flat(patch), np.random.default_rng(seed)
    middle = flat.taxels[:, :3].mean(axis=0)
    point = middle + random.normal(size=3) * random.choice([1e-3, 0.03, 0.1, 2.0])
    p_L, n_L = np.empty(3), np.empty(3)
    nearest(tuple(point), flat.taxels, flat.faces, flat.box, flat.cells, p_L, n_L)
    (expected,), (normal,) = skin.surfaces[patch].project(point[None])
    assert np.linalg.norm(p_L - point) == pytest.approx(np.linalg.norm(expected - point), rel=1e-9)
    assert np.linalg.norm(n_L) == pytest.approx(1.0)
    if np.linalg.norm(p_L - expected) < 1e-9:
        np.testing.assert_allclose(n_L, normal, atol=1e-6)


def test_skin_without_faces_has_its_nearest_taxel() -> None:
    skin = LiveSkin(load_robot("nao"))
    surface = skin.surfaces["left_forearm"]
    skin.surfaces = {"left_forearm": replace(surface, faces=np.zeros((0, 3), np.intp))}
    force = np.zeros(len(surface.positions))
    force[7] = 0.5
    _, posture = touched(skin_of("nao"), 0)
    poses = skin.kinematics.poses(np.zeros(len(skin.robot.servos)), skin.kinematics.links)
    state = SkinState({"left_forearm": PatchState("left_forearm", 0.0, 0, force, force)}, poses)
    (contact,) = find_contacts(skin, state, posture)
    np.testing.assert_allclose(contact.p_L, surface.positions[7], atol=1e-15)
