"""Hands on the skin as a teleoperator of LeRobot: they guide the robot that is recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

from lerobot_robot_tci.robot import MADE, TciRobot
from tci.errors import TciError


@TeleoperatorConfig.register_subclass("tci_touch")
@dataclass
class TciTouchConfig(TeleoperatorConfig):
    """With `id` it guides the robot of this id; without, the only one."""


class TciTouch(Teleoperator):
    config_class = TciTouchConfig
    name = "tci_touch"

    def __init__(self, config: TciTouchConfig) -> None:
        super().__init__(config)
        self.config = config
        self._connected = False

    @property
    def guided(self) -> TciRobot:
        """Raises TciError if it is not clear which robot is guided."""
        found = [one for one in MADE if self.id in (None, one.id)]
        if len(found) != 1:
            raise TciError(
                f"tci_touch: {len(found)} robots with --robot.type=tci"
                + (f" and the id {self.id}" if self.id else "")
                + "; valid: one, in the same program; with several, the id of one"
            )
        return found[0]

    @property
    def action_features(self) -> dict[str, Any]:
        return self.guided.action_features

    @property
    def feedback_features(self) -> dict[str, Any]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._connected

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        self._connected = True

    def calibrate(self) -> None:
        """The robot's skin needs none."""

    def configure(self) -> None:
        """The robot does all that is needed."""

    def get_action(self) -> dict[str, Any]:
        return self.guided.tci.guide()

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Whoever guides feels the robot."""

    def disconnect(self) -> None:
        self._connected = False
