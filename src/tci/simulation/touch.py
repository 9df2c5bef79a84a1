"""The skin that is not there: contacts of the physics become raw values of taxels."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from tci.errors import TciError
from tci.frames import Array, apply, invert, read_only
from tci.messages import SkinFrame
from tci.model.collisions import GROUND, SKIN
from tci.model.description import Patch
from tci.model.surfaces import Surface, is_sheet, tangents
from tci.simulation.kernel import spread, width
from tci.simulation.physics import Physics

SLOTS = 16
"""Contacts on one patch at a time. A finger makes one."""
_FIELDS = (
    mujoco.mjtConDataField.mjCONDATA_FOUND,
    mujoco.mjtConDataField.mjCONDATA_FORCE,
    mujoco.mjtConDataField.mjCONDATA_POS,
    mujoco.mjtConDataField.mjCONDATA_NORMAL,
    mujoco.mjtConDataField.mjCONDATA_TANGENT,
)
_FOUND, _FORCE, _POSITION, _NORMAL, _TANGENT = 0, slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 13)
_WIDTH = 13
"""Numbers per slot: found 1, force 3 (along normal, tangent and the third axis), position 3, normal 3,
tangent 3."""
_MOST_FORCE, _NET_FORCE = 2, 3
"""MuJoCo's codes: contacts sorted by force; or all as one, at their centre of pressure, in the world's
axes."""
FINGER_TIP, FLOOR = "tci_finger_tip", "tci_floor"
"""Geoms that the skin collides with."""
FINGER_PRIORITY = 1
"""Of the finger's contacts, which are without friction but for skin that feels it."""
WIDE = 0.02
"""[m]; far wider than a taxel. Ours."""
_CORNERS = 8
_THICKNESS = 2e-3
"""How thick [m] a sheet of skin is. Ours."""
_COLOUR = (0.22, 0.23, 0.25, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ContactTruth:
    """What the physics knows of the contacts of one patch: the reference for all checks."""

    patch: str
    force: float
    """Sum of the normal forces [N]; 0 when nothing touches."""
    vector: Array
    """Sum of the contact forces on the skin (3,) [N], seen from the torso."""
    center: Array
    """Force-weighted contact point (3,) [m], seen from the torso; NaN when nothing touches."""
    normal: Array
    """Force-weighted outward unit normal (3,) of the contacts, seen from the torso; NaN likewise."""


def skin_geom(patch: str) -> str:
    """Name of the geom and of the contact sensor of a patch."""
    return f"tci_skin_{patch}"


def stiff(step: float) -> list[float]:
    """MuJoCo's solref of a contact with the finger, whose light tip would sink in: 0.2 mm at 8 N here."""
    return [max(0.002, 2.0 * step), 1.0]


def add_skin(spec: mujoco.MjSpec, surface: Surface, *, axes: int, step: float, floor: bool) -> None:
    """Add a patch to the scene: a geom through its taxels, and a sensor of the contacts on it.

    MuJoCo collides a mesh's convex hull. Faces serve pictures. Only skin that feels `axes` 3 has friction
    with the finger. What a `floor` does has a sensor of its own.
    """
    name = skin_geom(surface.patch)
    points, faces = _solid(surface)
    spec.add_mesh(
        name=name,
        uservert=points.ravel(),
        userface=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.body(surface.link).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        mass=0.0,
        contype=0,
        conaffinity=SKIN | GROUND if floor else SKIN,
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
            name=_floor_sensor(surface.patch),
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=name,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=FLOOR,
            intprm=[sum(1 << int(field) for field in _FIELDS), _NET_FORCE, 1],
        )


def _floor_sensor(patch: str) -> str:
    return f"tci_floor_{patch}"


def _solid(surface: Surface) -> tuple[Array, NDArray[np.intp]]:
    """Vertices (v, 3) [m] and faces (f, 3) of a body with that surface.

    A limb's taxels enclose one. The taxels of a sheet, and single ones, are plates of their own area.
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
    points = np.concatenate(plates)
    return points, np.asarray(ConvexHull(points).simplices, dtype=np.intp)


def _size(surface: Surface) -> float:
    """Half the longest side [m] of a patch's box."""
    return 0.5 * float(np.ptp(surface.positions, axis=0).max())


class Touch:
    """One patch of skin in a world."""

    def __init__(
        self,
        physics: Physics,
        patch: Patch,
        surface: Surface,
        *,
        noise: float,
        generator: np.random.Generator,
    ) -> None:
        self.patch = patch
        self.surface = surface
        # A rigid plate hands a force on to all that carry it, however far away they are.
        self._width = _size(surface) if patch.rigid else width(surface.areas)
        self._physics = physics
        self._noise = noise
        self._generator = generator
        name = skin_geom(patch.name)
        self._geom = physics.model.geom(name).id
        self._body = int(physics.model.geom_bodyid[self._geom])
        start = int(physics.model.sensor(name).adr[0])
        self._slots = slice(start, start + SLOTS * _WIDTH)
        self._floor: slice | None = None
        sensors = [physics.model.sensor(index).name for index in range(physics.model.nsensor)]
        if _floor_sensor(patch.name) in sensors:
            start = int(physics.model.sensor(_floor_sensor(patch.name)).adr[0])
            self._floor = slice(start, start + _WIDTH)
        self._x = tangents(surface.normals) if surface.tangents is None else surface.tangents
        self._y = np.cross(surface.normals, self._x)
        sensor = patch.sensor
        self._type = np.uint8 if 0.0 <= sensor.lowest <= sensor.highest <= 255.0 else np.int32
        # One array for all frames at rest, which nobody can change: who sees it again need not look again.
        self._rest = read_only(self._raw(np.zeros((len(surface.positions), 3))), self._type)

    def reset(self) -> None:
        """The first frame is taken at time 0."""
        self._count = -1
        self.due = 0
        """Step in which the next frame is taken."""
        self.sample()

    def sample(self) -> None:
        """Take a frame now. Raises TciError when the patch has more contacts than slots."""
        self._count += 1
        due = (self._count + 1) / (self.patch.rate * self._physics.step)
        self.due = max(int(np.ceil(due - 1e-6)), self._physics.steps + 1)
        if self._noise or self.found or self.carried is not None:
            values = self._raw(self.vectors() / self.surface.areas[:, None])
            values.setflags(write=False)
        else:
            values = self._rest
        self.frame = SkinFrame(self.patch.name, self._physics.time, self._count, values)

    @property
    def found(self) -> int:
        """How many contacts the patch has now."""
        self._physics.refresh()
        return int(self._physics.data.sensordata[self._slots.start + _FOUND])

    @property
    def carried(self) -> Array | None:
        """What the floor does to the patch now: `_FIELDS` (13,); None when they don't touch."""
        if self._floor is None:
            return None
        self._physics.refresh()
        values: Array = self._physics.data.sensordata[self._floor]
        return values if values[_FOUND] else None

    def forces(self) -> Array:
        """Force (taxels,) [N] that presses each taxel now. Raises TciError like `sample`."""
        return self.vectors()[:, 2]

    def vectors(self) -> Array:
        """Force (taxels, 3) [N] on each taxel now: along its x and y axes, and pressing. Raises TciError like
        `sample`."""
        found, floor = self.found, self.carried
        slots = self._physics.data.sensordata[self._slots].reshape(SLOTS, _WIDTH)
        total = np.zeros((len(self.surface.positions), 3))
        if found == 0 and floor is None:
            return total
        if found > SLOTS:
            raise TciError(f"{found} contacts on {self.patch.name} at once; valid: up to {SLOTS}")
        T_LW = invert(self._physics.pose(self._body))
        if floor is not None:
            # A floor presses a padded sole all over, not in the corners of its hull.
            normal = self.surface.normals.mean(axis=0)
            normal /= np.linalg.norm(normal)
            force = T_LW[:3, :3] @ floor[_FORCE]
            centre = apply(T_LW, floor[_POSITION])
            total[:, 2] += abs(float(force @ normal)) * self._shares(centre, normal, _size(self.surface))
        for slot in slots[:found]:
            point = apply(T_LW, slot[_POSITION])
            normal = T_LW[:3, :3] @ slot[_NORMAL]
            pressing, first, second = slot[_FORCE]
            shares = self._shares(point, normal, self._width)
            total[:, 2] += pressing * shares
            if self.patch.sensor.axes == 3:
                tangent = T_LW[:3, :3] @ slot[_TANGENT]
                along = -(first * tangent + second * np.cross(normal, tangent))
                total[:, 0] += shares * (self._x @ along)
                total[:, 1] += shares * (self._y @ along)
        return total

    def _shares(self, point: Array, normal: Array, sigma: float) -> Array:
        """`spread` over the taxels; a wide one is aimed twice, since its softness is in widths."""
        shares = spread(self.surface.positions, point, normal, sigma)
        if sigma > WIDE:
            beside = point - shares @ self.surface.positions
            aim = point + beside - float(beside @ normal) * normal
            shares = spread(self.surface.positions, aim, normal, sigma)
        return shares

    def _raw(self, stress: Array) -> NDArray[np.generic]:
        """Raw values (channels,) of `stress` (taxels, 3) [Pa]; pads and absent taxels stay at rest."""
        sensor = self.patch.sensor
        values = np.full(self.patch.channels, sensor.rest)
        pressed = np.sign(sensor.pascal_per_count) * sensor.counts(stress[:, 2])
        if sensor.axes == 3:
            places = 3 * self.surface.channels
            values[places] += stress[:, 0] / sensor.shear_pascal_per_count
            values[places + 1] += stress[:, 1] / sensor.shear_pascal_per_count
            values[places + 2] += pressed
        else:
            values[self.surface.channels] += pressed
        if self._noise:
            values += self._generator.normal(0.0, self._noise, len(values))
        counts = np.clip(np.rint(values), sensor.lowest, sensor.highest)
        return np.asarray(counts, dtype=self._type)

    def truth(self, T_TW: Array) -> ContactTruth:
        """The physics' own contacts, now, not read from the sensor that the skin uses."""
        self._physics.refresh()
        model, data = self._physics.model, self._physics.data
        force, vector, moment, direction = 0.0, np.zeros(3), np.zeros(3), np.zeros(3)
        local = np.zeros(6)
        for index, contact in enumerate(data.contact[: data.ncon]):
            if self._geom not in contact.geom:
                continue
            mujoco.mj_contactForce(model, data, index, local)
            # The contact's normal points from its first to its second geom.
            outward = 1.0 if contact.geom[0] == self._geom else -1.0
            frame = contact.frame.reshape(3, 3)
            force += local[0]
            vector -= outward * local[:3] @ frame
            moment += local[0] * contact.pos
            direction += local[0] * outward * frame[0]
        if not force > 0.0:
            nothing = np.full(3, np.nan)
            return ContactTruth(self.patch.name, 0.0, np.zeros(3), nothing, nothing)
        rotation = T_TW[:3, :3]
        return ContactTruth(
            patch=self.patch.name,
            force=float(force),
            vector=rotation @ vector,
            center=apply(T_TW, moment / force),
            normal=rotation @ direction / np.linalg.norm(direction),
        )
