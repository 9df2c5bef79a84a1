"""Landmarks, and distances along skin that does not belong to a limb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from helpers.touches import touch
from tci.body.generic_body import GenericBody
from tci.errors import TciError
from tci.messages import Contact, Landmark, Site
from tci.messages.frames import Array, rotation_rpy
from tci.robot.catalogue import load_robot
from tci.robot.description import TruncatedCone
from tci.robot.joint_map import initial_position

ROBOTS = {name: load_robot(name) for name in ("nao-whole", "icub-whole")}
BODIES = {name: GenericBody(robot) for name, robot in ROBOTS.items()}
FRONT = Landmark("", (1.0, 0.0, 0.0))


def contact_at(body: GenericBody, patch: str, point: Array) -> Contact:
    words = body.robot.patch(patch)
    made = touch(np.nan, np.nan, [1.0], part=words.part, segment=words.segment)
    nearest, _ = body.skin.surfaces[patch].project(point[None])
    return replace(made.table.changed(p_L=nearest), sites=(Site(patch, words.part, words.segment),))[0]


@pytest.mark.parametrize("name", ROBOTS)
def test_distances_around_a_head_are_those_of_its_circumference(name: str) -> None:
    body = BODIES[name]
    cone = body.robot.patch("head_skin").surface
    assert isinstance(cone, TruncatedCone)
    radius = (cone.r1 + cone.r2) / 2.0
    surface = body.skin.surfaces["head_skin"]
    landmark = body.landmark("head", FRONT)
    middle = surface.positions.mean(axis=0)
    across = landmark.p_L - middle
    axis = rotation_rpy(*cone.rpy)[:, 2]
    across = across - axis * (axis @ across)
    side = np.cross(axis, across)
    side *= np.linalg.norm(across) / np.linalg.norm(side)
    for angle in np.deg2rad([40, 80, 120, 160]):
        point = middle + np.cos(angle) * across + np.sin(angle) * side
        found = body.distance(contact_at(body, "head_skin", point), FRONT)
        assert found == pytest.approx(radius * angle, rel=0.05), np.rad2deg(angle)
        chord = 2.0 * radius * np.sin(angle / 2.0)
        assert found > chord - 0.002


def unrolled(cone: TruncatedCone, points: Array) -> Array:
    """Returns points (n, 3) [m] of a truncated cone as coordinates (n, 2) in its unrolled sector: slant
    height [m] and angle [rad]."""
    local = (points - np.array(cone.origin)) @ rotation_rpy(*cone.rpy)
    slope = (cone.r2 - cone.r1) / cone.length
    sine = abs(slope) / np.hypot(1.0, slope)
    radius = cone.r1 - slope * local[:, 2]
    return np.column_stack([radius / sine, np.arctan2(local[:, 1], local[:, 0]) * sine])


@pytest.mark.parametrize(
    ("name", "patch", "landmark"),
    [
        ("nao-whole", "head_skin", FRONT),
        ("nao-whole", "torso_skin", Landmark("", (-1.0, 0.0, 0.0))),
        ("icub-whole", "torso_skin", FRONT),
        ("icub-whole", "left_palm", Landmark("", (0.0, -1.0, 0.0))),
        ("nao-whole", "left_thigh", Landmark("thigh", (1.0, 0.0, 0.0))),
        ("nao-whole", "right_shank", Landmark("shank", (-1.0, 0.0, 0.0))),
        ("icub-whole", "left_thigh", Landmark("thigh", (0.0, 1.0, 0.0))),
    ],
)
def test_distances_are_those_of_the_unrolled_cone(name: str, patch: str, landmark: Landmark) -> None:
    """On an unrolled cone the shortest path between two points is a straight line, in one of the two
    directions around the cone."""
    body = BODIES[name]
    words = body.robot.patch(patch)
    cone = words.surface
    assert isinstance(cone, TruncatedCone)
    place = body.landmark(words.part, landmark)
    surface = body.skin.surfaces[patch]
    (start,) = unrolled(cone, place.p_L[None])
    slope = (cone.r2 - cone.r1) / cone.length
    sector = 2.0 * np.pi * abs(slope) / np.hypot(1.0, slope)
    for taxel in range(0, len(surface.positions), 7):
        (end,) = unrolled(cone, surface.positions[taxel : taxel + 1])
        apart = abs(start[1] - end[1]) % sector
        angle = min(apart, sector - apart)
        exact = np.sqrt(start[0] ** 2 + end[0] ** 2 - 2.0 * start[0] * end[0] * np.cos(angle))
        found = body.distance(contact_at(body, patch, surface.positions[taxel]), landmark)
        assert found == pytest.approx(exact, rel=0.03, abs=0.001), (taxel, exact)


@pytest.mark.parametrize("name", ROBOTS)
def test_spots_lie_where_they_are_said_to(name: str) -> None:
    body = BODIES[name]
    start = initial_position(body.robot)
    for part, landmark, axis, sign in (
        ("head", FRONT, 0, 1.0),
        ("torso", Landmark("", (-1.0, 0.0, 0.0)), 0, -1.0),
        ("left_leg", Landmark("thigh", (0.0, 1.0, 0.0)), 1, 1.0),
        ("right_leg", Landmark("thigh", (0.0, 1.0, 0.0)), 1, -1.0),
        ("left_leg", Landmark("foot", (0.0, 0.0, -1.0)), 2, -1.0),
    ):
        place = body.landmark(part, landmark)
        link = body.robot.patch(place.patch).link
        position = np.array(start)
        legs = [part for part in body.robot.parts if part.kind == "leg"]
        position[[joint.servo for leg in legs for joint in leg.servos if joint.servo is not None]] = 0.0
        R_TL = body.skin.kinematics.poses(position, [link])[link][:3, :3]
        assert (R_TL @ place.n_L)[axis] * sign > 0.95, (part, landmark)


def test_a_contact_is_at_no_distance_from_its_own_place_and_none_from_other_skin() -> None:
    body = BODIES["icub-whole"]
    place = body.landmark("left_leg", Landmark("shank", (1.0, 0.0, 0.0)))
    contact = contact_at(body, place.patch, place.p_L)
    assert body.distance(contact, Landmark("shank", (1.0, 0.0, 0.0))) < 1e-6
    assert body.distance(contact, Landmark("thigh", (1.0, 0.0, 0.0))) == np.inf


def test_a_part_without_skin_there_is_told() -> None:
    body = BODIES["nao-whole"]
    with pytest.raises(TciError, match="no skin on tail of head"):
        body.landmark("head", Landmark("tail", (1.0, 0.0, 0.0)))


def test_the_sole_is_a_sheet() -> None:
    body = BODIES["icub-whole"]
    landmark = Landmark("foot", (0.0, 0.0, -1.0))
    place = body.landmark("left_leg", landmark)
    surface = body.skin.surfaces[place.patch]
    for taxel in range(0, len(surface.positions), 40):
        straight = float(np.linalg.norm(surface.positions[taxel] - place.p_L))
        found = body.distance(contact_at(body, place.patch, surface.positions[taxel]), landmark)
        assert straight - 1e-9 <= found <= 1.25 * straight + 0.005
