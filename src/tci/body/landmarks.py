"""Landmarks and distances on skin without limb coordinates: torso, head, palm, sole.

Receptive fields on this skin are discs: the centre of a field is a landmark, and its radius is a geodesic
distance. The geodesic distance is the length of the shortest path over the skin's faces, from taxel to taxel
(Dijkstra 1959). The computed length is at most a few percent too long.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.body.places import Place, leave_surface
from tci.errors import TciError
from tci.messages import Contact, Landmark
from tci.messages.frames import Array, read_only
from tci.robot.description import GenericPart, Patch
from tci.robot.joint_map import initial_position, joint_map
from tci.skin.nearest import nearest_on_faces
from tci.skin.skin import Skin
from tci.skin.surfaces import Surface

NEAR = 0.04
"""Distance [m] up to which points of a skin count as directly connected. Assumed: with a larger value paths
would cross gaps without skin; with a smaller value a patch with gaps between its modules would be split."""
TURNED = 0.5
"""Least cosine between the normals of directly connected points. Assumed: the normals differ by at most 60
degrees, so that no path passes through a thin limb to its other side."""
STEPS = 3
"""Largest number of mesh edges that one step of a path may span. Assumed: with 1 edge a path is up to 15 %
too long, with 3 edges a few percent."""
FACING = 0.2
"""Least cosine between the skin's normal at a landmark and the direction of the ray that defines the
landmark. Assumed: with this value, a landmark in the direction of the back of the hand is never found on the
palm."""


@dataclass(frozen=True, slots=True, eq=False)
class _Reach:
    """A landmark on one patch, and the geodesic distances from it to the points of the patch."""

    place: Place
    distances: Array
    """Geodesic distance (n,) [m] of every taxel of the patch from the landmark."""


class Landmarks:
    """Landmarks on one robot's skin. Their maps of distances are made when they are first needed."""

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._found: dict[tuple[str, Landmark], _Reach | None] = {}
        self._edges: dict[str, NDArray[np.intp]] = {}

    def place(self, part: str, landmark: Landmark) -> Place:
        """Returns the point of a landmark on a part's skin.

        Raises TciError if the part has no skin at this landmark, UnknownNameError for an unknown part.
        """
        reach = self._reach(part, landmark)
        if reach is None:
            where = landmark.segment or "no segment"
            raise TciError(f"{self._skin.robot.name} has no skin on {where} of {part}")
        return reach.place

    def around(self, part: str, landmark: Landmark, radius: float) -> tuple[str, NDArray[np.bool_]] | None:
        """Returns the patch of a landmark, and a mask (n,) of the patch's taxels that are nearer than
        `radius` [m] to the landmark. Returns None if the part has no skin at this landmark.
        """
        reach = self._reach(part, landmark)
        return None if reach is None else (reach.place.patch, reach.distances < radius)

    def distances(self, contact: Contact, landmarks: Sequence[Landmark]) -> list[float]:
        """Geodesic distance [m] of a contact from each of several landmarks of its part; infinite if contact
        and landmark are on different patches."""
        point, normal, around = contact.p_L, contact.n_L, None
        found = []
        for landmark in landmarks:
            reach = self._reach(contact.part, landmark)
            if reach is None or reach.place.patch != contact.patch:
                found.append(np.inf)
                continue
            place = reach.place
            if _is_near(place.p_L, place.n_L, point, normal):
                found.append(float(_lengths(place.p_L, place.n_L, point, normal)))
                continue
            if around is None:
                around = _around(self._skin.surfaces[contact.patch], point, normal)
            taxels, lengths = around
            found.append(float((reach.distances[taxels] + lengths).min()))
        return found

    def _reach(self, part: str, landmark: Landmark) -> _Reach | None:
        if (part, landmark) not in self._found:
            self._found[part, landmark] = self._find(part, landmark)
        return self._found[part, landmark]

    def _find(self, name: str, landmark: Landmark) -> _Reach | None:
        robot = self._skin.robot
        part = robot.part(name)
        patches = [p for p in robot.patches if p.part == name and p.segment == landmark.segment]
        patches = [p for p in patches if len(self._skin.surfaces[p.name].faces)]
        best: tuple[float, Patch, Array, Array] | None = None
        for patch in patches:
            surface = self._skin.surfaces[patch.name]
            direction = self._direction(part, patch, landmark)
            middle = (surface.positions.min(axis=0) + surface.positions.max(axis=0)) / 2.0
            # A sheet has no inside: the landmark of a sheet is its middle, if the direction comes from the
            # outer side of the sheet.
            reach = leave_surface(surface, middle, direction)
            points, normals = surface.project((middle + (reach or 0.0) * direction)[None])
            if normals[0] @ direction <= FACING:
                continue
            out = float((points[0] - middle) @ direction)
            if best is None or out > best[0]:
                best = out, patch, points[0], normals[0]
        if best is None:
            return None
        _, patch, point, normal = best
        surface = self._skin.surfaces[patch.name]
        place = Place(patch.name, read_only(point), read_only(normal))
        if patch.name not in self._edges:
            self._edges[patch.name] = _edges(len(surface.positions), surface.faces)
        return _Reach(place, _geodesics(surface, self._edges[patch.name], point, normal))

    def _direction(self, part: GenericPart, patch: Patch, landmark: Landmark) -> Array:
        """Returns the direction from the middle of the skin to a landmark, as a unit vector (3,) in the frame
        of the patch's link."""
        skin = self._skin
        joints = joint_map(skin.robot, part.name)
        position = np.array(initial_position(skin.robot))
        position[joints.servos] = joints.to_robot(np.zeros(len(part.servos)), position)
        towards = np.array(landmark.towards) / np.linalg.norm(landmark.towards)
        if part.side == "right":
            towards = towards * [1.0, -1.0, 1.0]
        direction: Array = skin.kinematics.poses(position, [patch.link])[patch.link][:3, :3].T @ towards
        return direction


