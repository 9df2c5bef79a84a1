"""The skin of a robot as surfaces: taxels, outward normals, neighbours, and the faces between taxels.

A patch is described as a truncated cone (eqs 3-4), a grid, triangular modules at frames of the kinematic
model, or a table of positions. All of them become a `Surface`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array, apply, invert, read_only, rotation_rpy, rotation_z, transform
from tci.robot.description import Grid, Patch, Robot, TriangularModules, TruncatedCone
from tci.robot.kinematics import KinematicChain
from tci.robot.near_points import nearest, pairs_within
from tci.robot.per_robot import per_robot
from tci.robot.skin_files.file import MODULE_PITCH
from tci.robot.skin_files.table import read_table
from tci.skin.nearest import nearest_on_faces
from tci.skin.triangulation import outward, triangulate

NEIGHBOUR_DISTANCE = 0.015
"""Upper bound [m] on the distance of neighbouring taxels. This value is the largest one in the settings of
iCub's skinManager."""

PITCHES = 2.3
"""Largest distance between neighbouring taxels, as a multiple of the pitch of the patch's lattice of taxels.
On an iCub this distance is 15 mm. Assumed: a failed taxel must not divide a contact, so the value is above
two steps of the lattice."""

GAP = 0.025
"""Width [m] of the widest gap in a skin over which taxels can be neighbours. Assumed: the widest gap in an
iCub's skin is 19 mm."""

CHANNELS_PER_MODULE = 12

_LATTICE = {
    0: (-1, 1), 1: (-1, 2), 2: (0, 1), 3: (0, 0), 4: (1, 0),
    5: (2, -1), 7: (1, -1), 8: (0, -1), 9: (-1, -1), 11: (-1, 0),
}  # fmt: skip
"""Place of each taxel on a triangular module of the iCub's skin, by channel: steps along two lattice axes 60
degrees apart. Taxel 3 is the centre.

Channels 6 and 10 are thermal pads. The places were derived from the positions in pyCub, and agree with the
positions of every module within 0.03 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The taxels of one patch, in the frame of its link."""

    patch: str
    """Name of the patch."""
    link: str
    """Link of the kinematic model on which the patch is."""
    positions: Array
    """Taxel positions (n, 3) [m] in the frame of the link."""
    normals: Array
    """Outward unit normals (n, 3) in the frame of the link."""
    areas: Array
    """Area (n,) [m2] that each taxel represents."""
    channels: NDArray[np.intp]
    """Index (n,) of each taxel's value in the raw frame."""
    neighbours: NDArray[np.intp]
    """Pairs (m, 2) of neighbouring taxels, each pair once. Neighbours are near each other, and not on
    opposite sides of a thin limb. Taxels under one rigid plate are all neighbours of each other."""
    faces: NDArray[np.intp]
    """Triangles (f, 3) of taxel indices. Seen from outside, the corners run anticlockwise.

    All taxels are corners, so the projection of a taxel onto the surface is the taxel itself. The simulation
    uses the convex hull of the faces for collisions. If all taxels are on one line, there are no faces."""
    tangents: Array | None = None
    """Unit x axes (n, 3) of three-axis taxels, in the frame of the link. The y axis is the cross product of
    normal and x axis. None means default axes: projections of the link's x axis or y axis (see the function
    `tangents`)."""

    def project(self, points: Array) -> tuple[Array, Array]:
        """Returns the points of the surface that are nearest to `points` (k, 3) [m].

        Also returns the surface normals (k, 3) at these nearest points (k, 3) [m]. All points and normals are
        in the frame of the link. `points` may be inside the limb, since a centre of pressure is inside. If
        the surface has no faces, the nearest taxel is returned.
        """
        if not len(self.faces):
            near = nearest(self.positions, points)[1].ravel()
            return self.positions[near], self.normals[near]
        corners, weights, found = nearest_on_faces(self.positions, self.faces, points)
        normals = np.einsum("kc,kci->ki", weights, self.normals[corners])
        return found, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def build_surface(robot: Robot, patch: Patch, kinematics: KinematicChain) -> Surface:
    """Builds the surface of one patch.

    Raises DescriptionError if a table can't be read, or if the frame of a module is not fixed to the patch's
    link. Also raises DescriptionError if the patch has fewer channels than its taxels need. Raises
    UnknownNameError for a link or frame that the model does not have.
    """
    description = patch.surface
    across: Array | None = None
    kinematics.poses(np.zeros(len(robot.servos)), [patch.link])  # raises when there is no such link
    if isinstance(description, TruncatedCone):
        positions, normals, areas, faces = _cone(description)
        channels = np.arange(len(positions))
    elif isinstance(description, Grid):
        positions, normals, areas = grid_taxels(description)
        channels, faces = np.arange(len(positions)), triangulate(positions, normals)
    elif isinstance(description, TriangularModules):
        positions, normals, areas, channels = _modules(robot, patch, description, kinematics)
        faces = triangulate(positions, normals)
    else:
        layout = read_table(robot, patch, description)
        channels = layout.taxels
        across = None if layout.tangents is None else layout.tangents[channels]
        positions, normals, areas = (
            values[channels] for values in (layout.positions, layout.normals, layout.areas)
        )
        faces = triangulate(positions, normals)
    mount = patch.mount
    positions, normals = apply(mount, positions), normals @ mount[:3, :3].T
    across = None if across is None else read_only(across @ mount[:3, :3].T)
    needed = patch.sensor.axes * (int(channels.max()) + 1)
    if needed > patch.channels:
        message = f"patch {patch.name}: it has {patch.channels} channels; its taxels need {needed}"
        raise DescriptionError(robot.source, [Fault(0, message)])
    if patch.rigid:
        neighbours = np.array(list(combinations(range(len(positions)), 2)), np.intp).reshape(-1, 2)
    else:
        neighbours = find_neighbours(positions, normals, patch.neighbours)
    return Surface(
        patch=patch.name,
        link=patch.link,
        positions=read_only(positions),
        normals=read_only(normals),
        areas=read_only(areas),
        channels=read_only(channels, np.intp),
        neighbours=read_only(neighbours, np.intp),
        faces=read_only(outward(faces, positions, normals), np.intp),
        tangents=across,
    )


