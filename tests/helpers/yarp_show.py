"""A simulated robot that a thread serves over YARP, together with a name server."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

from helpers.patient import patient
from tci.drivers.simulated import SimulatedDriver
from tci.runtime.serve import Served, serve
from tci.wires.yarp.server import YarpServer
from yarpwire.dialect import Dialect
from yarpwire.incoming import Delivery
from yarpwire.names import Names
from yarpwire.port import Port


def until(condition: Callable[[], bool], *, within: float = 40.0) -> bool:
    """Returns True if the condition becomes true within `within` [s]."""
    end = time.monotonic() + within
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


class Show:
    """The robot, its server and its name server."""

    def __init__(
        self, dialect: Dialect, robot: str = "nao", *, where: str = "127.0.0.1:0", paced: bool = True
    ) -> None:
        self.dialect = dialect
        self.driver = SimulatedDriver(patient(robot), paced=paced)
        self.server = YarpServer(self.driver, f"{where},dialect={dialect.name}")
        self.network = self.server.network
        self.names = Names(self.network.address)
        self.served = Served()
        self._stop = False
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        assert self._ready.wait(60.0), "the loop of the served robot has not begun"

    def _serve(self) -> None:
        class Stop(Exception):
            pass

        def see(tick: object) -> None:
            self._ready.set()
            if self._stop:
                raise Stop

        with contextlib.suppress(Stop):
            serve(self.server, observe=see, served=self.served)

    def listen(self, port: str, receive: Callable[[Delivery], None]) -> Port:
        reader = Port(f"/test{port}", self.names, self.dialect, receive=receive)
        reader.listen_to(port)
        return reader

    def close(self) -> None:
        self._stop = True
        self._thread.join(10)
        self.server.close()
