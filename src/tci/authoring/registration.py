"""Whether a skin's positions lie on the link they are said to be on, and the rigid correction if they don't.

Points are matched to a link's mesh by iterated closest points: first point to point from many starts, then
point to plane (Besl and McKay 1992; Chen and Medioni 1992). Nothing is assumed about the file's frame.
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
"""Points that stand for the surface of a link. Ours: on an arm they are 0.5 mm apart."""
OFFSETS = (-0.04, 0.0, 0.04)
"""Starts [m] along each axis of the link. Ours."""
KEPT = 25
"""Starts that are followed to their end. Ours."""
FITS = 0.005
"""Mean distance [m] up to which a skin fits its link: covers are a few millimetres thick. Ours."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkSurface:
    """Points all over the meshes of one link."""

    points: Array
    """(m, 3) [m] in the link."""
    normals: Array
    """(m, 3) of the faces they lie on."""
    tree: cKDTree
    """Of the points."""

    def distances(self, points: Array) -> Array:
        """Distance (n,) [m] of `points` (n, 3) [m] in the link."""
        found: Array = self.tree.query(points)[0]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """How well points lie on a link, as they are and after the best rigid correction that was found."""

    mean: float
    """Mean distance [m] as they are."""
    largest: float
    """[m]"""
    correction: Array
    """`T_LF` (4, 4): the points' frame F in the link L."""
    corrected_mean: float
    """Mean distance [m] after the correction."""
    corrected_largest: float
    """[m]"""

    @property
    def fits(self) -> bool:
        """Whether the points lie on the link as they are."""
        return self.mean <= FITS

    @property
    def mends(self) -> bool:
        """Whether the correction puts points on the link that are not there."""
        return not self.fits and self.corrected_mean <= FITS


@lru_cache(maxsize=8)
def link_surface(robot: Robot, link: str) -> LinkSurface:
    """The surface of a link. Raises DescriptionError when the robot has no model, or the link no mesh."""
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
    """Compare `points` (n, 3) [m] with a link, and look for the correction that brings them onto it.

    Of symmetric limbs several corrections may be as good; the best one found is told. Raises
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
    """Corners (f, 3, 3) [m] of a mesh's faces, in its link."""
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
    """The 24 rotations (3, 3) that take axes to axes."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            rotation = np.zeros((3, 3))
            rotation[range(3), order] = signs
            if np.linalg.det(rotation) > 0.0:
                found.append(rotation)
    return found


def _point_to_point(points: Array, surface: LinkSurface, pose: Array, *, steps: int) -> Array:
    """A better pose (4, 4): the nearest nine tenths of the points go to their nearest neighbours."""
    for _ in range(steps):
        distance, index = surface.tree.query(apply(pose, points))
        near = distance <= np.quantile(distance, 0.9)
        mine, theirs = points[near], surface.points[index[near]]
        U, _, Vt = np.linalg.svd((mine - mine.mean(axis=0)).T @ (theirs - theirs.mean(axis=0)))
        R = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
        pose = transform(R, theirs.mean(axis=0) - R @ mine.mean(axis=0))
    return pose


def _point_to_plane(points: Array, surface: LinkSurface, pose: Array, *, steps: int) -> Array:
    """A better pose (4, 4): the points go to the planes of their nearest neighbours and may slide there."""
    for _ in range(steps):
        here = apply(pose, points)
        distance, index = surface.tree.query(here)
        near = distance <= np.quantile(distance, 0.95)
        mine, normals = here[near], surface.normals[index[near]]
        away = np.einsum("ij,ij->i", surface.points[index[near]] - mine, normals)
        rows = np.hstack([np.cross(mine, normals), normals])
        # A limb that is round leaves a turn open: damping keeps it where it is.
        twist = np.linalg.solve(rows.T @ rows + 1e-9 * len(rows) * np.eye(6), rows.T @ away)
        R = Rotation.from_rotvec(np.clip(twist[:3], -0.1, 0.1)).as_matrix()
        pose = transform(R, twist[3:]) @ pose
    return pose
