"""Pressure laid on taxels is the Gaussian that it promises: integrated in another way, on every taxel."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tci.body import GenericBody
from tci.testing import TouchedRobot
from tci.touches import LaidTouches, plan
from tci.touches.places import initial_joints


@pytest.mark.parametrize("robot", ["nao", "g1"])
@pytest.mark.parametrize("u", [0.35, 0.6])
def test_each_taxel_takes_the_gaussian_over_its_own_area_on_the_unrolled_limb(robot: str, u: float) -> None:
    body = GenericBody(robot)
    (planned,) = plan(body, f"press 'left forearm outside' {u} 10N")
    at = planned.times[len(planned.times) // 2]
    found = LaidTouches(body, [planned]).forces([at])[planned.patch][0]
    patch, surface = body.robot.patch(planned.patch), body.skin.surfaces[planned.patch]
    length = body.robot.part(patch.part).segment(patch.segment).length
    along, theta, radius = body.skin.limb(patch.name, initial_joints(body))
    sigma = float(planned.radius[0]) / 1.5
    # A disc of each taxel's area, cut into 12 rings of equal area with 16 points each.
    rings, turns = np.meshgrid(np.sqrt((np.arange(12) + 0.5) / 12.0), 2.0 * np.pi * np.arange(16) / 16.0)
    disc = np.stack([rings * np.cos(turns), rings * np.sin(turns)]).reshape(2, -1)
    expected = []
    for x, angle, r, area in zip(along * length, theta, radius, surface.areas, strict=True):
        dx = x - u * length
        dy = np.angle(np.exp(1j * (angle - np.pi / 2.0))) * r
        points = np.array([dx, dy])[:, None] + np.sqrt(area / np.pi) * disc
        density = np.exp(-(points**2).sum(axis=0) / (2.0 * sigma**2)) / (2.0 * np.pi * sigma**2)
        expected.append(10.0 * area * density.mean())
    assert abs(found.sum() - sum(expected)) < 0.03 * sum(expected)
    np.testing.assert_allclose(found, expected, atol=0.05 * max(expected))


def test_force_beside_the_skin_is_lost_and_the_other_side_of_a_limb_feels_nothing() -> None:
    body = GenericBody("nao")
    middle, edge = plan(
        body, ["press 'left forearm outside' 0.6 10N", "press 'left forearm outside' 0.21 10N"]
    )
    laid = LaidTouches(body, [middle, edge])
    assert laid.share(1) < 0.95 * laid.share(0)
    forces = laid.forces([middle.times[100]])[middle.patch][0]
    normals = body.skin.surfaces[middle.patch].normals
    across = normals @ middle.normal[100, 0]
    assert forces[across < -0.3].sum() < 1e-3 * forces.sum()


@pytest.mark.parametrize("robot", ["nao", "icub", "g1", "talos", "alex"])
def test_a_touch_is_perceived_with_the_asked_force_at_the_asked_place(robot: str) -> None:
    """Over places along a forearm: what holds at the edges of the skin is not promised."""
    felt, off = [], []
    for u in (0.4, 0.5, 0.6):
        for face in ("outside", "back", "inside"):
            one = TouchedRobot(robot)
            words = f"press 'left forearm {face}' {u} 6N 0.6s"
            (planned,) = plan(one.body, words)
            if LaidTouches(one.body, [planned]).share(0) < 0.6:
                continue
            contacts = [seen.contacts[0] for seen in one.feel(words) if seen.contacts]
            best = max(contacts, key=lambda contact: contact.force)
            felt.append(best.force)
            off.append(np.linalg.norm(best.p_L - planned.centre[0, 0]))
    assert len(felt) >= 3
    assert np.median(felt) == pytest.approx(6.0, rel=0.1)
    assert np.median(off) < 0.005


def test_laying_is_at_least_fifty_times_faster_than_real_time() -> None:
    """On the 1026 to 1224 taxels of a Talos's sleeve, at 100 Hz, in processor time of this thread."""
    body = GenericBody("talos")
    planned = plan(body, ["stroke 'left forearm' 0.1..0.9 3N 8cm/s 8s", "hold 'left forearm' 8s"])
    laid, times = LaidTouches(body, planned), np.arange(0.0, planned[-1].end, 0.01)
    laid.forces(times[:50])
    begin = time.thread_time()
    forces = laid.forces(times)
    took = time.thread_time() - begin
    assert next(iter(forces.values())).shape[1] > 1000
    assert times[-1] / took > 50.0
