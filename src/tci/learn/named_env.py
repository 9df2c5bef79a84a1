"""Environments for programs that know only numbers with names, such as `lerobot-eval`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import TciError
from tci.learn.names import Names
from tci.learn.task import TouchTask
from tci.learn.touch_env import TouchEnv
from tci.robot.like import RobotLike
from tci.support.installed import needs
from tci.touches.touch import Touch

with needs("the environments of tci.learn", "gym"):
    import gymnasium
    from gymnasium import spaces

Seen = dict[str, Any]
LARGEST, TURN = 1e4, 2.0 * np.pi
"""Bounds of what is seen, in any unit, and of ordered angles [rad]: beyond what a robot does."""
RATE = 100.0
"""Commands per second, nearly: a whole number of them in each step."""


class NamedEnv(gymnasium.Env[Seen, Any]):
    """`TouchEnv` in the numbers of `NamedRobot`, so that what was recorded with one is judged in the other.

    It sees `agent_pos` (k,), the numbers `observed`, in their units; `environment_state` (m,), the force [N]
    on each taxel, as in sets of `tci log export`; and with `picture` `pixels`, what the camera in the head
    sees. An action (n,) is the angles [rad] `actions`. Rewards, touches and `info` are those of `TouchEnv`.
    """

    metadata = TouchEnv.metadata

    def __init__(
        self,
        robot: RobotLike = "nao",
        task: str | TouchTask = "withdrawal",
        *,
        parts: Iterable[str] = (),
        observations: Iterable[str] = ("posture", "velocity", "contacts"),
        fps: float = 30.0,
        part: str | None = None,
        touches: Iterable[str | Touch] = (),
        duration: float | None = None,
        picture: tuple[int, int] | None = None,
        render_mode: str | None = None,
        instruction: str = "",
    ) -> None:
        """Builds the world.

        Args:
            robot: Robot to simulate.
            task: As in `TouchEnv`, like `part`, which is touched, `touches`, `duration` and `render_mode`.
            parts: Generic parts that are seen and moved, as in `NamedRobot`, like `observations`.
            observations: What `agent_pos` has of each part.
            fps: Steps per second.
            part: Generic part that is touched.
            touches: Touches of a person in place of the task's.
            duration: Length [s] of an episode.
            picture: Width and height [pixels] of `pixels`.
            render_mode: `rgb_array` for pictures from `render`.
            instruction: What a policy that understands language is told; the task's name unless given.

        Raises the errors of `TouchEnv`, and UnknownNameError for an unknown part or observation.
        """
        if not 0.0 < fps < np.inf:
            raise TciError(f"fps {fps}; valid: above 0 and finite")
        env = TouchEnv(
            robot, task, part=part, touches=touches, duration=duration, picture=picture,
            render_mode=render_mode, rate=fps * max(1, round(RATE / fps)),
        )  # fmt: skip
        env.policy = replace(env.policy, mode="position", rate=fps)  # angles are ordered, not its actions
        self.env = env
        self.render_mode, self.metadata = render_mode, {**env.metadata, "render_fps": max(round(fps), 1)}
        self.names = Names(env.body, parts, observations)
        self.actions, self.observed = self.names.actions, self.names.observed
        self.task = str(task) if isinstance(task, str) else "task"
        self.task_description = instruction or self.task
        self._max_episode_steps = math.ceil(env.duration * fps - 1e-9)  # LeRobot asks for it
        taxels = sum(len(env.body.skin.surfaces[one.name].areas) for one in env.robot.patches)
        known: dict[str, spaces.Space[Any]] = {
            "agent_pos": spaces.Box(-LARGEST, LARGEST, (len(self.observed),), np.float32),
            "environment_state": spaces.Box(0.0, LARGEST, (taxels,), np.float32),
        }
        if picture is not None:
            known["pixels"] = spaces.Dict({"head": spaces.Box(0, 255, (picture[1], picture[0], 3), np.uint8)})
        self.observation_space = spaces.Dict(known)
        self.action_space: spaces.Space[Any] = spaces.Box(-TURN, TURN, (len(self.actions),), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Starts an episode. Episodes with equal seeds are equal bit for bit. `options` is ignored."""
        super().reset(seed=seed)
        _, info = self.env.reset(seed=seed)
        self._before = self.env.seen
        return self._observe(), info

    def step(self, action: ArrayLike) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """One step with angles (n,) [rad]. Raises TciError for another shape, or if one is not finite."""
        given = np.asarray(action, np.float64)
        if given.shape != (len(self.actions),) or not np.isfinite(given).all():
            raise TciError(
                f"action {np.array2string(given, precision=3)}; valid: one finite angle [rad] for each of "
                + ", ".join(self.actions)
            )
        self._before = self.env.seen
        values = dict(zip(self.actions, given.tolist(), strict=True))
        reward, over, info = self.env.go(self.names.order(values))
        return self._observe(), reward, False, over, info

    def render(self) -> NDArray[np.uint8] | None:
        """As `TouchEnv.render`."""
        return self.env.render()

    def _observe(self) -> Seen:
        now, surfaces = self.env.seen, self.env.body.skin.surfaces
        assert now.skin is not None  # a simulated skin always sends
        forces = [now.skin.on(p) * surfaces[one.name].areas for p, one in enumerate(self.env.robot.patches)]
        values = [*self.names.see(now, self._before).values()]
        found: Seen = {
            "agent_pos": np.array(values, np.float32),
            "environment_state": np.concatenate(forces).astype(np.float32),
        }
        if (picture := self.env.picture()) is not None:
            found["pixels"] = {"head": picture}
        return found
