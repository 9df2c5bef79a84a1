"""Points on the outer surface of links, and the cone of skin around them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.exports.cone import ConeFit, fit_cone
from tci.messages.frames import Array, apply, invert, transform
from tci.robot.description import Model
from tci.robot.mesh_files import NO_MESHES
from tci.robot.model_file import LEAST_MASS, compiled, load_spec
from tci.support.engine import mujoco

POINTS = 6000
"""Number of points on one mesh. Assumed: with fewer points, some of the pieces into which a limb's surface is
divided (`SECTORS` x `SLABS`) would have no point; more points take longer."""
SECTORS, SLABS = 24, 12
"""Number of pieces into which a limb's surface is divided, around and along the limb. The outermost point of
each piece is used. Assumed: fewer pieces do not follow the limb's shape, more pieces need more points."""
INSIDE = 0.9
"""Fraction of the outermost points that lie inside the skin. Assumed: single points that stick out must not
widen the skin."""
THINNEST = 0.02
"""Least radius [m] of a skin. Assumed: smaller than the radius of any humanoid's forearm."""


class LinkPoints:
    """Samples points on the geometry of a model's links, at the model's zero."""

    def __init__(self, model: Model) -> None:
        """Loads the model. Raises the errors of `load_spec`, and DescriptionError for a mesh that MuJoCo
        can't read."""
        self._model = self.compiled = compiled(load_spec(model), model)
        self.source = model.path
        """Path of the model's file."""
        self.shapeless = model.meshes == NO_MESHES
        """True if the model is read without its meshes."""
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = 0.0
        mujoco.mj_kinematics(self._model, self._data)

    def of(self, links: Iterable[str]) -> Array:
        """Returns points (n, 3) [m] on links and on all links fixed to them, in the root's frame."""
        bodies = self._with_fixed(self._model.body(link).id for link in links)
        geoms = [geom for geom in range(self._model.ngeom) if int(self._model.geom_bodyid[geom]) in bodies]
        found = [self._on_geom(geom) for geom in geoms]
        return np.concatenate([np.zeros((0, 3)), *found])

    def pose(self, body: int) -> Array:
        """Pose (4, 4) of a body, by its index in MuJoCo, in the root's frame."""
        return transform(self._data.xmat[body].reshape(3, 3), self._data.xpos[body])

    def own(self, body: int) -> Array:
        """Points (n, 3) [m] on the shapes of one body alone, in its frame, with the corners of its meshes."""
        found = [np.zeros((0, 3))]
        for geom in np.flatnonzero(self._model.geom_bodyid == body).tolist():
            found.append(self._on_geom(geom))
            if self._model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                mesh = int(self._model.geom_dataid[geom])
                first, count = int(self._model.mesh_vertadr[mesh]), int(self._model.mesh_vertnum[mesh])
                T_RG = transform(self._data.geom_xmat[geom].reshape(3, 3), self._data.geom_xpos[geom])
                found.append(apply(T_RG, self._model.mesh_vert[first : first + count].astype(float)))
        return apply(invert(self.pose(body)), np.concatenate(found))

    def around(self, link: str, *, neighbours: bool = True) -> Array:
        """Returns points (n, 3) [m] on a link and on its neighbouring links, in the frame of `link`."""
        joined = own = self._with_fixed([self._model.body(link).id])
        if neighbours:
            parents = self._model.body_parentid
            joined = {body for body in range(1, self._model.nbody) if int(parents[body]) in own}
            joined |= own | {int(parents[body]) for body in own} - {0}
        R_RL, p_RL = self.link_pose(link)
        points: Array = (self.of(str(self._model.body(body).name) for body in sorted(joined)) - p_RL) @ R_RL
        return points

    def far_end(self, link: str, start: Array) -> Array | None:
        """Returns the end (3,) [m] of a limb's last segment, in the root's frame.

        The segment begins at `start` (3,) [m] on `link`. The end of the segment is the mean of its farthest
        surface points: the 10 % of its points that are farthest from `start`. If the model is read without
        meshes, the end is at twice the distance of the centre of mass from `start`. Exception: if another
        link, such as a hand, is fixed to `link`, and the distance of its origin from `start` is 0.5 to 1
        times that of this end, the end is this origin. Returns None if the model contains none of these
        points.
        """
        body = self._model.body(link).id
        points = self.of([link])
        reach = np.linalg.norm(points - start, axis=1)
        far = reach >= np.quantile(reach, 0.9) if len(reach) else reach > 0.0
        tip: Array | None = points[far].mean(axis=0) if len(points) else None
        if self.shapeless and self._model.body_mass[body] > LEAST_MASS:
            tip = 2.0 * self._data.xipos[body] - start
        fixed = [self._data.xpos[other] for other in self._with_fixed([body]) if other != body]
        hand = max(fixed, key=lambda origin: float(np.linalg.norm(origin - start)), default=None)
        if hand is None or tip is None:
            return tip if hand is None else hand
        halfway = 0.5 * float(np.linalg.norm(tip - start))  # nearer links are covers and sensors
        return hand if halfway < float(np.linalg.norm(hand - start)) < 2.0 * halfway else tip

    def centre_of_mass_without(self, links: Iterable[str]) -> Array | None:
        """Returns the centre of mass (3,) [m] of a robot without `links` and without all links that `links`
        carry, in the root's frame. Returns None if the remaining links have no mass.
        """
        moved = {self._model.body(link).id for link in links}
        base = {int(self._model.body_rootid[body]) for body in moved}
        rest = []
        for body in range(1, self._model.nbody):
            if body in moved or int(self._model.body_parentid[body]) in moved:
                moved.add(body)
            elif int(self._model.body_rootid[body]) in base:
                rest.append(body)
        mass = self._model.body_mass[rest]
        if not mass.sum() > LEAST_MASS * max(1, len(rest)):
            return None
        centre: Array = mass @ self._data.xipos[rest] / mass.sum()
        return centre

    def _with_fixed(self, bodies: Iterable[int]) -> set[int]:
        """Returns `bodies` and all bodies that are fixed to them."""
        found = set(bodies)
        for body in range(1, self._model.nbody):
            if self._model.body_parentid[body] in found and not self._model.body_jntnum[body]:
                found.add(body)
        return found

    def link_pose(self, link: str) -> tuple[Array, Array]:
        """Returns the rotation `R_RL` (3, 3) and the position `p_RL` (3,) [m] of a link in the root's
        frame."""
        body = self._model.body(link).id
        return self._data.xmat[body].reshape(3, 3), self._data.xpos[body]

    def inertia(self, joints: Iterable[str]) -> Array:
        """Returns the largest inertia (k,) [kg m2] that each joint carries in 32 random postures."""
        return self.reactions(joints).diagonal()

    def reactions(self, joints: Iterable[str]) -> Array:
        """Returns the largest torque (k, k) [N m] in 32 random postures that an acceleration of 1 rad/s2 of
        the joint of each column takes of the motor of each row."""
        model, data = self._model, self._data
        generator = np.random.default_rng(0)
        full = np.zeros((model.nv, model.nv))
        most = np.zeros_like(full)
        for _ in range(32):
            data.qpos[:] = generator.uniform(-1.5, 1.5, model.nq)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_crb(model, data)
            mujoco.mj_fullM(model, data, full)
            most = np.maximum(most, np.abs(full))
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        own = [int(model.joint(joint).dofadr[0]) for joint in joints]
        return most[np.ix_(own, own)]

    def most_inert(self, joint: str) -> tuple[str, float, float]:
        """Of the links that a joint carries, the one with the largest inertia for its mass: name, mass [kg]
        and largest moment of inertia [kg m2]."""
        model = self._model
        top = int(model.jnt_bodyid[model.joint(joint).id])
        carried = [top]
        for body in range(top + 1, model.nbody):
            if int(model.body_parentid[body]) in carried:
                carried.append(body)
        inertia = model.body_inertia.max(axis=1)
        body = max(carried, key=lambda one: float(inertia[one] / max(model.body_mass[one], 1e-9)))
        return str(model.body(body).name), float(model.body_mass[body]), float(inertia[body])

    def _on_geom(self, geom: int) -> Array:
        model = self._model
        size = model.geom_size[geom]
        kind = model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            local = self._on_mesh(int(model.geom_dataid[geom]))
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            local = _on_box(size)
        else:
            radius = float(size[0])
            half = float(size[1]) if kind != mujoco.mjtGeom.mjGEOM_SPHERE else radius
            along = np.linspace(-half, half, 40)
            angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
            z, a = (grid.ravel() for grid in np.meshgrid(along, angle))
            r = np.sqrt(np.maximum(radius**2 - z**2, 0.0)) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else radius
            local = np.column_stack([r * np.cos(a), r * np.sin(a), z])
        rotation = self._data.geom_xmat[geom].reshape(3, 3)
        points: Array = local @ rotation.T + self._data.geom_xpos[geom]
        return points

    def _on_mesh(self, mesh: int) -> Array:
        """Returns points (k, 3) [m] that are sampled uniformly over the area of a mesh, in the frame of the
        mesh."""
        model = self._model
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = model.mesh_vert[first : first + count].astype(float)
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        a, b, c = vertices[model.mesh_face[first : first + count]].transpose(1, 0, 2)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        generator = np.random.default_rng(0)
        chosen = generator.choice(len(area), POINTS, p=area / area.sum())
        u, v = generator.uniform(size=(2, POINTS, 1))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        points: Array = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
        return points


