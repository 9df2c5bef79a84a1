"""Compares a skin's positions with the mesh of its link, and finds the rigid correction if they do not fit.

Points are matched to the mesh by iterated closest points: first point to point from many starts, then point
to plane (Besl and McKay 1992; Chen and Medioni 1992). Nothing is assumed about the file's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from tci.engine import mujoco
from tci.errors import CommandError, DescriptionError, Fault
from tci.frames import Array, apply, read_only, transform
from tci.robot.description import Robot
from tci.robot.model_file import compiled, load_spec

DENSITY = 200_000
"""Number of points that represent the surface of a link. Assumed: on an arm they are 0.5 mm apart."""
OFFSETS = (-0.04, 0.0, 0.04)
"""Offsets [m] of the starts along each axis of the link. Assumed: about the radius of a limb, so that one
start is near the solution."""
KEPT = 25
"""Number of best starts that are refined. Assumed; fewer may miss the solution, more take longer."""
FITS = 0.005
"""Mean distance [m] up to which a skin fits its link. Assumed: covers are a few millimetres thick."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkSurface:
    """Points sampled on the meshes of one link."""

    points: Array
    """Points (m, 3) [m] in the link."""
    normals: Array
    """Normals (m, 3) of the faces that the points lie on."""
    tree: cKDTree
    """Search tree of the points."""

    def distances(self, points: Array) -> Array:
        """Returns the distances (n,) [m] of `points` (n, 3) [m] in the link from the surface."""
        found: Array = self.tree.query(points)[0]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Distances of points from a link, as they are and after the best rigid correction that was found."""

    mean: float
    """Mean distance [m] without correction."""
    largest: float
    """Largest distance [m] without correction."""
    correction: Array
    """`T_LF` (4, 4): pose of the points' frame F in the link L."""
    corrected_mean: float
    """Mean distance [m] after the correction."""
    corrected_largest: float
    """Largest distance [m] after the correction."""

    @property
    def fits(self) -> bool:
        """True if the points lie on the link without correction."""
        return self.mean <= FITS

    @property
    def mends(self) -> bool:
        """True if the points lie on the link only after the correction."""
        return not self.fits and self.corrected_mean <= FITS


@lru_cache(maxsize=8)
def link_surface(robot: Robot, link: str) -> LinkSurface:
    """Returns the surface of a link. Raises DescriptionError without a model of the robot or mesh of the
    link."""
    if robot.model is None:
        raise DescriptionError(robot.source, [Fault(0, "no <model>: a surface needs a URDF or MJCF file")])
    model = compiled(load_spec(robot.model), robot.model)
    names = [model.body(index).name for index in range(model.nbody)]
    meshes = [
        _mesh(model, geom)
        for geom in range(model.ngeom)
        if names[model.geom_bodyid[geom]] == link and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH
    ]
    if not meshes:
        fault = f"link {link!r} has no mesh to compare with; valid: a link of the model that has one"
        raise DescriptionError(robot.model.path, [Fault(0, fault)])
    corners = np.concatenate(meshes)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    random = np.random.default_rng(0)
    face = random.choice(len(corners), DENSITY, p=areas / areas.sum())
    shares = random.dirichlet((1.0, 1.0, 1.0), DENSITY)
    points = np.einsum("nc,nci->ni", shares, corners[face])
    return LinkSurface(read_only(points), read_only(normals[face] / areas[face, None]), cKDTree(points))


def register(points: Array, surface: LinkSurface) -> Registration:
    """Compares `points` (n, 3) [m] with a link, and finds the correction that brings them onto it.

    For a symmetric limb several corrections may be equally good; one of the best is returned. Raises
    CommandError for fewer than 10 points or ones that are not finite.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 10 or not np.isfinite(points).all():
        raise CommandError(f"points of shape {points.shape}; valid: at least 10 finite rows of x y z [m]")
    before = surface.distances(points)
    some = points[np.random.default_rng(0).choice(len(points), min(60, len(points)), replace=False)]
    starts = [(np.eye(3), np.zeros(3))]
    for R in _right_angles():
        for offset in product(OFFSETS, repeat=3):
            starts.append((R, surface.points.mean(axis=0) + offset - R @ points.mean(axis=0)))
    tried = []
    for R, p in starts:
        pose = _point_to_point(some, surface, transform(R, p), steps=12)
        tried.append((float(surface.distances(apply(pose, some)).mean()), pose))
    tried.sort(key=lambda one: one[0])
    best, least = np.eye(4), float(before.mean())
    for _, pose in tried[:KEPT]:
        found = _point_to_plane(points, surface, _point_to_point(points, surface, pose, steps=10), steps=60)
        mean = float(surface.distances(apply(found, points)).mean())
        if mean < least:
            best, least = found, mean
    after = surface.distances(apply(best, points))
    return Registration(
        mean=float(before.mean()), largest=float(before.max()), correction=read_only(best),
        corrected_mean=float(after.mean()), corrected_largest=float(after.max()),
    )  # fmt: skip


def _mesh(model: mujoco.MjModel, geom: int) -> Array:
    """Returns the corners (f, 3, 3) [m] of a mesh's faces, in its link."""
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    begin, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    T_LG = transform(rotation.reshape(3, 3), model.geom_pos[geom])
    corners: Array = apply(T_LG, model.mesh_vert[first : first + count])[
        model.mesh_face[begin : begin + faces]
    ]
    return corners


def _right_angles() -> list[Array]:
    """Returns the 24 rotations (3, 3) that map axes to axes."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            rotation = np.zeros((3, 3))
            rotation[range(3), order] = signs
            if np.linalg.det(rotation) > 0.0:
                found.append(rotation)
    return found


def _point_to_point(points: Array, surface: LinkSurface, pose: Array, *, steps: int) -> Array:
    """Returns an improved pose (4, 4): moves nine tenths of the points, the nearest ones, to their
    neighbours."""
    for _ in range(steps):
        distance, index = surface.tree.query(apply(pose, points))
        near = distance <= np.quantile(distance, 0.9)
        mine, theirs = points[near], surface.points[index[near]]
        U, _, Vt = np.linalg.svd((mine - mine.mean(axis=0)).T @ (theirs - theirs.mean(axis=0)))
        R = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
        pose = transform(R, theirs.mean(axis=0) - R @ mine.mean(axis=0))
    return pose


def _point_to_plane(points: Array, surface: LinkSurface, pose: Array, *, steps: int) -> Array:
    """Returns an improved pose (4, 4) that moves points onto the planes of their nearest neighbours, where
    they may slide."""
    for _ in range(steps):
        here = apply(pose, points)
        distance, index = surface.tree.query(here)
        near = distance <= np.quantile(distance, 0.95)
        mine, normals = here[near], surface.normals[index[near]]
        away = np.einsum("ij,ij->i", surface.points[index[near]] - mine, normals)
        rows = np.hstack([np.cross(mine, normals), normals])
        # A round limb leaves the turn about its axis undetermined: damping makes it zero.
        twist = np.linalg.solve(rows.T @ rows + 1e-9 * len(rows) * np.eye(6), rows.T @ away)
        R = Rotation.from_rotvec(np.clip(twist[:3], -0.1, 0.1)).as_matrix()
        pose = transform(R, twist[3:]) @ pose
    return pose
