"""Many touched robots as one Gymnasium environment, on `tci.batch` (extra `gym`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.capabilities.policy.observations import View
from tci.capabilities.policy.spec import CLIP, PolicySpec, Seen
from tci.errors import TciError, UnknownNameError
from tci.learn.task import Scene, TouchTask, felt_part
from tci.learn.tasks import TASKS
from tci.learn.touch_env import ONSET
from tci.messages import Mode, Perception, PlatformCommand
from tci.messages.frames import Array
from tci.robot.like import RobotLike
from tci.simulation.world import World
from tci.support.installed import needs

with needs("the environments of tci.learn", "gym"):
    from gymnasium import spaces
    from gymnasium.envs.registration import load_env_creator
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

Rows = NDArray[np.float32]
WORLDS = "tci.batch.make:make_worlds"
"""Makes the worlds; named as Gymnasium names an environment: `tci.batch` plugs into the core as this package
does, and neither imports the other."""


class ManyWorlds(Protocol):
    """Worlds of `tci.batch`, as far as they are used here."""

    @property
    def scene(self) -> Any:
        """What the worlds share: `robot`, `body`, and `world`, one at its start."""

    @property
    def time(self) -> float:
        """[s]"""

    @property
    def finger_force(self) -> Array:
        """(N,) [N]"""

    def reset(self) -> None: ...
    def advance(self, duration: float) -> None: ...
    def send(self, targets: ArrayLike) -> None: ...
    def perceive(self, world: int) -> Perception: ...
    def touch(self, world: int, arrange: Callable[[World], object]) -> None: ...


class TouchVectorEnv(VectorEnv[Rows, Rows, NDArray[Any]]):
    """`TouchEnv` in many worlds that are stepped together: same observations, actions, rewards and touches.

    A limiter stands in for the gate: it keeps the limits of each servo, but looks at no couplings and no
    collisions with the own body. All episodes begin and end together. After the last step the observations
    are those of the next episodes, and `info` has the last ones as `final_obs`.
    """

    def __init__(
        self,
        robot: RobotLike = "nao",
        num_envs: int = 64,
        task: str | TouchTask = "withdrawal",
        *,
        part: str | None = None,
        policy: PolicySpec | None = None,
        duration: float | None = None,
        rate: float = 100.0,
        step: float = 0.002,
        threads: int = 0,
    ) -> None:
        """Builds the worlds.

        Args:
            robot: Robot to simulate.
            num_envs: Number of worlds.
            task: Name of a ready task, or one of your own whose touch is the finger's; positions are
                commanded.
            part: As in `TouchEnv`, like `policy`, `duration` and `step`.
            policy: What is seen, and what actions mean.
            duration: Length [s] of an episode.
            rate: Set-points per second that the limiter gives the servos.
            step: Step [s] of the physics.
            threads: Threads of the physics; 0 for one per processor.

        Raises TciError for what batches do not have, and the errors of `TouchEnv`.
        """
        if isinstance(task, str):
            if task not in TASKS:
                raise UnknownNameError("task", task, TASKS)
            task = TASKS[task]
        if task.obstacles:
            raise TciError(
                "a task with obstacles in many worlds; valid: one with the finger alone, or TouchEnv"
            )
        self.task, self.duration = task, task.duration if duration is None else duration
        for name, value in (("duration", self.duration), ("rate", rate)):
            if not 0.0 < value < np.inf:
                raise TciError(f"{name} {value}; valid: above 0 and finite")
        make: Any = load_env_creator(WORLDS)
        self._worlds: ManyWorlds = make(robot, num_envs, step=step, period=1.0 / rate, threads=threads)
        self.num_envs, self._tick, self._step = num_envs, 1.0 / rate, step
        self.robot, self.body = self._worlds.scene.robot, self._worlds.scene.body
        self.part = felt_part(self.robot, part)
        self._chance = [np.random.default_rng() for _ in range(num_envs)]
        self._begin()
        self.policy = task.complete(policy or task.policy, self._view(0, 0.0))
        """What a policy that is trained here sees, and what its actions mean, for `write_policy`."""
        if Mode.of(self.policy.mode) is not Mode.POSITION:
            raise TciError(f"mode {self.policy.mode} in many worlds; valid: position, or TouchEnv")
        size = self.policy.history * len(self.policy.scale)
        self.single_observation_space = spaces.Box(-CLIP, CLIP, (size,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (len(self.policy.joints),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Rows, dict[str, Any]]:
        """Starts an episode in each world; world w with `seed` + w, or the w-th of several. The touch of a
        seed is that of `TouchEnv`. `options` is ignored."""
        count = self.num_envs
        if seed is not None:
            seeds = [seed + w for w in range(count)] if isinstance(seed, int) else [*seed]
            if len(seeds) != count:
                raise TciError(f"{len(seeds)} seeds for {count} worlds; valid: one for each, or one number")
            for w, one in enumerate(seeds):
                if one is not None:
                    self._chance[w] = np.random.default_rng(one)
        self._begin()
        terms = self.task.reward(self._view(0, 0.0))
        return self._observe(), self._info({name: np.zeros(count) for name in terms})

    def step(
        self, actions: ArrayLike
    ) -> tuple[Rows, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One step in each world, with actions (N, n). Raises TciError for another shape, or if one is not
        finite."""
        given = np.asarray(actions, np.float64)
        if given.shape != self.action_space.shape or not np.isfinite(given).all():
            raise TciError(f"actions of shape {given.shape}; valid: {self.action_space.shape}, finite")
        self._aim(np.clip(given, -1.0, 1.0))
        end, begun, terms = self.time + 1.0 / self.policy.rate, self.time, dict[str, Array]()
        while self.time < end - 1e-9:
            for w in np.flatnonzero(self._due <= self.time + 1e-9).tolist():
                self._due[w] = np.inf
                self._worlds.touch(w, partial(self._touch, w))
            self._worlds.send(self._targets)
            self.time += self._tick
            self._look()
            for w in range(self.num_envs):
                elapsed = self._seen_now[w].stamp - self._before[w].stamp
                if elapsed <= 0.0:  # no frame of skin since
                    continue
                for name, term in self.task.reward(self._view(w, elapsed)).items():
                    terms.setdefault(name, np.zeros(self.num_envs))[w] += term * elapsed
        rewards = np.sum([*terms.values()], axis=0)
        info = self._info({name: total / (self.time - begun) for name, total in terms.items()})
        seen, over = self._observe(), self.time >= self.duration - 1e-9
        if over:
            info |= {"final_obs": seen, "_final_obs": np.ones(self.num_envs, np.bool_)}
            self._begin()
            seen = self._observe()
        none = np.zeros(self.num_envs, np.bool_)
        return seen, rewards, none, np.full(self.num_envs, over), info

    def _begin(self) -> None:
        """Arranges an episode in each world. Draws in the order of `TouchEnv`."""
        self._worlds.reset()
        self._worlds.advance(self._step)
        count, self.time = self.num_envs, 0.0
        self._goals: list[Array] = []
        self._due = np.empty(count)
        for w, chance in enumerate(self._chance):
            scene = self._scene(w, self._worlds.scene.world)
            self.task.reset(scene)
            self._due[w] = chance.uniform(*ONSET) * self.duration
            self._goals.append(np.ravel(self.task.goal(scene)))
        self._seen_now = [self._worlds.perceive(w) for w in range(count)]
        self._before: list[Perception] = self._seen_now
        self.home = [one.posture[self.part] for one in self._seen_now]
        """Posture (n,) [rad] of each part at the start of the episode."""
        self._seen: list[Seen | None] = [None] * count
        self._targets = np.full((count, len(self.robot.servos)), np.nan)

    def _scene(self, w: int, world: World) -> Scene:
        goal = self._goals[w] if w < len(self._goals) else np.zeros(0)
        return Scene(world, self.body, self.part, self._chance[w], goal)

    def _touch(self, w: int, world: World) -> None:
        self.task.touch(self._scene(w, world))

    def _aim(self, actions: Array) -> None:
        """Sets the targets of all servos of the part that can go where the actions say."""
        for w, action in enumerate(actions):
            joints = self._seen_now[w].joints
            assert joints is not None  # `perceive` gives them
            order = self.policy.order(self.part, action, self.home[w])
            for one in self.body.to_platform(order, joints)[0]:
                assert isinstance(one, PlatformCommand)
                self._targets[w, one.servos] = one.values

    def _look(self) -> None:
        self._worlds.advance(self.time + self._step - self._worlds.time)
        self._before, self._seen_now = self._seen_now, [
            self._worlds.perceive(w) for w in range(self.num_envs)
        ]  # fmt: skip

    def _view(self, w: int, elapsed: float) -> View:
        before = self._before[w].posture[self.part]
        return View(self._seen_now[w], self.body, self.part, self.home[w], before, elapsed, self._goals[w])

    def _observe(self) -> Rows:
        self._seen = [
            self.policy.see(
                now, self.body, self.part, home=self.home[w], before=self._seen[w], goal=self._goals[w],
                own=self.task.observations,
            )
            for w, now in enumerate(self._seen_now)
        ]  # fmt: skip
        return np.stack([one.history.ravel() for one in self._seen if one]).astype(np.float32)

    def _info(self, terms: dict[str, Array]) -> dict[str, Any]:
        """Gymnasium's form: an array for each name, and under `_name` in which worlds it is valid."""
        found = {**terms, "force": self._worlds.finger_force.copy()}
        return found | {f"_{name}": np.ones(self.num_envs, np.bool_) for name in found}
