"""Orders that wait for the next period of the serving loop, and what became of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Sequence

from tci.errors import CommandError
from tci.messages import Order
from tci.reasons import Code, Reason

MOST_ORDERS = 256
"""Orders that wait for the next period at most; beyond, the oldest go. Ours."""
SETTLE = 1.0
"""How long [s] a caller waits to hear what became of its orders. Ours."""


class OrderBook:
    """Connections put orders in, the loop takes them out and says which ones passed."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: list[Order] = []
        self._given: list[Order] = []
        self._refused: dict[int, Reason] = {}
        self._undo: dict[int, Callable[[], None]] = {}
        self._mine = threading.local()

    def put(self, order: Order, undo: Callable[[], None] | None = None) -> None:
        """Hand in an order; `undo` takes back what counts already, if it is refused."""
        with self._changed:
            self._waiting.append(order)
            if undo is not None:
                self._undo[id(order)] = undo
            for lost in self._waiting[:-MOST_ORDERS]:
                self._undo.pop(id(lost), None)
            del self._waiting[:-MOST_ORDERS]
        if getattr(self._mine, "orders", None) is not None:
            self._mine.orders.append(order)

    def take(self) -> list[Order]:
        """Orders since the last call, oldest first."""
        with self._changed:
            waiting, self._waiting = self._waiting, []
            self._given += waiting
        return waiting

    def refuse(self, order: Order, reason: Reason) -> bool:
        """Tell that an order did not even reach the gate; whether it was one of these."""
        with self._changed:
            mine = any(order is given for given in self._given)
            if mine:
                self._refused[id(order)] = reason
        return mine

    def judge(self, passed: Sequence[Order], reasons: Sequence[Reason]) -> None:
        """Tell which of the orders taken before the gate took over."""
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
        """Whether orders wait for the loop's verdict."""
        return bool(self._waiting or self._given)

    def _pending(self) -> list[Order]:
        return [*self._waiting, *self._given]

    def begin(self) -> None:
        """From here on this thread's orders are waited for by `settle`."""
        self._mine.orders = []

    def settle(self) -> None:
        """Wait until the loop has judged this thread's orders. Raises CommandError for a refused one."""
        mine, self._mine.orders = self._mine.orders, None
        until = time.monotonic() + SETTLE
        with self._changed:
            while any(order is other for order in mine for other in self._pending()):
                if not self._changed.wait(max(0.0, until - time.monotonic())):
                    raise CommandError("the robot's loop does not answer")
            reasons = [self._refused.pop(id(order)) for order in mine if id(order) in self._refused]
            if len(self._refused) > MOST_ORDERS:
                self._refused.clear()
        if reasons:
            raise CommandError(_joined(dict.fromkeys(reasons)).text)


def _joined(reasons: Collection[Reason]) -> Reason:
    """Returns the reasons as one, with the code of the first."""
    if not reasons:
        return Reason(Code.OTHER, "the gate did not take it over")
    return Reason(next(iter(reasons)).code, "; ".join(reason.text for reason in reasons))
