"""What every way to show a robot to others has in common; the counterpart of a driver.

A server stands beside the process's own driver of the robot, real or simulated. It publishes what the robot
senses and hands on what others order; `runtime/serve.py` puts the gate between the two.
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
    """Shows the robot of `driver` to others. All methods are called from the loop and never wait."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """A subclass opens its ports here, and raises DriverError when it can't."""
        self.driver = driver
        self.address = address

    @abstractmethod
    def where(self) -> str:
        """Where it is found, for people: an address, the names of ports."""

    def reach(self) -> str:
        """What `connect` takes on this machine to reach it."""
        return self.where().partition(",")[0]

    @abstractmethod
    def orders(self) -> Sequence[Order]:
        """What arrived since the last call, oldest first."""

    def show(self, reading: Reading) -> None:
        """Show what can't wait, such as new frames of the skin, before anything is made of this period's
        reading. `publish` follows."""
        return

    @abstractmethod
    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        """Show this period's joints and skin, what was made of them, and what the gate let pass."""

    @abstractmethod
    def close(self) -> None:
        """Let go of every resource. A second call does nothing."""

    @abstractmethod
    def refuse(self, order: Order, reason: Reason) -> None:
        """Tell who ordered it why it does not pass; what the gate refuses is in `publish`'s `sent`."""

    def fault(self) -> Reason | None:
        """Returns why the robot should hold, such as a commander that fell silent, or None."""
        return None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
