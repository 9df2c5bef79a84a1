"""The shapes of a robot's links as numeric arrays, for the compiled loops that check for self-collision.

All coordinates are in frames at the joints. While every joint is at zero, these frames are parallel to the
world frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.messages.frames import Array, read_only
from tci.robot.clearance import Clearance
from tci.robot.kernels.links import STEP, VISIT
from tci.robot.kinematics import turning
from tci.skin.kernels.arrays import Indices
from tci.support.engine import mujoco


@dataclass(frozen=True, slots=True, eq=False)
class Solids:
    """Joints and shapes of a robot, and the pairs of shapes that could collide."""

    servos: NDArray[np.intp]
    """Index (j,) of the servo that moves each joint. The joints are in an order in which every joint comes
    after the joints that carry it."""
    zero: Array
    """For each joint (j,): angle [rad] of its servo while the joint of the model is at zero."""
    steps: NDArray[np.void]
    """Steps (j,) from joint to joint, as `KinematicChain.steps`: each joint is one step, after the step of
    the joint that carries it. The kinematics of the robot itself do not fit here: joints that only follow a
    servo stay at 0."""
    sums: Array
    """Matrices (j, 3, 3, 4) of the steps, as `KinematicChain.sums`."""
    path: NDArray[np.void]
    """All steps (j,), as `KinematicChain.path` lists them."""
    shapes: Array
    """One row for each shape (g, 16). A shape is the convex hull of some points, extended on all sides by an
    ellipsoid: the vectors E u with |u| <= 1. The columns:

    - index of the joint that carries the shape (-1: no joint)
    - indices of its first point in `points`, and of its last point + 1
    - centre (3 numbers) and radius of its bounding sphere [m]
    - matrix E (9 numbers) of the ellipsoid [m]
    """
    points: Array
    """Points (v, 3) [m] of all shapes, each in the frame of the joint that carries its shape."""
    poses: Array
    """Poses (g, 12) of the MuJoCo geoms of all collision shapes. Each row contains the position (3 numbers)
    [m] and the rotation matrix (9 numbers) of one geom, in the frame of the joint that carries the shape."""
    geoms: Indices
    """Index (g,) of each shape's geom in the MuJoCo model."""
    pairs: Indices
    """Indices (p, 2) of the two shapes of each pair that could collide, in the order of the pairs of
    `Clearance`."""
    levers: Array
    """Upper bound (j, p) on the change of the distance between the two shapes of each pair, per radian by
    which each joint turns [m/rad]."""

    @staticmethod
    def of(clearance: Clearance) -> Solids:
        """Returns the joints and shapes of the robot that `clearance` checks for collisions. Raises TciError
        if a joint is not a hinge, or if a shape is neither a mesh nor a sphere, capsule, cylinder, ellipsoid
        or box."""
        model, data = clearance.model, mujoco.MjData(clearance.model)
        mujoco.mj_kinematics(model, data)
        for joint in np.flatnonzero(model.jnt_type != mujoco.mjtJoint.mjJNT_HINGE).tolist():
            raise TciError(f"joint {model.joint(joint).name} does not turn; valid: hinges")
        servo_of = dict(zip(clearance.joints, clearance.servos, strict=True))
        # the last element is for shapes without a joint
        anchors = np.concatenate([data.xanchor, np.zeros((1, 3))])
        above = [_carrier(model, int(model.jnt_bodyid[joint]), joint) for joint in range(model.njnt)]
        geoms = np.unique(clearance.pairs)
        points: list[Array] = []
        shapes, poses, first = [], [], 0
        for geom in geoms.tolist():
            joint = _carrier(model, int(model.geom_bodyid[geom]), model.njnt)
            p, R = data.geom_xpos[geom] - anchors[joint], data.geom_xmat[geom].reshape(3, 3)
            own, E = _shape(model, geom)
            points.append(p + own @ R.T)
            span = [first, first + len(own)]
            first += len(own)
            shapes.append([joint, *span, *p, model.geom_rbound[geom], *(R @ E).ravel()])
            poses.append([*p, *R.ravel()])
        count, offsets = model.njnt, anchors[:-1] - anchors[above]
        sums = np.zeros((count, 3, 3, 4))
        sums[:, :, :, :3] = np.array([turning(axis) for axis in data.xaxis]).reshape(count, 3, 3, 3)
        sums[:, 0, :, 3] = offsets
        pairs = np.searchsorted(geoms, clearance.pairs).reshape(-1, 2)
        solids = np.array(shapes).reshape(-1, 16)
        cloud = np.concatenate([np.zeros((0, 3)), *points])
        return Solids(
            servos=np.array([servo_of[joint] for joint in range(model.njnt)], dtype=np.intp),
            zero=read_only(model.qpos0[model.jnt_qposadr]),
            steps=read_only([(above[joint], joint, 0) for joint in range(count)], STEP),
            sums=read_only(sums),
            path=read_only([(joint, 0) for joint in range(count)], VISIT),
            shapes=read_only(solids),
            points=read_only(cloud),
            poses=read_only(np.array(poses).reshape(-1, 12)),
            geoms=read_only(geoms, np.int32),
            pairs=read_only(pairs, np.int32),
            levers=read_only(_levers(above, offsets, data.xaxis, solids, cloud, pairs)),
        )


