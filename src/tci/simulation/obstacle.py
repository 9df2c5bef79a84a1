"""Things that do not move of themselves: a part of a person, a table, a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError
from tci.messages.frames import Array
from tci.robot.neutral import neutral
from tci.simulation.hand_model import contact_of
from tci.simulation.physics import Physics, exclusive
from tci.simulation.posed_skin import PosedSkin, unit
from tci.support.engine import mujoco

PREFIX = "tci_obstacle_"
AWAY = np.array([0.0, 0.0, -40.0])
DAMPING = 0.3
"""Damping ratio of a surface on its spring. Assumed."""
_STEPS = 0.25
"""Square of (frequency x step) of a surface on its spring: the physics follows it, with a margin of 16."""
_COLOUR = (0.62, 0.55, 0.5, 1.0)


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A body with a soft or hard surface, such as a chest (a capsule on 25 N/mm) or a table (a box).

    It exerts no force of its own. The surface moves on a spring in all three directions, and does not turn.
    Raises CommandError for a number out of range.
    """

    name: str
    stiffness: float
    """[N/m] of the surface."""
    mass: float | None = None
    """[kg]: it gives way, held by nothing else; None: it can't, as a person against a wall."""
    radius: float = 0.05
    """[m] of a sphere, or of a capsule."""
    half: float = 0.0
    """Half the length [m] of a capsule, without its round ends; 0 for a sphere."""
    box: tuple[float, float, float] | None = None
    """Half sizes [m] of a box, instead of a sphere or a capsule."""

    def __post_init__(self) -> None:
        sizes = self.box or (self.radius,)
        if not 100.0 <= self.stiffness <= 150e3:
            raise CommandError(f"stiffness {self.stiffness} of {self.name}; valid: 100 to 150000 N/m")
        if self.mass is not None and not 0.1 <= self.mass <= 500.0:
            raise CommandError(f"mass {self.mass} of {self.name}; valid: 0.1 to 500 kg, or None")
        if not (all(0.0 < size < 5.0 for size in sizes) and 0.0 <= self.half < 5.0):
            raise CommandError(f"size of {self.name}; valid: above 0, below 5 m")


def add_obstacle(spec: mujoco.MjSpec, one: Obstacle, *, step: float) -> None:
    """Adds an obstacle, out of reach."""
    plain, name = neutral(spec), PREFIX + one.name
    light = max(0.05, one.stiffness * step**2 / _STEPS)
    if one.mass is not None:
        light = min(light, 0.5 * one.mass)
    base = spec.worldbody.add_body(name=name, pos=AWAY, gravcomp=1.0)
    if one.mass is not None:
        base.mass, base.inertia, base.explicitinertial = one.mass - light, [0.01 * one.mass] * 3, True
        _slide(base, plain, f"{name}_base", 0.0, 0.0)
    surface = base.add_body(name=f"{name}_surface", gravcomp=1.0)
    _slide(surface, plain, name, one.stiffness, 2.0 * DAMPING * float(np.sqrt(one.stiffness * light)))
    kinds = mujoco.mjtGeom
    kind = kinds.mjGEOM_BOX if one.box else kinds.mjGEOM_CAPSULE if one.half else kinds.mjGEOM_SPHERE
    surface.add_geom(
        plain, name=name, type=kind, size=one.box or [one.radius, one.half, 0.0], mass=light, rgba=_COLOUR,
        group=2, **contact_of(step),
    )  # fmt: skip


def _slide(
    body: mujoco.MjsBody, plain: mujoco.MjsDefault, name: str, stiffness: float, damping: float
) -> None:
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        body.add_joint(
            plain, name=f"{name}_{axis}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction,
            stiffness=[stiffness, 0.0, 0.0], damping=[damping, 0.0, 0.0],
        )  # fmt: skip


class PlacedObstacle:
    """An obstacle in a world."""

    def __init__(self, physics: Physics, skin: PosedSkin, obstacle: Obstacle) -> None:
        self._physics, self._skin, self.obstacle = physics, skin, obstacle
        self._body = physics.model.body(PREFIX + obstacle.name).id

    @exclusive
    def place(self, point: ArrayLike, along: ArrayLike = (0.0, 0.0, 1.0)) -> None:
        """Puts its middle at a `point` (3,) [m] of the torso frame, at rest; the axis of a capsule, or the
        third axis of a box, points along `along` (3,). Give it room: it pushes away what is there."""
        at, axis = self._skin.from_torso(point, unit("along", along))
        self._move(at, axis)

    @exclusive
    def remove(self) -> None:
        """Takes it away at once."""
        self._move(AWAY, np.array([0.0, 0.0, 1.0]))

    @property
    def position(self) -> Array:
        """(3,) [m] of its middle, in the torso frame."""
        model, data = self._physics.model, self._physics.data
        self._physics.refresh()
        geom = model.geom(PREFIX + self.obstacle.name).id
        return self._skin.to_torso(data.geom_xpos[geom], [0.0, 0.0, 1.0])[0]

    def _move(self, at: Array, axis: Array) -> None:
        model, data = self._physics.model, self._physics.data
        model.body_pos[self._body] = at
        mujoco.mju_quatZ2Vec(model.body_quat[self._body], np.ascontiguousarray(axis))
        for joint in range(model.njnt):
            if model.joint(joint).name.startswith(PREFIX + self.obstacle.name + "_"):
                data.qpos[model.jnt_qposadr[joint]] = data.qvel[model.jnt_dofadr[joint]] = 0.0
        self._physics.touch()
