"""Environments of TCI as environments of LeRobot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_IMAGES, OBS_STATE

from tci.learn import NamedEnv


@EnvConfig.register_subclass("tci")
@dataclass
class TciEnvConfig(EnvConfig):
    """The arguments of `tci.learn.NamedEnv`. What `--robot.type=tci` gives with the same options has the
    same numbers."""

    task: str | None = "withdrawal"
    fps: int = 30
    robot: str = "nao"
    parts: list[str] = field(default_factory=list)
    """Generic parts that are seen and moved; none: all arms."""
    observations: list[str] = field(default_factory=lambda: ["posture", "velocity", "contacts"])
    part: str | None = None
    """Generic part that is touched; none: the left arm, or where that has no skin the next part that has."""
    touches: list[str] = field(default_factory=list)
    """Touches of a person in place of the task's."""
    duration: float | None = None
    """Length [s] of an episode."""
    picture: list[int] = field(default_factory=list)
    """Width and height of pictures of the head camera."""
    instruction: str = ""
    """What policies that understand language are told."""

    def __post_init__(self) -> None:
        one = NamedEnv(**self.gym_kwargs)
        seen, kinds = one.observation_space, (("agent_pos", OBS_STATE, FeatureType.STATE),)
        kinds += (("environment_state", OBS_ENV_STATE, FeatureType.ENV),)
        self.features = {ACTION: PolicyFeature(FeatureType.ACTION, one.action_space.shape)}
        self.features_map = {ACTION: ACTION}
        for name, own, kind in kinds:
            self.features[name] = PolicyFeature(kind, seen[name].shape)
            self.features_map[name] = own
        if self.picture:
            self.features["pixels/head"] = PolicyFeature(FeatureType.VISUAL, seen["pixels"]["head"].shape)
            self.features_map["pixels/head"] = f"{OBS_IMAGES}.head"

    @property
    def package_name(self) -> str:
        return "tci.learn"

    @property
    def gym_id(self) -> str:
        return "tci/Named-v0"

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        return {
            "robot": self.robot, "task": self.task, "parts": self.parts, "observations": self.observations,
            "fps": float(self.fps), "part": self.part, "touches": self.touches, "duration": self.duration,
            "picture": tuple(self.picture) or None, "render_mode": "rgb_array",
            "instruction": self.instruction,
        }  # fmt: skip
