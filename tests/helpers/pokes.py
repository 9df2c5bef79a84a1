"""Random pokes on all of a robot's skin, and the resulting frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.errors import TciError
from tci.messages import SkinFrame
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot
from tci.simulation.world import World
from tci.skin.surfaces import Surface

GAP, SPEED, SETTLE = 0.002, 0.1, 0.12


@dataclass(frozen=True)
class Poked:
    """Result of one static poke."""

    patch: str
    edge: bool
    """True if the distance between the contact and the border of the surface is less than the taxel pitch."""
    force: float
    """Contact force [N] in the simulation."""
    felt: float
    """Sum of the taxels' forces [N], computed from the frame."""
    error: float
    """Distance [m] along the skin between the centre of force of the taxels and the contact point of the
    simulation."""
    saturated: bool
    """True if a taxel sent the largest pressure of its sensor."""


def straight_arms(robot: Robot) -> dict[str, Array]:
    """Returns the initial posture with elbow angles of 20 degrees, in which a finger can reach all of the
    skin."""
    arms = [part for part in robot.parts if part.kind == "arm"]
    return {part.name: np.array([*part.initial_posture[:3], np.deg2rad(20.0), 0.0]) for part in arms}


def pressures(patch: Patch, surface: Surface, frame: SkinFrame) -> Array:
    """Returns the pressure (taxels,) [Pa], computed with the formula in the description."""
    raw = frame.values[surface.channels].astype(float)
    return np.maximum(0.0, (raw - patch.sensor.rest) * patch.sensor.pascal_per_count)


def frame_of(world: World, patch: str) -> SkinFrame:
    """Returns the latest frame of a patch."""
    return next(frame for frame in world.frames() if frame.patch == patch)


def random_place(surface: Surface, pitch: float, generator: np.random.Generator) -> Array:
    """Returns a point (3,) [m] of the surface: the position of a taxel, displaced by up to half a pitch along
    the skin.

    All taxels are equally likely, including those of the border. A point beyond the border is moved back onto
    it.
    """
    taxel = generator.integers(len(surface.positions))
    along = np.cross(surface.normals[taxel], generator.normal(size=3))
    along /= np.linalg.norm(along)
    moved = surface.positions[taxel] + 0.5 * pitch * np.sqrt(generator.uniform()) * along
    return surface.project(moved[None])[0][0]


def pitch_of(surface: Surface) -> float:
    """Returns the median distance [m] between a taxel and its nearest neighbour."""
    apart = np.linalg.norm(surface.positions[:, None] - surface.positions[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    return float(np.median(apart.min(axis=1)))


def border(surface: Surface) -> Array:
    """Returns the positions (k, 3) [m] of the taxels on the border of the surface: an edge there belongs to
    only one face."""
    edges = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return surface.positions[np.unique(unique[count == 1])]


def poke_anywhere(world: World, count: int, *, seed: int) -> tuple[list[Poked], int]:
    """Makes `count` static pokes of 5 to 9 N, one patch after the other. Also counts the pokes for which the
    finger has no room."""
    generator = np.random.default_rng(seed)
    patches = [patch for patch in world.robot.patches if world.robot.limb_segment(patch)]
    pitches = {name: pitch_of(surface) for name, surface in world.surfaces.items()}
    borders = {name: border(surface) for name, surface in world.surfaces.items()}
    done: list[Poked] = []
    refused = 0
    while len(done) < count:
        patch = patches[len(done) % len(patches)]
        surface = world.surfaces[patch.name]
        place = random_place(surface, pitches[patch.name], generator)
        depth = generator.uniform(5.0, 9.0) / 800.0
        world.reset()
        try:
            world.finger.poke(patch.name, place, speed=SPEED, depth=depth, gap=GAP)
        except TciError:
            refused += 1
            continue
        world.advance((GAP + depth) / SPEED + SETTLE)
        world.advance(np.ceil(world.time * patch.rate - 1e-6) / patch.rate)
        truth, frame = world.contact_truth(patch.name), frame_of(world, patch.name)
        assert frame.stamp == world.time
        pressure = pressures(patch, surface, frame)
        felt = pressure * surface.areas
        centre, _ = world.skin_point(patch.name, felt @ surface.positions / felt.sum())
        offset = centre - truth.center
        offset -= (offset @ truth.normal) * truth.normal
        apart = np.linalg.norm(borders[patch.name] - place, axis=1)
        most = (patch.sensor.lowest, patch.sensor.highest)[patch.sensor.pascal_per_count > 0.0]
        done.append(
            Poked(
                patch=patch.name,
                edge=bool(len(apart) and apart.min() < pitches[patch.name]),
                force=truth.force,
                felt=float(felt.sum()),
                error=float(np.linalg.norm(offset)),
                saturated=bool((frame.values[surface.channels] == most).any()),
            )
        )
    return done, refused
