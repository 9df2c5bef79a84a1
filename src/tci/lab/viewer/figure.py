"""One robot in the scene: draws its links, its skin coloured by pressure, its contacts and the finger."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import viser

from tci.capabilities.fields import ReceptiveField
from tci.errors import DescriptionError, Fault
from tci.lab.pictures.paint import FULL_SCALE, SKIN_COLOUR, pressure_colours
from tci.lab.viewer.fields import OUTSIDE, REST, is_outside, nearest_field, tints
from tci.lab.viewer.meshes import body_meshes, disc, quaternion, towards
from tci.lab.viewer.view import View
from tci.messages import JointReading
from tci.messages.frames import Array, apply, invert, rotation_z, transform
from tci.robot.collisions import NO_MODEL, solid_spec
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.robot.model_file import compiled
from tci.simulation.finger import RADIUS
from tci.skin.skin import Skin
from tci.support.engine import mujoco

# Sizes, times and colours of the drawing are assumed. They change only the picture.
FADE = 0.15
"""Time constant [s] with which a shown pressure fades. With a faster fading a touch of 50 ms would not be
visible."""
ARROW = 0.02
"""Length [m/N] of a contact's arrow."""
LONGEST = 0.15
"""Largest length [m] of a contact's arrow."""
GAMMA = 2.2
"""Exponent that converts a colour to linear light, the form in which viser expects the colours of batched
meshes."""
COVER = 0.012
"""Thickness [m] of the thickest cover over a taxel. The cover of an iCub's forearm is up to 10 mm thick."""
ABOVE = 0.0008
"""Height [m] above the skin at which taxels are drawn."""
MOVED = 1e-5
"""Smallest change of a body's pose that is sent to the page: of a coordinate [m] of its position, or of a
number of its quaternion."""
TURNED = np.deg2rad(1.0)
"""Change [rad] of a joint after which the receptive field of each taxel is computed again."""
_INK = (225, 60, 50)
_FINGER = (215, 140, 115)
FINGER_TIP = 0.007, 0.024
"""Radius and length [m] of a hand's finger; those of the simulated hand."""


