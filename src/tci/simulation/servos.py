"""Simulated servos: stiff, critically damped, and limited in speed and torque.

In torque mode a servo exerts the commanded torque, and does not control the joint's angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import CommandError
from tci.messages import Mode
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.simulation import stepping as at
from tci.simulation.physics import Physics
from tci.support.engine import mujoco

TIME_CONSTANT = 5e-3
"""Time constant [s] of each servo. Assumed: the servo's response has two poles with this time constant. So
the servo reaches a target without overshoot, and follows a motion of constant speed with a delay of 10 ms."""
_POSTURES = 32
STALL = 0.1
"""Least torque with which a blocked servo pushes, as a fraction of its torque limit. If the stiffness of a
servo is too low for this torque, the inertia of its motor is increased, and the stiffness with it. Assumed: a
slow servo has a gear, so the inertia of its motor is large."""
_LEAST_ARMATURE = 1e-4
"""Least inertia [kg m2] of a motor, as it acts at the joint. Assumed: with this inertia the gains of very
light links are above 0."""
_INDEX, _NUMBER = np.dtype(np.int64), np.dtype(np.float64)


class Servos:
    """The actuators of a world, in the order of `Robot.servos`.

    The set-point of a servo moves linearly to each new target. The motion lasts one control period, or longer
    if the joint's speed limit requires a longer time. So a sudden change of the target causes no sudden
    velocity, and a distant target is reached at the permitted speed. A blocked servo that becomes free does
    not jump to the set-point, because the position error is limited to the error that occurs at full speed.

    In velocity mode the servo follows the angles that result from the velocity command, like the firmware of
    many robots. In impedance mode the servo also follows its set-points, but with a fraction of its
    stiffness. In torque mode, and when the servo is off, the servo does not control the joint's angle.
    """

    def __init__(self, physics: Physics, robot: Robot, home: Array, *, period: float) -> None:
        """Starts at the angles `home` (n,) [rad]. `period` [s] is the time between two targets."""
        self._physics = physics
        self._home = home
        driven = [(servo.index, one) for servo in robot.servos for one in servo.joints]
        moving = [index for index, _ in driven]
        self.moving: NDArray[np.intp] = np.array(moving, dtype=np.intp)
        """Servo (k,) of each moving joint. Several joints may follow one servo."""
        model = physics.model
        joints = [model.joint(one.joint) for _, one in driven]
        self._levers = np.array([abs(one.multiplier) if one.slides else 1.0 for _, one in driven])
        self.addresses: NDArray[np.intp] = np.array([joint.qposadr[0] for joint in joints], dtype=np.intp)
        """Index of each moving joint's angle in `qpos`."""
        self._dofs = np.array([joint.dofadr[0] for joint in joints], dtype=np.intp)
        self._actuators = np.array([model.actuator(joint.name).id for joint in joints], dtype=np.intp)
        self.ramp_steps = float(max(1, round(period / physics.step)))
        limits = [robot.servos[index].limits for index in self.moving]
        speed = np.array([np.inf if limit.velocity is None else limit.velocity for limit in limits])
        self.drives = np.zeros(len(moving), at.DRIVE)
        """Control (k,) of the moving joints."""
        self.asked = np.zeros(len(home), at.ASKED)
        """Commands (n,) to all servos."""
        drives = self.drives
        drives["servo"], drives["address"] = self.moving, self.addresses
        drives["dof"], drives["actuator"] = self._dofs, self._actuators
        drives["ratio"] = [one.multiplier for _, one in driven]
        drives["shift"] = [one.offset for _, one in driven]
        speed = speed * np.abs(drives["ratio"])
        self.top = speed * physics.step
        drives["lag"] = speed * 2.0 * TIME_CONSTANT
        self._targets, self._torques = self.asked["target"], self.asked["torque"]
        self._setpoint, self._stride = drives["setpoint"], drives["stride"]
        self._kp, self._kv = self._set_up(robot)

    def _set_up(self, robot: Robot) -> tuple[Array, Array]:
        """Sets motor inertia and torque limit of each moving joint.

        Returns the full stiffness (k,) [N m/rad] of each moving joint, and the damping (k,) [N m s/rad] that
        belongs to this stiffness.
        """
        model, data = self._physics.model, self._physics.data
        inertia = _largest_inertia(model, data, self._dofs)
        # Assumed, as manufacturers do not publish the value: the motor's inertia at the joint equals the
        # load's inertia, which is good practice. With this inertia the damping is near critical in every
        # posture.
        own = model.dof_armature[self._dofs]
        armature = np.maximum(np.maximum(own, inertia - own), _LEAST_ARMATURE)
        given = [robot.servos[index].limits.torque for index in self.moving]
        pushes = STALL * np.array([0.0 if torque is None else torque for torque in given]) / self._levers
        armature = np.maximum(armature, own - inertia + pushes * TIME_CONSTANT**2 / self.drives["lag"])
        model.dof_armature[self._dofs] = armature
        total = inertia - own + armature
        # If the joint's own damping is more than critical, the stiffness is increased too. Otherwise the
        # joint would lag behind.
        damping = model.dof_damping[self._dofs]
        kp = np.maximum(total / TIME_CONSTANT**2, damping / (2.0 * TIME_CONSTANT))
        kv = np.maximum(2.0 * total / TIME_CONSTANT, damping)
        for index, actuator, load, lever in zip(
            self.moving, self._actuators, total, self._levers, strict=True
        ):
            limits = robot.servos[index].limits
            enough = _enough_torque(limits.acceleration, load * lever**2)
            torque = enough if limits.torque is None else limits.torque
            force = torque / lever
            model.actuator_forcerange[actuator] = (-force, force)
        mujoco.mj_setConst(model, data)
        return kp, kv

    def reset(self) -> None:
        """Restores full stiffness, removes additional damping, and sets the initial angles as targets."""
        self._stiffness = np.ones(len(self._home))
        self._damping = np.zeros(len(self._home))
        self._targets[:] = self._home
        self._setpoint[:] = self.home
        self._stride[:] = 0.0
        self.drives["advance"] = 0.0
        self._torques[:] = 0.0
        self.modes = (Mode.POSITION,) * len(self._home)
        """Control mode of each servo (n,)."""
        self._told: tuple[bytes, tuple[Mode, ...], tuple[Mode, ...]] = b"", (), ()
        self.powered = read_only(np.ones(len(self._home)), np.bool_)
        """True (n,) for each servo that is on."""
        self._apply_gains()
        self._physics.data.ctrl[self._actuators] = self._setpoint

    def show(self, angles: Array) -> None:
        """Puts the joints at the servos' `angles` (n,) [rad] at once, at rest, for a picture."""
        self._physics.qpos[self.addresses] = self._joint_angles(angles)
        self._physics.qvel[:] = 0.0
        self._physics.touch()

    @property
    def home(self) -> Array:
        """Returns the initial angle (k,) [rad] of each moving joint."""
        return self._joint_angles(self._home)

    def _joint_angles(self, angles: Array) -> Array:
        """Returns the angle (k,) [rad] of each moving joint at the servo angles `angles` (n,) [rad]."""
        result: Array = angles[self.moving] * self.drives["ratio"] + self.drives["shift"]
        return result

    def set_position_targets(self, servos: ArrayLike, angles: ArrayLike) -> None:
        """Sets targets `angles` (k,) [rad]. Raises CommandError for an invalid servo or angle."""
        if not (_plain(servos, _INDEX) and _plain(angles, _NUMBER) and len(servos) == len(angles)):
            servos, angles = _checked(servos, angles, len(self._home))
        if at.aim(servos, angles, self.top, self.ramp_steps, self.drives, self.asked):
            _checked(servos, angles, len(self._home))  # raises the error

    def set_stiffness(self, servos: ArrayLike, share: ArrayLike) -> None:
        """Sets fractions (k,) 0..1 of full stiffness. At 0 a servo exerts no torque. Raises CommandError for
        an invalid fraction."""
        index, values = _checked(servos, share, len(self._home), share=True)
        self._stiffness[index] = values
        self._apply_gains()

    def set_damping(self, servos: ArrayLike, share: ArrayLike) -> None:
        """Sets fractions (k,) 0..1 of additional damping.

        A fraction of 1 doubles the critical damping. Raises CommandError for an invalid servo or fraction.
        """
        index, values = _checked(servos, share, len(self._home), share=True)
        self._damping[index] = values
        self._apply_gains()

    def set_modes(self, servos: ArrayLike, modes: Sequence[Mode]) -> None:
        """Switches servos to control modes (k,). A servo that leaves torque mode keeps its current angle.

        Raises CommandError for an invalid servo.
        """
        now = self.modes
        told = np.asarray(servos).tobytes(), tuple(modes)
        if (*told, now) == self._told:
            return  # commands that are sent in every period repeat their modes
        index, _ = _checked(servos, np.zeros(len(modes)), len(self._home))
        changes = [(s, mode) for s, mode in zip(index.tolist(), modes, strict=True) if mode is not now[s]]
        after = list(now)
        for servo, mode in changes:
            if after[servo] is Mode.TORQUE:
                self._catch(servo)
            after[servo] = mode
            self._torques[servo] = 0.0
        if changes:
            self.modes = tuple(after)
            self._apply_gains()
        self._told = *told, self.modes

    def set_torques(self, servos: ArrayLike, torque: ArrayLike) -> None:
        """Sets torques (k,) [N m] of servos in torque mode, limited to the motor's limit.

        Raises CommandError for an invalid servo or torque.
        """
        index, values = _checked(servos, torque, len(self._home))
        self._torques[index] = values

    def set_power(self, servos: ArrayLike, on: bool) -> None:
        """Switches servos on or off. A servo that is off exerts no torque.

        Servos that are switched on keep their current angles. Raises CommandError for an invalid servo.
        """
        index, _ = _checked(servos, np.zeros(np.size(servos)), len(self._home))
        for servo in index.tolist():
            if on and not self.powered[servo]:
                self._catch(servo)
        powered = self.powered.copy()
        powered[index] = on
        self.powered = read_only(powered, np.bool_)
        self._apply_gains()

    @property
    def stiffness(self) -> Array:
        """Stiffness (n,) [N m/rad] of each servo at the stiffness fraction 1. 0 for a servo whose joint the
        simulated model lacks."""
        result = np.zeros(len(self._home))
        np.add.at(result, self.moving, self.drives["ratio"] ** 2 * self._kp)
        return result

    def _catch(self, servo: int) -> None:
        """Sets the target of a servo to its current angle, so that a servo that was without torque starts
        with a torque of 0."""
        self._torques[servo] = 0.0
        here = self.measured()[0]
        self._targets[servo] = here[servo]
        mine = self.moving == servo
        self._setpoint[mine] = self._joint_angles(here)[mine]

    def measured(self) -> tuple[Array, Array, Array]:
        """Returns angles [rad], velocities [rad/s] and motor torques [N m] of all servos, each (n,).

        Torques are the torques of the latest step. For a servo without a joint, the angle is the servo's
        target, and velocity and torque are 0.
        """
        found = np.empty((3, len(self._home)))
        angles, velocities, torques = found
        physics = self._physics
        at.measure(
            physics.qpos, physics.qvel, physics.motors, self.drives, self.asked, angles, velocities, torques
        )
        found.setflags(write=False)
        return found[0], found[1], found[2]

    def _apply_gains(self) -> None:
        """Writes the present stiffness and damping of all servos to the physics model. Servos that are off or
        in torque mode get none.
        """
        model = self._physics.model
        on = self.powered[self.moving]
        loose = np.array([self.modes[servo] is Mode.TORQUE for servo in self.moving], dtype=bool)
        stiffness, damping = self._stiffness[self.moving], self._damping[self.moving]
        kp, wanted = stiffness * self._kp, (np.sqrt(stiffness) + damping) * self._kv
        # The damping of the joint in the model is a part of the wanted damping, so it is subtracted.
        kv = np.maximum(wanted - model.dof_damping[self._dofs], 0.0)
        held = on & ~loose
        kp, kv = kp * held, kv * held
        modes = [self.modes[servo] for servo in self.moving]
        yielding = np.array([mode is Mode.IMPEDANCE for mode in modes], dtype=bool)
        # In impedance mode the damping acts on the velocity error. So the damping does not slow down a
        # commanded motion (Hogan 1985).
        lead = kv / np.where(kp > 0.0, kp, np.inf) / self._physics.step
        self.drives["lead"] = np.where(yielding, lead, 0.0)
        self.drives["loose"], self.drives["yielding"] = loose, yielding
        self.drives["limp"] = ~held | (stiffness <= 0.0)
        model.actuator_gainprm[self._actuators, 0] = np.where(loose & on, 1.0 / self._levers**2, kp)
        model.actuator_biasprm[self._actuators, 1] = -kp
        model.actuator_biasprm[self._actuators, 2] = -kv
        self._physics.touch()


