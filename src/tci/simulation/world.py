"""The simulated world: one robot with servos and skin, and a simulated finger."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from tci.body.generic_body import GenericBody
from tci.errors import CommandError, DescriptionError, Fault, UnknownNameError
from tci.messages import JointReading, Mode, SkinFrame
from tci.messages.frames import Array
from tci.robot.collisions import NO_MODEL
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
from tci.robot.like import RobotLike, as_robot
from tci.simulation.finger import RADIUS, Finger
from tci.simulation.hand import Hand, Hands, Person
from tci.simulation.hand_model import PersonModel
from tci.simulation.hand_path import APPROACH, PADS
from tci.simulation.imperfection import Imperfection
from tci.simulation.joint_torques import JointTorques
from tci.simulation.obstacle import Obstacle, PlacedObstacle
from tci.simulation.physics import Physics, exclusive
from tci.simulation.posed_skin import PosedSkin
from tci.simulation.scene import build_scene
from tci.simulation.servos import Servos
from tci.simulation.taxels import Taxels
from tci.simulation.touch import FINGER_TIP, ContactTruth, Meeting, contact_truth, meetings
from tci.simulation.touching import hands_of, paths_of, people_for
from tci.skin.surfaces import Surface, surfaces_of
from tci.support.engine import mujoco
from tci.touches.kinds import Kind
from tci.touches.person import Person as TouchingPerson
from tci.touches.planned_touch import PlannedTouch, plan
from tci.touches.touch import Touch

MIDDLEWARE = "sim"
MAX_STEP = 0.005
"""Longest step [s] of the physics. This step equals the time constant of the servos. With steps of 0.002 s or
more, contacts are softer than with shorter steps."""
MOST_PEOPLE = 4
"""Each person makes a step of the physics slower, also before they touch."""
MAX_TIP = 0.05
"""Largest radius [m] of the finger's tip. In a simulated grasp the tip is the ball, and this value is the
radius of the largest ball that is tried."""


class World:
    """A physical simulation of one robot with servos, skin and a finger.

    The robot is on a fixed base or stands on a floor. Each world has a separate clock. With equal arguments,
    equal calls and the same version of MuJoCo, results are equal bit for bit. One thread may step
    a world while another thread reads or pokes it.
    """

    def __init__(
        self,
        robot: RobotLike,
        *,
        step: float = 0.001,
        seed: int = 0,
        skin: bool | Collection[str] = True,
        noise: float = 0.0,
        imperfection: Imperfection | None = None,
        posture: Mapping[str, ArrayLike] | None = None,
        stands: bool = False,
        period: float | None = None,
        tip: float = RADIUS,
        people: int | Sequence[PersonModel] = 0,
        obstacles: Sequence[Obstacle] = (),
        self_touch: bool | None = None,
        weight: bool = False,
    ) -> None:
        """Builds the world.

        - `step` [s]: step of the physics.
        - `period` [s]: time between two targets of the servos, by default the description's period.
        - `noise` [counts]: standard deviation of raw skin values.
        - `imperfection`: deviations of the skin's sensors from ideal sensors.
        - `skin`: True for all patches, False for none, or the names of patches.
        - `tip` [m]: radius of the finger's tip. The tip can also represent a ball in a hand.
        - `people`: who can touch the robot with their hands (`person`), or how many.
        - `obstacles`: parts of persons, tables and boxes, out of reach until they are placed (`obstacle`).
        - `self_touch`: skin feels the robot's own other links; by default in worlds with people or obstacles.
        - `weight`: a robot on a fixed base has weight. Servos hold it; those that are off, in torque mode or
          without stiffness let it hang.

        `posture` maps generic parts to their generic angles [rad] at the start. Other parts start at their
        initial posture. With `stands`, the robot carries its weight on a floor and may fall. Only its soles
        touch the floor. Without `stands` its base is fixed, and without `weight` it then has none. Raises
        DescriptionError for a robot that can't be simulated. Raises CommandError for an invalid number or
        posture, and for a standing robot without skin on its soles.
        """
        robot = as_robot(robot)
        if robot.model is None:
            raise DescriptionError(robot.source, [Fault(0, NO_MODEL)])
        if not (np.isfinite(step) and 0.0 < step <= MAX_STEP):
            raise CommandError(f"step {step}; valid: above 0, up to {MAX_STEP} s")
        if not 0.0 <= noise < np.inf:
            raise CommandError(f"noise {noise}; valid: at least 0 counts, and finite")
        if period is not None and not 0.0 < period < np.inf:
            raise CommandError(f"period {period}; valid: above 0 s, and finite")
        if not 0.0 < tip <= MAX_TIP:
            raise CommandError(f"tip {tip}; valid: above 0, up to {MAX_TIP} m")
        self.robot = robot
        names = [patch.name for patch in robot.patches] if skin is True else skin or ()
        worn = [robot.patch(name) for name in names]
        built = {one.patch: one for one in surfaces_of(robot)} if worn else {}
        self.surfaces: Mapping[str, Surface] = {patch.name: built[patch.name] for patch in worn}
        """Taxels of every patch, by the patch's name."""
        home = start_angles(robot, posture or {})
        models = _people(people)
        hands = {f"tci_{one.name}_{side}": one for one in models for side in one.hands}
        self._seed = _checked_seed(seed)
        self._generator = np.random.default_rng(seed)
        self._build = partial(
            build_scene, robot, self.surfaces, home, step=step, stands=stands, tip=tip, hands=hands,
            obstacles=obstacles,
            self_touch=bool(models or obstacles) if self_touch is None else self_touch, weight=weight,
        )  # fmt: skip
        self._physics = Physics(self._build())
        self._home = home
        period = 1.0 / robot.binding(MIDDLEWARE).rate if period is None else period
        self.servos = Servos(self._physics, robot, home, period=period)
        """For whoever steps copies of this world (`tci.batch`), as `taxels`."""
        through_joints = any(patch.through_joints for patch in robot.patches)
        self._outputs = JointTorques(self._physics, robot, stands=stands) if through_joints else None
        self._skin = PosedSkin(self._physics, robot.model, self.surfaces)
        self._hands = Hands(self._physics, hands)
        self.taxels = Taxels(
            self._physics, worn, self.surfaces, noise=noise, imperfection=imperfection,
            generator=self._generator, hands=self._hands.pads,
        )  # fmt: skip
        self.finger = Finger(self._physics, self._skin, self.taxels.unfelt)
        """Finger that pokes the skin."""
        self._hand_list = [Hand(self._hands, k, one, self.surfaces) for k, one in enumerate(hands.values())]
        left = iter(self._hand_list)
        self._people = {one.name: Person(one, {side: next(left) for side in one.hands}) for one in models}
        self._obstacles = {one.name: PlacedObstacle(self._physics, self._skin, one) for one in obstacles}
        servos, finger = self.servos, self.finger
        self._arrays = (
            (servos.drives, servos.asked), (finger.state, finger.traced), self.taxels.arrays,
        )  # fmt: skip
        self.reset()

    def person(self, name: str = "") -> Person:
        """A person of this world; the first one without a name. Raises UnknownNameError for another name,
        CommandError if the world has no people."""
        if not self._people:
            raise CommandError("this world has no people; valid: World(..., people=1)")
        name = name or next(iter(self._people))
        if name not in self._people:
            raise UnknownNameError("person", name, self._people)
        return self._people[name]

    @exclusive
    def touch(
        self,
        touches: Touch | str | Iterable[Touch | str],
        *,
        persons: Mapping[str, TouchingPerson] | None = None,
        kinds: Mapping[str, Kind] | None = None,
        seed: int = 0,
    ) -> tuple[PlannedTouch, ...]:
        """Has the people do touches such as `"stroke 'left forearm' 3N 8cm/s"`, and returns what they do.

        Onsets count from now; a hand needs a quarter of a second to come, so if one is earlier, all touches
        begin that much later. Raises the errors of `tci.touches.plan`, and CommandError if the world has too
        few people, or if a hand is at work already.
        """
        planned = plan(
            GenericBody(self.robot), touches, persons=persons, kinds=kinds, joints=self.joints(), seed=seed
        )
        self.touch_as_planned(planned)
        return planned

    @exclusive
    def touch_as_planned(self, planned: Sequence[PlannedTouch]) -> float:
        """Has the people do touches that are planned already. Returns the time [s] of this world from which
        their onsets count. Raises the errors of `touch`."""
        needed = len(people_for(planned))
        if needed > len(self._people):
            raise CommandError(
                f"these touches need {needed} people at once, this world has {len(self._people)}; valid: "
                f"World(..., people={min(needed, MOST_PEOPLE)}), at most {MOST_PEOPLE}"
            )
        late = max(0.0, APPROACH - min((one.onset for one in planned), default=APPROACH))
        for number, one in hands_of(planned):
            for k, path in enumerate(paths_of(self.robot, one)):
                person, side = self.people[(number ^ k) // 2], (number ^ k) % 2
                (person.right if side else person.left).touch(
                    path, start=self.time + late + one.onset - APPROACH
                )
        return self.time + late

    @exclusive
    def touching(self) -> dict[str, Array]:
        """Poses (7,), place [m] and quaternion, of the pads of all hands at work and of the finger, in the
        world frame, by the names of their bodies."""
        names = [f"{hand.name}_{pad}" for hand in self._hand_list if hand.busy for pad in PADS]
        names += [FINGER_TIP] if self.finger.active else []
        data = self._physics.data
        return {name: np.concatenate([data.body(name).xpos, data.body(name).xquat]) for name in names}

    def show_touching(self, data: mujoco.MjData, poses: Mapping[str, Array]) -> None:
        """Puts what `touching` gave into a copy of MuJoCo's data, for a picture."""
        for name, pose in poses.items():
            body = self.model.body(name).id
            data.xpos[body], data.xquat[body] = pose[:3], pose[3:]
            mujoco.mju_quat2Mat(data.xmat[body], pose[3:])
            if name == FINGER_TIP:
                data.mocap_pos[self.finger.mocap], data.mocap_quat[self.finger.mocap] = pose[:3], pose[3:]
                data.qpos[self.finger.qpos] = 0.0

    def obstacle(self, name: str) -> PlacedObstacle:
        """An obstacle of this world. Raises UnknownNameError for another name."""
        if name not in self._obstacles:
            raise UnknownNameError("obstacle", name, self._obstacles)
        return self._obstacles[name]

    @exclusive
    def meetings(self) -> tuple[Meeting, ...]:
        """All bodies that touch now, strongest first: skin, links, hands, obstacles, finger and floor."""
        return meetings(self._physics, self._skin.torso)

    @property
    def people(self) -> tuple[Person, ...]:
        return tuple(self._people.values())

    @property
    def seed(self) -> int:
        """Seed of the noise on the skin."""
        return self._seed

    @property
    def step(self) -> float:
        """Duration [s] of one step of the physics."""
        return self._physics.step

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model, for direct access by the thread that steps the world."""
        return self._physics.model

    def shown_model(self) -> mujoco.MjModel:
        """Builds MuJoCo's model with additional parts that only pictures need.

        The additional parts are full meshes, and geoms that never collide. Bodies and joints are those of
        `model`, so this model can show the states of `model`.
        """
        return self._build(shown=True)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data, for direct access by the thread that steps the world.

        Contacts and poses belong to the joint angles before the latest step. Call `refresh` to update
        contacts and poses.
        """
        return self._physics.data

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self._physics.time

    @exclusive
    def reset(self, *, seed: int | None = None) -> None:
        """Resets time to 0, restores the posture and full stiffness, and removes the finger.

        The noise restarts with `seed`. By default the seed does not change. Raises CommandError for an
        invalid seed.
        """
        self._seed = self._seed if seed is None else _checked_seed(seed)
        self._generator.bit_generator.state = np.random.default_rng(self._seed).bit_generator.state
        self._physics.reset(self.servos.addresses, self.servos.home)
        self.servos.reset()
        self.finger.retire()
        for hand in self._hand_list:
            hand.retire()
        for obstacle in self._obstacles.values():
            obstacle.remove()
        self.taxels.reset()

    @exclusive
    def show(self, angles: ArrayLike) -> None:
        """Puts all servos at `angles` (n,) [rad] at once, for pictures of a posture: no physics takes place.
        Raises CommandError for another number of angles."""
        given, count = np.asarray(angles, dtype=float), len(self.robot.servos)
        if given.shape != (count,) or not np.isfinite(given).all():
            raise CommandError(f"angles of shape {given.shape}; valid: ({count},), finite")
        self.servos.show(given)

    @property
    def torso(self) -> Array:
        """`T_WT` (4, 4): current pose of the torso frame in the world frame."""
        return self._skin.torso()

    def refresh(self) -> None:
        """Updates poses and contacts in `data` to the current joint angles. Later steps are not affected."""
        self._physics.refresh()

    def touch_physics(self) -> None:
        """Marks poses, contacts and sensors as out of date, after a change of `data` from outside."""
        self._physics.touch()

    @exclusive
    def moment(self) -> tuple[float, mujoco.MjData]:
        """Returns the time [s] and a copy of MuJoCo's data with current poses and contacts."""
        self.refresh()
        return self.time, copy.copy(self.data)

    def advance(self, until: float) -> None:
        """Steps the physics until `time` is at least `until` [s].

        Also creates the skin frames whose time is reached.
        """
        last = math.ceil(until / self._physics.step - 1e-6)
        while self._physics.steps < last:
            end = min(last, self.taxels.due) if self.taxels.noisy else last
            for hand in self._hand_list:
                hand.begin_waiting()
                if hand.waiting:
                    end = min(
                        end, max(math.ceil(hand.due / self._physics.step - 1e-6), self._physics.steps + 1)
                    )
            self._physics.advance(end, *self._arrays, self._hands.arrays)
            if self.taxels.noisy or self._physics.steps < end:
                self.frames()

    def set_position_targets(self, servos: ArrayLike, angles: ArrayLike) -> None:
        """Sends targets `angles` (k,) [rad] to `servos` (k,), which are indices into `Robot.servos`.

        Raises CommandError for an invalid servo or angle.
        """
        self.servos.set_position_targets(servos, angles)

    def set_modes(self, servos: ArrayLike, modes: Sequence[Mode]) -> None:
        """Switches servos (k,) to control modes (k,). Raises CommandError for an invalid servo."""
        self.servos.set_modes(servos, modes)

    def set_torques(self, servos: ArrayLike, torque: ArrayLike) -> None:
        """Sets torques (k,) [N m] of servos in torque mode.

        Each torque is limited to the motor's limit. Raises CommandError for an invalid servo or torque.
        """
        self.servos.set_torques(servos, torque)

    def set_power(self, servos: ArrayLike, on: bool) -> None:
        """Switches servos (k,) on or off. A servo that is off exerts no torque.

        Servos that are switched on keep their current angles. Raises CommandError for an invalid servo.
        """
        self.servos.set_power(servos, on)

    def halt(self) -> None:
        """Stops all servos at their current angles. Servos in torque mode are switched to position mode."""
        joints, _, _ = self.servos.measured()
        servos = np.arange(len(joints))
        modes = [Mode.POSITION if mode is Mode.TORQUE else mode for mode in self.servos.modes]
        self.servos.set_modes(servos, modes)
        self.servos.set_position_targets(servos, joints)

    @property
    def stiffness(self) -> Array:
        """Full stiffness (n,) [N m/rad] of each servo. Assumed: all servos respond with one time constant
        (`servos.TIME_CONSTANT`)."""
        return self.servos.stiffness

    def set_stiffness(self, servos: ArrayLike, share: ArrayLike) -> None:
        """Sets fractions (k,) 0..1 of full stiffness. At 0 a servo exerts no torque. Raises CommandError for
        an invalid fraction."""
        self.servos.set_stiffness(servos, share)

    def set_damping(self, servos: ArrayLike, share: ArrayLike) -> None:
        """Sets the additional damping of `servos` (k,): fractions `share` (k,) 0..1 of the critical damping
        at full stiffness. Raises CommandError for an invalid servo or fraction."""
        self.servos.set_damping(servos, share)

    def joints(self) -> JointReading:
        """Returns exact current angles and velocities of all servos.

        The angle of a servo without a joint is its target. Torques are the motors' torques. If the robot
        detects touches through joint torques, the torques are those at the joints' outputs.
        """
        with self._physics.lock:
            found = self.servos.measured()
            return JointReading(
                stamp=self.time,
                sequence=self._physics.steps,
                position=found[0],
                velocity=found[1],
                torque=found[2] if self._outputs is None else self._outputs.measured(found[0]),
                modes=self.servos.modes,
                powered=self.servos.powered,
            )

    def frames(self) -> tuple[SkinFrame, ...]:
        """Returns the latest frame of every patch, in the description's order of patches."""
        with self._physics.lock:
            return self.taxels.frames()

    @exclusive
    def contact_truth(self, patch: str) -> ContactTruth:
        """Returns the current contacts on a patch from the physics. Raises UnknownNameError for an unknown
        patch."""
        self._skin.surface(patch)
        return contact_truth(self._physics, patch, self._skin.torso)

    @exclusive
    def skin_point(
        self, patch: str, place: int | ArrayLike, normal: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Returns the current position (3,) [m] and outward normal (3,) of a point on the skin.

        Position and normal are in the torso frame. `place` is a taxel, or a point (3,) [m] in the frame of
        the patch's link. An outward `normal` (3,) in the link's frame replaces the surface normal, if given.
        Raises UnknownNameError for an unknown patch, and CommandError for an invalid point or normal.
        """
        return self.to_torso(*self._skin.point(patch, place, normal))

    def to_torso(self, point: ArrayLike, normal: ArrayLike) -> tuple[Array, Array]:
        """Transforms a point (3,) [m] and a direction (3,) from the world frame to the torso frame."""
        return self._skin.to_torso(point, normal)

    @exclusive
    def skin_point_in_world(
        self, patch: str, place: int | ArrayLike, normal: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Returns the position (3,) [m] and outward normal (3,) of a point on the skin, in the world frame.

        `place` is a taxel, or a point (3,) [m] in the frame of the patch's link. An outward `normal` (3,) in
        the link's frame replaces the surface normal, if given. Raises UnknownNameError for an unknown patch,
        and CommandError for an invalid point or normal.
        """
        return self._skin.point(patch, place, normal)


def start_angles(robot: Robot, posture: Mapping[str, ArrayLike]) -> Array:
    """Returns the angles (n,) [rad] of all servos for a generic posture (inverse of eq. 1).

    `posture` maps parts to generic angles [rad]. Other parts are at their initial posture. Servos that belong
    to no part are at 0. All angles are clipped to the servos' limits. Raises UnknownNameError for an unknown
    part, and CommandError for invalid angles.
    """
    angles = np.zeros(len(robot.servos))
    given = {robot.part(name).name: np.asarray(values, dtype=float) for name, values in posture.items()}
    for part in robot.parts:
        values = given.get(part.name, part.initial_posture)
        if values.shape != (len(part.servos),) or not np.isfinite(values).all():
            raise CommandError(
                f"posture of {part.name}: {values.tolist()}; valid: {len(part.servos)} finite angles [rad]"
            )
        joints = joint_map(robot, part.name)
        angles[joints.servos] = joints.to_robot(values, angles)
    for servo in robot.servos:
        lower, upper = servo.limits.lower, servo.limits.upper
        angles[servo.index] = np.clip(
            angles[servo.index], -np.inf if lower is None else lower, np.inf if upper is None else upper
        )
    return angles


def _people(people: int | Sequence[PersonModel]) -> list[PersonModel]:
    if isinstance(people, int):
        if not 0 <= people <= MOST_PEOPLE:
            raise CommandError(f"people {people}; valid: 0 to {MOST_PEOPLE}")
        return [PersonModel(name=f"person{k + 1}") for k in range(people)]
    names = [one.name for one in people]
    if len(set(names)) < len(names) or len(names) > MOST_PEOPLE:
        raise CommandError(f"people {names}; valid: up to {MOST_PEOPLE}, with different names")
    return list(people)


def _checked_seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise CommandError(f"seed {seed}; valid: a whole number from 0 on")
    return int(seed)
