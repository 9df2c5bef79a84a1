"""Draws a simulated robot at one instant: the robot's skin with pressures and receptive fields, and the
finger."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.lab.pictures.camera import Camera, look_at
from tci.lab.pictures.paint import SKIN_COLOUR, FieldLook, FieldPaint, TaxelPaint
from tci.lab.pictures.render import Painter, model_colours, render
from tci.messages import Reading
from tci.messages.frames import Array, apply, invert, transform
from tci.robot.description import Robot
from tci.robot.generic_arm import SEGMENTS
from tci.robot.joint_map import generic_posture
from tci.simulation.finger import FINGER
from tci.simulation.touch import skin_geom
from tci.simulation.world import World
from tci.skin.conditioning import Conditioner
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin
from tci.support.engine import mujoco

_FINGER_ALPHA = 0.6
"""Opacity of the finger. The finger is transparent, so that it does not hide the pressed taxels."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """State of a world at one instant, stored for a picture."""

    time: float
    """Time on the world's clock [s]."""
    reading: Reading
    """Latest reading of the robot."""
    data: mujoco.MjData
    """Copy of the physics simulation's state."""


def keep_moment(world: World, reading: Reading) -> Moment:
    """Copies the current state of a world. The copy has no effect on the world's simulation."""
    time, data = world.moment()
    return Moment(time, reading, data)


def world_camera(world: World, *, full_scale: float) -> Callable[[Reading], NDArray[np.uint8]]:
    """The camera of the learning environment: 320 x 240 pixels, in front of the torso. `full_scale` [Pa] is
    the pressure that has the last colour."""
    portrait = Portrait(world, (), full_scale=full_scale)

    def picture(reading: Reading) -> NDArray[np.uint8]:
        moment = keep_moment(world, reading)
        torso = portrait.torso(moment)[:3, 3]
        view = look_at(torso, azimuth=0.6, elevation=0.2, distance=1.4, width=320, height=240)
        return portrait.draw(moment, view)

    return picture


