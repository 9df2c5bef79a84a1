"""A robot of TCI as a robot of LeRobot."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from typing import Any

from lerobot.robots import Robot, RobotConfig

from tci.learn import NamedRobot

MADE: weakref.WeakSet[TciRobot] = weakref.WeakSet()
"""The robots of this process, for those who guide them."""


@RobotConfig.register_subclass("tci")
@dataclass
class TciRobotConfig(RobotConfig):
    """The arguments of `tci.learn.NamedRobot`."""

    robot: str = "nao"
    via: str = "sim"
    arm: bool | None = None
    """True to move a real robot."""
    parts: list[str] = field(default_factory=list)
    """Generic parts; none: all arms."""
    observations: list[str] = field(default_factory=lambda: ["posture", "velocity", "contacts"])
    fps: float = 30.0
    """As `--dataset.fps`."""
    touches: list[str] = field(default_factory=list)
    """Touches of a simulated person, over and over."""
    picture: list[int] = field(default_factory=list)
    """Width and height of pictures of a simulated robot's head camera."""
    record: str = ""
    """File (.mcap) that keeps everything, also the raw frames of the skin."""


class TciRobot(Robot):
    config_class = TciRobotConfig
    name = "tci"

    def __init__(self, config: TciRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.tci = NamedRobot(
            config.robot, config.via, arm=config.arm, parts=config.parts, observations=config.observations,
            rate=config.fps, touches=config.touches,
            picture=(config.picture[0], config.picture[1]) if config.picture else None, record=config.record,
        )  # fmt: skip
        self.cameras = self.tci.pictures  # LeRobot counts them
        MADE.add(self)

    @property
    def observation_features(self) -> dict[str, Any]:
        return dict.fromkeys(self.tci.observed, float) | self.tci.pictures

    @property
    def action_features(self) -> dict[str, Any]:
        return dict.fromkeys(self.tci.actions, float)

    @property
    def is_connected(self) -> bool:
        return self.tci.is_connected

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        self.tci.connect()

    def calibrate(self) -> None:
        """TCI knows its robots from their descriptions."""

    def configure(self) -> None:
        """The gate switches modes as orders need them."""

    def get_observation(self) -> dict[str, Any]:
        return self.tci.observe()

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Returns the set-points that the gate sent."""
        return self.tci.act({name: float(value) for name, value in action.items()})

    def disconnect(self) -> None:
        self.tci.disconnect()
