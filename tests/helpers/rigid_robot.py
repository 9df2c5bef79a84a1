"""A robot of rigid bodies with people around it, of which TCI knows nothing: it judges motion and force.

MuJoCo steps the packaged model: coupled, with gravity, dry friction and masses that differ from the model's.
Servos have their own frequency, damping and torque; readings come late, jittering, doubled, reordered and
coarse; commands take effect one to three periods later. Nothing of `tci.gate` or `tci.simulation` is imported
(a test holds that), so no assumption of theirs can hide here.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.messages import JointReading, Mode, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.collisions import solid_spec
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.skin.layout import normal_channels
from tci.skin.surfaces import surfaces_of

STEP = 5e-4
"""Physics step [s]: a hand of 75 N/mm still swings over 10 steps."""
ROBOT, PERSON = 1, 2
SURFACE_MASS = 0.05
"""Mass [kg] of a person's surface on its spring; far below every region's own mass."""
DEEP = 0.03
"""Distance [m] between a contact and the nearest taxel above which no skin is there: a sleeve is thinner."""
STICKS = 0.01
"""Angle [rad] at which a servo overcomes its dry friction: half a degree, as good servos do."""
SPREAD = 6e-3
"""Width [m] of the Gaussian over which skin spreads a force."""
AWAY = np.array([0.0, 0.0, -50.0])


@dataclass(frozen=True)
class Person:
    """A part of a person: a sphere or, with a `half` length, a capsule along z, on a spring."""

    name: str
    stiffness: float
    """[N/m]."""
    mass: float | None = None
    """[kg]; None: it can't give way (clamped, or lying against a wall)."""
    radius: float = 0.03
    """[m]."""
    half: float = 0.0
    """[m]."""
    damping: float = 0.3
    """Ratio on its spring."""
    surface: float = SURFACE_MASS
    """Mass [kg] of its surface."""


@dataclass(frozen=True)
class Dirt:
    """What differs from the model. The ranges are those of real humanoids' buses and gears."""

    masses: float = 0.2
    """Largest relative error of a link's mass."""
    frequency: tuple[float, float] = (60.0, 150.0)
    """Servo's natural frequency [rad/s]."""
    damping: tuple[float, float] = (0.7, 1.3)
    motor: tuple[float, float] = (0.0, 1.0)
    """Rotor's inertia at the joint, as a multiple of the links'."""
    friction: float = 0.05
    """Dry friction, as a fraction of the torque limit."""
    delay: tuple[float, float] = (0.003, 0.014)
    """Age of a reading on arrival [s]; each trial draws one, each reading adds up to a third."""
    doubled: float = 0.05
    reordered: float = 0.02
    coarse: tuple[float, float] = (1e-4, 3e-3)
    """Encoder's step [rad]."""
    late: tuple[int, int] = (1, 3)
    """Periods until a command takes effect."""
    torque: tuple[float, float] = (0.2, 0.01)
    """Measured torques: largest relative error of a joint's, and noise as a fraction of the torque limit."""
    stalls: float = 0.0
    """How often a second nothing arrives for `STALLS` [s]; what waited comes at once."""
    restamped: bool = False
    """Stamps tell when a reading arrived, not when it was taken."""


WIRE = Dirt(delay=(0.005, 0.03), stalls=0.2, restamped=True)
"""A robot behind a network."""
STALLS = (0.02, 0.2)
CLEAN = Dirt(
    0.0, (120.0, 120.0), (1.0, 1.0), (0.5, 0.5), 0.0, (0.0, 0.0), 0.0, 0.0, (1e-9, 1e-9), (0, 0), (0.0, 0.0)
)


class RigidClock:
    """The plant's clock: waiting runs the physics."""

    def __init__(self, plant: RigidRobot) -> None:
        self._plant = plant

    def now(self) -> float:
        return self._plant.time

    def sleep_until(self, stamp: float) -> None:
        self._plant.advance(stamp)


