"""Client of the name server, and reader and writer of the files with the name server's address.

The file `yarp.conf` contains the address, for example `127.0.0.1 10000 yarp`. The file is in
$YARP_CONFIG_HOME if this variable is set, otherwise in $XDG_CONFIG_HOME/yarp, otherwise in ~/.config/yarp.
Each namespace other than /root has its own file, which is named after the namespace.
"""

from __future__ import annotations

import os
import re
import socket
import struct
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

from yarpwire import auth
from yarpwire.errors import PortError, UnknownNameError, WireError
from yarpwire.source import SocketSource

END = "*** end of message"
ROOT = "/root"
GROUP = ("224.2.1.1", 10000)
"""Multicast address at which name servers answer searches."""
PATIENCE = 2.0
"""Longest time [s] to wait for an answer of another program. Assumed: on a local network, answers arrive
within a second."""
RECORD = re.compile(r"registration name (\S+) ip (\S+) port ([0-9]{1,5}|none) type (\S+)")


@dataclass(frozen=True, slots=True)
class Contact:
    """Address of a port."""

    name: str
    host: str
    port: int
    carrier: str = "tcp"

    def line(self) -> str:
        """Returns the address as a line of text, in the form that name servers send."""
        return f"registration name {self.name} ip {self.host} port {self.port} type {self.carrier}"

    def answers(self) -> bool:
        """Returns True if a program listens at this address. After a crash, a program's ports stay registered
        but no longer listen."""
        try:
            socket.create_connection((self.host, self.port), timeout=PATIENCE).close()
        except OSError:
            return False
        return True


def parse_contact(line: str) -> Contact | None:
    """Returns the contact (address of a port) in a line from a name server; None if the line has no valid
    contact."""
    found = RECORD.match(line)
    if found is None or found[3] == "none" or not 0 < int(found[3]) < 65536:
        return None
    return Contact(found[1], found[2], int(found[3]), found[4])


def config_folder() -> Path:
    """Returns the folder of YARP's configuration."""
    if home := os.environ.get("YARP_CONFIG_HOME"):
        return Path(home)
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "yarp"


def namespace() -> str:
    """Returns the namespace of this user, `/root` unless YARP_NAMESPACE is set."""
    return (os.environ.get("YARP_NAMESPACE") or ROOT).split()[0]


def config_file(space: str) -> Path:
    """Returns the path of the file that contains the address of the name server of a namespace."""
    return config_folder() / ("yarp.conf" if space == ROOT else re.sub(r"[^0-9A-Za-z]", "_", space) + ".conf")


def parse_address(text: str, *, port: int = 10000) -> tuple[str, int]:
    """Parses `HOST:PORT` or `HOST`. Raises PortError if the port number is invalid."""
    host, _, digits = text.partition(":")
    if digits and not (digits.isascii() and digits.isdigit() and 0 <= int(digits[:6]) < 65536):
        raise PortError(
            f"port {digits!r} in {text!r}; valid: HOST:PORT, port 1 to 65535, 0 to serve at a free one"
        )
    return host, int(digits) if digits else port


def read_key() -> bytes | None:
    """Returns the key in the group AUTH of the file `auth.conf`. Returns None if the file does not exist;
    authentication is then off. Raises PortError if the file has no key."""
    path = config_folder() / "auth.conf"
    if not path.is_file():
        return None
    text = path.read_text(encoding="utf-8", errors="replace")
    group = re.search(r"^\s*\[AUTH\]\s*$(.*?)(?=^\s*\[|\Z)", text, re.MULTILINE | re.DOTALL)
    found = re.search(r'^\s*key\s+("?)([^"\n]+?)\1\s*$', group[1], re.MULTILINE) if group else None
    if found is None:
        raise PortError(f"{path} has no key; valid: a line [AUTH], and below it a line: key THE_SECRET")
    return found[2].encode()


