"""Base class of servers, which make a robot available to other programs.

A server uses the driver that its process has opened for the robot, real or simulated. The server publishes
the robot's sensor data and receives the orders of other programs; `runtime/serve.py` passes the orders to the
gate.
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
        """Stores the driver. The constructor of a subclass opens the server's ports, and raises DriverError
        if a port can't be opened."""
        self.driver = driver
        self.address = address

    @abstractmethod
    def where(self) -> str:
        """Returns the server's address for messages to the user, for example the names of its ports."""

    def reach(self) -> str:
        """Returns the value of `via` with which `connect`, called on this machine, reaches the server."""
        return self.where().partition(",")[0]

    @abstractmethod
    def orders(self) -> Sequence[Order]:
        """Returns the orders that arrived since the last call, the oldest first."""

    def show(self, reading: Reading) -> None:
        """Publishes urgent data, such as new skin frames. The loop calls `show` before processing the reading
        of a period, and `publish` after processing.
        """
        return

    @abstractmethod
    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        """Publishes the joints, the skin and the perception of one period, and the command that the gate
        returned."""

    @abstractmethod
    def close(self) -> None:
        """Releases all resources. A second call has no effect."""

    @abstractmethod
    def refuse(self, order: Order, reason: Reason) -> None:
        """Tells the sender of `order` that `order` was refused, and why. The loop calls this only if `order`
        was refused before it reached the gate. Refusals by the gate are in the argument `sent` of `publish`.
        """

    @property
    def overtaken(self) -> int:
        """Number of orders that did not reach the gate, since their part met something while they were on
        their way; their senders were told."""
        return 0

    def fault(self) -> Reason | None:
        """Returns a reason if the robot must hold, for example because a commander sends no messages.
        Otherwise returns None."""
        return None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
