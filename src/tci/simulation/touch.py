"""Skin in a scene: collision geoms, contact sensors, and the contacts of the physics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array, apply, invert
from tci.robot.collisions import ALL_PEOPLE, GROUND, SKIN
from tci.robot.neutral import neutral
from tci.simulation.physics import Physics
from tci.simulation.sampling import SLOTS
from tci.skin.surfaces import Surface
from tci.skin.triangulation import is_sheet
from tci.support.engine import mujoco

_FIELDS = (
    mujoco.mjtConDataField.mjCONDATA_FOUND,
    mujoco.mjtConDataField.mjCONDATA_FORCE,
    mujoco.mjtConDataField.mjCONDATA_POS,
    mujoco.mjtConDataField.mjCONDATA_NORMAL,
    mujoco.mjtConDataField.mjCONDATA_TANGENT,
)
_MOST_FORCE, _NET_FORCE = 2, 3
"""MuJoCo's codes for two ways to report contacts. The first code reports contacts sorted by force. The second
code merges all contacts into a single contact at the centre of pressure, in world axes."""
FINGER_TIP, FLOOR = "tci_finger_tip", "tci_floor"
"""Names of the geoms with which the skin collides."""
FINGER_PRIORITY = 1
"""MuJoCo's priority of the finger. MuJoCo takes the friction of a contact from the geom of higher priority.
The finger is frictionless. Only skin with three-axis taxels has a higher priority, so only on this skin the
finger has friction.
"""
FRICTION = 0.5
"""Of people and things on skin and shells, and of the robot on itself. Assumed: dry skin on plastic has 0.3
to 0.6."""
_CORNERS = 8
_THICKNESS = 2e-3
"""Thickness [m] of a sheet of skin. Assumed: about the thickness of a robot's skin. The simulated finger
would pass through a thinner sheet."""
_COLOUR = (0.22, 0.23, 0.25, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ContactTruth:
    """Contacts of one patch according to the physics. These contacts are the reference for all checks of the
    skin."""

    patch: str
    force: float
    """Sum of the normal forces [N]. 0 without contact."""
    vector: Array
    """Sum (3,) [N] of the contact forces on the skin, in the torso frame."""
    center: Array
    """Contact point (3,) [m], weighted by force, in the torso frame. The value is NaN without contact."""
    normal: Array
    """Outward unit normal (3,) of the contacts, weighted by force, in the torso frame. The value is NaN
    without contact.
    """


def skin_geom(patch: str) -> str:
    """Returns the name that a patch's geom and contact sensor have."""
    return f"tci_skin_{patch}"


def stiff(step: float) -> list[float]:
    """Returns MuJoCo's parameter `solref` (time constant [s], damping ratio) of a contact with the finger,
    for simulation steps of `step` [s].

    The contact is stiff, since the light tip would otherwise move deeply into the skin. With this value the
    tip moves into the skin by 0.2 mm at 8 N.
    """
    return [max(0.002, 2.0 * step), 1.0]


def add_skin(
    spec: mujoco.MjSpec,
    surface: Surface,
    *,
    axes: int,
    step: float,
    floor: bool,
    own: tuple[int, int] | None = None,
) -> None:
    """Adds a patch to the scene: a geom with the shape of the skin, and a sensor of the contacts on this
    geom.

    MuJoCo uses a mesh's convex hull for collisions. The mesh's faces are used only in pictures. The skin has
    friction with the finger only if the patch has three `axes`. With its link's `own` collision bits it
    touches what the link touches: the rest of the robot. If `floor` is True, a second sensor measures the
    contacts with the floor.
    """
    name = skin_geom(surface.patch)
    points, faces = solid_of(surface)
    plain = neutral(spec)
    spec.add_mesh(
        plain,
        name=name,
        uservert=points.ravel(),
        userface=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.body(surface.link).add_geom(
        plain,
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        mass=0.0,
        contype=own[0] if own else 0,
        conaffinity=SKIN | ALL_PEOPLE | (GROUND if floor else 0) | (own[1] if own else 0),
        condim=3 if own else axes,
        friction=[FRICTION, 0.005, 1e-4] if own else [1.0, 0.005, 1e-4],
        priority=FINGER_PRIORITY + 1 if axes == 3 else 0,
        solref=stiff(step),
        group=2,
        rgba=_COLOUR,
    )
    spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=name,
        intprm=[sum(1 << int(field) for field in _FIELDS), _MOST_FORCE, SLOTS],
        **({"reftype": mujoco.mjtObj.mjOBJ_GEOM, "refname": FINGER_TIP} if floor else {}),
    )
    if floor:
        spec.add_sensor(
            name=floor_sensor(surface.patch),
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=name,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=FLOOR,
            intprm=[sum(1 << int(field) for field in _FIELDS), _NET_FORCE, 1],
        )


