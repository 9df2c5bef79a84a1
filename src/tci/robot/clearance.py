"""Distances between links that could collide: distances of each arm from the trunk, the head, the legs and
the other arm.

The module `collisions` selects the links. MuJoCo computes the distances between their collision geometries:
primitives, and the convex hulls of meshes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError, TciError
from tci.messages.frames import Array, apply, invert, read_only, transform
from tci.robot.collisions import LEFT, RIGHT, exclude_overlaps, solid_spec, thick_pads
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import joints_of
from tci.robot.model_file import compiled
from tci.robot.per_robot import per_robot
from tci.support.engine import mujoco

TOUCHING = 1e-6
"""Distance [m] below which the direction between two links is only a rounding error."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The nearest pair of links at one posture."""

    distance: float
    """Distance [m] between the surfaces of the two links; negative if the links overlap."""
    first: str
    """Name of one link; empty if no pair is within the search distance."""
    second: str
    """Name of the other link; empty if no pair is within the search distance."""


@dataclass(frozen=True, slots=True)
class Fixture:
    """A thing that stands still, such as a table: a box along the axes of the model's root, which is the
    pelvis of a G1 and the torso of a NAO (`KinematicChain.links[0]`)."""

    name: str
    centre: tuple[float, float, float]
    """[m], in the frame of the model's root."""
    size: tuple[float, float, float]
    """Whole lengths [m] along x, y and z."""

    def __post_init__(self) -> None:
        three = len(self.centre) == len(self.size) == 3
        if not (three and np.isfinite([*self.centre, *self.size]).all() and min(self.size) > 0.0):
            raise TciError(
                f"fixture {self.name}: centre {self.centre}, size {self.size}; valid: 3 finite numbers each, "
                "and lengths above 0 m"
            )


class Near(NamedTuple):
    """Two links, or a link and a fixture, that nearly touch."""

    first: str
    second: str
    distance: float
    """[m]."""
    p_T: Array
    """Point (3,) [m] in the middle between them, in the torso frame."""
    way_T: Array
    """Unit vector (3,) from the first to the second; 0 if they just touch."""


