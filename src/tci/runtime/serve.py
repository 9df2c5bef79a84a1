"""Serves a robot to other programs. Runs the control loop with the orders that a server receives, instead of
the orders of a capability. The gate, the lease and the watchdogs of this process apply to all orders from the
other programs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from tci.body.generic_body import GenericBody, order_to_platform
from tci.capabilities.capability import Capability
from tci.drivers.server import Server
from tci.errors import TciError
from tci.messages import Order, Perception, PlatformOrder
from tci.messages.clock import Clock, MonotonicClock
from tci.reasons import Code, Reason, ReasonCounter
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport
from tci.runtime.watchdogs import StallDetector, attentive


@dataclass(slots=True)
class Served:
    """Statistics of a server."""

    orders: int = 0
    """Number of received orders."""
    refusals: ReasonCounter = field(default_factory=ReasonCounter)
    """Reasons for which orders were refused, each with the number of orders."""


def serve(
    server: Server,
    *,
    duration: float | None = None,
    observe: Callable[[Tick], None] | None = None,
    report: LoopReport | None = None,
    served: Served | None = None,
    clock: Clock | None = None,
) -> Served:
    """Serves the robot of `server.driver` for `duration` [s], or until the user interrupts the process.

    If the driver is not armed, clients can read but not command the robot. If an order does not fit the
    robot, the server refuses the order, and the robot does not move. The server uses `clock`, by default the
    machine's clock, to notice that this process stood still. Raises errors as `run` does, for example
    DriverError if another process commands the robot.
    """
    orders = _Orders(server, served if served is not None else Served(), clock or MonotonicClock())

    def see(tick: Tick) -> None:
        orders.publish(tick)
        if observe is not None:
            observe(tick)

    with attentive():
        run(
            server.driver, orders, duration=duration, observe=see, sensed=server.show, guard=orders.hold,
            report=report, write=server.driver.armed,
        )  # fmt: skip
    return orders.served


class _Orders(Capability[None]):
    """Capability whose commands are the orders that a server receives from other programs."""

    def __init__(self, server: Server, served: Served, clock: Clock) -> None:
        self.server = server
        self.served = served
        self.clock = clock
        self._tick: Tick | None = None
        self._standstill: StallDetector | None = None

    def init(self, body: GenericBody) -> None:
        return None

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], None]:
        passed: list[PlatformOrder] = []
        for order in self.server.orders():
            self.served.orders += 1
            if self._tick is None:
                unread = Reason(Code.NOT_ARMED, "the robot has not been read yet")
                self._refuse(order, unread, perception.stamp)
                continue
            if not self.server.driver.armed:
                read_only = Reason(Code.NOT_ARMED, "this robot is served read-only; valid: tci serve --arm")
                self._refuse(order, read_only, perception.stamp)
                continue
            try:
                position = self._tick.reading.joints.position
                passed.append(order_to_platform(self.server.driver.robot, order, position))
            except TciError as error:
                self._refuse(order, error.reason, perception.stamp)
        return tuple(passed), None

    def hold(self) -> Reason | None:
        """Returns a reason to hold the robot in this period, or None."""
        missed = self.server.fault()
        return (self._standstill.fault() if self._standstill is not None else None) or missed

    def publish(self, tick: Tick) -> None:
        """Publishes the data of one period to the clients."""
        # the stall detector starts after the first period, which compiles code and reads files
        if self._standstill is None:
            self._standstill = StallDetector(self.clock, stale_after=self.server.driver.gate.stale_after)
        self._tick = tick
        for reason in tick.sent.refusals:
            self.served.refusals.add(reason, tick.now)
        self.server.publish(tick.reading, tick.perception, tick.sent)

    def _refuse(self, order: Order, reason: Reason, now: float) -> None:
        self.served.refusals.add(reason, now)
        self.server.refuse(order, reason)
