"""Ways of drawing who stands in the way of an arm: on its way or below it, between it and the robot's own
trunk, and inside its elbow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from helpers.rigid_robot import Person, RigidDriver, RigidRobot
from helpers.squeezed import By, Squeeze, angles_of, links_of, moved_by, plant_of, vertices_of
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.generic_arm import JOINTS
from tci.runtime.loop import run

Path = list[dict[str, tuple[Array, Array]]]
"""Poses of links (3,) [m], (3, 3) every period."""
Random = np.random.Generator
DOWN = -0.7
"""Vertical part of the direction in which a link goes that presses somebody below it."""
RADIUS = Person.radius
"""Of somebody [m]."""
TRIES, PLACES = 400, 2000
"""Ways are drawn of which one may end with somebody between two links, and places for each way."""
DEEP = 5e-3
"""Depth [m] by which links may be nearer at the start than in the posture in which a robot begins."""
WIDE, NEAR = 0.4, 0.15
"""Reach of postures: an arm that is tapped starts clear of the robot, from which no reflex frees it."""
ELBOW = JOINTS.index("elbow_pitch")


def draw(
    robot: Robot,
    seed: int,
    *,
    mode: Mode = Mode.POSITION,
    part: str = "",
    by: By = "order",
    below: bool = False,
) -> Squeeze:
    """Draws a trial in which the person is clear of the robot at first, and met on the way; `below` the arm,
    which comes down, if so asked."""
    random = np.random.default_rng(seed)
    while (one := _try(robot, seed, random, mode, part, by, below)) is None:
        pass
    return one


def draw_between(robot: Robot, seed: int, *, mode: Mode = Mode.POSITION, by: By = "order") -> Squeeze | None:
    """Draws a trial in which the arm presses somebody against the robot itself: its trunk, its head or a leg.
    None if `TRIES` ways leave too much room there, as a G1's arms often do."""
    random = np.random.default_rng(seed)
    free = _free(robot, seed, random, mode, "", by)
    plant = plant_of(robot, free)
    arm, moved, everything = (links_of(robot, plant, free.part, least) for least in (2, 1, 0))
    trunk = [name for name in everything if name not in moved]

    def drawn() -> tuple[Array, Array]:
        return _posture(robot, free.part, random), _posture(robot, free.part, random)

    return _between(robot, plant, free, arm, trunk, drawn, random)


def draw_in_elbow(robot: Robot, seed: int, *, mode: Mode = Mode.POSITION, by: By = "order") -> Squeeze | None:
    """Draws a trial in which the elbow closes on somebody, and no other joint moves. None if there is too
    much room in `TRIES` closed elbows."""
    random = np.random.default_rng(seed)
    free = _free(robot, seed, random, mode, "", by)
    plant = plant_of(robot, free)
    forearm, arm = (links_of(robot, plant, free.part, least) for least in (ELBOW + 1, 1))
    low, high = _bend(robot, free.part)

    def drawn() -> tuple[Array, Array]:
        start = _posture(robot, free.part, random)
        goal = start.copy()
        start[ELBOW] = random.uniform(low, low + 0.2 * (high - low))
        goal[ELBOW] = random.uniform(high - 0.05 * (high - low), high)
        return start, goal

    return _between(robot, plant, free, forearm, [one for one in arm if one not in forearm], drawn, random)


def _bend(robot: Robot, part: str) -> tuple[float, float]:
    """Limits [rad] of an elbow's generic angle."""
    joint = robot.part(part).servos[ELBOW]
    assert joint.servo is not None, part
    limits = robot.servos[joint.servo].limits
    low, high = sorted(joint.offset + joint.scale * (limit or 0.0) for limit in (limits.lower, limits.upper))
    return low, high


def _between(
    robot: Robot, plant: RigidRobot, free: Squeeze, moving: list[str], still: list[str],
    drawn: Callable[[], tuple[Array, Array]], random: Random,
) -> Squeeze | None:  # fmt: skip
    """A trial in which links of the arm that move press somebody against links that don't. `drawn` gives
    where the arm starts, and where it goes to."""
    points = {name: _few(vertices_of(plant, name)) for name in (*moving, *still)}
    links = np.repeat(moving, [len(points[name]) for name in moving])
    own_places = np.concatenate([points[name] for name in moving])

    def there(posture: Array, names: list[str]) -> Array:
        plant.pose(angles_of(robot, free.part, posture))
        return np.concatenate([_world(plant.link_pose(name), points[name]) for name in names])

    for _ in range(TRIES):
        start, goal = drawn()
        before, after = cKDTree(there(start, moving)), cKDTree(there(goal, moving))
        wall = there(start, still)
        ways = random.normal(size=(PLACES, 3))
        ways *= (RADIUS + 2e-3) / np.linalg.norm(ways, axis=1, keepdims=True)
        places = wall[random.integers(len(wall), size=PLACES)] + ways
        clear = (cKDTree(wall).query(places)[0] > RADIUS) & (before.query(places)[0] > RADIUS + 0.02)
        struck, by = after.query(places)
        for k in np.flatnonzero(clear & (struck < RADIUS - 5e-3))[:1].tolist():
            one = replace(
                free, start=start, goal=goal, at=places[k], link=str(links[by[k]]), point=own_places[by[k]]
            )
            if not _inside(robot, one):
                return one
    return None


