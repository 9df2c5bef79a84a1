"""`tci serve ROBOT --via yarp`: server of any robot as YARP control boards and skin ports.

YARP's own tools and iCub's software can then read and move the robot. Each robot part is a control board with
the ports `/ROBOT/PART/...`. Each skin patch has the port `/ROBOT/skin/PATCH`.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tci.drivers.driver import Driver
from tci.drivers.server import Server
from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import wire_name
from tci.wires.yarp import address as addresses
from tci.wires.yarp.address import YarpAddress, board_ports
from tci.wires.yarp.driver_errors import raises_driver_errors
from tci.wires.yarp.facts import FactsService, facts_port
from tci.wires.yarp.served_board import ServedBoard
from tci.wires.yarp.skin_events import EventForm
from tci.wires.yarp.skin_ports import SkinPorts
from yarpwire.calls_v3 import answer_v3
from yarpwire.calls_v4 import answer_v4
from yarpwire.dialect import V3, V4, Dialect
from yarpwire.errors import CallError, YarpError
from yarpwire.incoming import Answer, Delivery
from yarpwire.message import CALL, Stamp
from yarpwire.name_server import NameServer
from yarpwire.names import config_file, namespace, read_key
from yarpwire.network import NamedPort, Network
from yarpwire.state import encode_state
from yarpwire.streams import obey

PERIOD = 0.01
"""Time [s] between two published states of a board, as on an iCub."""
APART = 0.003
"""Time [s] after a skin frame in which the server publishes no states of boards. This delays a state by at
most half the time between two states. Assumed: in this time a client computes its answer to a touch, and
reading states would delay the answer."""
DEFAULT = ("127.0.0.1", 10000)
"""Host and port at which the server's own name server listens if no address is given."""
REGISTER_AGAIN = 1.0
"""Time [s] between two checks that the server's ports are still registered. A name server that restarts
forgets the ports. Assumed: a second is soon enough, since data between ports does not need the name
server."""


