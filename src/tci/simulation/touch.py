"""Skin in a scene: collision geoms, contact sensors, and the contacts of the physics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array, apply, invert
from tci.robot.collisions import GROUND, PERSON, SKIN
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


def add_skin(spec: mujoco.MjSpec, surface: Surface, *, axes: int, step: float, floor: bool) -> None:
    """Adds a patch to the scene: a geom with the shape of the skin, and a sensor of the contacts on this
    geom.

    MuJoCo uses a mesh's convex hull for collisions. The mesh's faces are used only in pictures. The skin has
    friction with the finger only if the patch has three `axes`. If `floor` is True, a second sensor measures
    the contacts with the floor.
    """
    name = skin_geom(surface.patch)
    points, faces = _solid(surface)
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
        contype=0,
        conaffinity=SKIN | PERSON | (GROUND if floor else 0),
        condim=axes,
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


def _solid(surface: Surface) -> tuple[Array, NDArray[np.intp]]:
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