class Clearance:
    """Distances between the links of one robot. Each thread needs its own object, because methods reuse
    memory."""

    def __init__(self, robot: Robot, fixtures: tuple[Fixture, ...] = ()) -> None:
        """Reads the robot's model, with `fixtures` beside its arms. Raises DescriptionError if the robot has
        no model, or if a joint is missing in the model; TciError for two fixtures of one name.

        Links that overlap in the initial posture are assumed to overlap by construction. Such pairs of links
        are never checked for collision.
        """
        robot = without_skin(robot)
        self._model, self._robot = _solid_model(robot, fixtures), robot
        self._data = mujoco.MjData(self._model)
        self._count = len(robot.servos)
        self._servos, self._addresses, columns = joints_of(robot, self._model)
        self.servos: tuple[int, ...] = tuple(self._servos)
        """Servos that have a joint in the model."""
        self.joints: tuple[int, ...] = tuple(int(self._model.dof_jntid[column]) for column in columns)
        """For each of `servos`, the index of its joint in MuJoCo."""
        self._pairs = _pairs(self._model)
        first, second = self._pairs.T
        self._reach = self._model.geom_rbound[first] + self._model.geom_rbound[second]
        self.levers = _levers(robot)
        """For each servo (n_servos,): upper bound [m/rad] on the change of the distance between any two
        links, per radian by which this servo turns."""

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo model of the robot's collision geometry and of the joints of its servos. Callers must not
        change the model."""
        return self._model

    @property
    def pairs(self) -> NDArray[np.intp]:
        """Pairs (m, 2) of geoms that could hit each other, by their index in MuJoCo."""
        return self._pairs

    def gap(self, position: Array, *, within: float) -> Gap:
        """Returns the nearest pair at `position` (n_servos,) [rad].

        If all pairs are farther apart than `within` [m], the result has the distance `within` and no names.
        Raises CommandError if `position` has another shape.
        """
        least = self._pose(position)
        nearest, found = within, -1
        for pair in np.argsort(least).tolist():
            if least[pair] >= nearest:
                break
            distance = self._distance(pair, nearest)
            if distance < nearest:
                nearest, found = distance, pair
        return Gap(nearest, *self.names(found)) if found >= 0 else Gap(within, "", "")

    def gaps(self, position: Array, *, within: float) -> Array:
        """Returns the distances (m,) [m] of all `pairs` at `position` (n_servos,) [rad]. Distances above
        `within` [m] are set to `within`.

        Raises CommandError if `position` has another shape.
        """
        least = self._pose(position)
        result = np.full(len(least), within)
        for pair in np.flatnonzero(least < within).tolist():
            result[pair] = min(within, self._distance(pair, within))
        return result

    def names(self, pair: int) -> tuple[str, str]:
        """Returns the names of the two links whose geoms are in the row `pair` of `pairs`."""
        first, second = (self._model.body(self._model.geom_bodyid[geom]) for geom in self._pairs[pair])
        return str(first.name), str(second.name)

    def near(self, position: Array, *, within: float) -> list[Near]:
        """The pairs that are nearer than `within` [m] at `position` (n_servos,) [rad]. Raises CommandError if
        `position` has another shape."""
        model, segment, found = self._robot.model, np.empty(6), list[Near]()
        for pair in np.flatnonzero(self._pose(position) < within).tolist():
            one, other = self._pairs[pair].tolist()
            distance = mujoco.mj_geomDistance(self._model, self._data, one, other, within, segment)
            if distance < within and model is not None:
                link = self._data.body(model.torso_link)
                T_WL = transform(link.xmat.reshape(3, 3), link.xpos)
                T_TW = invert(T_WL @ model.T_LT)
                middle = apply(T_TW, 0.5 * (segment[:3] + segment[3:]))
                way = T_TW[:3, :3] @ (segment[3:] - segment[:3])
                way = way / distance if abs(distance) > TOUCHING else np.zeros(3)
                found.append(Near(*self.names(pair), float(distance), middle, way))
        return found

    def _pose(self, position: Array) -> Array:
        """Moves the model to the servo angles `position` (n_servos,) [rad]. Returns a lower bound (m,) [m] on
        the distance of each of the m pairs of geoms, computed from bounding spheres."""
        if np.shape(position) != (self._count,):
            raise CommandError(f"position of shape {np.shape(position)}; the robot has {self._count} servos")
        data = self._data
        data.qpos[self._addresses] = position[self._servos]
        mujoco.mj_kinematics(self._model, data)
        offset = data.geom_xpos[self._pairs[:, 0]] - data.geom_xpos[self._pairs[:, 1]]
        least: Array = np.sqrt(np.einsum("ij,ij->i", offset, offset)) - self._reach
        return least

    def _distance(self, pair: int, cutoff: float) -> float:
        one, other = self._pairs[pair]
        return float(mujoco.mj_geomDistance(self._model, self._data, int(one), int(other), cutoff, None))


@per_robot
def without_skin(robot: Robot) -> Robot:
    """The robot with only those pads that are solid: robots that differ only in their skin share one model of
    collision geometry."""
    return robot.model_copy(update={"patches": thick_pads(robot)})


@lru_cache(maxsize=8)
def _solid_model(robot: Robot, fixtures: tuple[Fixture, ...]) -> mujoco.MjModel:
    """Returns the robot's model with its collision geometry. Callers must not change the model: it is cached
    and shared, because reading the meshes of an iCub takes a second."""
    spec = solid_spec(robot, mimics=False)
    model = exclude_overlaps(spec, robot, initial_position(robot))
    if not fixtures or robot.model is None:
        return model
    names = [one.name for one in fixtures]
    if len({*names}) < len(names):
        raise TciError(f"fixtures {', '.join(names)}; valid: another name for each")
    root, centre = model.body(1), np.empty(3)
    for one in fixtures:
        half = [0.5 * length for length in one.size]
        mujoco.mju_rotVecQuat(centre, np.array(one.centre, dtype=float), root.quat)
        body = spec.worldbody.add_body(name=f"fixture {one.name}", pos=root.pos + centre, quat=root.quat)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, contype=0, conaffinity=LEFT | RIGHT)
    return compiled(spec, robot.model)


def _pairs(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Returns the pairs (m, 2) of geoms that can collide according to the MuJoCo model."""
    one, other = np.triu_indices(model.ngeom, 1)
    meets = model.geom_contype[one] & model.geom_conaffinity[other]
    meets |= model.geom_contype[other] & model.geom_conaffinity[one]
    low, high = np.sort([model.geom_bodyid[one], model.geom_bodyid[other]], axis=0)
    free = (meets != 0) & (low != high) & ~np.isin((low << 16) + high, model.exclude_signature)
    return read_only(np.stack([one[free], other[free]], axis=1), np.intp)


@lru_cache(maxsize=8)
def _levers(robot: Robot) -> Array:
    """Returns for each servo (n_servos,) an upper bound [m/rad] on the change of the distance between any two
    links, per radian by which the servo turns. The result is cached, because each gate needs it and computing
    it for an iCub takes 10 ms."""
    model = _solid_model(robot, ())
    servos, _, columns = joints_of(robot, model)
    solid = set(_pairs(model).ravel().tolist())
    levers = np.zeros(len(robot.servos))
    for servo, column in zip(servos, columns, strict=True):
        levers[servo] = _lever(model, column, solid)
    return read_only(levers)


def _lever(model: mujoco.MjModel, column: int, geoms: set[int]) -> float:
    """Returns an upper bound [m] on the distance between the axis of the joint `column` and any point of
    those `geoms` that the joint moves."""
    carrier = int(model.dof_bodyid[column])
    anchor = float(np.linalg.norm(model.jnt_pos[model.dof_jntid[column]]))
    farthest = 0.0
    for geom in geoms:
        way = anchor + float(np.linalg.norm(model.geom_pos[geom])) + float(model.geom_rbound[geom])
        body = int(model.geom_bodyid[geom])
        while body not in (0, carrier):
            way += float(np.linalg.norm(model.body_pos[body]))
            body = int(model.body_parentid[body])
        if body == carrier:
            farthest = max(farthest, way)
    return farthest
