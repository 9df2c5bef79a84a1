"""Points on the outer surface of links, and the cone of skin around them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.engine import mujoco
from tci.exports.cone import ConeFit, fit_cone
from tci.frames import Array
from tci.robot.description import Model
from tci.robot.model_file import compiled, load_spec

POINTS = 6000
"""Number of points on one mesh. Assumed; fewer leave pieces of a limb without points, more take longer."""
SECTORS, SLABS = 24, 12
"""Number of pieces around and along a limb; the outermost point of each is used. Assumed; fewer ignore the
limb's shape, more need more points."""
INSIDE = 0.9
"""Fraction of these points inside the skin. Assumed: single points that stick out do not widen it."""
THINNEST = 0.02
"""Least radius [m] of a skin. Assumed: thinner than any humanoid's forearm."""


class LinkPoints:
    """Samples points on the shapes of a model's links, at the model's zero."""

    def __init__(self, model: Model) -> None:
        """Raises what `load_spec` raises, and DescriptionError for a mesh that MuJoCo can't read."""
        self._model = compiled(load_spec(model), model)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)

    def of(self, links: Iterable[str]) -> Array:
        """Returns points (n, 3) [m] on links and on everything fixed to them, in the root's frame."""
        bodies = {self._model.body(link).id for link in links}
        for body in range(1, self._model.nbody):
            if self._model.body_parentid[body] in bodies and not self._model.body_jntnum[body]:
                bodies.add(body)
        geoms = [geom for geom in range(self._model.ngeom) if int(self._model.geom_bodyid[geom]) in bodies]
        found = [self._on_geom(geom) for geom in geoms]
        return np.concatenate([np.zeros((0, 3)), *found])

    def link_pose(self, link: str) -> tuple[Array, Array]:
        """Returns `R_RL` (3, 3) and `p_RL` (3,) [m] of a link in the root's frame."""
        body = self._model.body(link).id
        return self._data.xmat[body].reshape(3, 3), self._data.xpos[body]

    def inertia(self, joints: Iterable[str]) -> Array:
        """Returns the largest inertia (k,) [kg m2] that each joint carries in 32 random postures."""
        model, data = self._model, self._data
        generator = np.random.default_rng(0)
        full = np.zeros((model.nv, model.nv))
        most = np.zeros(model.nv)
        for _ in range(32):
            data.qpos[:] = generator.uniform(-1.5, 1.5, model.nq)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_crb(model, data)
            mujoco.mj_fullM(model, data, full)
            most = np.maximum(most, np.diag(full))
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        return most[[int(model.joint(joint).dofadr[0]) for joint in joints]]

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
        """Samples points uniformly over the area of a mesh."""
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

    The axis starts at `origin` (3,) and points distally along the unit vector `axis` (3,); the cone may lie
    beside it. It encloses nine tenths of the outermost points. Returns None where the limb has too few
    points.
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
    # Bounds the taper, as few points at one end can make one radius far too small.
    low, high = sorted(radii)
    low = max(low, 0.7 * high, THINNEST)
    r1, r2 = (low, high) if radii[0] <= radii[1] else (high, low)
    return ConeFit(start, fit.axis, end - begin, r1, r2, fit.rms, fit.largest)


def _outermost(points: Array, origin: Array, axis: Array) -> Array:
    """Returns the outermost point (k, 3) of each piece of the limb's surface."""
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
