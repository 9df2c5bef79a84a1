"""Contacts: their taxels, their centre, and their force for a receptive field (equation 7)."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from helpers import small_robot
from helpers.felt_skin import FeltSkin, contacts_of, skin_state
from helpers.flat_skin import skin_patch
from helpers.small_robot import LOWER, RADIUS, TAXELS, joints
from tci.errors import TciError, UnknownNameError
from tci.messages import Contact, Contacts, Site, SkinFrame
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.robot.limb import generic_limb_distance
from tci.skin.contacts import (
    ContactFinder,
    ContactSettings,
    centre_of_pressure,
    single_contact,
    weighted_force,
)
from tci.skin.kernels.arrays import ActiveTaxels
from tci.skin.kernels.contacts import cluster
from tci.skin.layout import SkinLayout

PATCH = "left_arm_forearm"
SETTINGS = ContactSettings()
NAO_SENSOR = load_robot("nao").patch("left_forearm").sensor
NEWTON_PER_COUNT = 0.026

pokes = st.tuples(st.floats(0.15, 0.7), st.floats(-np.pi, np.pi), st.floats(5.0, 9.0))
pressures = hnp.arrays(
    np.float64, TAXELS, elements=st.sampled_from([0.0, 0.0, 0.0, 400.0, 900.0, 2e3, 5e3, 4e4])
)


@pytest.fixture(scope="module")
def skin(tmp_path_factory: pytest.TempPathFactory) -> FeltSkin:
    return FeltSkin(small_robot.build(tmp_path_factory.mktemp("robot")))


def contacts_at(skin: FeltSkin, pressure: np.ndarray, *, position: np.ndarray | None = None) -> Contacts:
    """Returns the contacts of the left forearm for these pressures (taxels,) [Pa]."""
    at = joints(np.zeros(10) if position is None else position)
    return contacts_of(skin, skin_state(skin.layout, {PATCH: pressure}, stamp=0.25, sequence=7), at)


def find_clusters(forces: np.ndarray, pairs: np.ndarray) -> list[np.ndarray]:
    """Returns the taxels (k,) of each cluster on a patch whose neighbourhood is given."""
    layout = SkinLayout.of([skin_patch(NAO_SENSOR, np.arange(len(forces)), neighbours=pairs)])
    clusters = ContactFinder(layout)._clusters
    state = skin_state(layout, {"skin": forces / layout.arrays.taxels["area"]})
    active = ActiveTaxels(state.stamp, state.begin, state.active, state.pressure)
    unknown = np.full(len(forces), np.inf)
    count, _, _ = cluster(active, SETTINGS.limits, unknown, layout.arrays, clusters)
    return [clusters.member[begin:end].copy() for begin, end in pairwise(clusters.bound[: count + 1])]


def press(skin: FeltSkin, *pokes: tuple[float, float, float]) -> np.ndarray:
    """Returns the pressures (taxels,) [Pa] of pokes (u, theta [rad], force [N]), distributed over taxels as
    in the simulation."""
    surface = skin.surfaces[PATCH]
    pressure = np.zeros(TAXELS)
    for u, theta, force in pokes:
        point = np.array([RADIUS * np.cos(theta), RADIUS * np.sin(theta), -u * LOWER])
        share = np.exp(-0.5 * (np.linalg.norm(surface.positions - point, axis=1) / 0.003) ** 2)
        pressure += force * share / share.sum() / surface.areas
    return pressure


def in_counts(skin: FeltSkin, pressure: np.ndarray) -> np.ndarray:
    """Rounds pressures [Pa] like an 8-bit sensor with a resolution of 0.026 N."""
    areas = skin.surfaces[PATCH].areas
    return np.clip(np.round(pressure * areas / NEWTON_PER_COUNT), 0, 240) * NEWTON_PER_COUNT / areas


# Taxels of a contact


@given(st.integers(1, 40), st.data())
def test_clusters_agree_with_scipy(count: int, data: st.DataObject) -> None:
    node = st.integers(0, count - 1)
    pairs = np.array(data.draw(st.lists(st.tuples(node, node), max_size=60)), dtype=np.intp).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, expected = connected_components(graph, directed=False)
    found = find_clusters(np.ones(count), pairs)
    assert [cluster.tolist() for cluster in found] == [
        np.flatnonzero(expected == label).tolist() for label in dict.fromkeys(expected.tolist())
    ]
    assert len(found) == number


def test_chain_of_many_taxels_is_one_cluster() -> None:
    nodes = np.random.default_rng(0).permutation(2000)
    assert len(find_clusters(np.ones(2000), np.stack([nodes[:-1], nodes[1:]], axis=1))) == 1


def test_floor_alone_is_no_contact_and_a_seed_takes_its_neighbours() -> None:
    pairs = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [5, 6]])
    forces = np.array([0.02, 0.5, 0.02, 0.0, 0.02, 0.09, 0.02])
    (cluster,) = find_clusters(forces, pairs)
    assert cluster.tolist() == [0, 1, 2]


def test_taxels_without_neighbours_do_not_cluster_together() -> None:
    clusters = find_clusters(np.full(3, 0.5), np.empty((0, 2), np.intp))
    assert [cluster.tolist() for cluster in clusters] == [[0], [1], [2]]


@given(pressures)
def test_clusters_are_disjoint_seeded_and_complete(skin: FeltSkin, pressure: np.ndarray) -> None:
    forces = pressure * skin.surfaces[PATCH].areas
    clusters = find_clusters(forces, skin.surfaces[PATCH].neighbours)
    taxels = np.concatenate([*clusters, np.empty(0, np.intp)])
    assert len(set(taxels.tolist())) == taxels.size
    assert set(np.flatnonzero(forces >= SETTINGS.touch)) <= set(taxels.tolist())
    assert (forces[taxels] >= SETTINGS.floor).all()
    assert all((forces[cluster] >= SETTINGS.touch).any() for cluster in clusters)


@given(theta=st.floats(-np.pi, np.pi), u=st.floats(0.2, 0.7))
def test_touches_on_both_sides_of_a_thin_limb_stay_two(skin: FeltSkin, u: float, theta: float) -> None:
    """The limb has a radius of 25 mm. The common centre of the two touches would be on the axis inside the
    limb."""
    found = contacts_at(skin, press(skin, (u, theta, 6.0), (u, theta + np.pi, 6.0)))
    assert len(found) == 2
    for contact in found:
        assert np.hypot(*contact.p_L[:2]) == pytest.approx(RADIUS, abs=0.001)
    assert np.dot(found[0].n_L, found[1].n_L) < -0.95


# Frames without contacts


@pytest.mark.parametrize("newton", [0.0, 0.005, 0.099])
def test_no_contact(skin: FeltSkin, newton: float) -> None:
    assert not contacts_at(skin, newton / skin.surfaces[PATCH].areas)


def test_no_patch_no_contact(skin: FeltSkin) -> None:
    assert not contacts_of(skin, skin_state(skin.layout, {}), joints(np.zeros(10)), posture={})


def test_posture_that_lacks_the_touched_part(skin: FeltSkin) -> None:
    state = skin_state(skin.layout, {PATCH: np.full(TAXELS, 5000.0)})
    with pytest.raises(UnknownNameError, match=r"left_arm.*valid: head"):
        contacts_of(skin, state, joints(np.zeros(10)), posture={"head": np.zeros(2)})


@pytest.mark.parametrize(("counts", "expected"), [(1, 0), (2, 1)])
def test_a_light_touch_begins_with_two_counts_once_the_noise_is_known(
    tmp_path: Path, counts: int, expected: int
) -> None:
    skin = FeltSkin(small_robot.build(tmp_path))
    sensor, surface = skin.robot.patch(PATCH).sensor, skin.surfaces[PATCH]
    near = np.argsort(np.linalg.norm(surface.positions - surface.positions[TAXELS // 2], axis=1))[:3]
    raw, found = np.full(skin.robot.patch(PATCH).channels, sensor.rest), []
    raw[surface.channels[near]] -= counts
    rest = np.full(len(raw), sensor.rest)
    for sequence, values in enumerate([rest, raw, *[rest] * 120, raw]):
        frame = SkinFrame(PATCH, 0.02 * sequence, sequence, read_only(values))
        skin.conditioner.step([frame])
        found.append(len(contacts_of(skin, skin.conditioner.state, joints(np.zeros(10)))))
    assert abs(sensor.pascal_per_count) * counts * surface.areas[near].max() < SETTINGS.touch
    assert found[:-1] == [0] * (len(found) - 1)
    assert found[-1] == expected


@pytest.mark.parametrize(
    ("touch", "light", "floor"),
    [(100.0, 150.0, 200.0), (100.0, 50.0, 0.0), (np.nan, 2.0, 1.0), (np.inf, 2.0, 1.0), (1.0, 2.0, 0.5)],
)
def test_impossible_settings_are_refused(touch: float, light: float, floor: float) -> None:
    with pytest.raises(TciError, match="0 < floor <= light <= touch"):
        ContactSettings(touch=touch, light=light, floor=floor)


# Centre and force


@given(pokes)
def test_nothing_of_a_touch_is_lost(skin: FeltSkin, poke: tuple[float, float, float]) -> None:
    """Each count of a coarse sensor belongs to the contact, also at the weak edge of the contact."""
    pressure = in_counts(skin, press(skin, poke))
    (contact,) = contacts_at(skin, pressure)
    assert contact.taxel_forces.sum() == pytest.approx((pressure * skin.surfaces[PATCH].areas).sum())
    assert contact.taxels.tolist() == np.flatnonzero(pressure).tolist()
    assert contact.peak == contact.taxel_forces.max()
    assert contact.area == pytest.approx(skin.surfaces[PATCH].areas[contact.taxels].sum())
    assert (contact.stamp, contact.sequence, contact.segment) == (0.25, 7, "forearm")


def test_force_of_random_pokes_is_within_two_percent(skin: FeltSkin) -> None:
    random = np.random.default_rng(0)
    for u, theta, force in random.uniform((0.15, -np.pi, 5.0), (0.7, np.pi, 9.0), (200, 3)):
        (contact,) = contacts_at(skin, in_counts(skin, press(skin, (u, theta, force))))
        assert contact.taxel_forces.sum() == pytest.approx(force, rel=0.02)


@given(pokes, hnp.arrays(np.float64, 10, elements=st.floats(-1.5, 1.5)))
def test_centre_is_where_the_finger_is(
    skin: FeltSkin, poke: tuple[float, float, float], position: np.ndarray
) -> None:
    """The centre in the link's frame is the poked place. The coordinates on the limb include the rotation by
    pronation."""
    (contact,) = contacts_at(skin, press(skin, poke), position=position)
    place = np.array([RADIUS * np.cos(poke[1]), RADIUS * np.sin(poke[1]), -poke[0] * LOWER])
    assert np.linalg.norm(contact.p_L - place) < 0.002
    assert contact.u == pytest.approx(poke[0], abs=0.015)
    assert abs(np.angle(np.exp(1j * (contact.theta - poke[1] + position[4])))) < 0.06
    assert contact.taxel_u.min() < contact.u < contact.taxel_u.max()
    T_TL = skin.link_pose("l_4", joints(position))
    np.testing.assert_allclose(contact.p_T, T_TL[:3, :3] @ contact.p_L + T_TL[:3, 3], atol=1e-12)
    np.testing.assert_allclose(contact.n_T, T_TL[:3, :3] @ contact.n_L, atol=1e-12)


@given(pressures)
def test_centre_lies_on_the_surface(skin: FeltSkin, pressure: np.ndarray) -> None:
    for contact in contacts_at(skin, pressure):
        again, _ = skin.surfaces[PATCH].project(contact.p_L[None])
        np.testing.assert_allclose(again[0], contact.p_L, atol=1e-9)
        assert np.linalg.norm(contact.n_L) == pytest.approx(1.0)


def test_wide_touch_does_not_sink_into_the_limb(skin: FeltSkin) -> None:
    """A grip covers half of the limb, so the mean position of equation 7 is 9 mm below the skin."""
    surface = skin.surfaces[PATCH]
    pressure = np.where(surface.positions[:, 0] > 0.0, 5000.0, 0.0)
    (contact,) = contacts_at(skin, pressure)
    mean = centre_of_pressure(surface.positions[contact.taxels], contact.taxel_forces)
    assert np.hypot(*mean[:2]) < RADIUS - 0.008
    assert np.hypot(*contact.p_L[:2]) == pytest.approx(RADIUS, abs=0.001)


def shuffle(skin: FeltSkin, order: np.ndarray) -> FeltSkin:
    """Returns a skin in which taxel i is taxel `order[i]` of the given skin."""
    surface, place = skin.surfaces[PATCH], np.argsort(order)
    shuffled = FeltSkin(skin.robot)
    turned = replace(
        surface,
        positions=surface.positions[order],
        normals=surface.normals[order],
        areas=surface.areas[order],
        channels=surface.channels[order],
        neighbours=place[surface.neighbours],
        faces=place[surface.faces],
    )
    shuffled.layout = SkinLayout.of(
        replace(one, surface=turned) if one.description.name == PATCH else one for one in skin.layout.patches
    )
    return shuffled


@settings(max_examples=50)
@given(pressures, st.permutations(range(TAXELS)))
def test_order_of_the_taxels_does_not_matter(skin: FeltSkin, pressure: np.ndarray, places: list[int]) -> None:
    order = np.array(places)
    one, other = contacts_at(skin, pressure), contacts_at(shuffle(skin, order), pressure[order])
    same = {frozenset(contact.taxels.tolist()): contact for contact in one}
    assert len(one) == len(other)
    for contact in other:
        twin = same[frozenset(order[contact.taxels].tolist())]
        assert contact.force == pytest.approx(twin.force)
        # On a symmetric limb two points may have equal distances to the mean. Both results are correct.
        mean = centre_of_pressure(skin.surfaces[PATCH].positions[twin.taxels], twin.taxel_forces)
        assert np.linalg.norm(contact.p_L - mean) == pytest.approx(np.linalg.norm(twin.p_L - mean), abs=1e-9)


@settings(max_examples=50)
@given(pokes, st.randoms(use_true_random=False))
def test_order_of_the_taxels_does_not_move_the_centre(
    skin: FeltSkin, poke: tuple[float, float, float], random: Random
) -> None:
    order = np.array(random.sample(range(TAXELS), TAXELS))
    pressure = press(skin, poke)
    (one,), (other,) = contacts_at(skin, pressure), contacts_at(shuffle(skin, order), pressure[order])
    for name in ("p_L", "p_T", "u"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9, err_msg=name)
    assert weighted_force(one, 0.2) == pytest.approx(weighted_force(other, 0.2))


def test_strongest_contact_comes_first(skin: FeltSkin) -> None:
    found = contacts_at(skin, press(skin, (0.2, 0.0, 5.0), (0.6, 1.5, 9.0), (0.5, -2.0, 7.0)))
    assert [contact.force for contact in found] == pytest.approx([9.0, 7.0, 5.0], rel=0.06)


def test_nobody_can_change_a_contact(skin: FeltSkin) -> None:
    (contact,) = contacts_at(skin, press(skin, (0.4, 0.0, 6.0)))
    for name in ("taxels", "taxel_forces", "p_L", "n_L", "p_T", "n_T", "taxel_u", "taxel_theta"):
        assert not getattr(contact, name).flags.writeable, name


# Force for a receptive field


def contact_of(
    u: list[float], theta: list[float], forces: list[float], *, at: tuple[float, float]
) -> Contact:
    """Returns a contact on the generic limb with these taxels and with its centre at (u, theta)."""
    nowhere = np.zeros(3)
    return single_contact(
        Site(PATCH, "left_arm", "forearm"), np.arange(len(forces)), forces, u=at[0], theta=at[1], taxel_u=u,
        taxel_theta=theta, p_L=nowhere, n_L=nowhere, p_T=nowhere, n_T=nowhere, f_T=nowhere,
    )  # fmt: skip


def test_weighted_force_is_equation_7() -> None:
    contact = contact_of([0.5, 0.6, 0.4], [0.0, 0.0, 0.0], [2.0, 1.0, 1.0], at=(0.5, 0.0))
    # Weights 2 r - |P_t - P| with r = 0.2: 0.4, 0.3 and 0.3.
    assert weighted_force(contact, 0.2) == pytest.approx((0.4 * 2 + 0.3 + 0.3) / 1.0)


def test_peak_among_weak_taxels_is_diluted_but_not_in_peak_and_total() -> None:
    """The weighted force of a contact with one taxel at 100 and ten taxels at 10 is about 19."""
    ring = 2.0 * np.pi * np.arange(10) / 10
    contact = contact_of(
        [0.5, *(0.5 + 0.01 * np.cos(ring))],
        [0.0, *(0.01 / 0.3 * np.sin(ring))],
        [100.0] + [10.0] * 10,
        at=(0.5, 0.0),
    )
    assert 18.0 < weighted_force(contact, 0.1) < 20.0
    assert weighted_force(contact, 0.1, measure="peak") == 100.0
    assert weighted_force(contact, 0.1, measure="total") == 200.0


def test_taxel_beyond_the_field_has_no_weight() -> None:
    """Read literally, equation 7 gives this taxel a negative weight, and the result would be -1."""
    contact = contact_of([0.5, 0.8], [0.0, 0.0], [1.0, 2.0], at=(0.5, 0.0))
    assert weighted_force(contact, 0.1) == 1.0


@pytest.mark.parametrize("radius", [0.0, 0.1])
def test_no_taxel_no_force(radius: float) -> None:
    assert weighted_force(contact_of([], [], [], at=(0.5, 0.0)), radius) == 0.0
    assert weighted_force(contact_of([0.9], [0.0], [5.0], at=(0.5, 0.0)), radius) == 0.0


def test_unknown_measure_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match="total, weighted, peak"):
        weighted_force(contact_of([], [], [], at=(0.5, 0.0)), 0.1, measure="mean")


@given(pressures, st.floats(0.01, 2.0))
def test_weighted_force_is_a_mean(skin: FeltSkin, pressure: np.ndarray, radius: float) -> None:
    for contact in contacts_at(skin, pressure):
        force = weighted_force(contact, radius)
        low, high = contact.taxel_forces.min(), contact.taxel_forces.max()
        assert force == 0.0 or low * (1 - 1e-12) <= force <= high * (1 + 1e-12)


@given(pokes, st.floats(1.0, 4.0))
def test_weighted_force_grows_with_the_force(
    skin: FeltSkin, poke: tuple[float, float, float], factor: float
) -> None:
    (contact,) = contacts_at(skin, press(skin, poke))
    stronger = contact.table.changed(taxel_force=contact.table.taxel_force * factor)[0]
    assert weighted_force(stronger, 0.3) == pytest.approx(factor * weighted_force(contact, 0.3))


@given(st.floats(-1, 2), st.floats(-10, 10), st.floats(-1, 2), st.floats(-10, 10), st.integers(-3, 3))
def test_distance_on_the_generic_limb(u: float, a: float, v: float, b: float, turns: int) -> None:
    distance = generic_limb_distance(u, a, v, b)
    assert distance == pytest.approx(np.hypot(u - v, 0.6 * np.sin((a - b) / 2)), abs=1e-12)
    assert distance == pytest.approx(float(generic_limb_distance(v, b + 2 * np.pi * turns, u, a)), abs=1e-9)


# The robots that come with TCI


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_skin_of_each_packaged_patch_hangs_together(name: str) -> None:
    """A finger on a gap between modules causes one contact, also on an iCub's forearm."""
    skin = FeltSkin(load_robot(name))
    for patch, surface in skin.surfaces.items():
        if skin.robot.limb_segment(skin.robot.patch(patch)) is None:
            continue  # NAO's switches are far from each other
        assert len(find_clusters(np.ones(len(surface.positions)), surface.neighbours)) == 1, patch
        pairs = surface.neighbours
        assert (np.einsum("ij,ij->i", *surface.normals[pairs.T]) > 0.0).all(), patch
