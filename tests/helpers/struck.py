"""Trials in which an arm that withdraws from a finger strikes somebody who stands in its way.

Nothing of `tci.gate` is imported (a test holds that): plant, persons and limits are the judge's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from helpers.rigid_robot import Dirt, Person, RigidDriver, RigidRobot
from helpers.squeezed import links_of, vertices_of
from tci.body.places import Place, find_place
from tci.capabilities.capability import Capability
from tci.errors import TciError
from tci.messages import JointReading
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.runtime.loop import run
from tci.skin.skin import Skin

LASTS = 2.2
"""Length of a trial [s]: the poke, the longest withdrawal, and a second after it."""
GAP = 0.006
"""Distance [m] between finger and skin at the start."""
FINGER = Person("finger", 800.0, radius=0.005, damping=0.7)


@dataclass(frozen=True)
class Region:
    """A region of a person's body, as two public sources print Annex A of ISO/TS 15066:2016."""

    name: str
    stiffness: float
    """[N/m]."""
    mass: float
    """[kg]."""
    limit: float
    """Quasi-static force [N]; twice as much is permitted for a moment."""
    radius: float
    """[m]; ours."""


REGIONS = (
    Region("chest", 25e3, 40.0, 140.0, 0.06),
    Region("abdomen", 10e3, 40.0, 110.0, 0.06),
    Region("back", 35e3, 40.0, 210.0, 0.06),
    Region("upper arm", 30e3, 3.0, 150.0, 0.04),
    Region("lower arm", 40e3, 2.0, 160.0, 0.03),
    Region("hand", 75e3, 0.6, 140.0, 0.02),
)


@dataclass(frozen=True)
class Strike:
    """What one trial draws."""

    part: str
    angles: Array
    """(n_servos,) [rad]."""
    place: Place
    """Where the finger pokes."""
    depth: float
    """[m] by which the finger goes on after the first touch: 0.8 N for each mm."""
    region: Region
    link: str
    at: Array
    """(3,) [m] in the world: the middle of the bystander, a sphere."""
    point: Array
    """(3,) [m] in the link's frame: where the link would strike first."""
    ahead: Array
    """(3,) Unit vector in the world: where that point goes."""
    rate: float
    """Of readings and commands [Hz]."""
    seed: int


@dataclass(frozen=True)
class Hit:
    """The first contact with the bystander."""

    link: str
    point: Array
    """(3,) [m] in the link's frame."""
    normal: Array
    """(3,) Unit vector in the torso frame, from the link into the bystander."""
    position: Array
    """(n_servos,) [rad]."""
    velocity: Array
    """(n_servos,) [rad/s]."""


class Watched(RigidRobot):
    """Looks at the first contact with the bystander."""

    hit: Hit | None = None

    def _sense(self) -> None:
        super()._sense()
        if self.hit is None and self.data.ncon:
            self._look()

    def _look(self) -> None:
        model, data = self.model, self.data
        geom = model.geom("bystander").id
        for contact in data.contact[: data.ncon]:
            if geom in contact.geom:
                first = contact.geom[0] == geom
                body = int(model.geom_bodyid[contact.geom[1 if first else 0]])
                name = model.body(body).name
                position, rotation = self.link_pose(name)
                normal = contact.frame[:3] * (-1.0 if first else 1.0)
                T_TL = self.chain.poses(self.position, [name])[name]
                self.hit = Hit(
                    name, rotation.T @ (contact.pos - position), T_TL[:3, :3] @ rotation.T @ normal,
                    self.position, self.velocity,
                )  # fmt: skip
                return

    @cached_property
    def chain(self) -> KinematicChain:
        return KinematicChain(self.robot)


@dataclass(frozen=True)
class Outcome:
    begun: float | None
    """When the reflex began [s]."""
    first: float | None
    """When the bystander was struck [s]."""
    peak: float
    late: float
    """Force [N] on the bystander in the last 20 ms."""
    finger: float
    """Largest force [N] on the finger."""
    state: str
    said: tuple[str, ...]
    told: float | None
    """Largest force [N] that the reflex told before the bystander was struck."""
    hit: Hit | None


