"""A server whose orders a test gives, by the number of the period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.drivers.driver import Driver
from tci.drivers.server import Server
from tci.gate.safe_command import SafeCommand
from tci.messages import GenericCommand, Mode, Order, Perception, Reading
from tci.reasons import Reason


class Desk(Server):
    """A server for which the test defines the received orders, by the number of the period in which they
    arrive."""

    def __init__(self, driver: Driver, orders: dict[int, Sequence[Order]]) -> None:
        super().__init__(driver)
        self.plan = orders
        self.shown: list[SafeCommand] = []
        self.refused: list[tuple[Order, str]] = []
        self.reason: Reason | None = None

    def where(self) -> str:
        return "a desk"

    def orders(self) -> Sequence[Order]:
        return self.plan.get(len(self.shown), ())

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        assert reading.joints.position.shape == (len(self.driver.robot.servos),)
        assert perception.posture
        self.shown.append(sent)

    def refuse(self, order: Order, reason: Reason) -> None:
        self.refused.append((order, reason))

    def fault(self) -> Reason | None:
        return self.reason

    def close(self) -> None:
        pass


def turn_head(angle: float) -> GenericCommand:
    return GenericCommand("head", Mode.POSITION, np.array([angle, 0.0, 0.0]))