def _on_box(half: Array) -> Array:
    grid = np.linspace(-1.0, 1.0, 15)
    u, v = (values.ravel() for values in np.meshgrid(grid, grid))
    one = np.ones_like(u)
    faces = [
        np.column_stack(columns)
        for s in (1.0, -1.0)
        for columns in ((s * one, u, v), (u, s * one, v), (u, v, s * one))
    ]
    points: Array = np.concatenate(faces) * half
    return points


def cone_around(points: Array, origin: Array, axis: Array, begin: float, end: float) -> ConeFit | None:
    """Fits a truncated cone around `points` (n, 3) [m] from `begin` to `end` [m] along a limb's axis.

    The axis starts at `origin` (3,) and points distally along the unit vector `axis` (3,). The cone is
    parallel to this axis, but may lie beside it. The cone is fitted to the points on the outside of the limb,
    and encloses about nine tenths of these points. Returns None if the limb has too few points.
    """
    along = (points - origin) @ axis
    near = points[(along >= begin) & (along <= end)]
    outer = _outermost(near, origin, axis)
    if len(outer) < SECTORS:
        return None
    fit = fit_cone(outer, origin=origin, axis=axis, free="centre")
    along = (outer - fit.origin) @ fit.axis
    distance = np.linalg.norm(outer - fit.origin - along[:, None] * fit.axis, axis=1)
    grow = max(0.0, float(np.quantile(distance - fit.radius(along), INSIDE)))
    start = fit.origin + fit.axis * (begin - float((fit.origin - origin) @ axis))
    radii = fit.radius(np.array([begin, end]) - float((fit.origin - origin) @ axis)) + grow
    # The taper is bounded, because with few points at one end, the radius there could be far too small.
    low, high = sorted(radii)
    low = max(low, 0.7 * high, THINNEST)
    r1, r2 = (low, high) if radii[0] <= radii[1] else (high, low)
    return ConeFit(start, fit.axis, end - begin, r1, r2, fit.rms, fit.largest)


def _outermost(points: Array, origin: Array, axis: Array) -> Array:
    """Returns those of `points` (n, 3) [m] that lie on the outside of a limb, as an array (k, 3) [m]: one
    point for each piece of the limb's surface. A piece is a sector around the limb's axis and a section along
    it. The result is empty for very few points."""
    if len(points) < SECTORS:
        return np.zeros((0, 3))
    side = np.linalg.svd(axis[None])[2][1:]
    relative = points - origin
    middle = relative @ side.T
    centre = (middle.min(axis=0) + middle.max(axis=0)) / 2.0
    x, y = (middle - centre).T
    along = relative @ axis
    sector = np.floor((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    slab = np.minimum((along - along.min()) / (np.ptp(along) + 1e-9) * SLABS, SLABS - 1).astype(int)
    place = sector * SLABS + slab
    order = np.lexsort((-np.hypot(x, y), place))
    first = np.unique(place[order], return_index=True)[1]
    chosen: Array = points[order][first]
    return chosen
