"""Simulates self-touch: a robot touches one patch of its skin with the skin of the other arm.

Postures are computed by kinematics within the servos' limits. Collisions between other links are not
considered. The taxels in the overlap of the two surfaces count as pressed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import TciError
from tci.lab.authoring.mount_skin import Mount, find_mount, moved_patch, self_touches
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import Array, apply, invert, read_only, transform
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface

DEPTH = 0.002
"""Depth [m] by which the two skins overlap. Assumed: the covers of the skins are 2 to 3 mm thick."""
PERIOD = 0.02
"""Period [s] of the skin frames."""
REST, PRESSED = 3, 14
"""REST: number of frames without a touch between two touches. PRESSED: number of frames of each touch, enough
for TCI to detect a contact of a single taxel."""
SHARE = 0.3
"""Raw value of a pressed taxel, as a fraction of the sensor's range. Assumed: the value does not affect the
result, since only the set of pressed taxels is used."""
ENCODER = np.deg2rad(0.1)
"""Standard deviation [rad] of the error of the measured angles. Assumed: the backlash of a humanoid's joints
has this size."""
NEAR = 0.0005
"""Largest distance [m] between the two touching points for which a posture is accepted."""
TRIES = 30
"""Largest number of postures that are tried for each touch. Assumed: at least one of these postures is within
the limits."""


FACING, OBLIQUE = 0.003, 0.8
"""In an ideal touch, the normals of the two taxels are opposite. The deviation is the length of the sum of
the two unit normals. FACING: the search for a posture multiplies the deviation by this weight [m], to
compare it with the distance of the taxels. OBLIQUE: largest deviation for which a posture is accepted.
Assumed: up to 47 degrees (a deviation of 0.8), the skins still touch with their surfaces."""


class _Places(NamedTuple):
    """Two taxels that are to touch each other: taxel number `a` of the surface `own`, and number `b` of
    `other`."""

    own: Surface
    a: int
    other: Surface
    b: int


@dataclass(frozen=True, slots=True, eq=False)
class FoundMount:
    """Correction of a patch's pose on its link, estimated from touches in simulation, where the true pose is
    known."""

    mount: Mount
    before: float
    """Median distance [m] of the taxels from their true positions, with the wrong mount in the
    description."""
    after: float
    """Median distance [m] of the taxels from their true positions, with the corrected mount."""


def mount_in_simulation(
    robot: Robot,
    patch: str,
    *,
    touches: int = 100,
    wrong: float = 0.010,
    turned: float = np.deg2rad(5.0),
    seed: int = 0,
    progress: Callable[[int], None] = lambda count: None,
) -> FoundMount:
    """Moves a patch of the description by `wrong` [m], turns the patch by `turned` [rad], and estimates the
    patch's mount from simulated touches.

    Raises TciError if the skin of the other arm can't reach the patch.
    """
    random = np.random.default_rng(seed)
    truth = GenericBody(robot)
    places = truth.skin.surfaces[patch].positions
    turn = Rotation.from_rotvec(turned * _direction(random)).as_matrix()
    centre = places.mean(axis=0)
    error = transform(turn, centre - turn @ centre + wrong * _direction(random))
    body = GenericBody(moved_patch(robot, patch, error))
    perceiver = Perceiver(body)
    readings = self_touch_readings(robot, patch, touches=touches, seed=seed, progress=progress)
    perceptions = (perceiver.step(reading, reading.joints.stamp) for reading in readings)
    found = find_mount(self_touches(body, patch, perceptions))
    believed = body.skin.surfaces[patch].positions
    before, after = (
        float(np.median(np.linalg.norm(one - places, axis=1)))
        for one in (believed, apply(found.correction, believed))
    )
    return FoundMount(found, before, after)


def _direction(random: np.random.Generator) -> Array:
    vector: Array = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def self_touch_readings(
    robot: Robot,
    patch: str,
    *,
    touches: int,
    seed: int = 0,
    progress: Callable[[int], None] = lambda count: None,
) -> Iterator[Reading]:
    """Yields the readings of a robot that touches its own skin `touches` times.

    Between two touches there are frames without touch.
    """
    body, random, number = GenericBody(robot), np.random.default_rng(seed), 0
    for touch in range(touches):
        position, other = _posture(body, patch, random)
        pressed = _pressed(body, position, patch, other)
        for frame in range(REST + PRESSED):
            now, still = number * PERIOD, np.zeros(len(position))
            read = read_only(position + random.normal(0.0, ENCODER, len(position)))
            frames = _frames(body, pressed if frame >= REST else {}, now, number)
            yield Reading(JointReading(now, number, read, read_only(still)), frames)
            number += 1
        progress(touch + 1)


def _posture(body: GenericBody, patch: str, random: np.random.Generator) -> tuple[Array, str]:
    """Returns servo angles (n_servos,) [rad] at which a random taxel of `patch` touches a taxel on another
    arm, and the name of the other patch. Raises TciError if none are found."""
    robot, surfaces, chain = body.robot, body.skin.surfaces, body.skin.kinematics
    own = surfaces[patch]
    arms = {part.name for part in robot.parts if part.kind == robot.part(robot.patch(patch).part).kind}
    others = [surfaces[one.name] for one in robot.patches if one.part in arms - {robot.patch(patch).part}]
    if not others:
        raise TciError(
            f"{patch}: {robot.name} has no skin on another limb of that kind; valid: a patch of an arm"
        )
    home = initial_position(robot)
    limits = np.array([(servo.limits.lower, servo.limits.upper) for servo in robot.servos], dtype=float)
    # The range is -pi to pi for limits that are not known.
    limits = np.where(np.isnan(limits), [-np.pi, np.pi], limits)
    for _ in range(TRIES):
        other = others[random.integers(len(others))]
        moving = sorted({*chain.chain(own.link)} ^ {*chain.chain(other.link)})
        low, high = limits[moving].T
        a, b = (int(random.integers(len(one.positions))) for one in (own, other))
        places = _Places(own, a, other, b)
        found = least_squares(
            _apart,
            random.uniform(low, high),
            bounds=(low, high),
            max_nfev=60,
            args=(chain, home, moving, places),
        )
        if np.linalg.norm(found.fun[:3]) <= NEAR and np.linalg.norm(found.fun[3:]) <= FACING * OBLIQUE:
            position = home.copy()
            position[moving] = found.x
            return position, other.patch
    raise TciError(
        f"{patch}: no skin of the other arm reaches it in {TRIES} postures; valid: a patch in reach"
    )


def _apart(angles: Array, chain: KinematicChain, home: Array, moving: list[int], places: _Places) -> Array:
    """Returns six numbers (6,) that are all 0 in an ideal touch of two taxels: the vector [m] between the two
    points, and the weighted sum of the two unit normals. `angles` [rad] are those of the servos `moving`; all
    others are at `home`."""
    position = home.copy()
    position[moving] = angles
    own, a, other, b = places
    here, there = chain.pose_array(position, (own.link, other.link))
    gap = apply(here, own.positions[a] - DEPTH * own.normals[a]) - apply(there, other.positions[b])
    facing = here[:3, :3] @ own.normals[a] + there[:3, :3] @ other.normals[b]
    return np.concatenate([gap, FACING * facing])


def _pressed(body: GenericBody, position: Array, patch: str, other: str) -> dict[str, Array]:
    """Returns a mask (n,) for each of the two patches: True for taxels below the surface of the other patch,
    and for at least one taxel."""
    surfaces = body.skin.surfaces
    one, two = surfaces[patch], surfaces[other]
    here, there = body.skin.kinematics.pose_array(position, (one.link, two.link))
    pressed = {}
    for mine, theirs, pose in ((one, two, invert(there) @ here), (two, one, invert(here) @ there)):
        points = apply(pose, mine.positions)
        nearest, normals = theirs.project(points)
        away = points - nearest
        height = np.einsum("ni,ni->n", away, normals)
        beside = np.linalg.norm(away - height[:, None] * normals, axis=1)
        facing = np.einsum("ni,ni->n", mine.normals @ pose[:3, :3].T, normals) < 0.0
        inside = (np.abs(height) < 2.0 * DEPTH) & (height < 0.0) & (beside < 0.008) & facing
        # A patch with few taxels may have no taxel inside. Its taxel nearest to the other skin then counts as
        # pressed.
        if not inside.any():
            inside[np.argmin(np.linalg.norm(away, axis=1))] = True
        pressed[mine.patch] = inside
    return pressed


def _frames(body: GenericBody, pressed: dict[str, Array], now: float, number: int) -> tuple[SkinFrame, ...]:
    frames = []
    for patch in body.robot.skin:
        sensor = patch.sensor
        values = np.full(patch.channels * sensor.axes, sensor.rest)
        if patch.name in pressed:
            end = sensor.highest if sensor.pascal_per_count > 0.0 else sensor.lowest
            channels = normal_channels(patch, body.skin.surfaces[patch.name])[pressed[patch.name]]
            values[channels] = np.rint(
                sensor.rest + max(SHARE, 1.0 / abs(end - sensor.rest)) * (end - sensor.rest)
            )
        frames.append(SkinFrame(patch.name, now, number, read_only(values)))
    return tuple(frames)