class Portrait:
    """Draws instants of one world."""

    def __init__(self, world: World, fields: Sequence[FieldLook], *, full_scale: float) -> None:
        """Prepares the drawing of a world.

        `fields` are the receptive fields that are drawn on both arms. `full_scale` [Pa] is the pressure that
        has the last colour of `paint.PRESSURE_COLOURS`.
        """
        self.skin = Skin(world.robot)
        """Skin of the robot."""
        self._robot = world.robot
        self._worn = [patch for patch in world.robot.patches if patch.name in world.surfaces]
        self.model = world.shown_model()
        """The world's model with all that pictures need."""
        self._data = mujoco.MjData(self.model)
        self._fields = tuple(fields)
        self._full_scale = full_scale
        self._hands = _hands(world, self.model)
        self._moved = np.flatnonzero(_below(self.model, self._hands)).tolist()
        self.colours = _colours(world, self.model)
        """Colours (ngeom, 4), 0 to 1, of its geoms."""

    def torso(self, moment: Moment) -> Array:
        """Returns `T_WT` (4, 4), the pose of the torso frame in the world."""
        assert self._robot.model is not None  # a World always has this link
        body = moment.data.body(self._robot.model.torso_link)
        T_WT: Array = transform(body.xmat.reshape(3, 3), body.xpos) @ self._robot.model.T_LT
        return T_WT

    def draw(self, moment: Moment, camera: Camera) -> NDArray[np.uint8]:
        """Returns the picture (height, width, 3) of the world at `moment`, seen by `camera`."""
        return render(self.model, self.pose(moment), camera, paint=self._paint(moment), colours=self.colours)

    def outline(self, moment: Moment, *, part: str, lowest: float) -> Array:
        """Returns the corners (n, 3) [m] of boxes around the robot's geoms, in the world frame. Arms other
        than `part` are left out.

        Only corners at least as high as `lowest` [m] in the torso frame are included.
        """
        model, data = self.model, self.pose(moment)
        others = {
            self._robot.servos[servo.servo].joint
            for other in self._robot.parts
            if other.kind == "arm" and other.name != part
            for servo in other.servos
            if servo.servo is not None
        }
        left_out = [model.body(FINGER).id, *self._hands]
        left_out += [model.joint(joint).bodyid.item() for joint in others if joint is not None]
        drawn = np.flatnonzero((self.colours[:, 3] > 0.0) & ~_below(model, left_out)[model.geom_bodyid])
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        boxes = model.geom_aabb[drawn]
        corners_G = boxes[:, None, :3] + signs * boxes[:, None, 3:]
        rotations = data.geom_xmat[drawn].reshape(-1, 3, 3)
        corners = np.einsum("gij,gkj->gki", rotations, corners_G) + data.geom_xpos[drawn][:, None]
        points: Array = corners.reshape(-1, 3)
        return points[apply(invert(self.torso(moment)), points)[:, 2] >= lowest]

    def pose(self, moment: Moment) -> mujoco.MjData:
        """Returns MuJoCo's data with the poses at a moment. The next call changes the returned object."""
        data, seen = self._data, moment.data
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = seen.qpos, seen.mocap_pos, seen.mocap_quat
        for body in self._moved:  # the simulation turns hands in its own model; here each is where it was
            first, count = self.model.body_jntadr[body], self.model.body_jntnum[body]
            data.qpos[self.model.jnt_qposadr[first : first + count]] = 0.0
            parent = self.model.body_parentid[body]
            back = seen.xquat[parent] * [1.0, -1.0, -1.0, -1.0]
            offset = seen.xpos[body] - seen.xpos[parent]
            mujoco.mju_rotVecQuat(self.model.body_pos[body], offset, back)
            mujoco.mju_mulQuat(self.model.body_quat[body], back, seen.xquat[body])
        mujoco.mj_kinematics(self.model, data)
        return data

    def _paint(self, moment: Moment) -> list[Painter]:
        """Returns the painters (objects that colour points of the skin) in the order in which they paint:
        first the receptive fields, then the taxels, which cover the fields."""
        if not self._worn:
            return []
        skin, robot, joints = self.skin, self._robot, moment.reading.joints
        T_WT = self.torso(moment)
        names = [patch.name for patch in self._worn]
        positions = {name: apply(T_WT, skin.positions(name, joints, frame="torso")) for name in names}
        normals = {name: skin.normals(name, joints, frame="torso") @ T_WT[:3, :3].T for name in names}
        posture = generic_posture(robot, joints)
        paint: list[Painter] = []
        for part in robot.parts:
            for segment in SEGMENTS:
                on = [p.name for p in self._worn if (p.part, p.segment) == (part.name, segment)]
                if not on or part.kind != "arm" or part.side is None:
                    continue
                T_WS = T_WT @ skin.segment_pose(part.name, segment, joints, posture[part.name])
                paint.append(
                    FieldPaint(
                        np.concatenate([positions[name] for name in on]),
                        np.concatenate([normals[name] for name in on]),
                        invert(T_WS),
                        part.segment(segment).length,
                        part.side,
                        [field for field in self._fields if field.segment == segment],
                    )
                )
        # A separate conditioner makes the pressures depend on this reading alone.
        conditioner = Conditioner(SkinLayout.of_robot(robot))
        conditioner.step(moment.reading.skin)
        felt = conditioner.state.by_patch(patch.name for patch in robot.patches)
        # surfaces that detect touches by joint torques send no frames
        pressure = np.concatenate([felt.get(name, np.zeros(len(positions[name]))) for name in names])
        paint.append(
            TaxelPaint(
                np.concatenate(list(positions.values())),
                np.concatenate(list(normals.values())),
                pressure,
                full_scale=self._full_scale,
            )
        )
        return paint


def _colours(world: World, model: mujoco.MjModel) -> Array:
    """Returns the colours of the model's geoms. A link that carries the skin of a limb is dark as a whole,
    and the finger and hands are transparent."""
    colours = model_colours(model)
    limbs = [patch.name for patch in world.robot.patches if world.robot.limb_segment(patch)]
    bodies = [model.geom_bodyid[model.geom(skin_geom(name)).id] for name in limbs if name in world.surfaces]
    covered = np.isin(model.geom_bodyid, bodies) & (colours[:, 3] > 0.0)
    colours[covered] = (*SKIN_COLOUR, 1.0)
    touching = _below(model, [model.body(FINGER).id, *_hands(world, model)])[model.geom_bodyid]
    colours[touching, 3] = _FINGER_ALPHA
    return colours


def _hands(world: World, model: mujoco.MjModel) -> list[int]:
    """Bodies of the hands of all people."""
    return [int(model.body(hand.name).id) for person in world.people for hand in person.hands]


def _below(model: mujoco.MjModel, bodies: Sequence[int]) -> NDArray[np.bool_]:
    """Returns a mask (nbody,) of `bodies` and of all bodies that are attached to these bodies, directly or
    indirectly."""
    found = np.isin(np.arange(model.nbody), bodies)
    for body in range(1, model.nbody):  # MuJoCo numbers a parent before its children.
        found[body] |= found[model.body_parentid[body]]
    return found


def lowest_shown(robot: Robot, part: str, share: float) -> float:
    """Lowest height [m] in the torso frame that a picture of a part shows: `share` of an arm's length below
    the torso, or all of a robot whose leg is touched."""
    found = robot.part(part)
    return -np.inf if found.kind == "leg" else -share * sum(segment.length for segment in found.segments)
