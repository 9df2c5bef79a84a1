"""A capability with additional orders from a person. The gate checks these orders like those of the
capability."""

from __future__ import annotations

from queue import Empty, SimpleQueue
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.orders import begin_of, step_of
from tci.messages import Order, Perception
from tci.reasons import Reason


class Steered(Capability[Any]):
    """Runs another capability and adds a person's orders to its orders. Recordings contain the orders of
    both.

    Orders that a person gives while no loop runs are dropped. So the robot does not move merely because the
    loop starts again.
    """

    def __init__(self, inner: Capability[Any]) -> None:
        self.inner = inner
        self.orders: SimpleQueue[Order] = SimpleQueue()
        """Orders of a person that wait for the next step. `step` returns them after the capability's own
        orders."""

    def init(self, body: GenericBody) -> Any:
        self._given()
        return self.inner.init(body)

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return begin_of(self.inner, perception, body)

    def step(self, memory: Any, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], Any]:
        orders, memory = step_of(self.inner, memory, perception, body)
        return (*orders, *self._given()), memory

    def notes(self, memory: Any) -> tuple[str, ...]:
        return self.inner.notes(memory)

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        return self.inner.fault(perception, body)

    def _given(self) -> list[Order]:
        found: list[Order] = []
        while True:
            try:
                found.append(self.orders.get_nowait())
            except Empty:
                return found
