"""Gymnasium environment `tci/Withdrawal-v0`: a simulated finger pokes one arm (extra `gym`).

One episode contains one poke at a random point of the arm, at a random time. The agent commands targets of
the generic arm, and the gate limits the motion. Harm, effort and distance from the task posture reduce the
reward.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.body.places import Place
from tci.body.touchable import Touchable, touchable, without_skin
from tci.capabilities.fields import default_fields
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.messages import GenericCommand, LimbPlace, Mode, Perception, Reading, SwitchMode
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.description import GenericPart, Robot
from tci.robot.generic_arm import SEGMENTS
from tci.runtime.control import Control
from tci.simulation.hand_path import APPROACH
from tci.simulation.poke_first import poke_first
from tci.simulation.touching import people_needed
from tci.simulation.world import World
from tci.support.installed import needs
from tci.touches.person import Person
from tci.touches.planned_touch import plan
from tci.touches.touch import Touch, parse_touch

with needs("the environment tci/Withdrawal-v0", "gym"):
    import gymnasium
    from gymnasium import spaces
    from gymnasium.envs.registration import load_env_creator

CONTACTS = 4
"""Number of contacts in an observation. The strongest contact is the first."""
CONTACT = 7
"""Number of values per contact. The values are: 1 on the forearm, 0 on the upper arm, -1 elsewhere; u, sine
of theta, cosine of theta (0 elsewhere), force [N], force [N] of the contact's strongest taxel, area [cm2].
All values are 0 in unused rows."""
PAIN = 400e3
"""Pressure [Pa] that counts as pain. Assumed: the order of magnitude that algometers measure on arms. Behrens
et al. 2022 (doi:10.3389/frobt.2021.667818) list thresholds for several points of the body and several
tools."""
EFFORT, TASK = 0.05, 1.0
"""Weights in the reward: EFFORT for effort, TASK for the distance from the task posture. The weight of harm
is 1. Assumed: with larger values of EFFORT and TASK the agent would accept more pain."""
SPEED = (0.1, 0.4)
DEPTH = (0.006, 0.014)
"""Ranges from which the random speed [m/s] (SPEED) and the random depth [m] (DEPTH) of the finger's base are
drawn for each poke. Assumed: the ranges include light and painful touches."""
FORCE = 100.0
"""Largest value of a force [N], and also of an area [cm2], in an observation. Larger values are clipped."""

CAMERA = "tci.lab.pictures.portrait:world_camera"
"""Camera of the environment, named as Gymnasium names an environment: the pictures are a tool above this
package."""

_log = logging.getLogger("tci")

Observation = dict[str, NDArray[np.float64]]


class Camera(Protocol):
    """Makes the pictures of one world."""

    def __call__(self, world: World, *, full_scale: float) -> Callable[[Reading], NDArray[np.uint8]]:
        """Returns a function from a reading to the picture (height, width, 3) of the world at that instant.
        `full_scale` [Pa] is the pressure with the last colour."""
        ...


class WithdrawalEnv(gymnasium.Env[Observation, NDArray[np.float64]]):
    """Environment with one arm that a finger pokes.

    The observation is a dictionary: `posture` (5,) [rad] and `velocity` (5,) [rad/s] of the generic arm,
    `task` (5,) [rad] (the posture to which the arm should return), and either `contacts` (4, 7), one row per
    contact with the columns that CONTACT lists, or `taxels` (n,), the force [N] on each taxel.

    The action (5,) is the target of the generic arm in the control mode of the environment: angles [rad] for
    position and impedance, velocities [rad/s] for velocity. Targets of joints that the robot lacks are
    ignored.

    The reward of a step is -period (harm + 0.05 effort + task). In this formula, period is `period` [s],
    rounded up to a multiple of the robot's control period. The term harm is the largest pressure divided by
    `pain`, effort is the mean square of the generic velocities [rad2/s2], and task is the mean distance of
    the joints from the task posture [rad]. The dictionary `info` contains the three terms. An episode is
    truncated after `duration` [s], and never ends earlier.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        robot: str | Robot = "nao",
        *,
        part: str | None = None,
        mode: str = "position",
        touch: Literal["contacts", "taxels"] = "contacts",
        touches: Sequence[str | Touch] = (),
        period: float = 0.02,
        duration: float = 1.5,
        rate: float = 100.0,
        step: float = 0.002,
        noise: float = 0.0,
        pain: float = PAIN,
        render_mode: str | None = None,
        camera: str | Camera = CAMERA,
    ) -> None:
        """Creates the environment.

        `robot` is the name or description of a robot, and `part` a part with skin; None for the left arm, or
        where it has none the next arm or part that has; arms without skin are logged. With `touches` such as
        `"stroke 'left forearm' 3N"` a person does one of them at random, instead of a poke by the finger;
        forces, lengths and so on that they leave open are drawn for each episode. `period` [s] is the
        length of one step, `rate` [Hz] the rate of commands to the robot, `step` [s] the step of the physics
        simulation, and `noise` [counts] the noise of the skin. `camera` makes the pictures of `render`: a
        `Camera`, or its place as `module:name`, which is loaded when pictures are asked for. The default rate
        is the frame rate of NAO's arm skin, since a new touch can't be detected between two frames. Raises
        TciError for an unknown `mode`, `touch` or `render_mode`, for a part without skin, for an invalid
        number, and for a robot that can't be simulated.
        """
        modes = {m.value: m for m in (Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE)}
        if mode not in modes:
            raise TciError(f"mode {mode!r}; valid: {', '.join(modes)}")
        if touch not in ("contacts", "taxels"):
            raise TciError(f"touch {touch!r}; valid: contacts, taxels")
        if render_mode not in (None, "rgb_array"):
            raise TciError(f"render mode {render_mode!r}; valid: rgb_array")
        given = (("pain", pain), ("period", period), ("duration", duration), ("rate", rate))
        for name, value in given:
            if not 0.0 < value < np.inf:
                raise TciError(f"{name} {value}; valid: above 0 and finite")
        self.robot = load_robot(robot) if isinstance(robot, str) else robot
        self.part = self.robot.part(part or _felt_part(self.robot))
        own = [patch for patch in self.robot.patches if patch.part == self.part.name]
        limbs = [patch for patch in own if patch.segment in SEGMENTS]
        self.patches = [patch.name for patch in limbs or own]
        if not self.patches:
            valid = ", ".join(dict.fromkeys(patch.part for patch in self.robot.patches))
            raise TciError(f"{self.robot.name} has no skin on {self.part.name}; valid: {valid or 'no part'}")
        self.without_skin = without_skin(self.robot)
        """Parts of the robot on which no touch is felt."""
        if any(" of " in bare or self.robot.part(bare).kind == "arm" for bare in self.without_skin):
            _log.warning("%s has no skin on %s", self.robot.name, ", ".join(self.without_skin))
        self._own = [number for number, one in enumerate(self.robot.patches) if one.name in self.patches]
        self.render_mode = render_mode
        self._camera = camera
        self.metadata = {**self.metadata, "render_fps": round(1.0 / period)}
        self.mode, self.touch, self.period, self.duration, self.pain = (
            modes[mode],
            touch,
            period,
            duration,
            pain,
        )
        self.body = GenericBody(self.robot)
        self._rate = rate
        self._touches = [parse_touch(one) if isinstance(one, str) else one for one in touches]
        people = max((people_needed(plan(self.body, one)) for one in self._touches), default=0)
        self.world = World(self.robot, step=step, noise=noise, period=1.0 / rate, people=people)
        here, fields = self.world.joints(), default_fields()
        felt_at = touchable(self.body.skin, here, [one.place for one in fields], parts=(self.part.name,))
        self._sites = [fields[one.site] for one in felt_at if one.site is not None]
        self._picture: Callable[[Reading], NDArray[np.uint8]] | None = None
        low, high = generic_limits(self.robot, self.part)
        if self.mode is Mode.VELOCITY:
            fastest = np.array([servo.speed or np.pi for servo in self.part.servos])
            low, high = -fastest, fastest
        n = len(low)
        self._low, self._high = low, high
        self.action_space = spaces.Box(low, high, dtype=np.float64)
        felt = (
            spaces.Box(-FORCE, FORCE, (CONTACTS, CONTACT), np.float64)
            if touch == "contacts"
            else spaces.Box(0.0, FORCE, (self._count(),), np.float64)
        )
        self._bounds: dict[str, spaces.Box[Any]] = {
            "posture": spaces.Box(-2 * np.pi, 2 * np.pi, (n,), np.float64),
            "velocity": spaces.Box(-100.0, 100.0, (n,), np.float64),
            "task": spaces.Box(-2 * np.pi, 2 * np.pi, (n,), np.float64),
            touch: felt,
        }
        self.observation_space = spaces.Dict({**self._bounds})  # type: ignore[assignment] # the base's is Space[Observation]
        boxes = self._bounds.values()
        self._least = np.concatenate([box.low.ravel() for box in boxes])
        self._most = np.concatenate([box.high.ravel() for box in boxes])

    def _count(self) -> int:
        return sum(len(self.world.surfaces[name].positions) for name in self.patches)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode. Episodes with equal seeds are equal bit for bit. The argument `options` is
        ignored."""
        super().reset(seed=seed)
        # With a separate generator, the noise does not change the point and the time of the poke.
        self.world.reset(seed=int(self.np_random.spawn(1)[0].integers(2**32)))
        self.driver = SimulatedDriver(self.robot, world=self.world, rate=self._rate)
        self._control = Control(self.driver, self.body)
        self.time, self._due = 0.0, self.np_random.uniform(0.1, 0.4) * self.duration
        self._poked = False
        seen = self._look()
        self._task = np.array(seen.posture[self.part.name])
        self._before = self._task
        if self.mode is not Mode.POSITION:
            self._control.act([SwitchMode(self.part.name, self.mode)])
        return self._observe(seen, self.period), {"harm": 0.0, "effort": 0.0, "task": 0.0, "force": 0.0}

    def step(self, action: NDArray[np.float64]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Executes one step of the environment with a new target. The gate checks the commands."""
        values = np.minimum(np.maximum(np.asarray(action, np.float64), self._low), self._high)
        orders: list[GenericCommand] = [GenericCommand(self.part.name, self.mode, values)]
        begin, end = self.time, self.time + self.period
        harm, seen = 0.0, self._seen
        while self.time < end - 1e-9:
            if not self._poked and self.time >= self._due:
                self._poke()
            self._control.act(orders)
            orders = []
            self.time += self.driver.period
            seen = self._look()
            harm = max(harm, self._harm(seen))
        took = self.time - begin
        observation = self._observe(seen, took)
        velocity, distance = observation["velocity"], np.abs(observation["posture"] - self._task)
        effort, task = float(velocity @ velocity) / len(velocity), float(distance.sum()) / len(distance)
        reward = -took * (harm + EFFORT * effort + TASK * task)
        info = {"harm": harm, "effort": effort, "task": task, "force": self._force()}
        return observation, reward, False, self.time >= self.duration - 1e-9, info

    def render(self) -> NDArray[np.uint8] | None:
        """Returns a picture (240, 320, 3) of the world, or None if `render_mode` is None."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            make: Any = load_env_creator(self._camera) if isinstance(self._camera, str) else self._camera
            self._picture = make(self.world, full_scale=self.pain)
        return self._picture(self.driver.read())

    def close(self) -> None:
        """Does nothing, because the world uses no resources except memory."""

    def _poke(self) -> None:
        """Pokes a point near the centre of a random receptive field of the reflex, or where the part has no
        such field, a random taxel; or has a person do one of the given touches."""
        self._poked = True
        if self._touches:
            one = self._touches[int(self.np_random.integers(len(self._touches)))]
            number = int(self.np_random.integers(2**31))
            drawn = Person.drawn(one.person, seed=number)
            self.world.touch(replace(one, onset=APPROACH), persons={one.person: drawn}, seed=number)
            return
        skin, name, joints, chance = self.body.skin, self.part.name, self.driver.read().joints, self.np_random
        places: list[Touchable] = []
        if self._sites:
            site = self._sites[int(chance.integers(len(self._sites)))]
            u = float(np.clip(site.u + chance.normal(0.0, 0.05), 0.1, 0.9))
            near = LimbPlace(site.segment, u, site.theta + chance.normal(0.0, 0.3))
            # without skin or room for the finger there, the centre of the field is poked instead
            places += touchable(skin, joints, [near, site.place], parts=(name,))
        else:
            patch = self.patches[int(chance.integers(len(self.patches)))]
            surface = skin.surfaces[patch]
            taxel = int(chance.integers(len(surface.positions)))
            place = Place(patch, surface.positions[taxel], surface.normals[taxel])
            places += [Touchable(name, place), *touchable(skin, joints, parts=(name,))]
        speed, depth = chance.uniform(*SPEED), chance.uniform(*DEPTH)
        poke_first(self.world, places, speed=speed, depth=depth)

    def _force(self) -> float:
        """Contact force [N] of the finger and of all hands."""
        hands = (hand.force for person in self.world.people for hand in person.hands)
        return self.world.finger.force + sum(hands)

    def _look(self) -> Perception:
        moment = self._control.observe()
        assert moment is not None  # a simulation goes on
        self._seen = moment.perceived()
        return self._seen

    def _harm(self, seen: Perception) -> float:
        """Returns the largest pressure on the arm, divided by `pain`, the pressure that counts as pain."""
        skin = seen.skin
        assert skin is not None  # a Perceiver always sets `skin`
        if not len(skin.pressure):
            return 0.0
        begin = skin.begin.tolist()
        largest = [skin.pressure[begin[p] : begin[p + 1]].max(initial=0.0) for p in self._own]
        return float(max(largest)) / self.pain

    def _observe(self, seen: Perception, took: float) -> Observation:
        """Returns the observation. `took` [s] is the time since the previous observation."""
        posture = seen.posture[self.part.name]
        velocity = (posture - self._before) / took
        self._before = posture
        touch = self._contacts(seen).ravel() if self.touch == "contacts" else self._taxels(seen)
        values = np.concatenate([posture, velocity, self._task, touch])
        # One array for all: `np.clip` and a call for each array take several times as long.
        values = np.minimum(np.maximum(values, self._least), self._most)
        n = len(posture)
        felt = values[3 * n :].reshape(self._bounds[self.touch].shape)
        return {
            "posture": values[:n],
            "velocity": values[n : 2 * n],
            "task": values[2 * n : 3 * n],
            self.touch: felt,
        }

    def _contacts(self, seen: Perception) -> Array:
        rows = np.zeros((CONTACTS, CONTACT))
        if not len(seen.contacts):
            return rows
        own = [c for c in seen.contacts if c.patch in self.patches]
        own.sort(key=lambda contact: -contact.force)
        for row, contact in zip(rows, own, strict=False):
            place = -1.0, 0.0, 0.0, 0.0
            if contact.segment in SEGMENTS:
                sin, cos = math.sin(contact.theta), math.cos(contact.theta)
                place = float(contact.segment == "forearm"), contact.u, sin, cos
            row[:] = *place, contact.force, contact.peak, 1e4 * contact.area
        return rows

    def _taxels(self, seen: Perception) -> Array:
        skin, surfaces = seen.skin, self.body.skin.surfaces
        assert skin is not None
        return np.concatenate(
            [skin.on(p) * surfaces[name].areas for p, name in zip(self._own, self.patches, strict=True)]
        )


def _felt_part(robot: Robot) -> str:
    """The part that an episode pokes: a part with joints and skin, an arm in its sleeve first."""
    limbs = {patch.part for patch in robot.patches if patch.segment in SEGMENTS}
    worn = {patch.part for patch in robot.patches}
    able = [part for part in robot.parts if any(joint.servo is not None for joint in part.servos)]
    best = sorted(able, key=lambda part: (part.name not in limbs, part.kind != "arm", part.side == "right"))
    return next((part.name for part in best if part.name in worn), "left_arm")


def generic_limits(robot: Robot, part: GenericPart) -> tuple[Array, Array]:
    """Returns the least and the largest generic angles (n,), (n,) [rad] of a part's joints.

    The limits are -pi and pi for a joint whose transform is not linear, and for a joint that the robot lacks.
    """
    low, high = np.full(len(part.servos), -np.pi), np.full(len(part.servos), np.pi)
    for joint in part.servos:
        if joint.servo is None or joint.transform != "linear":
            continue
        limits = robot.servos[joint.servo].limits
        if limits.lower is not None and limits.upper is not None:
            ends = sorted(joint.scale * end + joint.offset for end in (limits.lower, limits.upper))
            low[joint.id], high[joint.id] = ends
    return low, high
