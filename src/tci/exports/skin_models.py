"""A robot's model with its skin, for other programs: URDF with the tactile sensors of ROS' tactile_toolbox,
and MJCF with MuJoCo's touch sensors."""

from __future__ import annotations

import numpy as np
from lxml import etree
from lxml.builder import E

from tci.errors import TciError
from tci.exports.urdf import to_urdf
from tci.messages.frames import Array, rpy_of
from tci.robot.collisions import solid_spec
from tci.robot.description import Grid, Patch, Robot
from tci.robot.like import RobotLike, as_robot
from tci.skin.surfaces import Surface, surfaces_of, tangents
from tci.support.engine import mujoco

DEPTH = 0.002
"""Half the depth [m] of a site that feels: MuJoCo counts contacts inside it. Assumed: enough for shapes of a
link that end 2 mm below their skin."""


def skin_to_urdf(robot: RobotLike) -> str:
    """The URDF of `to_urdf` with a `<sensor>` for each patch: an `<array>` for a grid, a list of `<taxel>`
    for any other. The index of a taxel is its channel.

    Raises TciError for a robot without taxels, and the errors of `to_urdf`.
    """
    robot, worn = _worn(robot)
    root = etree.fromstring(to_urdf(robot).encode())
    for patch, surface in worn:
        grid = patch.surface if isinstance(patch.surface, Grid) and not patch.surface.mirrored else None
        pose = patch.mount @ grid.T_LP if grid is not None else np.eye(4)
        tactile = E.tactile(channel=patch.name)
        if grid is not None:
            pitch = np.array([grid.length / grid.rows, grid.width / grid.columns])
            half = 0.5 * (np.array([grid.length, grid.width]) - pitch)
            tactile.append(E.array(
                rows=str(grid.rows), cols=str(grid.columns), size=_words(pitch), spacing=_words(pitch),
                offset=_words(half), order="row-major" if grid.order == "row-major" else "col-major",
            ))  # fmt: skip
        else:
            for channel, frame in zip(surface.channels.tolist(), _frames(surface), strict=True):
                tactile.append(E.taxel(idx=str(channel), **_pose(frame)))
        root.append(
            E.sensor(
                E.parent(link=patch.link), E.origin(**_pose(pose)), tactile,
                name=patch.name, update_rate=f"{patch.rate:g}",
            )
        )  # fmt: skip
    etree.indent(root)
    return '<?xml version="1.0"?>\n' + str(etree.tostring(root, encoding="unicode")) + "\n"


def skin_to_mjcf(robot: RobotLike) -> str:
    """An MJCF of the robot's collision shapes, with a site and a `<touch>` sensor for each taxel: `PATCH_3`
    is the taxel of channel 3. Meshes are convex hulls in the file itself. The shapes collide with what is
    in a scene (`conaffinity="1"`), not with each other.

    Raises TciError for a robot without taxels, and the errors of `load_spec`.
    """
    robot, worn = _worn(robot)
    spec = solid_spec(robot, mounted=False)
    for geom in spec.geoms:
        solid = bool(geom.contype or geom.conaffinity)
        geom.contype, geom.conaffinity = int(solid), 0
    for patch, surface in worn:
        body = spec.body(patch.link)
        for channel, frame, area in zip(
            surface.channels.tolist(), _frames(surface), surface.areas.tolist(), strict=True
        ):
            name, half = f"{patch.name}_{channel}", 0.5 * float(np.sqrt(area))
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(frame[:3, :3]).ravel())
            body.add_site(
                name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=[half, half, DEPTH], pos=frame[:3, 3],
                quat=quaternion,
            )  # fmt: skip
            spec.add_sensor(
                name=name, type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name
            )
    spec.compile()  # MuJoCo writes only what it has compiled
    text: str = spec.to_xml()
    return text


def _worn(given: RobotLike) -> tuple[Robot, list[tuple[Patch, Surface]]]:
    robot = as_robot(given)
    worn = [
        (patch, surface)
        for patch, surface in zip(robot.patches, surfaces_of(robot), strict=True)
        if not patch.through_joints
    ]
    if not worn:
        raise TciError(f"{robot.name} has no taxels to export; valid: a robot with skin")
    return robot, worn


def _frames(surface: Surface) -> Array:
    """Poses (n, 4, 4) of taxels in the frame of the link: z is the outward normal."""
    x = tangents(surface.normals) if surface.tangents is None else surface.tangents
    frames = np.tile(np.eye(4), (len(x), 1, 1))
    frames[:, :3, 0], frames[:, :3, 1] = x, np.cross(surface.normals, x)
    frames[:, :3, 2], frames[:, :3, 3] = surface.normals, surface.positions
    return frames


def _pose(frame: Array) -> dict[str, str]:
    return {"xyz": _words(frame[:3, 3]), "rpy": _words(np.array(rpy_of(frame[:3, :3])))}


def _words(values: Array) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