def _largest_inertia(model: mujoco.MjModel, data: mujoco.MjData, dofs: NDArray[np.intp]) -> Array:
    """Returns the largest inertia (k,) [kg m2] at each of k joints over random postures within the joint
    limits. `dofs` (k,) are the indices of the joints in MuJoCo's `qvel`."""
    generator = np.random.default_rng(0)
    largest = np.zeros(len(dofs))
    full = np.zeros((model.nv, model.nv))
    # Jaws stay where they are: an arm with a gripper gets the motors of the arm without.
    slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
    jaws = [joint for joint in model.dof_jntid[dofs].tolist() if model.jnt_type[joint] == slide]
    moved = np.setdiff1d(np.arange(model.njnt), jaws)
    low, high = model.jnt_range[moved].T
    for _ in range(_POSTURES):
        data.qpos[model.jnt_qposadr[moved]] = generator.uniform(low, high)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_fullM(model, data, full)
        largest = np.maximum(largest, np.diag(full)[dofs])
    mujoco.mj_resetData(model, data)
    return largest


def _enough_torque(acceleration: float | None, inertia: float) -> float:
    """Returns a torque limit [N m] for a servo without a known limit.

    Assumed: twice the torque that accelerates `inertia` [kg m2] at the servo's limit `acceleration` [rad/s2].
    With None, the acceleration is assumed to be 100 rad/s2.
    """
    return 2.0 * inertia * (100.0 if acceleration is None else acceleration)


