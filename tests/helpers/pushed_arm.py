"""A simulated arm with masses and friction that differ from the observer's model, with noise, and a push on
this arm."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from tci.messages import JointReading
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.joint_calibration import JointCalibration, JointFriction
from tci.robot.joint_map import initial_position
from tci.robot.model_file import load_spec

ARM = "left_arm"
STEP, PERIOD = 0.001, 0.002
COULOMB, VISCOUS, ROTOR = 0.012, 0.004, 0.0004
"""For each joint, relative to its torque limit [N m]: dry friction [N m], viscous friction [N m s/rad] and
rotor inertia [kg m2]."""
STIFFNESS, DAMPING = 8.0, 0.2
"""Gains [1/rad] and [s/rad] of the position control, relative to a joint's torque limit [N m]. For a G1's arm
they are 200 and 5. G1's teleoperation uses 80 to 300."""
KNOWN = 0.5
"""Fraction of the friction that the calibration contains."""
WRONG = 0.1
"""Relative error of the masses and of the rotor inertias."""
NOISE, SPEED_NOISE = 0.008, 0.005
"""Noise of reported torques, as a fraction of the torque limit, and noise of reported speeds [rad/s]."""


def calibration(robot: Robot) -> JointCalibration:
    """Returns the result of an identification: half of the friction, and the rotor inertias."""
    friction = {}
    for servo in robot.servos:
        size = servo.limits.torque or 25.0
        friction[servo.name] = JointFriction(
            coulomb=KNOWN * COULOMB * size, viscous=KNOWN * VISCOUS * size, rotor=ROTOR * size
        )
    return JointCalibration(robot=robot.name, friction=friction)


@dataclass
class Push:
    """A force on a point of a link."""

    link: str
    point: Array
    """Position (3,) [m] of the point in the link."""
    force: Array
    """Force (3,) [N] in the frame of the link."""
    begin: float
    end: float

    def size(self, time: float) -> float:
        """Returns the fraction (0..1) of the force that acts at a time [s]. The force rises within 50 ms."""
        return float(np.clip((time - self.begin) / 0.05, 0.0, 1.0)) if time < self.end else 0.0


class Plant:
    """One arm that follows targets with springs and dampers, like the motors of a G1."""

    def __init__(self, robot: Robot, seed: int, *, amplitude: float = 0.5, hertz: float = 0.5) -> None:
        self.robot = robot
        self.random = np.random.default_rng(seed)
        arm = {servo.joint: servo for servo in robot.servos_of(ARM)}
        assert robot.model is not None
        spec = load_spec(robot.model)
        for joint in list(spec.joints):
            if joint.name not in arm:
                spec.delete(joint)
        for element in [*spec.geoms, *spec.meshes]:
            spec.delete(element)
        spec.compiler.boundmass, spec.compiler.boundinertia = 1e-6, 1e-9
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model = spec.compile()
        signs = self.random.choice([-1.0, 1.0], self.model.nbody)
        if seed % 2:
            signs[:] = signs[0]  # either all links are too heavy, or all links are too light
        factor = 1.0 + WRONG * signs
        self.servos = np.array([arm[self.model.joint(j).name].index for j in range(self.model.njnt)])
        self.limit = np.array([robot.servos[s].limits.torque for s in self.servos], dtype=float)
        self.nominal = mujoco.MjData(self.model)
        self.nominal_masses = self.model.body_mass.copy()
        self.model.body_mass[:] *= factor
        self.model.body_inertia[:] *= factor[:, None]
        self.model.dof_armature[:] = ROTOR * self.limit * (1.0 + WRONG * self.random.choice([-1.0, 1.0]))
        self.model.dof_frictionloss[:] = COULOMB * self.limit
        self.model.dof_damping[:] = VISCOUS * self.limit
        self.data = mujoco.MjData(self.model)
        self.stiffness = STIFFNESS * self.limit
        self.damping = DAMPING * self.limit
        self.home = initial_position(robot)
        self.amplitude, self.hertz = amplitude, hertz
        self.phase = self.random.uniform(0.0, 2.0 * np.pi, len(self.servos))
        self.limits = np.array(
            [(robot.servos[s].limits.lower, robot.servos[s].limits.upper) for s in self.servos]
        )
        self.centre = np.clip(
            self.home[self.servos], self.limits[:, 0] + amplitude, self.limits[:, 1] - amplitude
        )
        self.time, self.sequence = 0.0, 0
        self.target = self.reference(0.0)
        self.data.qpos[:] = self.target
        self.weight = self.model.body_mass.copy()
        mujoco.mj_forward(self.model, self.data)

    def reference(self, time: float) -> Array:
        """Returns the angles (k,) [rad] of the arm's undisturbed motion."""
        return self.centre + self.amplitude * np.sin(2.0 * np.pi * self.hertz * time + self.phase)

    def step(self, push: Push | None = None, *, target: Array | None = None) -> JointReading:
        """Simulates one control period towards `target` (k,) [rad], by default the undisturbed motion.
        Returns the readings of the robot."""
        model, data = self.model, self.data
        before, self.target = self.target, self.reference(self.time + PERIOD) if target is None else target
        speed = (self.target - before) / PERIOD
        held = self._weight_by_the_model()
        torque = self.stiffness * (self.target - data.qpos) + self.damping * (speed - data.qvel) + held
        torque = np.clip(torque, -self.limit, self.limit)
        for _ in range(round(PERIOD / STEP)):
            data.qfrc_applied[:] = torque
            if push is not None and (size := push.size(self.time)) > 0.0:
                body = model.body(push.link).id
                R = data.xmat[body].reshape(3, 3)
                mujoco.mj_applyFT(
                    model,
                    data,
                    size * (R @ push.force),
                    np.zeros(3),
                    data.xpos[body] + R @ push.point,
                    body,
                    data.qfrc_applied,
                )
            mujoco.mj_step(model, data)
            self.time += STEP
        self.sequence += 1
        n = len(self.robot.servos)
        position, velocity, reported = self.home.copy(), np.zeros(n), np.full(n, np.nan)
        position[self.servos] = data.qpos
        velocity[self.servos] = data.qvel + SPEED_NOISE * self.random.standard_normal(len(self.servos))
        reported[self.servos] = torque + NOISE * self.limit * self.random.standard_normal(len(self.servos))
        return JointReading(
            self.time, self.sequence, read_only(position), read_only(velocity), read_only(reported)
        )

    def _weight_by_the_model(self) -> Array:
        """Returns the torques (k,) [N m] that hold the weight in the controller's model."""
        model, held = self.model, np.zeros(self.model.nv)
        self.nominal.qpos[:] = self.data.qpos
        model.body_mass[:] = self.nominal_masses
        mujoco.mj_kinematics(model, self.nominal)
        mujoco.mj_comPos(model, self.nominal)
        mujoco.mj_comVel(model, self.nominal)
        mujoco.mj_rne(model, self.nominal, 0, held)
        model.body_mass[:] = self.weight
        return held
