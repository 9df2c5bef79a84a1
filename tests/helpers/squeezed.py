"""Trials in which a moving arm meets somebody who can't give way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import mujoco
import numpy as np

from helpers.rigid_robot import Dirt, Person, RigidDriver, RigidRobot
from helpers.taught import RADIUS as FINGER
from helpers.taught import GuidedRobot, Tap, place_on
from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.play_gesture import PlayGesture
from tci.capabilities.teach.capability import Teach
from tci.gestures.gesture import Fitted, Gesture
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.runtime.loop import run

By = Literal["order", "gesture", "lesson"]
"""Who moves the arm; a lesson is played after a tap on the other arm."""
Path = list[dict[str, tuple[Array, Array]]]
"""Poses of links (3,) [m], (3, 3) every period."""
DOWN = -0.7
"""Vertical part of the direction in which a link goes that presses somebody below it."""
STARTS = 1.0
"""Time [s] until a lesson is played: a tap, and the end of its series."""
LASTS = 3.4
"""Length of a trial [s]: the longest way to the person and 2 s of contact."""
RADIUS = Person.radius
"""Of somebody [m]."""
TRIES = 400
"""So many ways are drawn of which one may end with somebody between the arm and the robot's trunk."""


@dataclass(frozen=True)
class Squeeze:
    """What one trial draws."""

    part: str
    start: Array
    goal: Array
    """Generic angles (n,) [rad] of the part."""
    mode: Mode
    share: float
    """Of the gate's full speed."""
    stiffness: float
    """[N/m]."""
    link: str
    point: Array
    """(3,) [m] in the link's frame: where the robot strikes."""
    at: Array
    """(3,) [m] in the world: the middle of the person's surface, a sphere."""
    rate: float
    """Of readings and commands [Hz]."""
    seed: int
    by: By = "order"


@dataclass(frozen=True)
class Outcome:
    first: float | None
    """Time of the first contact [s]."""
    peak: float
    half: float
    """Force [N] 0.5 s after the first contact."""
    late: float
    """Force [N] 2 s after."""
    over: float
    """Time above 65 N [s]."""
    state: str
    said: tuple[str, ...]
    felt: bool
    """Skin felt it."""
    other: tuple[float, float, float]
    """Peak, and forces [N] 0.5 s and 2 s after its own first contact, on whoever stands behind."""
    force: tuple[Array, Array]
    """Times [s] and forces [N] on the first person."""


class Reach(Capability[bool]):
    """Moves one part to a posture, once, in any mode."""

    def __init__(self, trial: Squeeze) -> None:
        self.trial = trial

    def init(self, body: GenericBody) -> bool:
        return False

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return (SwitchMode(self.trial.part, self.trial.mode),)

    def step(self, memory: bool, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], bool]:
        one = self.trial
        if one.mode is Mode.VELOCITY:
            way = one.goal - perception.posture[one.part]
            speed = np.clip(4.0 * way, -one.share * 3.0, one.share * 3.0)
            return (GenericCommand(one.part, Mode.VELOCITY, speed),), True
        return (() if memory else (GenericCommand(one.part, one.mode, one.goal),)), True


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
    part = str(random.choice([one.name for one in robot.parts if one.kind == "arm"]))
    free = _free(robot, seed, random, mode, part, by)
    plant = _plant(robot, free, None)
    arm = links_of(robot, plant, part)
    trunk = [name for name in links_of(robot, plant, part, 0) if name not in links_of(robot, plant, part, 1)]
    points = {name: _few(vertices_of(plant, name)) for name in (*arm, *trunk)}

    def there(angles: Array, names: list[str]) -> Array:
        plant.pose(_angles(robot, part, angles))
        return np.concatenate([_world(plant.link_pose(name), points[name]) for name in names])

    for _ in range(TRIES):
        start, goal = (_posture(robot, part, random) for _ in range(2))
        begins, ends, own = there(start, arm), there(goal, arm), there(goal, trunk)
        apart = np.linalg.norm(ends[:, None] - own, axis=2)
        strikes, against = np.unravel_index(np.argmin(apart), apart.shape)
        to = begins[strikes] - own[against]
        at = own[against] + (RADIUS + 2e-3) * to / np.linalg.norm(to)
        one = replace(free, start=start, goal=goal, at=at, **_struck(plant, arm, points, int(strikes)))
        narrow = np.linalg.norm(ends - at, axis=1).min() < RADIUS - 5e-3
        clear = min(np.linalg.norm(begins - at, axis=1).min() - 0.02, np.linalg.norm(own - at, axis=1).min())
        if narrow and clear > RADIUS and not _touches(robot, one):
            return one
    return None