@dataclass
class Felt:
    """Force over time on one person."""

    time: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    first: float | None = None
    """Time [s] of the first contact of more than 1 N."""

    def add(self, time: float, force: float) -> None:
        self.time.append(time)
        self.force.append(force)
        if self.first is None and force > 1.0:
            self.first = time

    @property
    def now(self) -> float:
        return self.force[-1] if self.force else 0.0

    def at(self, time: float) -> float:
        """Force [N] at `time` [s], the mean of 20 ms around it."""
        times, forces = np.array(self.time), np.array(self.force)
        near = np.abs(times - time) <= 0.01
        return float(forces[near].mean()) if near.any() else 0.0

    @property
    def peak(self) -> float:
        return max(self.force, default=0.0)

    def above(self, force: float) -> float:
        """Time [s] for which the force was above `force` [N]."""
        return float(np.sum(np.array(self.force) > force) * STEP)


class RigidRobot:
    """The plant: robot, people, servos, readings and skin."""

    def __init__(
        self,
        robot: Robot,
        *,
        people: Sequence[Person] = (),
        dirt: Dirt | None = None,
        seed: int = 0,
        compensated: bool = True,
        angles: Array | None = None,
        rate: float | None = None,
    ) -> None:
        """Builds the plant at `angles` (n_servos,) [rad], by default the initial posture.

        Args:
            robot: what is simulated; needs a model with masses.
            people: out of reach until `place`.
            dirt: what differs from the model; None for the default ranges.
            seed: of everything that is drawn.
            compensated: the servos' firmware holds the weight that the *model* says.
            angles: start.
            rate: of readings and commands [Hz].
        """
        self.robot, self.people, self._dirt = robot, tuple(people), dirt or Dirt()
        self.random, self._seed = np.random.default_rng(seed), seed
        self._rate = rate or robot.binding("sim").rate
        start = np.array(initial_position(robot) if angles is None else angles)
        self._build(start, compensated)
        self.steps = 0
        self.felt = {one.name: Felt() for one in self.people}
        self._set_up_servos(start)
        self._set_up_readings()
        self._set_up_skin()

    # ---------------------------------------------------------------- the model

    def _build(self, start: Array, compensated: bool) -> None:
        spec = solid_spec(self.robot)
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.gravity = [0.0, 0.0, -9.81]
        links = [body for body in spec.bodies if body.name != "world"]
        for body in links:
            body.gravcomp = 1.0
        for geom in spec.geoms:
            geom.contype, geom.conaffinity, geom.condim = ROBOT, PERSON, 3
            geom.friction = [0.5, 0.005, 1e-4]
            geom.solref = [2.0 * STEP, 1.0]
        for servo in self.robot.servos:
            for joint in servo.joints:
                spec.add_actuator(name=joint.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.joint)
        for one in self.people:
            self._add(spec, one)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        names = [body.name for body in links]
        own = np.array([self.model.body(name).id for name in names])
        self._own = own
        self._inertia = _diagonal_inertia(self.model)
        errors = self.random.uniform(1.0 - self._dirt.masses, 1.0 + self._dirt.masses, len(own))
        self.model.body_mass[own] *= errors
        self.model.body_inertia[own] *= errors[:, None]
        self.model.body_gravcomp[own] = compensated / errors

    def _add(self, spec: mujoco.MjSpec, one: Person) -> None:
        base = spec.worldbody.add_body(name=one.name, pos=AWAY, gravcomp=1.0)
        if one.mass is not None:
            base.mass, base.inertia = one.mass, [0.01 * one.mass] * 3
            base.explicitinertial = True
            _slides(base, f"{one.name} base", 0.0, 0.0)
        surface = base.add_body(name=f"{one.name} surface", gravcomp=1.0)
        damping = 2.0 * one.damping * float(np.sqrt(one.stiffness * one.surface))
        _slides(surface, f"{one.name} surface", one.stiffness, damping)
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE if one.half else mujoco.mjtGeom.mjGEOM_SPHERE
        surface.add_geom(
            name=one.name, type=kind, size=[one.radius, one.half, 0.0], mass=one.surface, contype=PERSON,
            conaffinity=ROBOT, condim=3, friction=[0.5, 0.005, 1e-4], solref=[2.0 * STEP, 1.0],
        )  # fmt: skip

    def pose(self, angles: Array) -> None:
        """Puts the links where they are at `angles` (n_servos,) [rad], before the first step."""
        self.data.qpos[self._qpos] = angles[self._servo] * self._ratio + self._shift
        mujoco.mj_kinematics(self.model, self.data)

    def place(self, name: str, point: Array, along: Array | None = None) -> None:
        """Puts a person's surface around `point` (3,) [m] of the world, a capsule's axis `along` (3,)."""
        base = self.model.body(name).id
        self.model.body_pos[base] = point
        if along is not None:
            mujoco.mju_quatZ2Vec(self.model.body_quat[base], np.asarray(along, dtype=float))
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def shift(self, name: str, point: Array) -> None:
        """Moves a clamped person's surface towards `point` (3,) [m], as somebody who moves it does."""
        self.model.body_pos[self.model.body(name).id] = point

    def gaps(self, name: str, point: Array) -> dict[str, float]:
        """Distance [m] of each link's solids from a person's surface around `point` (3,) [m]; below 0 inside.
        Solids are convex hulls, so this says what touches, which the meshes' vertices do not."""
        surface, found = self.model.geom(name).id, dict[str, float]()
        before = self.data.geom_xpos[surface].copy()
        self.data.geom_xpos[surface] = point
        for geom in np.flatnonzero(self.model.geom_contype == ROBOT).tolist():
            link = self.model.body(self.model.geom_bodyid[geom]).name
            gap = mujoco.mj_geomDistance(self.model, self.data, surface, geom, 1.0, None)
            found[link] = min(found.get(link, 1.0), gap)
        self.data.geom_xpos[surface] = before
        return found

    def link_pose(self, link: str) -> tuple[Array, Array]:
        """Position (3,) [m] and rotation (3, 3) of a link in the world."""
        body = self.data.body(link)
        return body.xpos.copy(), body.xmat.reshape(3, 3).copy()

    # ---------------------------------------------------------------- time

    @property
    def time(self) -> float:
        return self.steps * STEP

    def advance(self, until: float) -> None:
        """Steps until `until` [s]."""
        last = round(until / STEP)
        while self.steps < last:
            self._drive()
            mujoco.mj_step(self.model, self.data)
            self.steps += 1
            for one, dofs in zip(self.people, self._surfaces, strict=True):
                spring = one.stiffness * self.data.qpos[dofs[0]]
                damper = -self.model.dof_damping[dofs[1]] * self.data.qvel[dofs[1]]
                touching = np.linalg.norm(spring - damper) if self.data.ncon else 0.0
                self.felt[one.name].add(self.time, float(touching))
            self._sense()

    # ---------------------------------------------------------------- servos

    def _set_up_servos(self, start: Array) -> None:
        model, random, dirt = self.model, self.random, self._dirt
        driven = [(servo.index, one) for servo in self.robot.servos for one in servo.joints]
        self._servo: NDArray[np.intp] = np.array([index for index, _ in driven], dtype=np.intp)
        joints = [model.joint(one.joint) for _, one in driven]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._dof = np.array([joint.dofadr[0] for joint in joints])
        self._motor = np.array([model.actuator(one.joint).id for _, one in driven])
        self._ratio = np.array([one.multiplier for _, one in driven])
        self._shift = np.array([one.offset for _, one in driven])
        first = {}
        for k, (index, _) in enumerate(driven):
            first.setdefault(index, k)
        self._first = np.array([first.get(index, -1) for index in range(len(self.robot.servos))])
        count = len(driven)
        load = np.maximum(self._inertia[self._dof], 1e-5)
        limits = [self.robot.servos[index].limits for index in self._servo]
        given = np.array([x.torque or 0.0 for x in limits])
        frequency, ratio = random.uniform(*dirt.frequency, count), random.uniform(*dirt.damping, count)
        # a gear with this friction has a rotor with which its servo still finds its target
        rotor = np.maximum(
            load * random.uniform(*dirt.motor, count), dirt.friction * given / STICKS / frequency**2
        )
        model.dof_armature[self._dof] = rotor
        total = load + rotor
        needed = total * np.array([x.acceleration or 20.0 for x in limits])
        self.needs = {self.robot.servos[i].name: (float(g), float(n))
                      for i, g, n in zip(self._servo, given, needed, strict=True) if 0.0 < g < n}  # fmt: skip
        """Servos whose described torque is below what the acceleration limit needs: (given, needed) [N m]."""
        self.torque = np.maximum(given, 1.2 * needed)
        model.dof_frictionloss[self._dof] = dirt.friction * np.where(given > 0.0, given, self.torque)
        # also where a joint's own damping rules, as that of Talos' grippers, its servo follows so fast
        self._kp = np.maximum(total * frequency**2, model.dof_damping[self._dof] * frequency)
        self._kd = 2.0 * ratio * total * frequency
        model.actuator_biastype[self._motor] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_forcelimited[self._motor] = True
        model.actuator_forcerange[self._motor] = np.column_stack([-self.torque, self.torque])
        mujoco.mj_setConst(model, self.data)
        mujoco.mj_resetData(model, self.data)
        self._target = start[self._servo] * self._ratio + self._shift
        self.data.qpos[self._qpos] = self._target
        self._reference, self._stride = self._target.copy(), np.zeros(count)
        self._modes = [Mode.POSITION] * len(self.robot.servos)
        self._share, self._damp = np.ones(len(self.robot.servos)), np.zeros(len(self.robot.servos))
        self._push = np.zeros(count)
        self._orders: deque[tuple[float, Any]] = deque()
        self._lateness = int(random.integers(dirt.late[0], dirt.late[1] + 1)) / self._rate
        self._surfaces = []
        for one in self.people:
            names = [model.joint(f"{one.name} surface {axis}") for axis in "xyz"]
            self._surfaces.append(
                (np.array([n.qposadr[0] for n in names]), np.array([n.dofadr[0] for n in names]))
            )
        mujoco.mj_forward(model, self.data)
        self._gain()

    def obey(self, safe: Any) -> None:
        """Takes a `SafeCommand`; it takes effect later."""
        self._orders.append((self.time + self._lateness, safe))

    def _drive(self) -> None:
        while self._orders and self._orders[0][0] <= self.time + 1e-9:
            self._take(self._orders.popleft()[1])
        # the set-point moves in a straight line through the period, as firmware interpolates
        left = self._target - self._reference
        self._reference += np.clip(left, -np.abs(self._stride), np.abs(self._stride))
        moving = np.where(np.abs(left) > 1e-12, np.sign(left) * np.abs(self._stride) / STEP, 0.0)
        lead = np.divide(self._kd, self._kp) * moving
        loose = np.array([self._modes[s] is Mode.TORQUE for s in self._servo])
        self.data.ctrl[self._motor] = np.where(loose, self._push, self._reference + lead)

    def _take(self, safe: Any) -> None:
        places = {int(servo): k for k, servo in enumerate(safe.servos)}
        for servo, k in places.items():
            if self._modes[servo] is Mode.TORQUE and safe.modes[k] is not Mode.TORQUE:
                mine = self._servo == servo
                self._reference[mine] = self.data.qpos[self._qpos][mine]
            self._modes[servo] = safe.modes[k]
        for servo, share in safe.stiffness.items():
            self._share[servo] = share
        for servo, share in safe.damping.items():
            self._damp[servo] = share
        for j, servo in enumerate(self._servo):
            if (k := places.get(int(servo))) is None:
                continue
            self._target[j] = safe.position[k] * self._ratio[j] + self._shift[j]
            self._push[j] = safe.torque[k] / self._ratio[j]
        self._stride = (self._target - self._reference) * self._rate * STEP
        self._gain()

    def _gain(self) -> None:
        loose = np.array([self._modes[s] is Mode.TORQUE for s in self._servo])
        share, more = self._share[self._servo], self._damp[self._servo]
        kp, kd = share * self._kp, (np.sqrt(share) + more) * self._kd
        model = self.model
        model.actuator_gainprm[self._motor, 0] = np.where(loose, 1.0, kp)
        model.actuator_biasprm[self._motor, 1] = np.where(loose, 0.0, -kp)
        model.actuator_biasprm[self._motor, 2] = np.where(loose, 0.0, -kd)

    # ---------------------------------------------------------------- what the robot tells

    @property
    def position(self) -> Array:
        """True angles (n_servos,) [rad]."""
        return self._of(self.data.qpos[self._qpos], shift=True)

    @property
    def velocity(self) -> Array:
        """True velocities (n_servos,) [rad/s]."""
        return self._of(self.data.qvel[self._dof])

    @property
    def kinetic_energy(self) -> float:
        """Of the whole robot [J], motors included."""
        return self.energy_at(self.data.qvel)

    def energy_at(self, speeds: Array) -> float:
        """Kinetic energy [J] in the present posture at joint speeds (nv,) [rad/s]."""
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        own = np.zeros(self.model.nv)
        own[self._dof] = speeds[self._dof]
        return float(0.5 * own @ full @ own)

    def _of(self, values: Array, *, shift: bool = False) -> Array:
        result = np.zeros(len(self._first))
        has = self._first >= 0
        k = self._first[has]
        result[has] = (values[k] - (self._shift[k] if shift else 0.0)) / self._ratio[k]
        return result

    def _set_up_readings(self) -> None:
        random, dirt = self.random, self._dirt
        self._delay = random.uniform(*dirt.delay)
        self._count = random.uniform(*dirt.coarse)
        self._due, self._sequence, self._stalled = 0, 0, 0.0
        self._waiting: list[tuple[float, JointReading]] = []
        self._arrived: deque[JointReading] = deque(maxlen=8)
        count = len(self._first)
        self._unlike = np.random.default_rng([self._seed, 11])
        self._scale = self._unlike.uniform(1.0 - dirt.torque[0], 1.0 + dirt.torque[0], count)
        self._noise = dirt.torque[1] * np.array([servo.limits.torque or 0.0 for servo in self.robot.servos])
        self._take_reading()
        self._arrived.append(self._waiting.pop()[1])

    def _take_reading(self) -> None:
        step = self._count
        torque = self._of(self.data.actuator_force[self._motor])
        position = np.round(self.position / step) * step
        joints = JointReading(
            stamp=self.time, sequence=self._sequence, position=read_only(position),
            velocity=read_only(np.round(self.velocity / 1e-3) * 1e-3), modes=tuple(self._modes),
            torque=read_only(self._scale * torque + self._noise * self._unlike.standard_normal(len(torque))),
        )  # fmt: skip
        self._sequence += 1
        late = self._delay * (1.0 + self.random.uniform(0.0, 0.33))
        self._waiting.append((self.time + late, joints))

    def _sense(self) -> None:
        if self.time >= self._sequence / self._rate - 1e-9:
            self._take_reading()
            if self._dirt.stalls and self._unlike.random() < self._dirt.stalls / self._rate:
                self._stalled = self.time + self._unlike.uniform(*STALLS)
        stalled = self.time < self._stalled
        arrived = [one for one in self._waiting if one[0] <= self.time + 1e-9 and not stalled]
        if arrived:
            self._waiting = [one for one in self._waiting if one[0] > self.time + 1e-9]
            stamp = {"stamp": self.time} if self._dirt.restamped else {}
            rows = sorted(arrived, key=lambda one: one[0])
            self._arrived.extend(replace(joints, **stamp) for _, joints in rows)
        for number, patch in enumerate(self._patches):
            if self.time >= self._frames[number].sequence / patch.rate + 1.0 / patch.rate - 1e-9:
                self._frames[number] = self._frame(number, self._frames[number].sequence + 1)

    def read(self) -> Reading:
        """What the robot's bus delivers now."""
        older = self._dirt.doubled + self._dirt.reordered
        latest = self._arrived[-2 if len(self._arrived) > 1 and self.random.random() < older else -1]
        return Reading(latest, tuple(self._frames))

    # ---------------------------------------------------------------- skin

    def _set_up_skin(self) -> None:
        self._patches = [patch for patch in self.robot.patches if not patch.through_joints]
        found = {one.patch: one for one in surfaces_of(self.robot)} if self._patches else {}
        self._surface = [found[patch.name] for patch in self._patches]
        self._link = [self.model.body(one.link).id for one in self._surface]
        self._frames = [self._frame(number, 0) for number in range(len(self._patches))]

    def _frame(self, number: int, sequence: int) -> SkinFrame:
        patch, surface = self._patches[number], self._surface[number]
        sensor = patch.sensor
        values = np.full(patch.channels, float(sensor.rest))
        forces = self._pressed(number)
        if forces is not None:
            counts = np.sign(sensor.pascal_per_count) * np.round(sensor.counts(forces / surface.areas))
            values[normal_channels(patch, surface)] += counts
            np.clip(values, sensor.lowest, sensor.highest, out=values)
        return SkinFrame(patch.name, self.time, sequence, read_only(values))

    def _pressed(self, number: int, by: str | None = None) -> Array | None:
        """Force (taxels,) [N] on each taxel, of one person if so asked; None if nothing touches."""
        data, surface, body = self.data, self._surface[number], self._link[number]
        forces, wrench = None, np.zeros(6)
        only = None if by is None else self.model.geom(by).id
        for index in range(data.ncon):
            contact = data.contact[index]
            bodies = self.model.geom_bodyid[list(contact.geom)]
            if self.model.body_weldid[body] not in self.model.body_weldid[bodies]:
                continue
            if only is not None and only not in contact.geom:
                continue
            mujoco.mj_contactForce(self.model, data, index, wrench)
            point = data.xmat[body].reshape(3, 3).T @ (contact.pos - data.xpos[body])
            apart = np.linalg.norm(surface.positions - point, axis=1)
            if wrench[0] <= 0.0 or apart.min() > DEEP:
                continue
            weights = np.exp(-0.5 * ((apart - apart.min()) / SPREAD) ** 2)
            forces = np.zeros(len(apart)) if forces is None else forces
            forces += wrench[0] * weights / weights.sum()
        return forces

    def on_skin(self, by: str | None = None) -> bool:
        """True if a taxel is pressed now, by one person if so asked."""
        return any(self._pressed(number, by) is not None for number in range(len(self._patches)))