class Figure:
    """Draws the views of one robot. Only one thread may use it."""

    def __init__(self, server: viser.ViserServer, robot: Robot, key: str) -> None:
        """Adds the robot to the page, under the name `key`. Raises DescriptionError for a robot without a
        model."""
        if robot.model is None:
            raise DescriptionError(robot.source, [Fault(0, NO_MODEL)])
        self.robot = robot
        self.skin = Skin(robot)
        self._server = server
        self._model = compiled(solid_spec(robot, shown=True, mounted=False), robot.model)
        self._data = mujoco.MjData(self._model)
        driven = [(servo.index, one) for servo in robot.servos for one in servo.joints]
        self._servos = np.array([servo for servo, _ in driven], dtype=np.intp)
        self._lines = np.array([(one.multiplier, one.offset) for _, one in driven]).reshape(-1, 2).T
        places = [self._model.joint(one.joint).qposadr[0] for _, one in driven]
        self._addresses = np.array(places, dtype=np.intp)
        self._torso_body = self._model.body(robot.model.torso_link).id
        self._T_LT = robot.model.T_LT
        self._links = {name: self._model.body(s.link).id for name, s in self.skin.surfaces.items()}
        self._move(initial_position(robot))
        self._root = server.scene.add_frame(f"/{key}", show_axes=False)
        limbs = {body for name, body in self._links.items() if robot.limb_segment(robot.patch(name))}
        meshes = body_meshes(self._model, limbs)
        self._turn = self._facing()
        low, high = self._extent()
        middle = (low + high) / 2.0
        self.width, self.height = float(high[1] - low[1]), float(high[2] - low[2])
        """Size [m] of the robot."""
        self._standing = -np.array([middle[0], middle[1], low[2]])
        self.T_SW = transform(self._turn, self._standing)
        """Pose (4, 4) of the model's world frame in the scene."""
        self.stand(0.0)
        self._bodies: dict[int, viser.FrameHandle] = {}
        for body in sorted(set(self._links.values()) | {mesh.body for mesh in meshes}):
            self._bodies[body] = server.scene.add_frame(f"/{key}/{body}", show_axes=False)
        self._shown_bodies = np.array(list(self._bodies), dtype=np.intp)
        self._sent = np.full((len(self._bodies), 7), np.nan)
        for index, mesh in enumerate(meshes):
            server.scene.add_mesh_simple(
                f"/{key}/{mesh.body}/mesh{index}",
                mesh.vertices, mesh.faces, color=mesh.colour,
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        self._taxels = {name: self._add_taxels(key, name) for name in self.skin.surfaces}
        self._shown = {name: np.zeros(len(s.positions)) for name, s in self.skin.surfaces.items()}
        self._tints: dict[str, Array] = {}
        self._fields: tuple[ReceptiveField, ...] = ()
        self._tinted: Array | None = None
        self._glows = dict.fromkeys(self._taxels, True)
        self._before = time.monotonic()
        self._arrows = server.scene.add_arrows(
            f"/{key}/contacts", np.zeros((1, 2, 3)), _INK,
            shaft_radius=0.0035, head_radius=0.009, head_length=0.02, visible=False,
        )  # fmt: skip
        self._finger = server.scene.add_frame(f"/{key}/finger", show_axes=False, visible=False)
        server.scene.add_icosphere(
            f"/{key}/finger/tip", RADIUS, color=_FINGER, opacity=0.5, cast_shadow=False
        )
        server.scene.add_cylinder(
            f"/{key}/finger/shaft", RADIUS, 0.06, color=_FINGER, opacity=0.35, position=(0.0, 0.0, -0.03),
            cast_shadow=False,
        )  # fmt: skip
        self._hands = [self._add_hand(server, f"/{key}/hand{number}") for number in range(2)]
        self._outside = server.scene.add_label(
            f"/{key}/finger/outside", OUTSIDE, position=(0.0, 0.0, -0.07), visible=False
        )
        name = (robot.title or robot.name).split()[0]
        above = self._turn.T @ np.array([middle[0], middle[1], high[2] + 0.06])
        server.scene.add_label(f"/{key}/name", name, position=above)
        self._pose_bodies()
        self._draw_taxels(initial_position(robot))

    def stand(self, y: float) -> None:
        """Puts the robot on the floor, with its middle `y` [m] to the left of the scene's origin."""
        self.T_SW = transform(self._turn, self._standing + np.array([0.0, y, 0.0]))
        self._root.position = self.T_SW[:3, 3]
        self._root.wxyz = quaternion(self._turn)

    def show_fields(self, fields: Sequence[ReceptiveField]) -> None:
        """Sets the receptive fields whose colours the skin shows. Without fields, the skin has one colour."""
        if tuple(fields) != self._fields:
            self._fields, self._tinted = tuple(fields), None

    def show(self, view: View) -> None:
        """Draws a view. Sends only the differences from the previous view to the page."""
        position = view.joints.position
        self._move(position)
        now = time.monotonic()
        share = float(np.exp(-(now - self._before) / FADE))
        self._before = now
        for name, shown in self._shown.items():
            felt = view.pressure.get(name)
            shown *= share
            shown[shown < 0.002 * FULL_SCALE] = 0.0
            if felt is not None:
                np.maximum(shown, felt, out=shown)
        with self._server.atomic():
            self._pose_bodies()
            self._draw_taxels(position)
            self._draw_contacts(view)
            self._finger.visible = view.finger is not None
            outside = any(is_outside(self._fields, contact) for contact in view.contacts)
            self._outside.visible = view.finger is not None and (outside or self._outside.visible)
            if view.finger is not None:
                self._finger.position = view.finger[:3, 3]
                self._finger.wxyz = quaternion(view.finger[:3, :3])

            for number, (frame, label) in enumerate(self._hands):
                frame.visible = label.visible = number < len(view.hands)
                if frame.visible:
                    hand = view.hands[number]
                    frame.position, frame.wxyz = hand.tip[:3, 3], quaternion(hand.tip[:3, :3])
                    if label.text != hand.words:
                        label.text = hand.words

    @staticmethod
    def _add_hand(server: viser.ViserServer, name: str) -> tuple[viser.FrameHandle, viser.LabelHandle]:
        radius, length = FINGER_TIP
        frame = server.scene.add_frame(name, show_axes=False, visible=False)
        for part, z in (("tip", -radius), ("end", -radius - length)):
            server.scene.add_icosphere(
                f"{name}/{part}", radius, color=_FINGER, position=(0.0, 0.0, z), cast_shadow=False
            )
        server.scene.add_cylinder(
            f"{name}/shaft", radius, length, color=_FINGER, position=(0.0, 0.0, -radius - length / 2.0),
            cast_shadow=False,
        )  # fmt: skip
        label = server.scene.add_label(f"{name}/says", "", position=(0.0, 0.0, -0.07), visible=False)
        return frame, label

    def pose(self, link: str) -> Array:
        """Returns `T_SL` (4, 4), the pose of a link in the scene, in the posture that is shown. For the
        drawing thread only."""
        pose: Array = self.T_SW @ self._pose(self._model.body(link).id)
        return pose

    def distance(self, origin: Array, direction: Array) -> float:
        """Returns the distance [m] from `origin` (3,) at which a ray along the unit vector `direction` (3,),
        both in the scene's frame, meets a link in the posture that is shown. The distance is infinite if the
        ray meets no link."""
        groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        geom = np.zeros(1, dtype=np.int32)
        T_WS = invert(self.T_SW)
        start, along = apply(T_WS, origin), T_WS[:3, :3] @ direction
        found = mujoco.mj_ray(self._model, self._data, start, along, groups, 1, -1, geom, None)
        return float(found) if found >= 0.0 else np.inf

    def _move(self, position: Array) -> None:
        self._data.qpos[self._addresses] = position[self._servos] * self._lines[0] + self._lines[1]
        mujoco.mj_kinematics(self._model, self._data)

    def _pose(self, body: int) -> Array:
        return transform(self._data.xmat[body].reshape(3, 3), np.array(self._data.xpos[body]))

    def _facing(self) -> Array:
        """Returns the rotation `R_SW` (3, 3) around the vertical axis that turns the front of the robot's
        torso to the x axis."""
        forward = (self._pose(self._torso_body) @ self._T_LT)[:3, 0]
        return rotation_z(-float(np.arctan2(forward[1], forward[0])))

    def _extent(self) -> tuple[Array, Array]:
        """Returns the lowest and the highest coordinates, each (3,) [m], of the robot's visible shapes in the
        present posture."""
        reach = self._model.geom_rbound[:, None]
        shown = (self._model.geom_group < 3) & (self._model.geom_rbound > 0.0)
        rotation = self._turn @ self._data.geom_xmat.reshape(-1, 3, 3)
        boxes = self._model.geom_aabb
        across = np.minimum(np.einsum("gij,gj->gi", np.abs(rotation), boxes[:, 3:]), reach)
        centre = self._data.geom_xpos @ self._turn.T + np.einsum("gij,gj->gi", rotation, boxes[:, :3])
        return (centre - across)[shown].min(axis=0), (centre + across)[shown].max(axis=0)

    def _pose_bodies(self) -> None:
        bodies = self._shown_bodies
        poses = np.concatenate([self._data.xpos[bodies], self._data.xquat[bodies]], axis=1)
        still = np.abs(poses - self._sent).max(axis=1) <= MOVED
        for index in np.flatnonzero(~still):
            frame, pose = self._bodies[int(bodies[index])], poses[index]
            frame.position, frame.wxyz = pose[:3], pose[3:]
            self._sent[index] = pose

    def _add_taxels(self, key: str, name: str) -> viser.BatchedMeshHandle:
        surface = self.skin.surfaces[name]
        body = self._links[name]
        dark = np.round(255.0 * np.array(SKIN_COLOUR)).astype(np.uint8)
        positions = surface.positions + self._lift(name)[:, None] * surface.normals
        self._server.scene.add_mesh_simple(
            f"/{key}/{body}/{name}_skin",
            positions,
            surface.faces,
            color=dark,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )
        shape, faces = disc(0.52 * float(np.sqrt(np.median(surface.areas))))
        return self._server.scene.add_batched_meshes_simple(
            f"/{key}/{body}/{name}_taxels",
            shape,
            faces,
            np.array([towards(normal) for normal in surface.normals]),
            positions + ABOVE * surface.normals,
            batched_colors=np.zeros((len(surface.positions), 3), dtype=np.uint8),
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _lift(self, name: str) -> Array:
        """Returns the distance (taxels,) [m] from each taxel of the patch `name` to the outside of the cover
        above the taxel, where the taxel is drawn. The distance is 0 if no part of the link covers the taxel.
        """
        surface = self.skin.surfaces[name]
        T_WL = self._pose(self._links[name])
        starts = apply(T_WL, surface.positions + COVER * surface.normals)
        along = -surface.normals @ T_WL[:3, :3].T
        groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        geom = np.zeros(1, dtype=np.int32)
        lift = np.zeros(len(starts))
        for taxel, (start, direction) in enumerate(zip(starts, along, strict=True)):
            distance = mujoco.mj_ray(self._model, self._data, start, direction, groups, 1, -1, geom, None)
            if 0.0 <= distance < COVER and self._model.geom_bodyid[geom[0]] == self._links[name]:
                lift[taxel] = COVER - distance
        return lift

    def _draw_taxels(self, position: Array) -> None:
        tinted = self._tinted is None or np.abs(position - self._tinted).max() > TURNED
        if tinted:
            self._tint(position)
        for name, handle in self._taxels.items():
            felt = self._shown[name]
            glowed, self._glows[name] = self._glows[name], bool(felt.any())
            if not (tinted or glowed or self._glows[name]):
                continue
            weight = np.clip(felt / FULL_SCALE * 8.0, 0.0, 1.0)[:, None]
            colours = self._tints[name] * (1.0 - weight) + weight * pressure_colours(felt, FULL_SCALE)
            sent = np.round(255.0 * colours**GAMMA).astype(np.uint8)
            handle.batched_colors = sent

    def _tint(self, position: Array) -> None:
        """Computes the colour of each taxel at rest, for the servo angles `position` [rad]: the colour of the
        receptive field that contains the taxel."""
        joints = JointReading(0.0, 0, position, np.zeros_like(position))
        for name, surface in self.skin.surfaces.items():
            patch = self.robot.patch(name)
            if self.robot.limb_segment(patch):
                u, theta, _ = self.skin.limb(name, joints)
                self._tints[name] = tints(nearest_field(self._fields, patch.segment, u, theta))
            else:
                self._tints[name] = np.repeat(REST[None], len(surface.positions), axis=0)
        self._tinted = np.array(position)

    def _draw_contacts(self, view: View) -> None:
        self._arrows.visible = bool(view.contacts)
        if not view.contacts:
            return
        T_WT = self._pose(self._torso_body) @ self._T_LT
        points = []
        for contact in view.contacts:
            force = T_WT[:3, :3] @ contact.f_T
            length = min(ARROW * contact.force, LONGEST)
            tip = apply(T_WT, contact.p_T)
            size = max(float(np.linalg.norm(force)), 1e-9)
            points.append([tip - length * force / size, tip])
        self._arrows.points = np.array(points, dtype=np.float32)
