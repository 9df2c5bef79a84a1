"""A capability with additional orders from a person. The gate checks all orders in the same way."""

from __future__ import annotations

from collections.abc import Sequence
from queue import Empty, SimpleQueue
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.wrapper import CapabilityWrapper
from tci.messages import Order, Perception


class Steered(CapabilityWrapper[Any]):
    """Runs another capability and adds a person's orders to the orders of this capability. Recordings contain
    all these orders.

    A person's orders are dropped while the loop does not run. So the start of the loop does not move the
    robot.
    """

    def __init__(self, inner: Capability[Any], *, first: Sequence[Order] = ()) -> None:
        """`first` are orders before the capability's own first ones."""
        super().__init__(inner)
        self._first = tuple(first)
        self.orders: SimpleQueue[Order] = SimpleQueue()
        """Orders of a person that wait for the next step. The method `step` returns these orders after the
        capability's orders."""

    def init(self, body: GenericBody) -> Any:
        self._given()
        return super().init(body)

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return (*self._first, *super().begin(perception, body))

    def step(self, memory: Any, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], Any]:
        orders, memory = super().step(memory, perception, body)
        return (*orders, *self._given()), memory

    def _given(self) -> list[Order]:
        found: list[Order] = []
        while True:
            try:
                found.append(self.orders.get_nowait())
            except Empty:
                return found