def draw(robot: Robot, seed: int, reflex: Capability[Any], *, full: bool) -> Strike | None:
    """Draws a trial; None if the arm does not withdraw, or there is no room for the bystander.

    Args:
        robot: what is simulated.
        seed: of all that is drawn.
        reflex: what withdraws; it is tried without a bystander first.
        full: poke so hard that the reflex has its full gain.
    """
    random = np.random.default_rng(seed)
    part = str(random.choice([one.name for one in robot.parts if one.kind == "arm"]))
    angles = _near_initial(robot, part, random)
    skin = Skin(robot)
    joints = JointReading(0.0, 0, read_only(angles), read_only(np.zeros(len(angles))))
    segment = str(random.choice(["upper_arm", "forearm"]))
    try:
        place = find_place(skin, part, segment, random.uniform(0.1, 0.9), random.uniform(-3.1, 3.1), joints)
    except TciError:
        return None
    depth = 0.02 if full else float(random.uniform(0.002, 0.01))
    region = REGIONS[int(random.integers(len(REGIONS)))]
    rate = float(random.choice([100.0, 500.0]))
    zero = np.zeros(3)
    free = Strike(part, angles, place, depth, region, "", zero, zero, zero, rate, seed)
    plant, path, begun = _path(robot, free, reflex)
    if begun is None:
        return None
    links = links_of(robot, plant, part)
    before = int(begun * rate) + 1
    where = {name: np.array([_world(pose[name], vertices_of(plant, name)).mean(axis=0) for pose in path])
             for name in links}  # fmt: skip
    link = str(random.choice(links))
    # anywhere on the link's way, by distance
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(where[link][before:], axis=0), axis=1))])
    if way[-1] < 0.02:
        return None
    index = before + int(np.searchsorted(way, random.uniform(0.0, 0.95) * way[-1]))
    vertices = vertices_of(plant, link)
    here = _world(path[index][link], vertices)
    moved = _world(path[min(index + max(1, round(0.01 * rate)), len(path) - 1)][link], vertices) - here
    ahead = moved.mean(axis=0)
    if np.linalg.norm(ahead) < 1e-3:
        return None
    ahead /= np.linalg.norm(ahead)
    front = here @ ahead
    k = int(random.choice(np.flatnonzero(front >= np.quantile(front, 0.9))))
    at = here[k] + region.radius * ahead
    one = replace(free, link=link, at=at, point=vertices[k], ahead=ahead)
    for name, pose in path[0].items():
        if np.linalg.norm(_world(pose, vertices_of(plant, name)) - at, axis=1).min() < region.radius + 2e-3:
            return None
    return one


def strike(
    robot: Robot, one: Strike, reflex: Capability[Any], *, settings: Any = None, dirt: Dirt | None = None,
    told: Callable[[Any], float | None] = lambda memory: None,
) -> Outcome:  # fmt: skip
    """Runs a trial. `told` reads the bound from the reflex's memory."""
    plant = _plant(robot, one, dirt)
    plant.place("bystander", one.at)
    bounds: list[float] = []

    def listen(memory: Any) -> bool:
        if (bound := told(memory)) is not None and plant.felt["bystander"].first is None:
            bounds.append(bound)
        return False

    result, begun = _poke(plant, one, reflex, settings, listen)
    force = plant.felt["bystander"]
    said = [str(notice) for notice in (*result.refusals, *result.clamps, *result.holds, *result.went_back)]
    said += [str(result.reason)] if result.reason else []
    return Outcome(
        begun, force.first, force.peak, force.at(plant.time - 0.01), plant.felt["finger"].peak,
        result.state.name, tuple(said), max(bounds, default=None), plant.hit,
    )  # fmt: skip


def _poke(
    plant: Watched, one: Strike, reflex: Capability[Any], settings: Any,
    listen: Callable[[Any], bool] | None = None, see: Callable[[], None] = lambda: None,
) -> tuple[Any, float | None]:  # fmt: skip
    link = plant.robot.patch(one.place.patch).link
    position, rotation = plant.link_pose(link)
    point, normal = position + rotation @ one.place.p_L, rotation @ one.place.n_L
    start = plant.time
    state: dict[str, float] = {}

    def go(tick: Any) -> None:
        see()
        felt = plant.felt["finger"]
        way = 0.25 * (plant.time - start)
        if felt.first is not None:
            state.setdefault("touch", way)
            way = min(way, state["touch"] + one.depth)
        plant.shift("finger", point + (FINGER.radius + GAP - way) * normal)
        if tick.sent.orders:
            state.setdefault("begun", tick.now)

    plant.place("finger", point + (FINGER.radius + GAP) * normal)
    result = run(RigidDriver(plant, settings=settings), reflex, duration=LASTS, observe=go, until=listen)
    return result, state.get("begun")


def _near_initial(robot: Robot, part: str, random: np.random.Generator) -> Array:
    angles = np.array(initial_position(robot))
    for joint in robot.part(part).servos:
        if joint.servo is not None:
            limits = robot.servos[joint.servo].limits
            low, high = limits.lower, limits.upper
            angle = angles[joint.servo] + random.uniform(-0.5, 0.5)
            if low is not None and high is not None:
                angle = np.clip(angle, low + 0.05 * (high - low), high - 0.05 * (high - low))
            angles[joint.servo] = angle
    return angles


def _plant(robot: Robot, one: Strike, dirt: Dirt | None) -> Watched:
    bystander = Person("bystander", one.region.stiffness, one.region.mass, radius=one.region.radius)
    people = [FINGER, bystander]
    return Watched(robot, people=people, dirt=dirt, seed=one.seed, angles=one.angles, rate=one.rate)


def _path(
    robot: Robot, one: Strike, reflex: Capability[Any]
) -> tuple[Watched, list[dict[str, tuple[Array, Array]]], float | None]:
    """The plant, the links' poses every period with nobody in the way, and when the reflex began."""
    plant = _plant(robot, one, None)
    path: list[dict[str, tuple[Array, Array]]] = []
    names = [plant.model.body(k).name for k in plant._own if plant.model.body_geomnum[k]]
    _, begun = _poke(
        plant, one, reflex, None, see=lambda: path.append({name: plant.link_pose(name) for name in names})
    )
    return plant, path, begun


def _world(pose: tuple[Array, Array], points: Array) -> Array:
    position, rotation = pose
    moved: Array = position + points @ rotation.T
    return moved