def _carrier(model: mujoco.MjModel, body: int, before: int) -> int:
    """Returns the index of the joint that moves a body most directly, among the joints with an index below
    `before`; -1 if no such joint moves the body."""
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        own = [joint for joint in range(first, first + count) if joint < before]
        if own:
            return own[-1]
        body = int(model.body_parentid[body])
    return -1


def _shape(model: mujoco.MjModel, geom: int) -> tuple[Array, Array]:
    """Returns the shape of a MuJoCo geom in its own frame, as points (n, 3) [m] and a matrix E (3, 3) [m]:
    the shape is the convex hull of the points, extended on all sides by the ellipsoid of the vectors E u with
    |u| <= 1."""
    x, y, z = model.geom_size[geom].tolist()
    ends = np.array([[0.0, 0.0, -y], [0.0, 0.0, y]])
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    match kind:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return np.zeros((1, 3)), x * np.eye(3)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return ends, x * np.eye(3)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return ends, np.diag([x, x, 0.0])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return np.zeros((1, 3)), np.diag([x, y, z])
        case mujoco.mjtGeom.mjGEOM_BOX:
            corners = np.stack(np.meshgrid([-x, x], [-y, y], [-z, z]), axis=-1).reshape(-1, 3)
            return corners, np.zeros((3, 3))
        case mujoco.mjtGeom.mjGEOM_MESH:
            return _hull(model, int(model.geom_dataid[geom])), np.zeros((3, 3))
    raise TciError(f"geom {model.geom(geom).name} is a {kind.name}; valid: primitives and meshes")


def _hull(model: mujoco.MjModel, mesh: int) -> Array:
    """Returns the corners (n, 3) [m] of a mesh's convex hull, in the frame of its geom; all corners of the
    mesh if the model contains no hull."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    points = np.array(model.mesh_vert[first : first + count], dtype=float)
    graph = int(model.mesh_graphadr[mesh])
    if graph < 0:
        return points
    corners = int(model.mesh_graph[graph])
    begin = graph + 2 + corners  # the graph begins with two counts, then the begin of each corner's edges
    hull: Array = points[model.mesh_graph[begin : begin + corners]]
    return hull


def _levers(
    above: list[int], offsets: Array, axes: Array, shapes: Array, points: Array, pairs: NDArray[np.intp]
) -> Array:
    """Returns an upper bound (j, p) on the change of the distance between the two shapes of each pair, per
    radian by which each joint turns [m/rad]. The value is 0 if a joint carries both shapes or neither.

    Args:
        above: Index (j,) of the joint that carries each joint; -1 for none.
        offsets: Position (j, 3) [m] of each joint relative to that joint.
        axes: Unit vector (j, 3) along the axis of each joint.
        shapes: `Solids.shapes`.
        points: `Solids.points`.
        pairs: `Solids.pairs`.
    """
    reach = np.zeros((len(above), len(shapes)))
    carried = np.zeros(reach.shape, dtype=bool)
    for index, shape in enumerate(shapes):
        joint, first, last = (int(number) for number in shape[:3])
        mine = points[first:last]
        round_about = float(np.linalg.norm(shape[7:].reshape(3, 3), 2))
        inner = 0.0
        while joint >= 0:
            across = np.linalg.norm(np.cross(axes[joint], mine), axis=1).max()
            reach[joint, index] = across + inner + round_about
            carried[joint, index] = True
            inner += float(np.linalg.norm(mine, axis=1).max())
            mine = offsets[joint][None, :]
            joint = above[joint]
    first, second = pairs.T
    # A joint that carries both shapes of a pair does not change the distance of the pair.
    moves = carried[:, first] != carried[:, second]
    levers: Array = np.ascontiguousarray(np.where(moves, np.maximum(reach[:, first], reach[:, second]), 0.0))
    return levers
