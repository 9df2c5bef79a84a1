"""YARP's own name server client, ports and carriers, as a link asks for them."""

from __future__ import annotations

import socket
from collections.abc import Callable

from tci.errors import LinkError, UnknownNameError
from tci.middleware.yarp.bindings.calls import BindingsCaller
from tci.middleware.yarp.bindings.module import importable, load, style, version
from tci.middleware.yarp.bindings.port import BindingsPort, BindingsWriter
from tci.middleware.yarp.dialect import Dialect
from tci.middleware.yarp.incoming import Answer, Delivery
from tci.middleware.yarp.names import PATIENCE, Contact, parse_contact
from tci.middleware.yarp.network import Network


class Bindings(Network):
    """Speaks the dialect that the bindings were built for, by any carrier that they have."""

    def __init__(self, server: tuple[str, int] | None = None) -> None:
        """Raises MissingExtraError without the bindings, LinkError when YARP's configuration has another
        name server than `server`: there is one for the whole process."""
        self._yarp = load()
        self.dialect: Dialect = version(self._yarp)[1]
        self.title = importable()
        self._yarp.Network.init()
        contact = self._yarp.NetworkBase.getNameServerContact()
        self.address = (contact.getHost(), contact.getPort())
        if server is not None and server != self.address:
            host, port = server
            raise LinkError(
                "YARP's bindings ask the name server of YARP's configuration, {}:{}, ".format(*self.address)
                + f"not {host}:{port}; valid: yarp conf {host} {port} before, or without bindings"
            )

    def list(self) -> list[Contact]:
        self._look()
        question, answer = self._yarp.Bottle(), self._yarp.Bottle()
        question.addString("list")
        if not self._yarp.NetworkBase.writeToNameServer(question, answer, style(self._yarp)):
            raise LinkError(
                "the YARP name server at {}:{} does not answer YARP's bindings".format(*self.address)
            )
        lines = answer.get(0).asString().splitlines()
        return [contact for line in lines if (contact := parse_contact(line)) is not None]

    def query(self, name: str) -> Contact:
        self._look()
        found = self._yarp.NetworkBase.queryName(name)
        if not found.isValid():
            raise UnknownNameError("YARP port", name, sorted(contact.name for contact in self.list()))
        return Contact(name, found.getHost(), found.getPort(), found.getCarrier())

    def port(
        self, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None
    ) -> BindingsPort:
        return BindingsPort(self._yarp, name, dialect, receive)

    def writer(self, target: str, sender: str) -> BindingsWriter:
        self.query(target)
        return BindingsWriter(self._yarp, target, sender, self.dialect)

    def caller(self, target: Contact, sender: str, dialect: Dialect) -> BindingsCaller:
        return BindingsCaller(self._yarp, target.name, sender)

    def _look(self) -> None:
        """Raises LinkError when nobody is there: YARP would search the network, and complain aloud."""
        try:
            socket.create_connection(self.address, timeout=PATIENCE).close()
        except OSError as error:
            raise LinkError("no YARP name server at {}:{}: {}".format(*self.address, error)) from error
