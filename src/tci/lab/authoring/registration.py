"""Compares taxel positions with the mesh of their link, and finds a rigid correction if they do not fit.

Points are matched to the mesh by iterated closest points: first point to point from many start poses, then
point to plane (Besl and McKay 1992; Chen and Medioni 1992). The positions may be given in any frame: the
correction is then the pose of that frame in the link.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from tci.errors import CommandError, DescriptionError, Fault
from tci.messages.frames import Array, apply, invert, read_only, transform
from tci.robot.description import Model, Robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.robot.model_file import compiled, load_spec
from tci.support.engine import mujoco

DENSITY = 200_000
"""Number of points that are sampled on the surface of a link. Assumed: on an arm, neighbouring points are 0.5
mm apart."""
OFFSETS = (-0.04, 0.0, 0.04)
"""Offsets [m] of the start poses along each axis of the link. Assumed: about the radius of a limb, so that at
least one start pose is near the solution."""
SEARCH = ((3, 120), (9, 25))
"""For each stage of the search: number of steps, and number of best poses that the next stage continues.
Assumed: with fewer poses, the solution may be missed; with more poses, the search takes longer."""
REFINED = 3
"""Number of poses that are refined with all points. These are the best poses after a refinement with only
some of the points. Assumed: the best pose of all is among them."""
COARSE = 10
"""Before the last refinement, only every COARSE-th point of the surface is used. Assumed: on an arm, these
points are 1.5 mm apart."""
STILL = 1e-5
"""Refinement ends when a step moves the pose by less than this angle [rad] and distance [m]. Assumed: far
below the distances between points."""
ALIKE = 0.0005
"""If two corrections lead to mean distances of the taxels from the mesh that differ by at most this length
[m], the smaller correction is used. Assumed: this is the accuracy of meshes. For example, a flat sole fits
its link equally well when it is turned by 180 degrees."""
FITS = 0.005
"""Mean distance [m] up to which a skin fits its link. Assumed: covers are a few millimetres thick."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkSurface:
    """Points sampled on the meshes of one link."""

    points: Array
    """Points (m, 3) [m] in the frame of the link."""
    normals: Array
    """Normals (m, 3) of the faces that the points lie on."""
    tree: cKDTree
    """Search tree of the points."""

    def thinned(self, step: int) -> LinkSurface:
        """Returns the surface with every `step`-th of its points, which are in random order."""
        points = self.points[::step]
        return LinkSurface(points, self.normals[::step], cKDTree(points))

    def distances(self, points: Array) -> Array:
        """Returns the distances (n,) [m] from the surface to `points` (n, 3) [m], which are in the link's
        frame."""
        found: Array = self.tree.query(points)[0]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Distances of points, such as taxels, from the surface of a link: before and after the rigid motion (the
    correction) that brings the points closest to the surface."""

    mean: float
    """Mean distance [m] of the points from the surface, without correction."""
    largest: float
    """Largest distance [m] of a point from the surface, without correction."""
    correction: Array
    """`T_LF` (4, 4): pose of the points' frame F in the link L."""
    corrected_mean: float
    """Mean distance [m] of the points from the surface, after the correction."""
    corrected_largest: float
    """Largest distance [m] of a point from the surface, after the correction."""

    @property
    def fits(self) -> bool:
        """True if the points are on the link without correction: the mean distance is at most 5 mm."""
        return self.mean <= FITS

    @property
    def mends(self) -> bool:
        """True if the points are on the link only after the correction."""
        return not self.fits and self.corrected_mean <= FITS


@lru_cache(maxsize=1)  # cached, because all patches of a robot use one model
def _compiled(file: Model) -> mujoco.MjModel:
    return compiled(load_spec(file), file)


@lru_cache(maxsize=8)
def link_surface(robot: Robot, *links: str, frame: str | None = None) -> LinkSurface:
    """Returns the surface of several links together in the initial posture, in the frame of the link `frame`
    or else of the first. Raises DescriptionError if the robot has no model, if the links have no mesh, or if
    one has other shapes only: a pad on a palm that is a box is not measured against the wrist's mesh."""
    if robot.model is None:
        raise DescriptionError(robot.source, [Fault(0, "no <model>: a surface needs a URDF or MJCF file")])
    model = _compiled(robot.model)
    names = [model.body(index).name for index in range(model.nbody)]
    own = frame or links[0]
    poses = KinematicChain(robot).poses(initial_position(robot), [own, *links])
    T_LR = invert(poses[own])
    meshes = [
        apply(T_LR @ poses[names[model.geom_bodyid[geom]]], _mesh(model, geom).reshape(-1, 3)).reshape(
            -1, 3, 3
        )
        for geom in range(model.ngeom)
        if names[model.geom_bodyid[geom]] in links and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH
    ]
    shapes = [(names[model.geom_bodyid[geom]], model.geom_type[geom]) for geom in range(model.ngeom)]
    meshed = {link for link, kind in shapes if kind == mujoco.mjtGeom.mjGEOM_MESH}
    if not meshes or any(link in links and link not in meshed for link, _ in shapes):
        fault = (
            f"link {' '.join(links)!r} has no mesh to compare with, or shapes beside it that are no meshes; "
            "valid: a link of the model that has one"
        )
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
    """Compares `points` (n, 3) [m] with the surface of a link, and finds a correction if they do not fit.

    On a symmetric limb several corrections may be equally good; in this case the function returns one of
    these corrections, and prefers a small correction. Raises CommandError for fewer than 10 points, or for
    points that are not finite.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 10 or not np.isfinite(points).all():
        raise CommandError(f"points of shape {points.shape}; valid: at least 10 finite rows of x y z [m]")
    before = surface.distances(points)
    if before.mean() <= FITS:
        return _registration(before, np.eye(4), before)
    coarse = surface.thinned(COARSE)
    some = points[np.random.default_rng(0).choice(len(points), min(60, len(points)), replace=False)]
    poses = _starts(points, surface)
    for steps, kept in SEARCH:
        poses = _best(_point_to_point(some, coarse, poses, steps=steps), some, coarse, kept)
    poses = _best(_point_to_plane(some, coarse, poses, steps=20), some, coarse, REFINED)
    (best,) = _best(_point_to_plane(points, surface, poses, steps=60), points, surface, 1)
    (small,) = _point_to_plane(points, surface, np.eye(4)[None], steps=60)
    after, after_small = (surface.distances(apply(pose, points)) for pose in (best, small))
    if after_small.mean() <= after.mean() + ALIKE:
        best, after = small, after_small
    if after.mean() >= before.mean():
        return _registration(before, np.eye(4), before)
    return _registration(before, best, after)


def _registration(before: Array, correction: Array, after: Array) -> Registration:
    """Summarises the distances (n,) [m] of taxels from a mesh before and after a correction (4, 4)."""
    return Registration(
        mean=float(before.mean()), largest=float(before.max()), correction=read_only(correction),
        corrected_mean=float(after.mean()), corrected_largest=float(after.max()),
    )  # fmt: skip


def _mesh(model: mujoco.MjModel, geom: int) -> Array:
    """Returns the three corners of each of the f triangles of a mesh, as an array (f, 3, 3) [m] in the frame
    of its link."""
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
    """Returns the 24 rotations (3, 3) by multiples of 90 degrees about the axes."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            rotation = np.zeros((3, 3))
            rotation[range(3), order] = signs
            if np.linalg.det(rotation) > 0.0:
                found.append(rotation)
    return found


