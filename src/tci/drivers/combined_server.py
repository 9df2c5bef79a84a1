"""Combines several servers of one robot. For example, one server serves the joints of a G1 on Unitree's
topics, and another server serves the skin over YARP."""

from __future__ import annotations

from collections.abc import Sequence

from tci.drivers.server import Server
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading
from tci.reasons import Reason

JOIN = " + "
"""Separator between the addresses of combined drivers or servers."""


class CombinedServer(Server):
    """One robot that is served on several middlewares at once. Clients of each middleware can command the
    robot."""

    def __init__(self, servers: Sequence[Server]) -> None:
        """Stores `servers`, which all serve one driver. Closing the combined server also closes `servers`."""
        super().__init__(servers[0].driver, JOIN.join(server.address for server in servers))
        self.servers = tuple(servers)
        self._senders: dict[int, Server] = {}

    def where(self) -> str:
        return JOIN.join(server.where() for server in self.servers)

    def reach(self) -> str:
        return JOIN.join(server.reach() for server in self.servers)

    def orders(self) -> Sequence[Order]:
        found = [(order, server) for server in self.servers for order in server.orders()]
        self._senders = {id(order): server for order, server in found}
        return [order for order, _ in found]

    def show(self, reading: Reading) -> None:
        for server in self.servers:
            server.show(reading)

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        for server in self.servers:
            server.publish(reading, perception, sent)

    def refuse(self, order: Order, reason: Reason) -> None:
        self._senders[id(order)].refuse(order, reason)

    def fault(self) -> Reason | None:
        faults = [server.fault() for server in self.servers]
        return next((fault for fault in faults if fault is not None), None)

    def close(self) -> None:
        for server in self.servers:
            server.close()