def _plain(values: ArrayLike, dtype: np.dtype[Any]) -> TypeGuard[NDArray[Any]]:
    return isinstance(values, np.ndarray) and values.dtype == dtype and values.ndim == 1


def _checked(
    servos: ArrayLike, values: ArrayLike, count: int, *, share: bool = False
) -> tuple[NDArray[np.intp], Array]:
    if _plain(servos, _INDEX) and _plain(values, _NUMBER):
        index, numbers = servos, values
    else:
        index, numbers = np.atleast_1d(servos), np.atleast_1d(np.asarray(values, dtype=float))
    if index.shape != numbers.shape or index.ndim != 1:
        raise CommandError(f"{numbers.size} values for {index.size} servos; valid: one for each")
    whole = index.dtype.kind in "iu" or not index.size
    index = index.astype(np.intp, copy=False) if whole else index
    fault = at.fault_of(index, numbers, count) if whole else 1
    if fault == 1:
        raise CommandError(f"servos {index.tolist()}; valid: 0 to {count - 1}")
    if fault == 2:
        raise CommandError(f"values {numbers.tolist()} for servos {index.tolist()}; valid: finite numbers")
    if share and not ((numbers >= 0.0) & (numbers <= 1.0)).all():
        raise CommandError(f"shares {numbers.tolist()} for servos {index.tolist()}; valid: 0 to 1")
    return index, numbers
