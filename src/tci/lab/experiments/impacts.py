"""How hard a robot's links may strike or squeeze people, over random postures, speeds, places and regions.

A blow is that of `tci.robot.coupled_blow`: the joints behind the place, each carried by its servo, against a
region of a person's body. Joints go as fast as their limits allow, so no motion in position or velocity mode
that passes the gate is faster. A person is free to move, or clamped: against a wall, they can't give way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array
from tci.robot.blow import REACTION, Struck
from tci.robot.collisions import solid_spec
from tci.robot.coupled_blow import Coupled, Motors
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration
from tci.robot.kinematics import KinematicChain
from tci.support.engine import mujoco

LASTING = 0.25
"""Time [s] after which a contact is noticed if nothing answers: by then every blow has its peak."""
WALL = 1e6
"""Mass [kg] of a person who can't give way."""
HEAD_ON = 0.7
"""Cosine of the angle between the way of the place and the direction in which it presses, from which on a
contact counts: one that grazes slides off, and is softer than its prediction."""
SLOW = 0.02
"""Speed [m/s] below which a contact is no blow."""


@dataclass(frozen=True, slots=True, eq=False)
class Impact:
    """One contact of a moving link with a region of a person's body."""

    part: str
    link: str
    person: Struck
    clamped: bool
    position: Array
    """(n_servos,) [rad] at the first touch."""
    velocity: Array
    """(n_servos,) [rad/s] at the first touch."""
    point: Array
    """(3,) [m] where the link touches, in its own frame."""
    direction: Array
    """(3,) Unit vector from the link into the person, in the frame of the model's root, which stands still.
    That point of the link is ahead of all others in this direction."""
    speed: float
    """[m/s] of that point along the direction."""
    striker: Coupled
    unanswered: float
    """Largest force [N] if nothing notices the contact."""
    answered: float
    """Largest force [N] if the contact is noticed after `REACTION`."""
    pressure: float
    """Mean pressure [Pa] at the answered force."""

    @property
    def limit(self) -> float:
        """Force [N] that the region may get for a moment."""
        return self.person.force

    @property
    def share(self) -> float:
        """The answered force as a fraction of the limit."""
        return self.answered / self.limit

    @property
    def held(self) -> float:
        """Force [N] that lasts if nothing lets go: a clamped person gets what the servos have."""
        return self.striker.stall if self.clamped else 0.0


class Impacts:
    """Draws impacts of one robot."""

    def __init__(self, robot: Robot) -> None:
        """Raises DescriptionError for a robot without a model, masses, or parts that move."""
        self._robot, self._chain, self._motors = robot, KinematicChain(robot), Motors(robot)
        self._dynamics = Dynamics(robot, JointCalibration(robot=robot.name))
        model = solid_spec(robot, mounted=False).compile()
        limits = [servo.limits for servo in robot.servos]
        self._lower = np.array([one.lower or 0.0 for one in limits])
        self._upper = np.maximum(self._lower, [one.upper or 0.0 for one in limits])
        self._speeds = np.array([one.velocity or 0.0 for one in limits])
        self._accelerations = np.array([one.acceleration or 20.0 for one in limits])
        self._solids = _Solids(model)
        self._links = {part.name: links for part in robot.parts if (links := self._links_of(part.name))}
        if not self._links:
            raise DescriptionError(robot.source, [Fault(0, "no part moves a link that has a shape")])

    def _links_of(self, part: str) -> list[str]:
        """Links with shapes whose last servo is one of the part's."""
        own = set(self._servos(part))
        chains = ((link, self._chain.chain(link)) for link in self._solids.links)
        return [link for link, chain in chains if chain and chain[-1] in own]

    def _servos(self, part: str) -> list[int]:
        joints = self._robot.part(part).servos
        return [one.servo for one in joints if one.servo is not None and self._speeds[one.servo] > 0.0]

    def draw(
        self, count: int, people: Sequence[Struck], *, seed: int = 0,
        progress: Callable[[int], None] = lambda done: None,
    ) -> Iterator[Impact]:  # fmt: skip
        """Draws `count` impacts on `people`, half of them clamped, equal ones for an equal seed."""
        for number in range(count):
            random = np.random.default_rng((seed, number))
            yield self._one(people[int(random.integers(len(people)))], random)
            progress(number + 1)

    def _fastest(self, position: Array) -> Array:
        """Largest speeds (n_servos,) [rad/s] to which joints can accelerate on their way from a limit, and
        from which they can still brake before the other one."""
        room = np.minimum(position - self._lower, self._upper - position)
        room[self._lower == self._upper] = np.inf  # it has no limits
        fastest: Array = np.minimum(self._speeds, np.sqrt(2.0 * self._accelerations * room))
        return fastest

    def _one(self, person: Struck, random: np.random.Generator) -> Impact:
        parts, clamped = list(self._links), bool(random.integers(2))
        while True:
            part = str(random.choice(parts))
            servos = self._servos(part)
            position = random.uniform(self._lower, self._upper)
            way = random.uniform(-1.0, 1.0, len(servos))
            velocity = np.zeros(len(position))
            velocity[servos] = way / np.abs(way).max() * self._fastest(position)[servos]
            link = str(random.choice(self._links[part]))
            inertia, _ = self._dynamics.at(position, np.zeros(len(position)))
            goes = self._dynamics.moved(link, self._solids.middle(link)) @ velocity
            # not far from the way of the link, else most draws graze
            direction = goes / max(float(np.linalg.norm(goes)), 1e-9) + 0.5 * random.normal(size=3)
            direction /= np.linalg.norm(direction)
            point = self._solids.ahead(link, self._dynamics.turned(link).T @ direction)
            moved = self._dynamics.moved(link, point)
            speed = float(direction @ moved @ velocity)
            if speed > max(SLOW, HEAD_ON * float(np.linalg.norm(moved @ velocity))):
                break
        striker = self._motors.behind(inertia, direction @ moved)
        assert striker is not None  # the servos move the place
        struck = person if not clamped else Struck(
            name=person.name, stiffness=person.stiffness, mass=WALL, force=person.force
        )  # fmt: skip
        answered = striker.force_on(struck, velocity, reaction=REACTION)
        area = self._solids.area(link, answered / person.stiffness)
        return Impact(
            part, link, person, clamped, position, velocity, point, direction, speed, striker,
            striker.force_on(struck, velocity, reaction=LASTING), answered, answered / area,
        )  # fmt: skip


