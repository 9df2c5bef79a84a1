"""Worlds on the processor: `mujoco.batch`, which steps them in threads, in double precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike, NDArray

from tci.batch import loops
from tci.batch.limiter import BatchLimiter
from tci.batch.posture import ANGLES, LimbTables
from tci.batch.scene import BatchScene
from tci.batch.worlds import Ids, Worlds
from tci.errors import CommandError, TciError
from tci.messages.contacts import CONTACT, TAXEL
from tci.messages.frames import Array, frozen
from tci.simulation.finger import PARKED as FINGER_PARKED
from tci.simulation.stepping import POKE
from tci.simulation.touch import skin_geom
from tci.simulation.world import World
from tci.skin.kernels.arrays import Clusters, ContactArrays
from tci.skin.kernels.contacts import SUMMARY
from tci.skin.tracking import Tracker
from tci.support.engine import mujoco

ACC, NONE = mujoco.mjtStage.mjSTAGE_ACC.value, mujoco.mjtStage.mjSTAGE_NONE.value
MOST = 16
"""Contacts of one world at a time."""


class MujocoWorlds(Worlds):
    """Worlds that equal `World` bit for bit, apart from the time at which a frame is there.

    Args:
        scene: The scene.
        count: Number of worlds.
        threads: Threads of the physics; 0 for one per processor.
        skin: False leaves taxels and contacts out; the physics stays the same.
    """

    def __init__(self, scene: BatchScene, count: int, *, threads: int = 0, skin: bool = True) -> None:
        super().__init__(scene, count)
        world, layout = scene.world, scene.body.layout
        self.batch = Batch(scene.model, count, threads)
        """MuJoCo's batch, for direct access between two steps. With skin, the contact sensors in its
        `sensordata` hold values of the world only after a step in which a frame was taken."""
        batch: Any = self.batch
        self._qpos, self._qvel, self._ctrl = batch.qpos, batch.qvel, batch.ctrl
        self._sensors, self._centres, self._turns = batch.sensordata, batch.xpos, batch.xmat
        self._drives = np.repeat(world.servos.drives[None], count, axis=0)
        self._asked = np.repeat(world.servos.asked[None], count, axis=0)
        self._pokes = np.repeat(world.finger.state, count)
        self._row = np.zeros((1, 3))
        self._wanted = np.full((count, len(scene.robot.servos)), np.nan)
        self._limiter = BatchLimiter(
            scene.limits, np.repeat(world.servos.asked["target"][None], count, axis=0), period=scene.period
        )
        self._every = int(world.servos.ramp_steps)
        shared = world.taxels.arrays
        self._rows = shared[3].copy()
        skins = (
            self._sensors, self._centres, self._turns, self._rows, *shared[4:8],
            *(np.array(one) for one in shared[8:]),
        )  # fmt: skip
        n, p = scene.taxels, len(layout.sites)
        self._force, self._numbers = np.zeros((count, n)), np.zeros((count, p), np.int64)
        self._felt = (
            self._force, np.zeros((count, n), np.int32), np.zeros((count, n)), self._numbers,
            np.zeros((count, p, 2), np.int64),
        )  # fmt: skip
        clusters = Clusters(
            np.zeros(n), np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(p, np.int64),
            np.zeros(n + 1, np.int32), np.zeros(n, np.int32), np.zeros(n),
        )  # fmt: skip
        self._found = (
            np.zeros((count, MOST), CONTACT), np.zeros((count, MOST + 1), np.int64),
            np.zeros((count, n), TAXEL), np.zeros(count, np.int64),
        )  # fmt: skip
        work = (
            np.zeros((len(scene.bodies) + 1, 4, 4)), np.zeros(p + 1, np.int64), np.zeros(n, np.int32),
            np.zeros(n), np.zeros(MOST, SUMMARY), np.zeros(len(scene.robot.servos)),
        )  # fmt: skip
        self._limbs, self._before = LimbTables(scene.body), (self._qpos.copy(), self._qvel.copy())
        self._posture = np.zeros((count, len(self._limbs.limbs), ANGLES))
        robots = (
            self._before[0], self._asked, world.servos.drives, self._limbs.weights, self._limbs.limbs,
            self._posture,
            scene.torso, np.ascontiguousarray(scene.T_LT), scene.bodies, self._centres, self._turns,
        )  # fmt: skip
        self._tables = (
            skins, layout.arrays, scene.estimates, self._felt, robots,
            scene.body.settings.contacts.limits, clusters, self._found, work,
        )  # fmt: skip
        self._contact_sensors = [scene.model.sensor(skin_geom(name)).id for name in world.surfaces]
        self._stages = batch.expand("sensor_needstage") if skin else None
        self._senses = True
        self._shared = -1, self._stamps(), np.zeros(p, np.int64)
        self.reset()

    def reset(self, worlds: ArrayLike | None = None) -> None:
        ids, world = self.ids(worlds), self.scene.world
        self.batch.reset(ids, stage=0)
        self._qpos[ids] = world.data.qpos
        self._qvel[ids] = 0.0
        self._drives[ids], self._asked[ids] = world.servos.drives, world.servos.asked
        self._ctrl[ids] = world.data.ctrl
        self._wanted[ids] = np.nan
        self._limiter.reset(ids, np.repeat(world.servos.asked["target"][None], len(ids), axis=0))
        self.retire(ids)
        for one in self._felt:
            one[ids] = 0
        self._found[3][ids] = 0
        for w in ids.tolist() if self._trackers else ():
            self._trackers[w] = Tracker()
        if worlds is None:
            self.steps = 0
            self._rows["count"], self._rows["due"], self._shared = -1, 0, (-1, *self._shared[1:])
            self._due = 0
        self.batch.forward(ids)

    def retire(self, worlds: ArrayLike | None = None) -> None:
        """Removes the fingers of some worlds, or of all."""
        ids, finger = self.ids(worlds), self.scene.world.finger
        batch: Any = self.batch
        batch.mocap_pos[ids, finger.mocap] = FINGER_PARKED
        self._qpos[ids, finger.qpos] = self._qvel[ids, finger.dof] = self._ctrl[ids, finger.actuator] = 0.0
        self._pokes[ids] = self.scene.world.finger.state[0]
        self._pokes["active"][ids] = 0

    def advance(self, duration: float) -> None:
        last = self.steps + self._steps_in(duration)
        while self.steps < last:
            number, time = self.steps, self.steps * self.scene.step
            if number % self._every == self.phase:
                sent = self._limiter.step(self._wanted)
                loops.aim(sent, self.scene.world.servos.top, float(self._every), self._drives, self._asked)
            loops.prepare(time, self._qpos, self._ctrl, self._drives, self._asked, self._pokes)
            due = self._stages is not None and number >= self._due
            if due:
                self._before[0][:], self._before[1][:] = self._qpos, self._qvel
            if self._stages is not None and due != self._senses:  # nobody reads them in other steps
                self._stages[:, self._contact_sensors] = ACC if due else NONE
                self._senses = due
            self.batch.step()
            loops.note(time, self._sensors, self._pokes, self._row)
            self.steps = number + 1
            if due:
                self._feel(number)

    def _feel(self, number: int) -> None:
        """Takes the frames that are due at the beginning of a step, which is over now; the joints were at
        `_before`."""
        if self._limbs.tabled:
            felt = (self._sensors[:, self._rows["sensor"]] > 0.0).any(axis=1) | self._numbers.any(axis=1)
            if len(worlds := np.flatnonzero(felt)):
                angles = self._angles_at(self._before[0][worlds], self._asked[worlds])
                self._limbs.fill(angles, worlds, self._posture)
        due = loops.take(number, *self._tables)
        if due < 0:
            far, world = divmod(-1 - due, self.count)
            most = f"more than {MOST} contacts" if far else "too many contacts on one patch"
            raise TciError(f"world {world}: {most} at once")
        self.frames, self._due = self.frames + 1, due
        self._follow()

    def _active_of(self, world: int) -> tuple[NDArray[np.int64], NDArray[np.int32], Array]:
        _, listed, pressure, _, _ = self._felt
        numbers, starts = self._numbers[world], self.scene.body.layout.starts
        if not numbers.any():
            return numbers, np.zeros(0, np.int32), np.zeros(0)
        own = np.concatenate([np.arange(s, s + n) for s, n in zip(starts, numbers.tolist(), strict=False)])
        return numbers, listed[world, own], pressure[world, own]

    def _then(self, world: int) -> tuple[Array, Array]:
        qpos, qvel = (one[world : world + 1] for one in self._before)
        drives, velocity = self.scene.world.servos.drives[::-1], np.zeros(self._wanted.shape[1])
        velocity[drives["servo"]] = qvel[0, drives["dof"]] / drives["ratio"]
        return self._angles_at(qpos, self._asked[world : world + 1])[0], velocity

    def _stamps(self) -> Array:
        """Times (p,) [s] of the latest frames."""
        stamps: Array = self._rows["taken"] * self.scene.step
        return stamps

    def _latest(self) -> tuple[Array, NDArray[np.int64]]:
        if self._shared[0] != self.frames:
            self._shared = self.frames, frozen(self._stamps()), frozen(self._rows["count"].copy())
        return self._shared[1:]

    def _contacts_of(self, world: int) -> ContactArrays:
        rows, begin, taxels, counts = self._found
        count = int(counts[world])
        kept = begin[world, : count + 1] if count else np.zeros(1, np.int64)
        return ContactArrays(rows[world, :count], kept, taxels[world, : kept[-1]])

    def send(self, targets: ArrayLike) -> None:
        given = np.asarray(targets, dtype=float)
        if given.shape != self._wanted.shape or np.isinf(given).any():
            raise CommandError(f"targets of shape {given.shape}; valid: {self._wanted.shape}, finite or NaN")
        self._wanted[:] = given

    @property
    def joints(self) -> Array:
        return self._angles_at(self._qpos, self._asked)

    def _angles_at(self, qpos: Array, asked: NDArray[np.void]) -> Array:
        """Angles (k, n) [rad] of all servos at MuJoCo's `qpos`, see `loops.servo_angles`."""
        angles = np.empty(asked.shape)
        loops.servo_angles(qpos, asked, self.scene.world.servos.drives, angles)
        return angles

    @property
    def set_points(self) -> Array:
        """Set-points (N, n) [rad] of the limiter."""
        return self._limiter.sent

    @property
    def force(self) -> Array:
        return self._force

    @property
    def touched(self) -> NDArray[np.bool_]:
        return self._found[3] > 0

    @property
    def finger_force(self) -> Array:
        """Contact force (N,) [N] on the tip of each finger in the latest step."""
        force: Array = self._pokes["force"]
        return force

    @property
    def finger_peak(self) -> Array:
        """Largest contact force (N,) [N] on the tip of each finger in its poke."""
        peak: Array = self._pokes["peak"]
        return peak

    def touch(self, world: int, arrange: Callable[[World], object]) -> None:
        """Has the finger of one world do what `arrange` has it do in a single world in the same posture, such
        as `lambda one: one.finger.poke("left_forearm", 100)`, with its look whether there is room."""
        one, finger = self.scene.world, self.scene.world.finger
        one.data.qpos[:] = self._qpos[world]
        one.touch_physics()
        try:
            arrange(one)
            if finger.pose is None:
                return
            fields: Any = self.batch
            fields.mocap_pos[world, finger.mocap] = one.data.mocap_pos[finger.mocap]
            fields.mocap_quat[world, finger.mocap] = one.data.mocap_quat[finger.mocap]
            self._qpos[world, finger.qpos], self._qvel[world, finger.dof] = 0.0, finger.state["speed"][0]
            self._pokes[world] = finger.state[0]
            self._pokes["begin"][world] = self.time
        finally:
            one.reset()

    def _link_poses(self, bodies: Ids, worlds: Ids) -> tuple[Array, Array]:
        self.batch.forward(worlds, stage=int(mujoco.mjtStage.mjSTAGE_POS))
        return self._centres[worlds, bodies], self._turns[worlds, bodies].reshape(-1, 3, 3)

    def _place_fingers(
        self, worlds: Ids, at: Array, way: Array, speed: Array, depth: Array, gap: float
    ) -> None:
        finger, batch = self.scene.world.finger, self.batch
        quats = np.empty((len(worlds), 4))
        for quat, one in zip(quats, way, strict=True):
            mujoco.mju_quatZ2Vec(quat, one)
        fields: Any = batch
        fields.mocap_pos[worlds, finger.mocap], fields.mocap_quat[worlds, finger.mocap] = at, quats
        self._qpos[worlds, finger.qpos], self._qvel[worlds, finger.dof] = 0.0, speed
        pokes = np.repeat(finger.state, len(worlds)).astype(POKE)
        pokes["active"], pokes["path"], pokes["end"] = 1, 0.0, gap + depth
        pokes["begin"], pokes["speed"], pokes["depth"] = self.time, speed, depth
        self._pokes[worlds] = pokes
