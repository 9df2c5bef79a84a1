"""Simulates a self-calibration: a probe touches a patch whose map of taxels contains errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tci.errors import TciError
from tci.lab.authoring.locate_taxels import LocatedTaxels, ProbeTouch, locate_taxels
from tci.messages.frames import Array, apply, invert
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.simulation.finger import STIFFNESS
from tci.simulation.world import World
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface

SPEED, FORCE = 0.25, (3.0, 6.0)
"""Speed [m/s] of the probe, and range of the probe's force [N]. Assumed: a person presses the probe carefully
by hand."""
DWELL = 0.045
"""Time [s] from the start of a touch to the skin frame that is used. The time contains at least two frames at
50 Hz."""
CANDIDATES = 20
"""Number of random points from which the next touched point is chosen. Assumed: enough for an even
distribution of touches."""
PROBE = 0.0003
"""Standard deviation [m] of the probe's measured position. Assumed: the accuracy of an optical tracker."""


@dataclass(frozen=True, slots=True, eq=False)
class SelfCalibration:
    """Errors (n,) [m] of the taxels' positions, before and after the calibration."""

    patch: str
    touches: int
    before: Array
    after: Array
    located: LocatedTaxels


def calibrate_in_simulation(
    robot: Robot,
    patch: str,
    *,
    touches: int = 200,
    wrong: float = 0.010,
    noise: float = 0.5,
    seed: int = 0,
    progress: Callable[[int], None] = lambda count: None,
) -> SelfCalibration:
    """Adds an error to the known position of every taxel, touches the simulated skin, and locates the taxels
    from the touches.

    Args:
        robot: Description of the robot.
        patch: Patch to calibrate.
        touches: Number of touches. They are distributed evenly over the patch.
        wrong: Displacement [m] of each taxel, in a random direction.
        noise: Standard deviation [counts] of the raw skin values.
        seed: Seed of the random directions, points, forces and noise.
        progress: Function that is called after each touch with the number of completed touches.

    Raises UnknownNameError if the robot does not have the patch. Raises TciError if the finger can't reach
    the skin, or if the taxels are too few or too far apart to form a surface.
    """
    words = robot.patch(patch)
    world = World(robot, seed=seed, noise=noise)
    surface = world.surfaces[patch]
    if not len(surface.faces):
        raise TciError(
            f"{patch}: its {len(surface.positions)} taxels form no surface; valid: a patch with more taxels "
            "that are close together"
        )
    generator = np.random.default_rng(seed)
    shift = generator.normal(size=surface.positions.shape)
    shift *= wrong / np.linalg.norm(shift, axis=1, keepdims=True)
    initial = surface.positions + shift
    link = KinematicChain(robot)
    tried: list[Array] = []
    found: list[ProbeTouch] = []
    tries = 0
    while len(found) < touches:
        tries += 1
        if tries > 5 * touches:
            raise TciError(
                f"{patch}: only {len(found)} of {tries} touches reached it, for other links are in the way; "
                "valid: a patch that a finger can reach"
            )
        place = _far_from(surface, tried, generator)
        tried.append(place)
        if (touch := _touch(world, patch, place, generator, link)) is not None:
            found.append(touch)
            progress(len(found))
    located = locate_taxels(found, initial)
    before = np.linalg.norm(initial - surface.positions, axis=1)
    after = np.linalg.norm(located.positions - surface.positions, axis=1)
    return SelfCalibration(words.name, len(found), before, after, located)


def _far_from(surface: Surface, tried: list[Array], generator: np.random.Generator) -> Array:
    """Returns a random point (3,) [m] on a surface, far from all points in `tried`.

    Draws several random points, and returns the one that is farthest from `tried` (Mitchell 1991).
    """
    a, b, c = surface.positions[surface.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = generator.choice(len(area), CANDIDATES, p=area / area.sum())
    weights = generator.dirichlet(np.ones(3), CANDIDATES)[:, :, None]
    points: Array = weights[:, 0] * a[chosen] + weights[:, 1] * b[chosen] + weights[:, 2] * c[chosen]
    best = int(cKDTree(np.array(tried)).query(points)[0].argmax()) if tried else 0
    result: Array = points[best]
    return result


def _touch(
    world: World, patch: str, place: Array, generator: np.random.Generator, kinematics: KinematicChain
) -> ProbeTouch | None:
    """Touches the simulated skin at the point nearest to `place` (3,) [m], and returns the measured touch,
    both in the frame of the patch's link.

    Returns None if another link blocks the finger, or if no skin frame arrives in time.
    """
    surface, words = world.surfaces[patch], world.robot.patch(patch)
    points, normals = surface.project(place[None])
    world.finger.retire()
    world.advance(world.time + 0.02)
    depth = generator.uniform(*FORCE) / STIFFNESS
    try:
        world.finger.poke(patch, points[0], normals[0], speed=SPEED, depth=depth, gap=0.001)
    except TciError:
        return None
    rest = {frame.patch: frame.sequence for frame in world.frames()}
    world.advance(world.time + DWELL)
    truth = world.contact_truth(patch)
    frame = next(frame for frame in world.frames() if frame.patch == patch)
    if not truth.force > 0.0 or frame.sequence == rest[patch]:
        return None
    T_LT = invert(kinematics.poses(world.joints().position, [words.link])[words.link])
    counts = (frame.values.astype(float) - words.sensor.rest) * np.sign(words.sensor.pascal_per_count)
    pressure = words.sensor.pressure(np.maximum(counts[normal_channels(words, surface)] - 1.0, 0.0))
    point = apply(T_LT, truth.center) + generator.normal(0.0, PROBE, 3)
    return ProbeTouch(point, T_LT[:3, :3] @ truth.normal, pressure)