class YarpServer(Server):
    """Serves the robot of a driver on YARP. The server accepts commands only if the driver is armed."""

    @raises_driver_errors
    def __init__(self, driver: Driver, address: str = "") -> None:
        """Opens all ports. Starts a name server in this process if no name server is found.

        docs/yarp.md describes the `address`. Raises DriverError if a port is in use or the name server does
        not answer. Raises MissingExtraError if the address requests YARP's own bindings and they are not
        installed.
        """
        super().__init__(driver, address)
        options = addresses.parse(address)
        self.prefix = options.robot or wire_name(driver.robot.name)
        self._bindings = options.bindings
        self._own, self.network = self._name_server(options)
        self.dialect: Dialect = options.dialect or self.network.dialect or V3
        self._where = board_ports(driver.robot, self.prefix)
        self.boards = {part: ServedBoard(part, driver.robot.servos_of(part)) for part in self._where}
        joints = driver.read().joints
        for board in self.boards.values():
            board.update(joints, driver.gate.modes)
        self.last_error = ""
        """Reason why the last refused command was refused."""
        self.refused = 0
        """Number of refused commands."""
        self._ports: dict[str, NamedPort] = {}
        self._skin: dict[str, SkinPorts] = {}
        self._sequences: dict[str, int] = {}
        self._stamps: dict[str, int] = {}
        self._due = 0.0
        self._skin_time = -np.inf
        self._shown = False
        self._closed = threading.Event()
        try:
            for part in self.boards:
                self.open_board(part)
            for patch in driver.robot.skin:
                self._skin[patch.name] = SkinPorts(driver.robot, patch, self.prefix, self.dialect, self._open)
            self._form = EventForm(driver.robot)
            self._events = self._open(options.events) if options.events else None
            self._open_facts()
        except (DriverError, YarpError):
            self.close()
            raise
        threading.Thread(target=self._keep_registered, name="yarp registration", daemon=True).start()

    def where(self) -> str:
        host, port = self.network.address
        file = config_file(namespace())
        hint = "" if file.is_file() else f"; for YARP's tools: yarp conf {host} {port}"
        return f"yarp:{host}:{port}, ports /{self.prefix}/... of YARP {self.dialect.name}{hint}"

    def reach(self) -> str:
        host, port = self.network.address
        return f"yarp:{host}:{port},{'bindings' if self._bindings else f'dialect={self.dialect.name}'}"

    def orders(self) -> Sequence[Order]:
        if not self._shown:
            return []  # orders wait until the first reading is published
        return [order for board in self.boards.values() for order in board.book.take()]

    def refuse(self, order: Order, reason: Reason) -> None:
        self._refuse(reason)
        for board in self.boards.values():
            board.book.refuse(order, reason)

    @raises_driver_errors
    def show(self, reading: Reading) -> None:
        offset = time.time() - self.driver.clock.now()
        for frame in reading.skin:
            if self._sequences.get(frame.patch) != frame.sequence:
                self._sequences[frame.patch] = frame.sequence
                self._skin_time = time.monotonic()
                self._skin[frame.patch].publish(frame, self._stamp(frame.patch, frame.stamp + offset))

    @raises_driver_errors
    def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
        self._shown = True
        here = reading.joints.position
        aims = np.array([here, here, np.zeros(len(here))])
        aims[:, sent.servos] = self.driver.gate.targets, sent.position, sent.velocity
        for board in self.boards.values():
            board.follow(*aims)
            board.book.judge(sent.orders, sent.refusals)
        offset = time.time() - self.driver.clock.now()
        now = time.monotonic()
        if now < self._due or (now - self._skin_time < APART and now < self._due + PERIOD / 2):
            return
        self._due = max(self._due + PERIOD, now)
        for part, board in self.boards.items():
            board.update(reading.joints, self.driver.gate.modes)
            where = self._where[part]
            if f"{where}/state:o" not in self._ports:
                continue  # `close_board` has closed this board
            stamp = self._stamp(part, reading.joints.stamp + offset)
            self._write(f"{where}/state:o", board.state.position, stamp)
            extended = f"{where}/stateExt:o"
            if self._ports[extended].outputs:
                self._write(extended, encode_state(board.state, self.dialect), stamp)
        if self._events is not None and self._events.outputs:
            self._events.write(
                self._form.encode(perception.contacts), self._stamp("events", offset + perception.stamp)
            )

    @raises_driver_errors
    def close(self) -> None:
        self._closed.set()
        for port in self._ports.values():
            port.close()
        if self._own is not None:
            self._own.close()

    def _name_server(self, options: YarpAddress) -> tuple[NameServer | None, Network]:
        """Returns the name server if this process has started it, otherwise None; and the network.

        Uses the name server in the address or in yarp.conf. If it does not answer, starts one in this
        process. Searches for no other name server: through one on another machine, other machines could reach
        the ports.
        """
        if options.server is None and not config_file(namespace()).is_file():
            options = replace(options, server=DEFAULT)
        where = options.server or DEFAULT
        try:
            network = options.network()
            where = network.address
            network.list()
            return None, network
        except (DriverError, YarpError):
            own = NameServer(*where, key=read_key(), space=namespace())
            try:
                return own, replace(options, server=own.address).network()
            except DriverError:
                own.close()
                raise

    @raises_driver_errors
    def open_board(self, part: str) -> None:
        """Opens the ports of one robot part's control board. Raises DriverError if a port is in use."""
        board = self.boards[part]
        calls = "nws/rpc:i" if self.dialect is V4 else "rpc:i"
        answer = answer_v4 if self.dialect is V4 else answer_v3

        def call(delivery: Delivery) -> Answer:
            return answer(board, delivery.items(self.dialect)) if delivery.command.kind == CALL else None

        def command(delivery: Delivery) -> None:
            try:
                obey(board, delivery.items(self.dialect), self.dialect)
            except CallError as error:
                self._refuse(Reason(Code.COMMAND_INVALID, str(error)))

        board.armed = self.driver.armed
        for name, receive in ((calls, call), ("command:i", command), ("state:o", None), ("stateExt:o", None)):
            self._open(f"{self._where[part]}/{name}", receive)

    @raises_driver_errors
    def close_board(self, part: str) -> None:
        """Closes the ports of one control board until `open_board` is called.

        Tests with a board that restarts need this method.
        """
        for name in list(self._ports):
            if name.startswith(f"{self._where[part]}/"):
                self._ports.pop(name).close()

    def _open_facts(self) -> None:
        """Opens the port on which other programs query facts about the robot."""
        facts = FactsService(self.driver.robot)

        def call(delivery: Delivery) -> Answer:
            return facts.answer(delivery.items(self.dialect)) if delivery.command.kind == CALL else None

        self._open(facts_port(self.prefix), call)

    def _open(self, name: str, receive: Callable[[Delivery], Answer] | None = None) -> NamedPort:
        port = self._ports[name] = self.network.port(name, self.dialect, receive)
        return port

    def _stamp(self, what: str, stamp: float) -> Stamp:
        count = self._stamps[what] = self._stamps.get(what, -1) + 1
        return Stamp(count, stamp)

    def _write(self, name: str, value: Array | list[Any], stamp: Stamp) -> None:
        self._ports[name].write(value, stamp)

    def _refuse(self, reason: Reason) -> None:
        self.refused += 1
        self.last_error = reason.text

    def _keep_registered(self) -> None:
        """Registers the server's ports again if the name server has restarted, until the server closes."""
        while not self._closed.wait(REGISTER_AGAIN):
            with contextlib.suppress(YarpError):
                known = {contact.name for contact in self.network.list()}
                for port in list(self._ports.values()):
                    if port.name not in known and not self._closed.is_set():
                        port.register()