def _starts(points: Array, surface: LinkSurface) -> Array:
    """Returns poses (s, 4, 4) at which the search for a correction starts.

    The first pose is the identity. The others turn the points by each of the 24 rotations by multiples of 90
    degrees, and move their centre to 27 places at and around the centre of the surface.
    """
    centre, theirs = points.mean(axis=0), surface.points.mean(axis=0)
    return np.array(
        [np.eye(4)]
        + [
            transform(R, theirs + offset - R @ centre)
            for R in _right_angles()
            for offset in product(OFFSETS, repeat=3)
        ]
    )


def _best(poses: Array, points: Array, surface: LinkSurface, count: int) -> Array:
    """Returns the `count` best of `poses` (s, 4, 4): those that bring the points closest to the surface."""
    far = surface.tree.query(_placed(poses, points))[0].mean(axis=1)
    best: Array = poses[np.argsort(far, kind="stable")[:count]]
    return best


def _placed(poses: Array, points: Array) -> Array:
    """Returns `points` (n, 3) [m] moved by each of `poses` (s, 4, 4), as an array (s, n, 3)."""
    placed: Array = points @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
    return placed


def _nearest(distance: Array, share: float) -> Array:
    """Selects, for each of s poses, the fraction `share` of n points with the smallest `distance` (s, n).
    Returns weights (s, n, 1): 1 for a selected point, 0 for the others.
    """
    last = max(0, int(np.ceil(share * distance.shape[1])) - 1)
    farthest = np.partition(distance, last, axis=1)[:, last : last + 1]
    return (distance <= farthest)[:, :, None].astype(np.float64)


def _point_to_point(points: Array, surface: LinkSurface, poses: Array, *, steps: int) -> Array:
    """Returns `poses` (s, 4, 4) improved such that they bring `points` (n, 3) [m] closer to the surface.

    The tenth of the points that is farthest from the surface is ignored.
    """
    for _ in range(steps):
        distance, index = surface.tree.query(_placed(poses, points))
        weights, theirs = _nearest(distance, 0.9), surface.points[index]
        total = weights.sum(axis=1)
        here, there = (weights * points).sum(axis=1) / total, (weights * theirs).sum(axis=1) / total
        spread = (weights * (points - here[:, None])).swapaxes(1, 2) @ (theirs - there[:, None])
        U, _, Vt = np.linalg.svd(spread)
        U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]  # excludes mirror images
        R = (U @ Vt).swapaxes(1, 2)
        poses = poses.copy()
        poses[:, :3, :3], poses[:, :3, 3] = R, there - np.einsum("sij,sj->si", R, here)
    return poses


def _point_to_plane(points: Array, surface: LinkSurface, poses: Array, *, steps: int) -> Array:
    """Returns `poses` (s, 4, 4) improved such that they bring `points` (n, 3) [m] closer to the surface.

    Only the distances perpendicular to the surface count; the points may slide along the surface.
    """
    for _ in range(steps):
        here = _placed(poses, points)
        distance, index = surface.tree.query(here)
        normals = surface.normals[index]
        away = np.einsum("snj,snj->sn", surface.points[index] - here, normals)
        rows = np.concatenate([np.cross(here, normals), normals], axis=2)
        weighed = (_nearest(distance, 0.95) * rows).swapaxes(1, 2)
        # On a round limb, the points do not determine the turn about the limb's axis: damping keeps this turn
        # at zero.
        square = weighed @ rows + 1e-9 * len(points) * np.eye(6)
        twist = np.linalg.solve(square, weighed @ away[:, :, None])[:, :, 0]
        turns = Rotation.from_rotvec(np.clip(twist[:, :3], -0.1, 0.1)).as_matrix()
        moves = np.array([transform(R, p) for R, p in zip(turns, twist[:, 3:], strict=True)])
        poses = moves @ poses
        if np.abs(twist).max() < STILL:
            break
    return poses