def _few(vertices: Array) -> Array:
    return vertices[:: max(1, len(vertices) // 150)]


def _world(pose: tuple[Array, Array], points: Array) -> Array:
    position, rotation = pose
    moved: Array = position + points @ rotation.T
    return moved


def _free(robot: Robot, seed: int, random: Random, mode: Mode, part: str, by: By) -> Squeeze:
    """A trial with nobody in it yet."""
    part = part or str(random.choice([one.name for one in robot.parts if one.kind == "arm"]))
    reach = NEAR if by == "reflex" else WIDE
    start, goal = (_posture(robot, part, random, reach) for _ in range(2))
    stiffness = 75e3 if random.random() < 1 / 3 else float(np.exp(random.uniform(np.log(8e3), np.log(75e3))))
    share = 1.0 if random.random() < 0.5 else float(random.uniform(0.2, 1.0))
    rate = float(random.choice([100.0, 500.0]))
    if by == "reflex":  # else the same place is tapped again where no arm withdraws
        seed = int(random.integers(2**31))
    return Squeeze(part, start, goal, mode, share, stiffness, "", np.zeros(3), np.zeros(3), rate, seed, by)


def _try(
    robot: Robot, seed: int, random: Random, mode: Mode, part: str, by: By, below: bool
) -> Squeeze | None:
    free = _free(robot, seed, random, mode, part, by)
    plant, path = _path(robot, free)
    links = links_of(robot, plant, free.part)
    link = str(random.choice(links))
    index = int(random.uniform(0.25, 0.75) * len(path))
    if below:
        spots = [(name, k) for name in links for k in range(len(path) // 4, 3 * len(path) // 4, 12)]
        falls = [spot for spot in spots if _ahead(plant, path, *spot, free.rate)[2] < DOWN]
        if not falls:
            return None
        link, index = falls[int(random.integers(len(falls)))]
    elif by == "reflex":
        middles = np.array([_world(pose[link], vertices_of(plant, link)).mean(axis=0) for pose in path])
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middles, axis=0), axis=1))])
        index = int(np.searchsorted(way, random.uniform(0.1, 0.9) * way[-1]))
    vertices = vertices_of(plant, link)
    here, rotation = path[index][link]
    ahead = _ahead(plant, path, link, index, free.rate)
    if not ahead.any():
        return None
    # the foremost vertices strike first
    world = here + vertices @ rotation.T
    front = world @ ahead
    k = int(random.choice(np.flatnonzero(front >= np.quantile(front, 0.9))))
    at = world[k] + 0.03 * ahead
    one = replace(free, link=link, point=vertices[k], at=at)
    for pose in path[: max(2, index // 4) : 2]:
        for name in links:
            p, r = pose[name]
            if np.linalg.norm(p + vertices_of(plant, name) @ r.T - at, axis=1).min() < 0.031:
                return None
    return None if _inside(robot, one) else one


def _ahead(plant: RigidRobot, path: Path, link: str, index: int, rate: float) -> Array:
    """Direction (3,) in which a link goes; zeros if it hardly does."""
    vertices = vertices_of(plant, link)
    after = path[min(index + max(1, round(0.008 * rate)), len(path) - 1)][link]
    ahead: Array = (_world(after, vertices) - _world(path[index][link], vertices)).mean(axis=0)
    far = float(np.linalg.norm(ahead))
    return np.zeros(3) if far < 2e-3 else ahead / far


def _inside(robot: Robot, one: Squeeze) -> bool:
    """True if the person would stand inside the robot at the start, since convex hulls stick out of meshes,
    or the arm inside the rest of it: no gate lets an arm go through its own body."""
    plant = plant_of(robot, one)
    plant.place("person", one.at)
    plant.advance(0.01)
    if plant.felt["person"].first is not None:
        return True
    arm = links_of(robot, plant, one.part, 1)
    usual, start = (
        _gaps(plant, arm, angles_of(robot, one.part, posture))
        for posture in (robot.part(one.part).initial_posture, one.start)
    )
    return bool((start < np.minimum(usual, 0.0) - DEEP).any())


def _gaps(plant: RigidRobot, arm: list[str], angles: Array) -> Array:
    """Distances (n,) [m] of the arm's solids from those of other links, at most `DEEP`; below 0 inside."""
    model, data = plant.model, plant.data
    plant.pose(angles)
    solids: dict[bool, list[int]] = {True: [], False: []}
    for body in plant._own:
        geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
        solids[model.body(body).name in arm] += geoms
    pairs = product(solids[True], solids[False])
    return np.array([mujoco.mj_geomDistance(model, data, *pair, DEEP, None) for pair in pairs])


def _posture(robot: Robot, part: str, random: Random, reach: float = WIDE) -> Array:
    """Angles (n,) [rad] that are at most a share of each joint's range away from the first ones."""
    found = robot.part(part)
    low, high = [], []
    for joint, middle in zip(found.servos, found.initial_posture, strict=True):
        limits = None if joint.servo is None else robot.servos[joint.servo].limits
        if limits is None or limits.lower is None or limits.upper is None:
            low.append(middle), high.append(middle)
        else:
            way = reach * (limits.upper - limits.lower)
            low.append(middle - way), high.append(middle + way)
    return random.uniform(low, high)


def _path(robot: Robot, one: Squeeze) -> tuple[RigidRobot, Path]:
    """The plant, and the links' poses every period, with nobody in the way."""
    plant = plant_of(robot, one)
    path: Path = []
    names = [plant.model.body(k).name for k in plant._own]

    def see(_: object) -> None:
        path.append({name: plant.link_pose(name) for name in names})

    run(RigidDriver(plant), moved_by(one), duration=1.2, observe=see)
    return plant, path
