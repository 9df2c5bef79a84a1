"""Implementation of `Network` with YARP's own ports and carriers."""

from __future__ import annotations

from collections.abc import Callable

from yarpwire.bindings.calls import BindingsCaller
from yarpwire.bindings.module import importable, load, version
from yarpwire.bindings.port import BindingsPort, BindingsWriter
from yarpwire.dialect import Dialect
from yarpwire.errors import PortError
from yarpwire.incoming import Answer, Delivery
from yarpwire.names import Contact, Names, read_key
from yarpwire.network import Network


class Bindings(Network):
    """A YARP network through YARP's bindings. The bindings determine the dialect and the carriers."""

    def __init__(self, server: tuple[str, int] | None = None) -> None:
        """Connects to the name server of YARP's configuration.

        Raises BindingsError if the bindings can't be imported. Raises PortError if YARP's configuration has
        no name server, or a name server other than `server`: a process can use only one.
        """
        self._yarp = load()
        self.dialect: Dialect = version(self._yarp)[1]
        self.title = importable()
        self._yarp.Network.init()
        contact = self._yarp.NetworkBase.getNameServerContact()
        self.address = (contact.getHost(), contact.getPort())
        if not contact.isValid():
            raise PortError("YARP's configuration has no name server; set one: yarp conf HOST PORT")
        if server is not None and server != self.address:
            host, port = server
            raise PortError(
                "YARP's bindings ask the name server of YARP's configuration, {}:{}, ".format(*self.address)
                + f"not {host}:{port}; valid: yarp conf {host} {port} before, or without bindings"
            )
        # The query uses yarpwire's client, because YARP's own client waits without end if it lacks the key.
        self._names = Names(self.address, key=read_key())

    def list(self) -> list[Contact]:
        return self._names.list()

    def query(self, name: str) -> Contact:
        return self._names.query(name)

    def port(
        self, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None
    ) -> BindingsPort:
        return BindingsPort(self._yarp, name, dialect, receive)

    def writer(self, target: str, sender: str) -> BindingsWriter:
        self.query(target)
        return BindingsWriter(self._yarp, target, sender, self.dialect)

    def caller(self, target: Contact, sender: str, dialect: Dialect) -> BindingsCaller:
        return BindingsCaller(self._yarp, target.name, sender)