class _Solids:
    """The shapes of each link."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._geoms: dict[str, list[int]] = {}
        for geom in range(model.ngeom):
            link = model.body(model.geom_bodyid[geom]).name
            if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE and link != "world":
                self._geoms.setdefault(link, []).append(geom)
        self.links = list(self._geoms)
        self._radii = {link: self._radius(link) for link in self.links}

    def middle(self, link: str) -> Array:
        """Middle (3,) [m] of a link's shapes, in its frame."""
        middle: Array = np.mean([self._model.geom_pos[geom] for geom in self._geoms[link]], axis=0)
        return middle

    def ahead(self, link: str, direction: Array) -> Array:
        """The point (3,) [m] of a link that is farthest in a direction (3,), both in its frame."""
        points = [self._farthest(geom, direction) for geom in self._geoms[link]]
        return max(points, key=lambda point: float(point @ direction))

    def area(self, link: str, depth: float) -> float:
        """Area [m2] in which a person touches a link who is pressed in by `depth` [m]: that of a sphere's cap
        with the link's radius, at least a finger tip's (0.5 cm2), at most the link's cross-section."""
        radius = self._radii[link]
        return float(np.clip(2.0 * np.pi * radius * depth, 5e-5, max(np.pi * radius**2, 5e-5)))

    def _radius(self, link: str) -> float:
        """Half of the second smallest extent [m], as of a limb along the largest."""
        sizes = [[float((self.ahead(link, axis) - self.ahead(link, -axis)) @ axis)] for axis in np.eye(3)]
        return 0.5 * sorted(sizes)[1][0]

    def _farthest(self, geom: int, direction: Array) -> Array:
        model, kind, turn = self._model, self._model.geom_type[geom], np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        rotation, size, shapes = turn.reshape(3, 3), model.geom_size[geom], mujoco.mjtGeom
        way = rotation.T @ direction / max(float(np.linalg.norm(direction)), 1e-12)
        if kind == shapes.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
            own = vertices[int(np.argmax(vertices @ way))]
        elif kind == shapes.mjGEOM_SPHERE:
            own = size[0] * way
        elif kind == shapes.mjGEOM_CAPSULE:
            own = size[0] * way + np.array([0.0, 0.0, size[1] * np.sign(way[2])])
        elif kind == shapes.mjGEOM_CYLINDER:
            across = size[0] * way[:2] / max(float(np.linalg.norm(way[:2])), 1e-12)
            own = np.array([*across, size[1] * np.sign(way[2])])
        elif kind == shapes.mjGEOM_ELLIPSOID:
            own = size**2 * way / max(float(np.linalg.norm(size * way)), 1e-12)
        else:  # a box
            own = size * np.sign(way)
        farthest: Array = model.geom_pos[geom] + rotation @ own
        return farthest
