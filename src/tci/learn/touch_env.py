"""Gymnasium environments of touch on any simulated robot (extra `gym`).

The agent's actions are those of a policy (`PolicySpec`), and pass through the gate like everybody's.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.body.generic_body import GenericBody
from tci.body.touchable import without_skin
from tci.capabilities.orders import begin_of, step_of
from tci.capabilities.policy.observations import View
from tci.capabilities.policy.spec import CLIP, PolicySpec, Seen
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError, UnknownNameError
from tci.learn.head_camera import head_camera
from tci.learn.task import PersonTouches, Scene, TouchTask, felt_part, nothing
from tci.learn.tasks import TASKS
from tci.messages import GenericCommand, Mode, Order, Perception, Reading, SwitchMode
from tci.messages.frames import read_only
from tci.robot.like import RobotLike, as_robot
from tci.runtime.control import Control
from tci.simulation.touching import people_for
from tci.simulation.world import World
from tci.support.installed import needs
from tci.touches.planned_touch import plan
from tci.touches.touch import Touch

with needs("the environments of tci.learn", "gym"):
    import gymnasium
    from gymnasium import spaces
    from gymnasium.envs.registration import load_env_creator

ONSET = (0.1, 0.4)
"""Range of the touch's begin, as fractions of an episode: a policy must also rest while nothing touches."""
CAMERA = "tci.lab.pictures.portrait:world_camera"
"""Camera of the environment, named as Gymnasium names an environment: the pictures are a tool above this
package."""
FULL_SCALE = 400e3
"""Pressure [Pa] with the last colour in pictures."""

_log = logging.getLogger("tci")

Vector = NDArray[np.float32]


class Camera(Protocol):
    """Makes the pictures of one world."""

    def __call__(self, world: World, *, full_scale: float) -> Callable[[Reading], NDArray[np.uint8]]:
        """A function from a reading to the picture (height, width, 3) of the world at that instant.
        `full_scale` [Pa] is the pressure with the last colour."""
        ...