def _struck(plant: RigidRobot, arm: list[str], points: dict[str, Array], number: int) -> dict[str, Any]:
    """Link and place on it of one of the arm's `points`, by its number among all."""
    for link in arm:
        if number < len(points[link]):
            return {"link": link, "point": points[link][number]}
        number -= len(points[link])
    raise IndexError(number)


def _few(vertices: Array) -> Array:
    return vertices[:: max(1, len(vertices) // 150)]


def _world(pose: tuple[Array, Array], points: Array) -> Array:
    position, rotation = pose
    moved: Array = position + points @ rotation.T
    return moved


def _free(robot: Robot, seed: int, random: np.random.Generator, mode: Mode, part: str, by: By) -> Squeeze:
    """A trial with nobody in it yet."""
    start, goal = (_posture(robot, part, random) for _ in range(2))
    stiffness = 75e3 if random.random() < 1 / 3 else float(np.exp(random.uniform(np.log(8e3), np.log(75e3))))
    share = 1.0 if random.random() < 0.5 else float(random.uniform(0.2, 1.0))
    rate = float(random.choice([100.0, 500.0]))
    return Squeeze(part, start, goal, mode, share, stiffness, "", np.zeros(3), np.zeros(3), rate, seed, by)


def _capability(one: Squeeze) -> Capability[Any]:
    if one.by == "order":
        return Reach(one)
    way = float(np.abs(one.goal - one.start).max())
    gesture = Gesture(np.array([0.0, way / (3.0 * one.share)]), {one.part: np.array([one.start, one.goal])})
    if one.by == "lesson":
        return Teach(gesture=gesture)
    return PlayGesture(Fitted(gesture, gesture, 1.0, {}, ()))


def _try(
    robot: Robot, seed: int, random: np.random.Generator, mode: Mode, part: str, by: By, below: bool
) -> Squeeze | None:
    arms = [one.name for one in robot.parts if one.kind == "arm"]
    part = part or str(random.choice(arms))
    free = _free(robot, seed, random, mode, part, by)
    plant, path = _path(robot, free)
    links = links_of(robot, plant, part)
    link = str(random.choice(links))
    index = int(random.uniform(0.25, 0.75) * len(path))
    if below:
        spots = [(name, k) for name in links for k in range(len(path) // 4, 3 * len(path) // 4, 12)]
        falls = [spot for spot in spots if _ahead(plant, path, *spot, free.rate)[2] < DOWN]
        if not falls:
            return None
        link, index = falls[int(random.integers(len(falls)))]
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
    return None if _touches(robot, one) else one


def _ahead(plant: RigidRobot, path: Path, link: str, index: int, rate: float) -> Array:
    """Direction (3,) in which a link goes; zeros if it hardly does."""
    vertices = vertices_of(plant, link)
    here, rotation = path[index][link]
    after, turned = path[min(index + max(1, round(0.008 * rate)), len(path) - 1)][link]
    moved = (after + vertices @ turned.T) - (here + vertices @ rotation.T)
    ahead: Array = moved.mean(axis=0)
    far = float(np.linalg.norm(ahead))
    return np.zeros(3) if far < 2e-3 else ahead / far


def _touches(robot: Robot, one: Squeeze) -> bool:
    """True if the person would stand inside the robot at the start: convex hulls stick out of meshes."""
    plant = _plant(robot, one, None)
    plant.place("person", one.at)
    plant.advance(0.01)
    return plant.felt["person"].first is not None


def squeeze(
    robot: Robot,
    one: Squeeze,
    *,
    settings: Any = None,
    dirt: Dirt | None = None,
    behind: float | None = None,
) -> Outcome:
    """Runs a trial. A second person, as stiff, steps `behind` [m] behind the link when the first is met."""
    plant = _plant(robot, one, dirt)
    plant.place("person", one.at)
    driver = RigidDriver(plant, settings=settings)
    felt, there = [False], [False]

    def see(tick: Any) -> None:
        felt[0] |= bool(len(tick.perception.contacts))
        if behind is not None and not there[0] and plant.felt["person"].first is not None:
            there[0] = True
            plant.place("second", _behind(robot, plant, one, behind))

    lasts = LASTS + (STARTS if one.by == "lesson" else 0.0)
    result = run(driver, _capability(one), duration=lasts, observe=see)
    force = plant.felt["person"]
    first = force.first
    said = [str(notice) for notice in (*result.refusals, *result.clamps, *result.holds, *result.went_back)]
    said += [str(result.reason)] if result.reason else []
    return Outcome(
        first, force.peak, 0.0 if first is None else force.at(first + 0.5),
        0.0 if first is None else force.at(first + 2.0), force.above(65.0), result.state.name,
        tuple(said), felt[0], _on_second(plant), (np.array(force.time), np.array(force.force)),
    )  # fmt: skip


def _behind(robot: Robot, plant: RigidRobot, one: Squeeze, room: float) -> Array:
    """Place of the second person's middle: on the far side of the link that meets the first, with `room` [m]
    to every solid of the part, and clear of all others."""
    part = links_of(robot, plant, one.part)
    position, rotation = plant.link_pose(one.link)
    world = position + vertices_of(plant, one.link) @ rotation.T
    ahead = one.at - (position + rotation @ one.point)
    ahead /= np.linalg.norm(ahead)
    place: Array = one.at.copy()
    while ((world - place) @ ahead < 0.0).all() or any(
        gap < (room if link in part else 0.0) for link, gap in plant.gaps("second", place).items()
    ):
        place -= 1e-3 * ahead
    return place


def _on_second(plant: RigidRobot) -> tuple[float, float, float]:
    force = plant.felt["second"]
    first = force.first
    return (
        (force.peak, 0.0, 0.0)
        if first is None
        else (force.peak, force.at(first + 0.5), force.at(first + 2.0))
    )


def _posture(robot: Robot, part: str, random: np.random.Generator) -> Array:
    found = robot.part(part)
    low, high = [], []
    for joint, middle in zip(found.servos, found.initial_posture, strict=True):
        limits = None if joint.servo is None else robot.servos[joint.servo].limits
        if limits is None or limits.lower is None or limits.upper is None:
            low.append(middle), high.append(middle)
        else:
            reach = 0.4 * (limits.upper - limits.lower)
            low.append(middle - reach), high.append(middle + reach)
    return random.uniform(low, high)


def _angles(robot: Robot, part: str, posture: Array) -> Array:
    """Angles (n_servos,) [rad] with a part in a posture (n,) [rad], and all others as they begin."""
    from tci.body.posture import to_platform
    from tci.robot.joint_map import initial_position

    angles = np.array(initial_position(robot))
    own = to_platform(robot, GenericCommand(part, Mode.POSITION, posture), position=angles)
    low = np.array([-np.inf if (x := robot.servos[s].limits.lower) is None else x for s in own.servos])
    high = np.array([np.inf if (x := robot.servos[s].limits.upper) is None else x for s in own.servos])
    angles[own.servos] = np.clip(own.values, low + 1e-3, high - 1e-3)
    return angles


def _plant(robot: Robot, one: Squeeze, dirt: Dirt | None) -> RigidRobot:
    angles = _angles(robot, one.part, one.start)
    people = [Person(name, one.stiffness) for name in ("person", "second")]
    if one.by != "lesson":
        return RigidRobot(robot, people=people, dirt=dirt, seed=one.seed, angles=angles, rate=one.rate)
    plant = GuidedRobot(
        robot, people=[Person("finger", 1500.0, radius=FINGER), *people], dirt=dirt, seed=one.seed,
        angles=angles, rate=one.rate,
    )  # fmt: skip
    other = next(part.name for part in robot.parts if part.kind == "arm" and part.name != one.part)
    link, _, p_L, n_L = place_on(plant, other, np.random.default_rng(one.seed))
    plant.hands = (Tap(plant, "finger", link, p_L, n_L, (0.1,)),)
    return plant


def _path(robot: Robot, one: Squeeze) -> tuple[RigidRobot, Path]:
    """The plant, and the links' poses every period, with nobody in the way."""
    plant = _plant(robot, one, None)
    path: Path = []
    names = [plant.model.body(k).name for k in plant._own]

    def see(_: Any) -> None:
        path.append({name: plant.link_pose(name) for name in names})

    run(RigidDriver(plant), _capability(one), duration=1.2, observe=see)
    return plant, path


def links_of(robot: Robot, plant: RigidRobot, part: str, least: int = 2) -> list[str]:
    """Links with a solid that at least so many of the part's joints move."""
    joints = {robot.servos[one.servo].joint for one in robot.part(part).servos if one.servo is not None}
    model, found = plant.model, []
    for body in plant._own:
        if not model.body_geomnum[body]:
            continue
        moved, up = 0, body
        while up:
            for joint in range(model.body_jntadr[up], model.body_jntadr[up] + model.body_jntnum[up]):
                moved += model.joint(joint).name in joints
            up = model.body_parentid[up]
        if moved >= least:
            found.append(model.body(body).name)
    return found


def vertices_of(plant: RigidRobot, link: str) -> Array:
    """Points (n, 3) [m] on a link's solids, in its frame."""
    model, found = plant.model, []
    body = model.body(link).id
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            adr, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            points = model.mesh_vert[adr : adr + count]
        else:
            random = np.random.default_rng(0).normal(size=(64, 3))
            points = model.geom_aabb[geom, 3:] * random / np.abs(random).max(axis=1, keepdims=True)
        found.append(model.geom_pos[geom] + points @ rotation.reshape(3, 3).T)
    return np.concatenate(found)
