"""One robot that is served over several middlewares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import tci
from tci.drivers.combined_server import CombinedServer
from tci.drivers.driver import Driver
from tci.drivers.registry import open_server
from tci.drivers.server import Server
from tci.drivers.simulated import SimulatedDriver
from tci.errors import UnknownNameError
from tci.gate.gate import SafeCommand
from tci.messages import Mode, Order, Perception, PlatformCommand, Reading
from tci.reasons import Code, Reason
from tci.robot.description import Robot


class Told(Server):
    """A server that records the calls of its methods."""

    def __init__(self, driver: Driver, address: str, order: Order) -> None:
        super().__init__(driver, address)
        self.order, self.calls, self.silent = order, list[str](), False

    def where(self) -> str:
        return f"{self.address}, for all"

    def orders(self) -> Sequence[Order]:
        return [self.order]

    def show(self, reading: Reading) -> None:
        self.calls.append("show")

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self.calls.append("publish")

    def refuse(self, order: Order, reason: Reason) -> None:
        self.calls.append(f"refuse {order is self.order}")

    def fault(self) -> Reason | None:
        return Reason(Code.COMMANDER_SILENT, self.address) if self.silent else None

    def close(self) -> None:
        self.calls.append("close")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return tci.load_robot("nao")


def test_each_server_shows_the_robot_and_hears_of_its_own_orders(robot: Robot) -> None:
    made = [PlatformCommand(Mode.POSITION, np.array([0]), np.zeros(1), np.ones(1)) for _ in range(2)]
    with SimulatedDriver(robot) as driver:
        first, second = (Told(driver, name, order) for name, order in zip("ab", made, strict=True))
        with CombinedServer([first, second]) as server:
            assert server.where() == "a, for all + b, for all"
            assert server.reach() == "a + b"
            assert [id(order) for order in server.orders()] == [*map(id, made)]
            server.refuse(made[1], Reason(Code.OTHER, "no"))
            assert (first.calls, second.calls) == ([], ["refuse True"])
            assert server.fault() is None
            second.silent = True
            assert server.fault() == Reason(Code.COMMANDER_SILENT, "b")
            server.show(driver.read())
    assert first.calls == ["show", "close"]
    assert second.calls == ["refuse True", "show", "close"]


def test_a_second_server_that_does_not_exist_closes_the_first(robot: Robot) -> None:
    with SimulatedDriver(robot) as driver:
        for _ in range(2):  # otherwise its port would still be in use
            with pytest.raises(UnknownNameError, match="smoke"):
                open_server(driver, "player:127.0.0.1:16665 + smoke")