def find_server(space: str | None = None) -> tuple[str, int]:
    """Returns host and port of the name server, from the configuration file.

    If there is no file, searches the network as `yarp detect` does.

    Raises PortError with advice if no name server is found.
    """
    space = space or namespace()
    path = config_file(space)
    if path.is_file():
        words = path.read_text(encoding="utf-8", errors="replace").split()
        if len(words) < 2 or not words[1].isdigit():
            raise PortError(f"{path} contains {' '.join(words)[:60]!r}; valid: HOST PORT yarp")
        return words[0], int(words[1])
    found = detect(space)
    if found is None:
        raise PortError(
            f"no YARP name server: {path} does not exist, and none answers for {space} in the network; "
            "valid: an address HOST:PORT, or a name server on this machine (yarpserver)"
        )
    return found


def detect(space: str, *, wait: float = 0.3) -> tuple[str, int] | None:
    """Searches the network for the name server of a namespace, as `yarp detect` does. Returns None if no
    server answers."""
    line = f"NAME_SERVER query {space}\n".encode()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(("", GROUP[1]))
            member = socket.inet_aton(GROUP[0]) + socket.inet_aton("0.0.0.0")
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            sock.sendto(struct.pack("<Ii", zlib.crc32(line), 0) + line, GROUP)
            until = time.monotonic() + wait
            while (left := until - time.monotonic()) > 0:
                sock.settimeout(left)
                contact = parse_contact(sock.recv(2048)[8:].decode(errors="replace"))
                if contact is not None:
                    return contact.host, contact.port
    except OSError:
        return None
    return None


class Names:
    """The client of a name server. Each request uses a connection of its own."""

    def __init__(self, address: tuple[str, int], *, key: bytes | None = None) -> None:
        self.address = address
        self.key = key
        """Key for authentication; None if authentication is off."""

    def request(self, *words: str) -> list[str]:
        """Sends a request and returns the lines of the answer. Raises PortError if no valid answer
        arrives."""
        host, port = self.address
        line = f"NAME_SERVER {' '.join(words)}"
        if not line.isprintable():
            raise PortError(f"{line[:80]!r} is no request to a name server; valid: one line of text")
        lines: list[str] = []
        try:
            with socket.create_connection(self.address, timeout=PATIENCE) as sock:
                source = SocketSource(sock)
                if self.key is not None:
                    auth.connect(sock, source, self.key)
                sock.sendall(f"{line}\n".encode())
                try:
                    while (said := source.line()) != END:
                        lines.append(said)
                        if words[0] == "announce" or len(lines) > 100_000:
                            break
                except EOFError:
                    # the answer to `announce` has no end mark: it may be incomplete, or a nonce
                    if words[0] != "announce":
                        raise WireError(
                            "it closed the connection; it may require a key (auth.conf)"
                        ) from None
        except (OSError, WireError) as error:
            raise PortError(f"the YARP name server at {host}:{port} does not answer: {error}") from error
        return lines

    def query(self, name: str) -> Contact:
        """Returns the address of a port. Raises UnknownNameError if the port is not registered, and PortError
        if no valid answer arrives."""
        for line in self.request("query", name):
            if (contact := parse_contact(line)) is not None:
                return contact
        raise UnknownNameError("YARP port", name, sorted(contact.name for contact in self.list()))

    def list(self) -> list[Contact]:
        """Returns the addresses of all ports."""
        return [contact for line in self.request("list") if (contact := parse_contact(line)) is not None]

    def register(self, contact: Contact, properties: dict[str, str] | None = None) -> None:
        """Registers a port."""
        lines = self.request("register", contact.name, contact.carrier, contact.host, str(contact.port))
        if not any(parse_contact(line) for line in lines):
            raise PortError(f"the name server at {self.address[0]} did not register {contact.name}: {lines}")
        for name, value in (properties or {}).items():
            self.request("set", contact.name, name, value)
        self.request("announce", contact.name)

    def unregister(self, name: str) -> None:
        """Unregisters a port."""
        self.request("unregister", name)
