"""YARP's network in pure Python."""

from __future__ import annotations

from collections.abc import Callable

from yarpwire.carrier import FAST_TCP
from yarpwire.dialect import Dialect
from yarpwire.incoming import Answer, Delivery
from yarpwire.names import Contact, Names, find_server, read_key
from yarpwire.network import Network
from yarpwire.outgoing import Outgoing
from yarpwire.port import Port
from yarpwire.rpc import Rpc


class Wire(Network):
    """A YARP network in pure Python, for both dialects. The module does not need YARP."""

    title = "yarpwire, YARP in pure Python"

    def __init__(self, server: tuple[str, int] | None = None) -> None:
        """Uses the name server at `server` (host, port), by default the name server that `find_server` finds.

        Raises PortError if the address of the name server is unknown.
        """
        self.names = Names(server or find_server(), key=read_key())
        self.address = self.names.address

    def list(self) -> list[Contact]:
        return self.names.list()

    def query(self, name: str) -> Contact:
        return self.names.query(name)

    def port(self, name: str, dialect: Dialect, receive: Callable[[Delivery], Answer] | None = None) -> Port:
        return Port(name, self.names, dialect, receive=receive)

    def writer(self, target: str, sender: str) -> Outgoing:
        return Outgoing(self.names.query(target), sender, FAST_TCP, self.names.key)

    def caller(self, target: Contact, sender: str, dialect: Dialect) -> Rpc:
        return Rpc(target, sender, dialect, key=self.names.key)