class TouchEnv(gymnasium.Env[Any, Vector]):
    """One part of a robot that is touched, in the simulation.

    The observation is what a policy of `policy` sees (history x k,), normalised, at most 10; with `picture`
    it is `{"state": this, "picture": (height, width, 3) uint8}`. The action (n,)
    is what such a policy gives, -1 to 1; larger ones are clipped. Joints that the robot lacks ignore theirs.
    The reward is the task's for each second, times the length of the step. `info` has its terms, `force`, the
    force [N] of finger, hands and obstacles on the robot, `refused`, how many orders the gate refused, and
    `is_success`, whether the robot was touched and what the task calls success holds now.
    An episode is truncated after its duration, and never ends earlier.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        robot: RobotLike = "nao",
        task: str | TouchTask = "withdrawal",
        *,
        part: str | None = None,
        policy: PolicySpec | None = None,
        touches: Iterable[str | Touch] = (),
        duration: float | None = None,
        rate: float = 100.0,
        step: float = 0.002,
        noise: float = 0.0,
        picture: tuple[int, int] | None = None,
        render_mode: str | None = None,
        camera: str | Camera = CAMERA,
    ) -> None:
        """Builds the world.

        Args:
            robot: Robot to simulate.
            task: What is asked for: the name of a ready task (`TASKS`), or one of your own.
            part: Generic part that is touched and moved. None: the left arm, or where that has no skin the
                next arm or part that has.
            policy: What is seen, and what actions mean, instead of the task's.
            touches: Touches such as `"stroke 'left forearm' 3N"`: a person does one of them in each episode,
                instead of the task's touch. What the words leave open is drawn.
            duration: Length [s] of an episode, instead of the task's.
            rate: Commands per second that go through the gate. 100 is the rate of NAO's skin: between two
                frames no new touch can be felt.
            step: Step [s] of the physics.
            noise: Standard deviation [counts] of the skin's raw values, another noise in each episode.
            picture: Width and height [pixels] of what the robot sees with the camera in its head. It is drawn
                over EGL with the extra `camera`, and some hundred times slower without.
            render_mode: `rgb_array` for pictures from `render`.
            camera: Makes these pictures: a `Camera`, or its place as `module:name`, which is loaded when
                pictures are asked for.

        Raises TciError for an unknown task, part or mode, for a part without skin, for a number out of range,
        and for a robot that can't be simulated.
        """
        if isinstance(task, str):
            if task not in TASKS:
                raise UnknownNameError("task", task, TASKS)
            task = TASKS[task]
        if render_mode not in (None, "rgb_array"):
            raise TciError(f"render mode {render_mode!r}; valid: rgb_array")
        self.task, self.duration = task, task.duration if duration is None else duration
        for name, value in (("duration", self.duration), ("rate", rate)):
            if not 0.0 < value < np.inf:
                raise TciError(f"{name} {value}; valid: above 0 and finite")
        self.robot = as_robot(robot)
        self.part = felt_part(self.robot, part)
        self.without_skin = without_skin(self.robot)
        """Parts of the robot on which no touch is felt."""
        if any(" of " in bare or self.robot.part(bare).kind == "arm" for bare in self.without_skin):
            _log.warning("%s has no skin on %s", self.robot.name, ", ".join(self.without_skin))
        self.render_mode, self._camera = render_mode, camera
        self._picture: Callable[[Reading], NDArray[np.uint8]] | None = None
        self.body = GenericBody(self.robot)
        given = PersonTouches.of(touches)
        self._touch = given if given.touches else task.touch
        known = self._touch.touches if isinstance(self._touch, PersonTouches) else ()
        people = len(people_for(*(plan(self.body, one) for one in known)))
        self._rate = rate
        self.world = World(
            self.robot, step=step, noise=noise, period=1.0 / rate, people=people, obstacles=task.obstacles
        )
        self._begin(0)
        self.policy = task.complete(policy or task.policy, self._view(0.0))
        """What a policy that is trained here sees, and what its actions mean, for `write_policy`."""
        self.metadata = {**self.metadata, "render_fps": max(round(self.policy.rate), 1)}
        size = self.policy.history * len(self.policy.scale)
        state = spaces.Box(-CLIP, CLIP, (size,), np.float32)
        self.observation_space: spaces.Space[Any] = state
        self._sees = None if picture is None else head_camera(self.world, picture)
        if picture is not None:
            shown = spaces.Box(0, 255, (picture[1], picture[0], 3), np.uint8)
            self.observation_space = spaces.Dict({"state": state, "picture": shown})
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.policy.joints),), np.float32)

    def _begin(self, seed: int) -> None:
        """Arranges an episode."""
        self.world.reset(seed=seed)
        self.driver = SimulatedDriver(self.robot, world=self.world, rate=self._rate)
        self._control = Control(self.driver, self.body)
        self.scene = Scene(self.world, self.body, self.part, self.np_random)
        self.task.reset(self.scene)
        self._due = self.np_random.uniform(*ONSET) * self.duration
        goal = read_only(np.ravel(self.task.goal(self.scene)))
        self.scene = replace(self.scene, goal=goal)
        self.time, self._touched, self._met = 0.0, False, False
        self._answer: tuple[float, Vector] | None = None
        self._memory: Any = None
        self._look()
        self.home = self.seen.posture[self.part]
        """Posture (n,) [rad] of the part at the start of the episode."""
        self._before = self.home
        self._seen: Seen | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode. Episodes with equal seeds are equal bit for bit. `options` is ignored."""
        super().reset(seed=seed)
        # a separate generator, so that the noise does not change the touch
        self._begin(int(self.np_random.spawn(1)[0].integers(2**32)))
        mode = Mode.of(self.policy.mode)
        if mode is not Mode.POSITION:
            self._control.act([SwitchMode(self.part, mode)])
        terms = self.task.reward(self._view(0.0))
        return self._observe(), self._info(dict.fromkeys(terms, 0.0), 0)

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step with an action (n,). Raises TciError for one of another shape, or that is not finite."""
        given = np.asarray(action, np.float64)
        if given.shape != self.action_space.shape or not np.isfinite(given).all():
            raise TciError(
                f"action {np.array2string(given, precision=3)}; valid: {len(self.home)} finite "
                f"numbers: {', '.join(self.policy.joints)}"
            )
        reward, over, info = self.go([self.policy.order(self.part, np.clip(given, -1.0, 1.0), self.home)])
        return self._observe(), reward, False, over, info

    def go(self, orders: Iterable[Order]) -> tuple[float, bool, dict[str, Any]]:
        """One step with orders of your own in place of an action: its reward, whether the episode is over,
        and `info`."""
        waiting = list(orders)
        begin, end = self.time, self.time + 1.0 / self.policy.rate
        sums, refused = dict[str, float](), 0
        while self.time < end - 1e-9:
            if not self._touched and self.time >= self._due:
                self._touched = True
                self._touch(self.scene)
            sent = self._control.act(waiting)
            refused += len(sent.refusals)
            waiting = []
            self.time += self.driver.period
            self._look()
            for name, term in self.task.reward(self._view(self.driver.period)).items():
                sums[name] = sums.get(name, 0.0) + term * self.driver.period
            self._before = self.seen.posture[self.part]
            self._met = self._met or self._force() > 0.0
        terms = {name: total / (self.time - begin) for name, total in sums.items()}
        return sum(sums.values()), self.time >= self.duration - 1e-9, self._info(terms, refused)

    def _info(self, terms: dict[str, float], refused: int) -> dict[str, Any]:
        touched = self._met or self._touch is nothing
        success = touched and self.task.success(self._view(0.0))
        return {**terms, "force": self._force(), "refused": refused, "is_success": bool(success)}

    def baseline(self) -> Vector:
        """The action (n,) with which the task's hand-written answer goes on now. Call it once in each step;
        what it would do is what it orders, as far as an action can say it."""
        now = self.seen
        if self._answer is None:
            self._hand_written = self.task.baseline(self.scene)
            self._memory = self._hand_written.init(self.body)
            begin_of(self._hand_written, now, self.body)
            drives = Mode.of(self.policy.mode) is Mode.VELOCITY
            self._answer = -np.inf, self._action(np.zeros(len(self.home)) if drives else self.home)
        stamp, answer = self._answer
        if now.stamp > stamp:
            orders, self._memory = step_of(self._hand_written, self._memory, now, self.body)
            own = [one for one in orders if isinstance(one, GenericCommand) and one.part == self.part]
            moved = [one for one in own if one.mode is Mode.of(self.policy.mode)]
            if moved:
                answer = self._action(moved[-1].values)
            self._answer = now.stamp, answer
        return answer

    def picture(self) -> NDArray[np.uint8] | None:
        """What the camera in the head sees (height, width, 3); None without `picture`."""
        return None if self._sees is None else self._sees(self.driver.read())

    def render(self) -> NDArray[np.uint8] | None:
        """A picture (240, 320, 3) of the world, or None if `render_mode` is None."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            make: Any = load_env_creator(self._camera) if isinstance(self._camera, str) else self._camera
            self._picture = make(self.world, full_scale=FULL_SCALE)
        return self._picture(self.driver.read())

    def _action(self, values: ArrayLike) -> Vector:
        """The action that orders these values."""
        spec, given = self.policy, np.asarray(values, np.float64)
        if spec.relative and Mode.of(spec.mode) is not Mode.VELOCITY:
            given = given - self.home
        action = (given - spec.action_mean) / spec.action_scale
        return np.clip(action, -1.0, 1.0).astype(np.float32)

    def _force(self) -> float:
        """Contact force [N] of the finger, of all hands and of all obstacles."""
        force = self.world.finger.force
        force += sum(hand.force for person in self.world.people for hand in person.hands)
        if own := {one.name for one in self.task.obstacles}:
            met = self.world.meetings()
            force += sum(one.force for one in met if not own.isdisjoint((one.first, one.second)))
        return float(force)

    def _look(self) -> None:
        moment = self._control.observe()
        assert moment is not None  # a simulation goes on
        self.seen: Perception = moment.perceived()
        """What was perceived last."""

    def _view(self, elapsed: float) -> View:
        return View(self.seen, self.body, self.part, self.home, self._before, elapsed, self.scene.goal)

    def _observe(self) -> Any:
        self._seen = self.policy.see(
            self.seen, self.body, self.part, home=self.home, before=self._seen, goal=self.scene.goal,
            own=self.task.observations,
        )  # fmt: skip
        state = self._seen.history.ravel().astype(np.float32)
        picture = self.picture()
        return state if picture is None else {"state": state, "picture": picture}