class RigidDriver(Driver):
    """The plant behind TCI's interface of a robot."""

    def __init__(self, plant: RigidRobot, *, settings: Any = None) -> None:
        self.plant = plant
        super().__init__(
            DriverInfo.of(
                plant.robot, "sim", clock=RigidClock(plant), armed=True, settings=settings, streams=True,
                period=1.0 / plant._rate, lease_name=f"sim:{plant.robot.name}:{os.getpid()}:{id(plant)}",
            )
        )  # fmt: skip

    def _receive(self) -> Reading:
        return self.plant.read()

    def _send(self, safe: Any) -> None:
        self.plant.obey(safe)

    def _close(self) -> None:
        pass


def _slides(body: mujoco.MjsBody, name: str, stiffness: float, damping: float) -> None:
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        body.add_joint(
            name=f"{name} {axis}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction, stiffness=stiffness,
            damping=damping,
        )  # fmt: skip


def _diagonal_inertia(model: mujoco.MjModel) -> Array:
    """Largest inertia (nv,) [kg m2] of the links at each joint, over 32 postures."""
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    full, largest = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    low, high = model.jnt_range.T
    limited = model.jnt_limited.astype(bool) & (model.jnt_type != mujoco.mjtJoint.mjJNT_FREE)
    for _ in range(32):
        data.qpos[model.jnt_qposadr[limited]] = random.uniform(low[limited], high[limited])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_fullM(model, data, full)
        largest = np.maximum(largest, np.diag(full) - model.dof_armature)
    return largest
