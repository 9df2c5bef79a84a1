"""A name server in Python, for machines without YARP. This server is sufficient for YARP's tools and devices,
and for yarpwire."""

from __future__ import annotations

import contextlib
import re
import socket
import threading

from yarpwire import auth
from yarpwire.connection_limit import AcceptedConnection
from yarpwire.dialect import V3
from yarpwire.errors import PortError, WireError
from yarpwire.incoming import Answer, Delivery, Incoming
from yarpwire.listener import Listener
from yarpwire.message import ADMIN
from yarpwire.names import END, PATIENCE, ROOT, Contact
from yarpwire.port import VERSION
from yarpwire.source import SocketSource
from yarpwire.values import Vocab

FIRST_PORT = 2
"""Difference between the first port number that the server assigns and the server's own port number. YARP's
name server has the same difference."""
MOST_NAMES = 10_000
"""Largest number of registered names. Assumed: this bounds the memory."""
MOST_PROPERTIES = 16
"""Largest number of properties of a name. Assumed: this bounds the memory; YARP's ports set four
properties."""
LONGEST_REQUEST = 2000
"""Largest number of characters of a request. Assumed: twice the length of the longest name is enough. The
limit bounds the memory."""

ASKED, GREETING = "NAME_SERVER", 8
"""First word of a request, and how many of its bytes tell it from a connection to a port."""
USAGE = (
    "Here are some ways to use the name server:",
    "+ help",
    "+ list",
    "+ register $portname",
    "+ register $portname $carrier $ipAddress $portNumber",
    "+ unregister $portname",
    "+ query $portname",
    "+ set $portname $property $value",
    "+ get $portname $property",
    "+ check $portname $property $value",
)
"""Answer to `yarp name help`."""


class NameServer:
    """Answers `NAME_SERVER ...` lines over TCP."""

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, *, key: bytes | None = None, space: str = ROOT
    ) -> None:
        """Starts the server. With port 0, the server uses a free port. Raises PortError if the port is in
        use."""
        self._lock = threading.Lock()
        self._contacts: dict[str, Contact] = {}
        self._properties: dict[str, dict[str, list[str]]] = {}
        self._key = key
        self._listener = Listener(host, port, self._serve, name="the YARP name server")
        self.address = self._listener.address
        """Host and port of the server."""
        self._next = self.address[1] + FIRST_PORT
        self._contacts[space] = Contact(space, *self.address)

    def close(self) -> None:
        """Stops the server."""
        self._listener.close()

    def __enter__(self) -> NameServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve(self, sock: socket.socket, connection: AcceptedConnection) -> None:
        source = SocketSource(sock)
        sock.settimeout(PATIENCE)
        if self._key is not None:
            auth.accept(sock, source, self._key)
        if source.peek(GREETING) != ASKED[:GREETING].encode():
            self._serve_as_port(Incoming(sock, connection, dialect=V3, deliver=_order, source=source))
            return
        while True:
            source.allow()
            answer = self.answer(source.line(), connection.host)
            connection.mark_verified()
            sock.settimeout(60.0)
            sock.sendall(answer.encode())

    def _serve_as_port(self, incoming: Incoming) -> None:
        """Answers as the port with the server's own name: `yarp exists /root` and `yarp check` ask it for its
        version."""
        incoming.greet(None, lambda name: None)
        incoming.run()

    def answer(self, line: str, peer: str = "127.0.0.1") -> str:
        """Returns the answer to a request that came from host `peer`. Raises WireError if the request is
        invalid."""
        if len(line) > LONGEST_REQUEST:
            raise WireError(f"a request of {len(line)} characters; valid: at most {LONGEST_REQUEST}")
        words = re.split(r'["\s]+', line.strip())
        if words[0] != ASKED:
            raise WireError(f"{line[:40]!r} is no request to a name server")
        verb, arguments = (words[1:2] or [""])[0], [word for word in words[2:] if word]
        if verb == "announce":
            return "[ok]\r\n"
        with self._lock:
            lines = self._lines(verb, arguments, peer)
        return "".join(f"{line}\r\n" for line in [*lines, END])

    def _lines(self, verb: str, words: list[str], peer: str) -> list[str]:
        name = words[0] if words else ""
        match verb:
            case "help":
                return list(USAGE)
            case "register" if words:
                return [self._register(name, [*words[1:], "...", "...", "..."], peer).line()]
            case "query":
                return [self._contacts[name].line()] if name in self._contacts else []
            case "unregister":
                self._contacts.pop(name, None)
                self._properties.pop(name, None)
            case "list":
                return [self._contacts[key].line() for key in sorted(self._contacts)]
            case "set" if len(words) > 1 and name in self._contacts:
                known = self._properties.setdefault(name, {})
                if words[1] not in known and len(known) >= MOST_PROPERTIES:
                    raise WireError(f"more than {MOST_PROPERTIES} properties of {name}")
                known[words[1]] = sorted(set(words[2:]))
                return [f"port {name} property {words[1]} = {' '.join(self._property(name, words[1]))}"]
            case "get" if len(words) > 1:
                return [f"port {name} property {words[1]} = {' '.join(self._property(name, words[1]))}"]
            case "check" if len(words) > 2:
                present = str(words[2] in self._property(name, words[1])).lower()
                return [f"port {name} property {words[1]} value {words[2]} present {present}"]
        return []

    def _property(self, name: str, key: str) -> list[str]:
        return self._properties.get(name, {}).get(key, [])

    def _register(self, name: str, words: list[str], peer: str) -> Contact:
        if name not in self._contacts and len(self._contacts) >= MOST_NAMES:
            raise WireError(f"more than {MOST_NAMES} names")
        if name == "...":
            name = f"/tmp/port/{self._next}"  # the name that YARP gives to an unnamed port; not a path
        port = int(words[2]) if re.fullmatch(r"-?\d{1,5}", words[2]) else 0
        carrier = words[0] if words[0] != "..." else "tcp"
        host = words[1] if words[1] != "..." else peer
        if not 0 < port < 65536:
            known = self._contacts.get(name)
            port = known.port if known is not None and known.host == host else self._free()
        contact = self._contacts[name] = Contact(name, host, port, carrier)
        return contact

    def _free(self) -> int:
        taken = {contact.port for contact in self._contacts.values()}
        for _ in range(50_000):
            port, self._next = self._next, self._next + 1 if self._next < 65000 else 10002
            if port not in taken and _is_free(port):
                return port
        raise PortError("no free port is left")


def _order(delivery: Delivery) -> Answer:
    items = delivery.items(V3) if delivery.command.kind == ADMIN else []
    return VERSION if items[:1] == [Vocab("ver")] else [Vocab("fail")]


def _is_free(port: int) -> bool:
    with contextlib.suppress(OSError), socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("", port))
        return True
    return False