def _geodesics(surface: Surface, edges: NDArray[np.intp], point: Array, normal: Array) -> Array:
    """Returns the geodesic distance (n,) [m] of every taxel from `point` (3,) [m] on a surface.

    `normal` (3,) is the surface's normal at the point. Paths follow `edges` (m, 2), pairs of taxels.
    """
    # imported here, because the import is slow and skin on sleeves does not need this function
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    count = len(surface.positions)
    one, other = edges.T
    lengths = _lengths(
        surface.positions[one], surface.normals[one], surface.positions[other], surface.normals[other]
    )
    around, starts = _around(surface, point, normal)
    rows = np.concatenate([one, np.full(len(around), count)])
    columns = np.concatenate([other, around])
    # An edge of length 0 would be no entry of a sparse matrix.
    weights = np.maximum(np.concatenate([lengths, starts]), 1e-9)
    graph = coo_array((weights, (rows, columns)), shape=(count + 1, count + 1)).tocsr()
    found: Array = dijkstra(graph, directed=False, indices=count)[:count]
    return read_only(found)


def _edges(count: int, faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """Returns pairs (m, 2) of taxels that at most 3 edges of the mesh `faces` (f, 3) connect. Paths on the
    skin consist of such pairs.
    """
    from scipy.sparse import coo_array

    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    near = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count)).tocsr()
    near = near + near.T
    reach = near
    for _ in range(STEPS - 1):
        reach = reach + reach @ near
    rows, columns = reach.nonzero()
    pairs: NDArray[np.intp] = np.column_stack([rows, columns])[rows < columns]
    return pairs


def _lengths(one: Array, normal: Array, other: Array, its_normal: Array) -> Array:
    """Returns the lengths (n,) [m] of paths on the skin between points `one` and `other` (n, 3) [m]. The unit
    normals `normal` and `its_normal` (n, 3) at the points determine the curvature, which is assumed to be
    constant along a path.
    """
    half = np.arccos(np.clip((normal * its_normal).sum(axis=-1), -1.0, 1.0)) / 2.0
    lengths: Array = np.linalg.norm(one - other, axis=-1) / np.sinc(half / np.pi)
    return lengths


def _is_near(points: Array, normals: Array, point: Array, normal: Array) -> NDArray[np.bool_]:
    """Returns a mask (n,): True for those of `points` (n, 3) [m] that are near `point` (3,) [m] and whose
    normals differ little from the normal there.

    `normals` (n, 3) and `normal` (3,) are unit normals at the points.
    """
    near: NDArray[np.bool_] = np.linalg.norm(points - point, axis=-1) <= NEAR
    return near & (normals @ normal > TURNED)


def _around(surface: Surface, point: Array, normal: Array) -> tuple[NDArray[np.intp], Array]:
    """Returns taxels (k,) around a point with the normal `normal` (3,), and path lengths (k,) [m] to them.

    The result contains the taxels that are at most 4 cm from the point and whose normals differ from `normal`
    by less than 60 degrees. It also contains the corners of the face on which the point lies.
    """
    near = np.flatnonzero(_is_near(surface.positions, surface.normals, point, normal))
    corners = nearest_on_faces(surface.positions, surface.faces, point[None])[0][0]
    found: NDArray[np.intp] = np.union1d(near, corners)
    return found, _lengths(surface.positions[found], surface.normals[found], point, normal)