def floor_sensor(patch: str) -> str:
    """Returns the name of the sensor of a patch's contacts with the floor."""
    return f"tci_floor_{patch}"


def solid_of(surface: Surface) -> tuple[Array, NDArray[np.intp]]:
    """Returns vertices (v, 3) [m] and triangles (f, 3) of a solid body that represents a patch of skin in
    collisions.

    Without triangles (f = 0), MuJoCo uses the convex hull of the vertices.

    If the skin surrounds a limb, the taxels are the vertices. On other skin, each taxel becomes a plate with
    the taxel's area.
    """
    if len(surface.faces) and not is_sheet(surface.normals):
        return surface.positions, surface.faces
    angles = np.arange(_CORNERS) * 2.0 * np.pi / _CORNERS
    plates = []
    for position, normal, area in zip(surface.positions, surface.normals, surface.areas, strict=True):
        across = np.linalg.svd(normal[None])[2][1:]
        rim = position + np.sqrt(area / np.pi) * (
            np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]
        )
        plates += [rim, rim - _THICKNESS * normal]
    return np.concatenate(plates), np.zeros((0, 3), dtype=np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """Two bodies that touch, according to the physics."""

    first: str
    second: str
    """A patch, a link without skin there, `finger`, `floor`, an obstacle, or `NAME SIDE PAD` of a hand."""
    force: float
    """Sum of the normal forces [N]."""
    vector: Array
    """Force (3,) [N] on the second body, in the torso frame."""
    center: Array
    """(3,) [m], weighted by force, in the torso frame."""


def meetings(physics: Physics, torso: Callable[[], Array]) -> tuple[Meeting, ...]:
    """All bodies that touch now, strongest first; `torso` as in `contact_truth`."""
    physics.refresh()
    model, data, local = physics.model, physics.data, np.zeros(6)
    found: dict[tuple[str, str], list[Array]] = {}
    for index in range(data.ncon):
        mujoco.mj_contactForce(model, data, index, local)
        contact, frame = data.contact[index], data.contact[index].frame.reshape(3, 3)
        if local[0] > 0.0:
            pair = _called(model, int(contact.geom[0])), _called(model, int(contact.geom[1]))
            row = np.array([local[0], *(local[:3] @ frame), *(local[0] * contact.pos)])
            found.setdefault(pair, []).append(row)
    if not found:
        return ()
    T_TW = invert(torso())
    result = []
    for (first, second), rows in found.items():
        total = np.sum(rows, axis=0)
        force = float(total[0])
        result.append(
            Meeting(first, second, force, T_TW[:3, :3] @ total[1:4], apply(T_TW, total[4:] / force))
        )
    return tuple(sorted(result, key=lambda one: -one.force))


def _called(model: mujoco.MjModel, geom: int) -> str:
    name = str(model.geom(geom).name)
    if name in (FINGER_TIP, FLOOR):
        return "finger" if name == FINGER_TIP else "floor"
    for prefix in ("tci_skin_", "tci_obstacle_"):
        if name.startswith(prefix):
            return name.removeprefix(prefix)
    if name.startswith("tci_"):
        return " ".join(name.removeprefix("tci_").rsplit("_", 2))
    return str(model.body(int(model.geom_bodyid[geom])).name)


def contact_truth(physics: Physics, patch: str, torso: Callable[[], Array]) -> ContactTruth:
    """Returns the current contacts on a patch.

    The contacts come from the physics, not from the sensor that the skin uses. `torso` is a function that
    returns the pose (4, 4) of the torso in the world. The function `torso` is called only if there is a
    contact.
    """
    physics.refresh()
    model, data = physics.model, physics.data
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, skin_geom(patch))
    force, vector, moment, direction = 0.0, np.zeros(3), np.zeros(3), np.zeros(3)
    local = np.zeros(6)
    touching = (data.contact.geom[: data.ncon] == geom).any(axis=1) if data.ncon else np.zeros(0)
    for index in np.flatnonzero(touching).tolist():
        contact = data.contact[index]
        mujoco.mj_contactForce(model, data, index, local)
        # The normal of a contact points from the contact's first geom to the second geom.
        outward = 1.0 if contact.geom[0] == geom else -1.0
        frame = contact.frame.reshape(3, 3)
        force += local[0]
        vector -= outward * local[:3] @ frame
        moment += local[0] * contact.pos
        direction += local[0] * outward * frame[0]
    if not force > 0.0:
        nothing = np.full(3, np.nan)
        return ContactTruth(patch, 0.0, np.zeros(3), nothing, nothing)
    T_TW = invert(torso())
    rotation = T_TW[:3, :3]
    return ContactTruth(
        patch=patch,
        force=float(force),
        vector=rotation @ vector,
        center=apply(T_TW, moment / force),
        normal=rotation @ direction / np.linalg.norm(direction),
    )
