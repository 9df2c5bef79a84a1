"""A named port. Accepts connections, and opens connections to other ports when a program such as `yarp
connect` orders it."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from yarpwire import message, outgoing
from yarpwire.carrier import FAST_TCP, TCP, find_carrier
from yarpwire.connection_limit import MOST, AcceptedConnection
from yarpwire.dialect import Dialect
from yarpwire.errors import PortError
from yarpwire.incoming import Answer, Delivery, Incoming
from yarpwire.listener import Listener, error_text
from yarpwire.message import Stamp
from yarpwire.names import Contact, Names
from yarpwire.outgoing import Outgoing
from yarpwire.values import Array, Dict, Vocab

SPOKEN = "tcp fast_tcp udp text text_ack"
"""Carriers that the ports offer and accept."""
ORDERS = (
    "[help]                  # give this help",
    "[ver]                   # report protocol version information",
    "[add] $portname         # add an output connection",
    "[add] $carrier:/$portname  # add an output connection with a given protocol",
    "[del] $portname         # remove an output connection",
    "[list] [in]             # list input connections",
    "[list] [out]            # list output connections",
    "[list] [out] $portname  # give details for output",
    "[prop] [get] $cur_port  # get the directions of this port",
)
"""Orders to a port itself, as `yarp admin rpc PORT` sends them."""
VERSION = (Vocab("ver"), 1, 2, 3)
"""Answer of a port to `[ver]`."""


class Port:
    """A named port. `receive` is called with each message. For a call, `receive` returns the reply.

    Each connection has its own thread, which calls `receive`. An error that `receive` raises ends only this
    connection.
    """

    def __init__(
        self,
        name: str,
        names: Names,
        dialect: Dialect,
        *,
        receive: Callable[[Delivery], Answer] | None = None,
        host: str | None = None,
    ) -> None:
        """Starts to listen and registers the port. Raises PortError if the name server does not answer, or if
        the TCP port is in use."""
        if not name.startswith("/") or any(letter.isspace() for letter in name):
            raise PortError(f"port name {name!r}; valid: it begins with / and has no spaces")
        self.name, self.dialect, self.names = name, dialect, names
        self.wrong = 0
        """Number of messages that could not be decoded."""
        self.last_error = ""
        """Latest error of a message or a connection."""
        self._receive = receive
        self._lock = threading.Lock()
        self._inputs: dict[str, Incoming] = {}
        self._served: set[Incoming] = set()
        self._closed = False
        self._outputs: dict[str, Outgoing] = {}
        host = host if host is not None else own_host(names.address)
        self._listener = Listener(host, 0, self._serve, name=f"the port {name}")
        self.contact = Contact(name, *self._listener.address)
        """Name and address of the port."""
        try:
            self.register()
        except PortError:
            self._listener.close()
            raise

    def register(self) -> None:
        """Registers the port. Call this again after the name server has restarted. Raises PortError if the
        registration fails."""
        properties = {
            "offers": SPOKEN,
            "accepts": SPOKEN,
            "ips": self.contact.host,
            "process": str(os.getpid()),
        }
        self.names.register(self.contact, properties)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the ports that send to this port."""
        return tuple(self._inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the ports to which this port sends."""
        return tuple(self._outputs)

    @property
    def dropped(self) -> int:
        """Number of messages dropped because readers were too slow, plus number of connections that were
        closed because of invalid data or to make room for new ones."""
        return self._listener.dropped + sum(output.dropped for output in list(self._outputs.values()))

    def write(self, value: Array | Sequence[Any], stamp: Stamp | None = None) -> None:
        """Sends a Vector (an array) or a Bottle (a list) to all readers. Never waits: if a reader is too
        slow, its message is dropped."""
        for name, output in list(self._outputs.items()):
            try:
                output.offer(value, self.dialect, stamp)
            except PortError as error:
                self.last_error = str(error)
                with self._lock:
                    if self._outputs.get(name) is output:
                        del self._outputs[name]
                output.drop()

    def connect(self, target: str, carrier: str = FAST_TCP.name) -> None:
        """Connects to the port `target`, to which `write` also sends from now on. Raises PortError if that
        fails."""
        if target not in self._outputs and len(self._outputs) >= MOST:
            raise PortError(f"{self.name} sends to {MOST} ports already; valid: at most {MOST}")
        found = Outgoing(self.names.query(target), self.name, find_carrier(carrier), self.names.key)
        with self._lock:
            old, self._outputs[target] = self._outputs.get(target), found
        if old is not None:
            old.drop()  # the reader closed the old connection, because a new one has the same name

    def listen_to(self, source: str, carrier: str = FAST_TCP.name) -> None:
        """Makes the port `source` send to this port. Raises PortError if `source` can't be reached or
        refuses."""
        contact = self.names.query(source)
        url = f"{find_carrier(carrier).name}:/{self.name}"
        said = outgoing.order(contact, [Vocab("add"), url], self.names.key)
        if source not in self._inputs and not said.startswith("0"):
            raise PortError(f"{source} does not connect to {self.name} by {carrier}: {said.strip()[:120]}")

    def close(self) -> None:
        """Unregisters the port and closes every connection. A second call does nothing."""
        with contextlib.suppress(PortError):
            self.names.unregister(self.name)
        with self._lock:
            self._closed = True
            connections: set[Incoming | Outgoing] = {*self._served, *self._outputs.values()}
            self._inputs, self._outputs = {}, {}
        self._listener.close()
        for connection in connections:
            connection.close()

    def _serve(self, sock: socket.socket, connection: AcceptedConnection) -> None:
        incoming = Incoming(sock, connection, dialect=self.dialect, deliver=self._deliver)
        with self._lock:
            if self._closed:  # otherwise a new connection would stay open
                return
            self._served.add(incoming)
        connection.end = partial(self._let_go, incoming)
        try:
            incoming.greet(self.names.key, lambda name: self._add(name, incoming))
            connection.mark_verified()
            self._run(incoming)
        finally:
            with self._lock:
                self._served.discard(incoming)
                if self._inputs.get(incoming.sender) is incoming:
                    del self._inputs[incoming.sender]

    def _run(self, incoming: Incoming) -> None:
        try:
            incoming.run()
        except (EOFError, OSError):
            raise
        except Exception as error:
            self.wrong += 1
            self.last_error = f"{incoming.sender}: {error_text(error)}"
            raise

    def _let_go(self, incoming: Incoming) -> None:
        """Ends a connection to make room for a new one. This is necessary because a dead sender over udp
        can't be detected, and because other senders may never send anything."""
        if not self._closed:
            self.last_error = (
                f"{incoming.sender or 'a client without a name'}, silent the longest, "
                "was closed to make room for others"
            )
        incoming.close()

    def _add(self, name: str, incoming: Incoming) -> None:
        """Registers the connection of the sender `name`. A second connection of one sender ends the first
        connection, as in YARP."""
        if not name.startswith("/"):
            return
        with self._lock:
            old, self._inputs[name] = self._inputs.get(name), incoming
        if old is not None:
            old.close()

    def _remove(self, name: str) -> bool:
        with self._lock:
            found = self._outputs.pop(name, None)
        if found is not None:
            found.close()
        return found is not None

    def _deliver(self, delivery: Delivery) -> Answer:
        kind = delivery.command.kind
        if kind == message.ADMIN:
            return self._order(delivery.items(self.dialect))
        if kind == "*":
            return self._describe()
        if kind == "~":
            with self._lock:
                source = self._inputs.pop(delivery.command.rest, None)
            if source is not None:
                source.close()
            return f"Removing connection from {delivery.command.rest} to {self.name}"
        if kind in (message.DATA, message.CALL) and self._receive is not None:
            return self._receive(delivery)
        return None

    def _order(self, items: list[Any]) -> Answer:
        """Executes an order to the port itself, such as that of `yarp connect`, and returns the answer."""
        verb = items[0] if items else Vocab(0)
        target = str(items[-1]) if len(items) > 1 else ""
        if verb == Vocab("ver"):
            return VERSION
        if verb == Vocab("add"):
            carrier, _, name = target.rpartition(":/")
            return self._answer_add(name if carrier else target, carrier or TCP.name)
        if verb == Vocab("del"):
            found = self._remove(target)
            there = "Removed connection from" if found else "Could not find an outgoing connection from"
            return [0 if found else -1, f"{there} {self.name} to {target}\r\n"]
        if verb == Vocab("list"):
            inward = len(items) > 1 and items[1] == Vocab("in")
            if len(items) < 3:
                return list(self.inputs if inward else self.outputs)
            output = self._outputs.get(target)
            if inward or output is None:
                return []
            return [["from", self.name], ["to", target], ["carrier", output.carrier.name]]
        if verb == Vocab("help"):
            return [Vocab("many"), *ORDERS]
        if verb == Vocab("prop") and items[1:2] == [Vocab("get")]:
            return self._properties(target)
        return [Vocab("fail"), "send [help] for list of valid commands"]

    def _properties(self, name: str) -> Answer:
        """Returns the directions (input, output, calls) of this port, if `name` is its name. The port has no
        other properties."""
        if name != self.name:
            return (
                [Vocab("fail"), f"cannot find any connection to/from {name}"] if name.startswith("/") else []
            )
        directions = [["is_input", self._receive is not None], ["is_output", True], ["is_rpc", False]]
        return [["port", Dict(directions)]]

    def _answer_add(self, name: str, carrier: str) -> Answer:
        name = name if name.startswith("/") else f"/{name}"
        try:
            self.connect(name, carrier)
        except PortError as error:
            return [-1, f"Cannot connect from {self.name} to {name}: {error}\r\n"]
        return [0, f"Added connection from {self.name} to {carrier}:/{name}\r\n"]

    def _describe(self) -> str:
        lines = [f"This is {self.name} at tcp://{self.contact.host}:{self.contact.port}/"]
        with self._lock:
            outputs, inputs = dict(self._outputs), dict(self._inputs)
        for name, output in outputs.items():
            lines.append(
                f"There is an output connection from {self.name} to {name} using {output.carrier.name}"
            )
        for name, incoming in inputs.items():
            lines.append(
                f"There is an input connection from {name} to {self.name} using {incoming.carrier.name}"
            )
        if not outputs:
            lines.append("There are no outgoing connections")
        if not inputs:
            lines.append("There are no incoming connections")
        return "\r\n".join(lines)


def own_host(server: tuple[str, int]) -> str:
    """Returns this machine's address in the network of the name server. The result is the loopback address if
    the name server is on this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(server)
        except OSError as error:
            raise PortError(f"the name server's address {server[0]} can't be reached: {error}") from error
        return str(probe.getsockname()[0])
