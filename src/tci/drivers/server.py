"""Base class of servers, which make a robot available to other programs: the counterpart of a driver.

A server uses the process's own driver of the robot, real or simulated. It publishes the robot's sensor data
and passes on the orders of other programs; `runtime/serve.py` connects it to the gate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from tci.drivers.driver import Driver
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading
from tci.reasons import Reason


class Server(ABC):
    """Serves the robot of `driver` to other programs. All methods are called from the loop and never wait."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Stores the driver. A subclass opens its ports here, and raises DriverError if that fails."""
        self.driver = driver
        self.address = address

    @abstractmethod
    def where(self) -> str:
        """Returns the address of the server for messages, such as the names of its ports."""

    def reach(self) -> str:
        """Returns the argument of `connect` that reaches the server on this machine."""
        return self.where().partition(",")[0]

    @abstractmethod
    def orders(self) -> Sequence[Order]:
        """Returns the orders that arrived since the last call, oldest first."""

    def show(self, reading: Reading) -> None:
        """Publishes urgent data, such as new frames of the skin, before this period's reading is processed.
        `publish` follows."""
        return

    @abstractmethod
    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        """Publishes this period's joints and skin, the perception, and the command that the gate allowed."""

    @abstractmethod
    def close(self) -> None:
        """Closes every resource. A second call does nothing."""

    @abstractmethod
    def refuse(self, order: Order, reason: Reason) -> None:
        """Reports the reason for a refused order to the sender of the order. Refusals by the gate are in the
        argument `sent` of `publish`."""

    def fault(self) -> Reason | None:
        """Returns a reason to hold, such as a silent commander, or None."""
        return None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
