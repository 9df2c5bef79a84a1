"""Worlds on a GPU, in single precision: mujoco-warp (extra `batch`). Its CPU device is for tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.batch.scene import BatchScene
from tci.batch.worlds import Ids, Worlds
from tci.errors import ClashError, CommandError, TciError
from tci.messages.frames import Array, frozen
from tci.simulation.finger import DAMPING, PARKED, STIFFNESS
from tci.simulation.sampling import SLOTS
from tci.skin.kernels.arrays import ContactArrays
from tci.skin.tracking import Tracker
from tci.support.engine import mujoco
from tci.support.installed import needs

if not mujoco.__version__.startswith("4."):
    raise ClashError(
        f"mujoco-warp 4 and TCI need MuJoCo 4, but MuJoCo {mujoco.__version__} lies over it in one folder; "
        "valid: pip install --force-reinstall --no-deps 'mujoco-core>=4,<5', and beside it "
        "pip install --no-deps 'mujoco-warp>=4,<5'"
    )
with needs("worlds on a GPU", "batch"):
    import mujoco_warp as mjw
    import warp as wp

    from tci.batch import feel, kernels
    from tci.batch.touches import Touches

CONTACTS, ROWS = 24, 64
"""Room for contacts, and for rows of constraints beside those of joints, of each world. More are left out by
mujoco-warp, which says so."""


class WarpWorlds(Worlds):
    """Worlds on a device of Warp.

    Args:
        scene: The scene.
        count: Number of worlds.
        device: Of Warp, such as "cuda:0" or "cpu"; by default the first GPU.
        skin: False leaves taxels and contacts out; the physics stays the same.
    """

    def __init__(
        self, scene: BatchScene, count: int, *, device: str | None = None, skin: bool = True
    ) -> None:
        super().__init__(scene, count)
        wp.init()
        self.device = wp.get_device(device)
        world = scene.world
        rows = world.taxels.arrays[3]
        if (wide := [one.name for one in scene.robot.patches if one.rigid]) and skin:
            raise TciError(f"{wide[0]} is a rigid plate; valid on a GPU: soft skin, or skin=False")
        layout = scene.body.layout.arrays
        servos = world.servos
        with wp.ScopedDevice(self.device):
            world.refresh()
            self.model = mjw.put_model(scene.model)
            """Model of mujoco-warp."""
            self.data = mjw.put_data(
                scene.model, world.data, nworld=count, nconmax=CONTACTS, njmax=scene.model.nv + ROWS
            )
            """Data of mujoco-warp, for direct access between two steps."""
            self._servos = feel.structs(
                kernels.Servo,
                [
                    {
                        "lag": float(one["lag"]), "ratio": float(one["ratio"]), "shift": float(one["shift"]),
                        "top": float(top), "servo": int(one["servo"]), "address": int(one["address"]),
                        "actuator": int(one["actuator"]),
                    }
                    for one, top in zip(servos.drives, servos.top, strict=True)
                ],
                self.device,
            )  # fmt: skip
            self._patches = feel.structs(
                feel.Patch,
                [
                    {"width": float(one["width"])}
                    | {name: int(one[name]) for name in ("sensor", "body", "begin", "end")}
                    for one in rows
                ],
                self.device,
            )
            self._positions = wp.array(layout.taxels["position"], dtype=wp.vec3)
            self._normals = wp.array(layout.taxels["normal"], dtype=wp.vec3)
            owner = np.repeat(np.arange(len(rows)), rows["end"] - rows["begin"]).astype(np.int32)
            self._owner = wp.array(owner, dtype=int)
            self._forces = wp.zeros((count, scene.taxels), dtype=float)
            self._full, self._number = wp.zeros(1, dtype=int), wp.zeros(1, dtype=int)
            self._limits = wp.array(scene.limits, dtype=float)
            self._start = servos.asked["target"].copy()
            n = len(self._start)
            self._wanted = wp.full((count, n), math.nan, dtype=float)
            self._goals, self._states = wp.zeros((count, n), dtype=float), wp.zeros((count, n), dtype=wp.vec3)
            self._times, self._jerks = (wp.zeros((count, n, 8), dtype=float) for _ in range(2))
            self._drives = wp.zeros((count, len(servos.drives)), dtype=wp.vec3)
            self._pokes = wp.zeros(count, dtype=kernels.Poke)
            self._qpos, self._qvel = wp.clone(self.data.qpos), wp.clone(self.data.qvel)
            self._touches = Touches(scene, count) if skin else None
        self._rates = rows["rate"].copy()
        self._every = int(servos.ramp_steps)
        self._due: dict[bytes, Any] = {}
        self._graphs: dict[tuple[bool, bytes], Any] = {}
        self.reset()

    def reset(self, worlds: ArrayLike | None = None) -> None:
        ids, world = self.ids(worlds), self.scene.world
        data, servos = world.data, world.servos
        states = np.zeros((len(self._start), 3))
        states[:, 0] = self._start
        drives = np.zeros((len(servos.drives), 3))
        drives[:, 0] = servos.drives["setpoint"]
        for array, value in (
            (self.data.qpos, data.qpos), (self.data.qvel, data.qvel), (self.data.ctrl, data.ctrl),
            (self.data.qacc_warmstart, 0.0), (self._goals, self._start), (self._states, states),
            (self._times, 0.0), (self._drives, drives), (self._wanted, math.nan), (self._forces, 0.0),
        ):  # fmt: skip
            self._write(array, ids, value)
        self.retire(ids)
        if self._touches:
            self._touches.reset(ids)
            for w in ids.tolist() if self._trackers else ():
                self._trackers[w] = Tracker()
        if worlds is None:
            self.steps, self._taken = 0, np.full(len(self._rates), -1)
            self._stamps = np.zeros(len(self._rates))
            self._number.zero_()
            self._full.zero_()
            if self._touches:
                self._touches.full.zero_()

    def retire(self, worlds: ArrayLike | None = None) -> None:
        """Removes the fingers of some worlds, or of all."""
        ids, finger = self.ids(worlds), self.scene.world.finger
        self._place(ids, np.broadcast_to(PARKED, (len(ids), 3)), np.array([1.0, 0.0, 0.0, 0.0]), 0.0)
        pokes = self._pokes.numpy()
        pokes[ids] = np.zeros(1, pokes.dtype)
        self._pokes.assign(pokes)
        ctrl = self.data.ctrl.numpy()
        ctrl[ids, finger.actuator] = 0.0
        self.data.ctrl.assign(ctrl)

    def _write(self, array: Any, ids: Ids, value: Any) -> None:
        if len(ids) == self.count:
            array.assign(np.broadcast_to(value, array.numpy().shape).astype(np.float32))
            return
        values = array.numpy()
        values[ids] = value
        array.assign(values)

    def advance(self, duration: float) -> None:
        count = self._steps_in(duration)
        with wp.ScopedDevice(self.device):
            for _ in range(count):
                self._step()

    def check(self) -> None:
        """Raises TciError if a patch had more contacts at a time than its sensor can report: waits for the
        device, so `advance` does not."""
        if full := int(self._full.numpy()[0]):
            raise TciError(f"world {full - 1}: too many contacts on one patch at once")

    def _step(self) -> None:
        due = np.zeros(len(self._rates), np.int32)
        if self._touches:
            # As in `loops.feel`: the frame after the latest one is due from this step on.
            due[:] = self.steps >= np.ceil((self._taken + 1) / self._rates - 1e-6)
            self._taken += due
            self._stamps[due > 0] = self.time
        key = self.steps % self._every == self.phase, due.tobytes()
        if key[1] not in self._due:
            self._due[key[1]] = wp.array(due, dtype=int)
        if not self.device.is_cuda:
            self._launch(*key)
        elif key not in self._graphs:
            # Recorded without running, then run: so the kernels must be loaded before.
            self._launch(*key)
            with wp.ScopedCapture() as capture:
                self._launch(*key)
            self._graphs[key] = capture.graph
        else:
            wp.capture_launch(self._graphs[key])
        self.steps += 1
        if self._touches and due.any():
            self.frames += 1
            self._touches.renew()
            self._follow()

    def _launch(self, tick: bool, which: bytes) -> None:
        """One step of the physics, on a control `tick` after the set-points have moved on; then frames of the
        patches that are due."""
        data, count, step = self.data, self.count, wp.float64(self.scene.step)
        shape, finger = self._drives.shape, self.scene.world.finger
        if tick:
            wp.launch(kernels.limit, dim=self._goals.shape, inputs=[
                self.scene.period, self._wanted, self._limits, self._goals, self._states, self._times,
                self._jerks,
            ])  # fmt: skip
            wp.launch(
                kernels.aim, dim=shape, inputs=[float(self._every), self._servos, self._states, self._drives]
            )
        wp.launch(
            kernels.prepare, dim=shape,
            inputs=[self._servos, self._states, data.qpos, self._drives, data.ctrl],
        )  # fmt: skip
        wp.launch(kernels.push, dim=count, inputs=[
            step, self._number, finger.actuator, DAMPING / STIFFNESS, self._pokes, data.ctrl,
        ])  # fmt: skip
        if any(which):
            wp.copy(self._qpos, data.qpos)
            wp.copy(self._qvel, data.qvel)
        mjw.step(self.model, data)
        sensor = int(finger.state[0]["sensor"])
        wp.launch(kernels.note, dim=count, inputs=[step, self._number, sensor, data.sensordata, self._pokes])
        wp.launch(kernels.count, dim=1, inputs=[self._number])
        if any(which):
            due = self._due[which]
            wp.launch(feel.clear, dim=self._forces.shape, inputs=[due, self._owner, self._forces])
            wp.launch_tiled(
                feel.feel, dim=(count, len(self._rates), SLOTS), block_dim=feel.LANES,
                inputs=[
                    due, self._patches, data.sensordata, data.xpos, data.xmat, self._positions, self._normals,
                    self._forces, self._full,
                ],
            )  # fmt: skip
            assert self._touches is not None  # or no frame were due
            self._touches.launch(due, self._forces, self._states, self._qpos, data)

    def send(self, targets: ArrayLike) -> None:
        given = np.asarray(targets, dtype=np.float32)
        if given.shape != self._wanted.shape or np.isinf(given).any():
            raise CommandError(f"targets of shape {given.shape}; valid: {self._wanted.shape}, finite or NaN")
        self._wanted.assign(given)

    @property
    def joints(self) -> Array:
        return self._servo_angles(self.data.qpos.numpy())

    def _servo_angles(self, qpos: Array) -> Array:
        first = self.scene.world.servos.drives[::-1]  # of a servo with several joints the first counts
        angles: Array = self._states.numpy()[:, :, 0].astype(float)
        angles[:, first["servo"]] = (qpos[:, first["address"]] - first["shift"]) / first["ratio"]
        return angles

    @property
    def contacts_on_device(self) -> Touches:
        """The contacts of the latest frames, as Warp's arrays. Raises CommandError for worlds without
        skin."""
        if self._touches is None:
            raise CommandError("contacts of worlds without skin; valid: skin=True")
        return self._touches

    @property
    def touched(self) -> NDArray[np.bool_]:
        touched: NDArray[np.bool_] = self.contacts_on_device.read("counts").any(axis=1)
        return touched

    def _contacts_of(self, world: int) -> ContactArrays:
        return self.contacts_on_device.contacts(world)

    def _active_of(self, world: int) -> tuple[NDArray[np.int64], NDArray[np.int32], Array]:
        return self.contacts_on_device.active(world)

    def _latest(self) -> tuple[Array, NDArray[np.int64]]:
        return frozen(self._stamps.copy()), frozen(self._taken.astype(np.int64))

    def _then(self, world: int) -> tuple[Array, Array]:
        angles = self._servo_angles(self._qpos.numpy())[world]
        drives, velocity = self.scene.world.servos.drives[::-1], np.zeros(len(self._start))
        velocity[drives["servo"]] = self._qvel.numpy()[world, drives["dof"]] / drives["ratio"]
        return angles, velocity

    @property
    def force(self) -> Array:
        self.check()
        force: Array = self._forces.numpy()
        return force

    @property
    def force_on_device(self) -> Any:
        """`force` as Warp's array (N, taxels); one and the same object always, for `wp.to_torch`."""
        return self._forces

    @property
    def finger_force(self) -> Array:
        """Contact force (N,) [N] on the tip of each finger in the latest step."""
        force: Array = self._pokes.numpy()["force"]
        return force

    def _link_poses(self, bodies: Ids, worlds: Ids) -> tuple[Array, Array]:
        with wp.ScopedDevice(self.device):
            mjw.kinematics(self.model, self.data)
        turns = self.data.xmat.numpy()[worlds, bodies].reshape(-1, 3, 3)
        return self.data.xpos.numpy()[worlds, bodies].astype(float), turns.astype(float)

    def _place(self, worlds: Ids, at: Array, quats: Array, speed: ArrayLike) -> None:
        finger = self.scene.world.finger
        for array, column, value in (
            (self.data.mocap_pos, finger.mocap, at), (self.data.mocap_quat, finger.mocap, quats),
            (self.data.qpos, finger.qpos, 0.0), (self.data.qvel, finger.dof, speed),
        ):  # fmt: skip
            values = array.numpy()
            values[worlds, column] = value
            array.assign(values)

    def _place_fingers(
        self, worlds: Ids, at: Array, way: Array, speed: Array, depth: Array, gap: float
    ) -> None:
        quats = np.empty((len(worlds), 4))
        for quat, one in zip(quats, way, strict=True):
            mujoco.mju_quatZ2Vec(quat, one)
        self._place(worlds, at, quats, speed)
        pokes = self._pokes.numpy()
        pokes[worlds] = np.zeros(1, pokes.dtype)
        pokes["active"][worlds], pokes["begin"][worlds], pokes["end"][worlds] = 1, self.time, gap + depth
        pokes["speed"][worlds], pokes["depth"][worlds] = speed, depth
        self._pokes.assign(pokes)