@per_robot
def surfaces_of(robot: Robot) -> tuple[Surface, ...]:
    """Returns the surface of every patch, in the robot's order of patches.

    Raises the errors that KinematicChain and build_surface raise.
    """
    kinematics = KinematicChain(robot)
    return tuple(build_surface(robot, patch, kinematics) for patch in robot.patches)


def tangents(normals: Array) -> Array:
    """Returns default x axes (n, 3) of taxels, unit vectors perpendicular to `normals` (n, 3).

    The x axes are projections of the link's x axis. If the link's x axis is within 18 degrees of the normal,
    the link's y axis is projected instead. Assumed, since the description does not define these axes.
    """
    steep = np.abs(normals[:, :1]) > 0.95
    guide = np.where(steep, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    along = guide - np.einsum("ni,ni->n", guide, normals)[:, None] * normals
    result: Array = along / np.linalg.norm(along, axis=1, keepdims=True)
    return result


def _cone(cone: TruncatedCone) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Returns positions (n, 3) [m], outward normals (n, 3), areas (n,) [m2] and triangles (f, 3) of the
    taxels on a cone (eqs 3-4).

    Positions and normals are in the frame of the patch's link. The first and the last ring of taxels are at
    the ends of the cone.
    """
    ring, place = np.divmod(np.arange(cone.rings * cone.per_ring), cone.per_ring)
    share = ring / (cone.rings - 1) if cone.rings > 1 else np.full(len(ring), 0.5)
    x = cone.length * share
    theta = 2.0 * np.pi * (place + 0.5 * (ring % 2)) / cone.per_ring
    radius = cone.r1 + (cone.r2 - cone.r1) * share
    slope = (cone.r2 - cone.r1) / cone.length
    cos, sin = np.cos(theta), np.sin(theta)
    positions = np.column_stack([radius * cos, radius * sin, -x])
    normals = np.column_stack([cos, sin, np.full(len(ring), slope)]) / np.hypot(1.0, slope)
    area = np.pi * (cone.r1 + cone.r2) * np.hypot(cone.length, cone.r2 - cone.r1)
    pose = transform(rotation_rpy(*cone.rpy), np.array(cone.origin))
    areas = np.full(len(ring), area / len(ring))
    return apply(pose, positions), normals @ pose[:3, :3].T, areas, _ring_strips(cone.rings, cone.per_ring)


def grid_taxels(grid: Grid) -> tuple[Array, Array, Array]:
    """Returns positions (n, 3) [m], outward normals (n, 3) and areas (n,) [m2] of the taxels of a pad, in the
    frame of its link and in the order of a frame."""
    count = grid.rows * grid.columns
    if grid.order == "row-major":
        row, column = np.divmod(np.arange(count), grid.columns)
    else:
        column, row = np.divmod(np.arange(count), grid.rows)
    x = ((row + 0.5) / grid.rows - 0.5) * grid.length
    y = ((column + 0.5) / grid.columns - 0.5) * grid.width * (-1.0 if grid.mirrored else 1.0)
    pose = grid.T_LP
    positions = apply(pose, np.column_stack([x, y, np.zeros(count)]))
    return positions, np.tile(pose[:3, 2], (count, 1)), np.full(count, grid.length * grid.width / count)


def _ring_strips(rings: int, per_ring: int) -> NDArray[np.intp]:
    """Returns the triangles (f, 3) between each ring of taxels on a cone and the next ring, as indices of
    taxels.

    Each ring has `per_ring` taxels. Successive rings are turned against each other by half the distance
    between two taxels.
    """
    if rings < 2 or per_ring < 2:
        return np.zeros((0, 3), np.intp)  # taxels on one line, or in one plane across
    here = np.arange(per_ring)
    following = (here + 1) % per_ring
    strips = []
    for ring in range(rings - 1):
        # `ahead` is the ring whose taxels lie half a step after the other's.
        behind, ahead = (ring, ring + 1) if ring % 2 == 0 else (ring + 1, ring)
        a, b = behind * per_ring, ahead * per_ring
        strips.append(np.column_stack([a + here, a + following, b + here]))
        strips.append(np.column_stack([b + here, a + following, b + following]))
    return np.concatenate(strips)


def _modules(
    robot: Robot, patch: Patch, modules: TriangularModules, kinematics: KinematicChain
) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Returns positions (n, 3) [m], outward normals (n, 3), areas (n,) [m2] and channels (n,) of the taxels
    on the flat modules of a patch.

    Positions and normals are in the frame of the patch's link. The z axes of the modules' frames must point
    outward.
    """
    poses = _frames(robot, patch, modules, kinematics)
    turns = modules.turns or (0.0,) * len(poses)
    steps = np.array(list(_LATTICE.values()), dtype=np.float64)
    template = np.column_stack(
        [steps[:, 0] + 0.5 * steps[:, 1], np.sqrt(0.75) * steps[:, 1], np.zeros(len(steps))]
    )
    turned = [MODULE_PITCH * template @ rotation_z(turn).T for turn in turns]
    positions = np.concatenate([apply(pose, taxels) for pose, taxels in zip(poses, turned, strict=True)])
    normals = np.repeat([pose[:3, 2] for pose in poses], len(_LATTICE), axis=0)
    # Each taxel of a triangular lattice stands for one hexagon.
    areas = np.full(len(positions), np.sqrt(0.75) * MODULE_PITCH**2)
    channels = CHANNELS_PER_MODULE * np.array(modules.ports)[:, None] + np.array(list(_LATTICE))
    return positions, normals, areas, channels.ravel()


def _frames(
    robot: Robot, patch: Patch, modules: TriangularModules, kinematics: KinematicChain
) -> list[Array]:
    """Returns the pose `T_LF` (4, 4) of each module's frame F in the frame of the patch's link. Raises
    DescriptionError if a joint is between a module and the link."""
    found = []
    for angle in (0.0, 0.3):
        poses = kinematics.poses(np.full(len(robot.servos), angle), [patch.link, *modules.frames])
        T_LT = invert(poses[patch.link])
        found.append([T_LT @ poses[frame] for frame in modules.frames])
    moving = [
        frame
        for frame, before, after in zip(modules.frames, *found, strict=True)
        if not np.allclose(before, after, atol=1e-9)
    ]
    if moving:
        message = (
            f"patch {patch.name}: {', '.join(moving)} moves against link {patch.link}; a joint is between"
        )
        raise DescriptionError(robot.source, [Fault(0, message)])
    return found[0]


def lattice_pitch(positions: Array) -> float:
    """Returns the pitch [m] of the lattice of taxels at `positions` (n, 3) [m].

    The pitch is the median distance of a taxel to its third nearest taxel. The first and second nearest are
    not used, since their distances can be too small in files with rounded positions. The pitch is infinite
    for fewer than four taxels.
    """
    places = np.unique(positions, axis=0)
    if len(places) < 4:
        return float("inf")
    return float(np.median(nearest(places, places, 4)[0][:, 3]))


def neighbour_distance(positions: Array) -> float:
    """Returns the default for the largest distance [m] at which two taxels are neighbours.

    `positions` (n, 3) [m] are the positions of all taxels.
    """
    return min(PITCHES * lattice_pitch(positions), NEIGHBOUR_DISTANCE)


def find_neighbours(positions: Array, normals: Array, distance: float | None = None) -> NDArray[np.intp]:
    """Returns pairs (m, 2) of neighbouring taxels, which are near each other and have similar normals.

    In a pair, the lower index is first. Taxels are near each other if their distance is at most `distance`
    [m]. If `distance` is None, a limit that follows from the spacing of the taxels (`neighbour_distance`) is
    used instead. In this case, two taxels on opposite sides of a wider gap are also neighbours if the ball
    between them contains no other taxel (Gabriel and Sokal 1969). The reason: one finger on the gap presses
    both taxels.
    """
    near = neighbour_distance(positions) if distance is None else distance
    widest = GAP if distance is None else distance
    pairs = pairs_within(positions, widest)
    facing = np.einsum("pi,pi->p", normals[pairs[:, 0]], normals[pairs[:, 1]]) > 0.0
    pairs = pairs[facing]
    one, other = positions[pairs[:, 0]], positions[pairs[:, 1]]
    gap = np.linalg.norm(one - other, axis=1)
    kept = gap <= near
    middle = 0.5 * (one + other)[~kept]
    kept[~kept] = nearest(positions, middle)[0].ravel() >= 0.5 * gap[~kept] * (1.0 - 1e-9)
    pairs = pairs[kept]
    result: NDArray[np.intp] = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return result
