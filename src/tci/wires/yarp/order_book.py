"""Orders that wait for the next period of the server's loop, and the results of orders."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Sequence

from tci.errors import CommandError
from tci.messages import Order
from tci.reasons import Code, Reason

MOST_ORDERS = 256
"""Largest number of orders that wait for the next period. If there are more, the oldest orders are dropped.
Assumed: this number bounds the memory; a client sends a few orders per period and board."""
SETTLE = 1.0
"""Longest time [s] that a call waits for the results of its orders. Assumed: the loop answers within a few
periods, and YARP's own clients wait longer."""


class OrderBook:
    """Passes orders from the threads of connections to the loop, and passes the results of the orders back to
    these threads.

    Each connection has a thread of its own, which calls `put`. If a client waits for an answer, the thread
    also calls `begin` before and `settle` after. The loop calls `take`, `refuse` and `judge`.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: list[Order] = []
        self._given: list[Order] = []
        self._refused: dict[int, Reason] = {}
        self._undo: dict[int, Callable[[], object]] = {}
        self._mine = threading.local()

    def put(self, order: Order, undo: Callable[[], object] | None = None) -> None:
        """Adds an order. If the order is refused later, the book calls `undo` to restore the state before the
        order."""
        with self._changed:
            self._waiting.append(order)
            if undo is not None:
                self._undo[id(order)] = undo
            for lost in self._waiting[:-MOST_ORDERS]:
                self._undo.pop(id(lost), None)
            del self._waiting[:-MOST_ORDERS]
        if self.is_awaited:
            self._mine.orders.append(order)

    def take(self) -> list[Order]:
        """Returns the orders that were added since the last call, the oldest first."""
        with self._changed:
            waiting, self._waiting = self._waiting, []
            self._given += waiting
        return waiting

    def refuse(self, order: Order, reason: Reason) -> bool:
        """Records that an order was refused before it reached the gate.

        Returns True if the order came from this book.
        """
        with self._changed:
            mine = any(order is given for given in self._given)
            if mine:
                self._refused[id(order)] = reason
        return mine

    def judge(self, passed: Sequence[Order], reasons: Sequence[Reason]) -> None:
        """Records the gate's decision on the orders that `take` has returned since the last decision.

        `passed` are the orders that the gate accepted, `reasons` the reasons why it refused the rest.
        """
        if not self._given:
            return
        with self._changed:
            for order in self._given:
                undo = self._undo.pop(id(order), None)
                if not any(order is other for other in passed):
                    if undo is not None:
                        undo()
                    self._refused.setdefault(id(order), _joined(reasons))
            self._given = []
            self._changed.notify_all()

    def is_busy(self) -> bool:
        """Returns True while an order waits for its result."""
        return bool(self._waiting or self._given)

    def _pending(self) -> list[Order]:
        return [*self._waiting, *self._given]

    @property
    def is_awaited(self) -> bool:
        """True if the calling thread has called `begin` and not yet `settle`."""
        return getattr(self._mine, "orders", None) is not None

    def begin(self) -> None:
        """Makes `settle` wait for all orders that the calling thread adds after this call."""
        self._mine.orders = []

    def settle(self) -> None:
        """Waits until the orders of the calling thread have a result.

        Raises CommandError if an order is refused, or has no result after one second.
        """
        mine, self._mine.orders = self._mine.orders, None
        until = time.monotonic() + SETTLE
        with self._changed:
            while any(order is other for order in mine for other in self._pending()):
                if not self._changed.wait(max(0.0, until - time.monotonic())):
                    raise CommandError(f"the robot's loop has not answered within {SETTLE:g} s")
            reasons = [self._refused.pop(id(order)) for order in mine if id(order) in self._refused]
            if len(self._refused) > MOST_ORDERS:
                self._refused.clear()
        if reasons:
            raise CommandError(_joined(dict.fromkeys(reasons)).text)


def _joined(reasons: Collection[Reason]) -> Reason:
    """Returns one reason with the texts of all reasons, and with the code of the first reason."""
    if not reasons:
        return Reason(Code.OTHER, "the gate did not accept it")
    return Reason(next(iter(reasons)).code, "; ".join(reason.text for reason in reasons))
