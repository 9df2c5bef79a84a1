"""The robot that is not there: a physical world with one robot, its skin and a finger."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from tci.engine import mujoco
from tci.errors import CommandError, DescriptionError, Fault
from tci.frames import Array, invert
from tci.messages import JointReading, Mode, SkinFrame
from tci.robot.collisions import NO_MODEL
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import Kinematics
from tci.simulation.finger import Finger
from tci.simulation.physics import Physics
from tci.simulation.posed_skin import PosedSkin
from tci.simulation.scene import build_scene
from tci.simulation.servos import Servos
from tci.simulation.taxels import Taxels
from tci.simulation.touch import ContactTruth, contact_truth
from tci.skin.surfaces import Surface, build_surface

MIDDLEWARE = "sim"
MAX_STEP = 0.005
"""Longest step [s]: the servos' own time constant. Contacts are softer from 0.002 s on."""
_PERIOD = 0.002
"""Time [s] between two targets for a robot without a binding to the simulation. Ours."""


class World:
    """One robot, with servos, skin and a finger, at its own time: on a fixed base, or standing on a floor.

    The same arguments, calls and MuJoCo version give the same bits. An object serves one thread.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        step: float = 0.001,
        seed: int = 0,
        skin: bool | Collection[str] = True,
        noise: float = 0.0,
        posture: Mapping[str, ArrayLike] | None = None,
        stands: bool = False,
        period: float | None = None,
    ) -> None:
        """`step` [s] is the physics' step, `period` [s] the time between two targets of the servos if not the
        description's; `noise` [counts] the standard deviation of raw skin values. `skin`
        says whether the robot wears its skin, or names the patches that it wears.

        `posture` are generic angles [rad] by generic part where the robot starts; parts that it does
        not name start at their initial posture. A robot that `stands` carries its weight on a floor under its
        soles, which alone touch it, and may fall; otherwise its base is fixed and it weighs nothing. Raises
        DescriptionError for a robot that can't be simulated, CommandError for a number or a posture that does
        not fit, or a robot that stands and has no soles that feel.
        """
        if robot.model is None:
            raise DescriptionError(robot.source, [Fault(0, NO_MODEL)])
        if not (np.isfinite(step) and 0.0 < step <= MAX_STEP):
            raise CommandError(f"step {step}; valid: above 0, up to {MAX_STEP} s")
        if not 0.0 <= noise < np.inf:
            raise CommandError(f"noise {noise}; valid: at least 0 counts, and finite")
        if period is not None and not 0.0 < period < np.inf:
            raise CommandError(f"period {period}; valid: above 0 s, and finite")
        self.robot = robot
        kinematics = Kinematics(robot)
        names = [patch.name for patch in robot.patches] if skin is True else skin or ()
        worn = [robot.patch(name) for name in names]
        self.surfaces: Mapping[str, Surface] = {
            patch.name: build_surface(robot, patch, kinematics) for patch in worn
        }
        """Taxels of every patch, by its name."""
        home = start_angles(robot, posture or {})
        self._seed = _checked_seed(seed)
        self._generator = np.random.default_rng(seed)
        self._physics = Physics(build_scene(robot, self.surfaces, home, step=step, stands=stands))
        self._home = home
        self._servos = Servos(self._physics, robot, home, period=_period(robot) if period is None else period)
        self._skin = PosedSkin(self._physics, robot.model, self.surfaces)
        self._taxels = Taxels(self._physics, worn, self.surfaces, noise=noise, generator=self._generator)
        self.finger = Finger(self._physics, self._skin)
        """What pokes the skin."""
        self.reset()

    @property
    def seed(self) -> int:
        """Of the noise on the skin."""
        return self._seed

    @property
    def step(self) -> float:
        """Of the physics [s]."""
        return self._physics.step

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model, for those who know it."""
        return self._physics.model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data. Contacts and poses belong to the joints before the latest step; see `refresh`."""
        return self._physics.data

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._physics.time

    def reset(self, *, seed: int | None = None) -> None:
        """Back to time 0, the initial posture, full stiffness, no finger, and the seed, or another one.

        Raises CommandError for a seed that is none.
        """
        self._seed = self._seed if seed is None else _checked_seed(seed)
        self._generator.bit_generator.state = np.random.default_rng(self._seed).bit_generator.state
        self._physics.reset(self._servos.addresses, self._home[self._servos.moving])
        self._servos.reset()
        self.finger.retire()
        self._taxels.reset()

    @property
    def torso(self) -> Array:
        """`T_WT` (4, 4): the torso in the world, now."""
        return self._skin.torso()

    def refresh(self) -> None:
        """Make poses and contacts in `data` belong to its joints. The future stays the same."""
        self._physics.refresh()

    def advance(self, until: float) -> None:
        """Step the physics until `time` is at least `until` [s]; skin frames are taken on the way."""
        last = math.ceil(until / self._physics.step - 1e-6)
        while self._physics.steps < last:
            end = min(last, self._taxels.due) if self._taxels.noisy else last
            servos, finger = self._servos, self.finger
            self._physics.advance(
                end,
                servos.state,
                servos.places,
                servos.asked,
                finger.state,
                finger.traced,
                self._taxels.arrays,
            )
            if self._taxels.noisy or self._physics.steps < end:
                self._taxels.frames()

    def set_position_targets(self, servos: ArrayLike, angles: ArrayLike) -> None:
        """Let servos (k,), indices into `Robot.servos`, go to `angles` (k,) [rad]. Raises CommandError."""
        self._servos.set_position_targets(servos, angles)

    def set_modes(self, servos: ArrayLike, modes: Sequence[Mode]) -> None:
        """Switch servos (k,) to control modes (k,). Raises CommandError."""
        self._servos.set_modes(servos, modes)

    def set_torques(self, servos: ArrayLike, torque: ArrayLike) -> None:
        """Torques (k,) [N m] of servos in torque mode; the motors' limits hold. Raises CommandError."""
        self._servos.set_torques(servos, torque)

    def set_power(self, servos: ArrayLike, on: bool) -> None:
        """Switch servos (k,) off, which leaves them limp, or on, where they are. Raises CommandError."""
        self._servos.set_power(servos, on)

    def halt(self) -> None:
        """All servos stay where they are now: those in torque mode are switched to position mode."""
        joints, _, _ = self._servos.measured()
        servos = np.arange(len(joints))
        modes = [Mode.POSITION if mode is Mode.TORQUE else mode for mode in self._servos.modes]
        self._servos.set_modes(servos, modes)
        self._servos.set_position_targets(servos, joints)

    @property
    def stiffness(self) -> Array:
        """Stiffness (n,) [N m/rad] of each servo at a share of 1. Ours: see `servos.TIME_CONSTANT`."""
        return self._servos.stiffness

    def set_stiffness(self, servos: ArrayLike, share: ArrayLike) -> None:
        """Share (k,) 0..1 of full stiffness; at 0 a servo is limp. Raises CommandError."""
        self._servos.set_stiffness(servos, share)

    def set_damping(self, servos: ArrayLike, share: ArrayLike) -> None:
        """Share (k,) 0..1 of damping on top of the critical one. Raises CommandError."""
        self._servos.set_damping(servos, share)

    def joints(self) -> JointReading:
        """Angles and velocities of all servos now, exact. One without a joint reads its target."""
        found = self._servos.measured()
        return JointReading(
            stamp=self.time,
            sequence=self._physics.steps,
            position=found[0],
            velocity=found[1],
            torque=found[2],
            modes=self._servos.modes,
            powered=self._servos.powered,
        )

    def frames(self) -> tuple[SkinFrame, ...]:
        """The latest frame of every patch, in the description's order."""
        return self._taxels.frames()

    def contact_truth(self, patch: str) -> ContactTruth:
        """What the physics knows of a patch's contacts, now. Raises UnknownNameError."""
        self._skin.surface(patch)
        return contact_truth(self._physics, patch, invert(self._skin.torso()))

    def skin_point(
        self, patch: str, place: int | ArrayLike, normal: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Point (3,) [m] and outward normal (3,), seen from the torso, of a place on the skin, now.

        `place` is a taxel or a point (3,) [m] in the patch's link, `normal` (3,) a normal in it, if
        not the surface's own. Raises UnknownNameError, CommandError.
        """
        return self._skin.to_torso(*self._skin.point(patch, place, normal))

    def skin_point_in_world(
        self, patch: str, place: int | ArrayLike, normal: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """The same, seen from the world."""
        return self._skin.point(patch, place, normal)


def start_angles(robot: Robot, posture: Mapping[str, ArrayLike]) -> Array:
    """Angles (n,) [rad] of all servos (inverse of eq. 1) at a generic `posture` by part.

    Parts not named are at their initial posture, servos that no part maps at 0 or their nearest limit;
    all are brought inside their limits. Raises UnknownNameError, CommandError.
    """
    angles = np.zeros(len(robot.servos))
    given = {robot.part(name).name: np.asarray(values, dtype=float) for name, values in posture.items()}
    for part in robot.parts:
        values = given.get(part.name, part.initial_posture)
        if values.shape != (len(part.servos),) or not np.isfinite(values).all():
            raise CommandError(
                f"posture of {part.name}: {values.tolist()}; {len(part.servos)} finite angles belong here"
            )
        joints = joint_map(robot, part.name)
        angles[joints.servos] = joints.to_robot(values, angles)
    for servo in robot.servos:
        lower, upper = servo.limits.lower, servo.limits.upper
        angles[servo.index] = np.clip(
            angles[servo.index], -np.inf if lower is None else lower, np.inf if upper is None else upper
        )
    return angles


def _checked_seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise CommandError(f"seed {seed}; valid: a whole number from 0 on")
    return int(seed)


def _period(robot: Robot) -> float:
    for binding in robot.bindings:
        if binding.middleware == MIDDLEWARE:
            return 1.0 / binding.rate
    return _PERIOD
