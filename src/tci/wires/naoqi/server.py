"""`tci serve nao --via naoqi`: serves any NAO, for example the simulated NAO. Other programs connect over a
socket with NAOqi's library `qi`, as to a real NAO. Joints move to the latest target at a fraction of the top
speed, as with ALMotion on a real NAO. In addition, the safety gate of this process checks every motion. The
server has no login, so by default only programs on this machine can connect."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import qi

from tci.drivers.driver import Driver
from tci.drivers.server import Server
from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading
from tci.reasons import Reason
from tci.shared.own_sockets import ConnectionMonitor
from tci.wires.naoqi import services
from tci.wires.naoqi.board import Board
from tci.wires.naoqi.session import PORT, first_line
from tci.wires.naoqi.tactile_gesture import ALTactileGesture

LOCAL = "127.0.0.1"


class NaoqiServer(Server):
    """Lets other programs read and command a driver's robot through the same services that NAOqi offers."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Listens at `address` (HOST:PORT). Raises DriverError if the server can't listen at this address."""
        super().__init__(driver, address)
        host, _, port = address.removeprefix("//").rpartition(":")
        if not host and port and not port.isdigit():
            host, port = port, ""
        if port and not port.isdigit():
            raise DriverError(f"address {address!r}; valid: naoqi:HOST:PORT")
        url = f"tcp://{host or LOCAL}:{port or PORT}"
        self._board = Board(driver.robot, driver.read())
        self._gestures: ALTactileGesture | None = None
        self._session = qi.Session()
        try:
            self._session.listenStandalone(url)
        except RuntimeError as error:
            reason = "the port is taken" if "in use" in str(error) else first_line(error)
            raise DriverError(f"can't listen at {url}: {reason}; valid: --via naoqi:HOST:PORT") from None
        self._monitor = ConnectionMonitor(int(self._session.endpoints()[0].rpartition(":")[2]))

    def where(self) -> str:
        return f"NAOqi at {', '.join(self._session.endpoints())}"

    def reach(self) -> str:
        return str(self._session.endpoints()[0]).replace("tcp://", "naoqi://")

    def orders(self) -> Sequence[Order]:
        return self._board.take()

    def show(self, reading: Reading) -> None:
        self._board.store_skin(reading)

    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self._board.store(reading, sent)
        # services are registered when the first data is available, as on a robot that starts
        if self._gestures is None:
            every = services.all_services(self._board)
            memory = every["ALMemory"]
            assert isinstance(memory, services.ALMemory)
            self._gestures = ALTactileGesture(memory)
            for name, one in {"ALTactileGesture": self._gestures, **every}.items():
                self._session.registerService(name, one)
        self._gestures._follow(perception.stamp)

    def refuse(self, order: Order, reason: Reason) -> None:
        self._board.gate = ["refused", reason.text]

    def close(self) -> None:
        self._monitor.close()
        with suppress(RuntimeError):
            self._session.close()
