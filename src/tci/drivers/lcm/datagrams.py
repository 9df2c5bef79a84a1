"""LCM's datagrams, sent and read without LCM's own library.

LCM's own library is not used for two reasons: damaged datagrams crash its receiver, and it joins the group on
the interface of the default route, which may be a public network.

A short message is one datagram: `LC02`, the message number, the channel and a zero, the bytes of the message.
A long message consists of several datagrams: `LC03`, the message number, the size of the message, the offset
of this piece, its index and the number of pieces; the first piece begins with the channel. All numbers are
big-endian. Each sender numbers its messages consecutively, so losses are detected.
"""

from __future__ import annotations

import re
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from tci.errors import DriverError

URL = "udpm://239.255.76.67:7667?ttl=0"
"""LCM's own default: this machine only."""
VALID = f"valid: {URL}; with ttl=1 everybody on the local network may read and command"
PER_POLL = 1024
"""Largest number of datagrams read per call. Assumed: more than usually wait, so that the latest is found,
and few enough to bound the time in case of a flood."""
BUFFER = 1 << 18
"""Size [bytes] of the system's send and receive buffers. Assumed: twice the longest message."""
LONGEST = 1 << 17
"""Length [bytes] of the longest message. Assumed: about two datagrams of the largest size."""
SENDERS = 64
"""Largest number of senders whose message numbers and pieces are tracked. Assumed: bounds memory."""
PATIENCE = 0.1
"""Longest time [s] from the first to the last piece of a message. Assumed: pieces are sent at once."""
PIECE = 65_487 if sys.platform == "linux" else 1435
"""Largest number of bytes of a message in one datagram, as in LCM, since some systems refuse longer ones."""
_SHORT, _LONG = struct.Struct(">4sI"), struct.Struct(">4sIIIHH")
IP_MULTICAST_ALL = 49
"""Linux's option, which Python does not define. By default, a socket also receives messages from interfaces
on which another program joined the group."""


@dataclass(frozen=True, slots=True)
class Group:
    """A multicast group, and the range of its datagrams."""

    address: str
    port: int
    ttl: int

    @property
    def interface(self) -> str:
        """Address of the interface on which it is joined: loopback, or for a network that of the default
        route."""
        return "0.0.0.0" if self.ttl else "127.0.0.1"


def parse_url(url: str) -> Group:
    """Returns the group of an LCM URL. Raises DriverError."""
    found = re.fullmatch(r"udpm://(\d+\.\d+\.\d+\.\d+):(\d{1,5})(?:\?ttl=(\d{1,3}))?", url)
    if found is None or not 224 <= int(found[1].split(".")[0]) <= 239 or not 0 < int(found[2]) < 65536:
        raise DriverError(f"lcm: {url!r}; {VALID}")
    return Group(found[1], int(found[2]), min(int(found[3] or 0), 255))


Address = tuple[str, int]
"""Source address and port of datagrams."""


@dataclass(slots=True)
class _Sender:
    """Message number of one sender, and its message whose pieces are arriving."""

    number: int
    pieces: dict[int, bytes] = field(default_factory=dict)
    message: int = -1
    """Number of that message; -1 between messages."""
    count: int = 0
    """Number of pieces that have arrived."""
    begun: float = 0.0


class Datagrams:
    """Assembles complete messages from datagrams."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._senders: dict[object, _Sender] = {}
        self.lost = 0
        """Number of messages that were lost."""
        self.rejected = 0
        """Number of datagrams that were damaged, duplicates, or part of a message that was never complete."""

    def take(self, data: bytes, sender: object) -> tuple[str, bytes] | None:
        """Returns channel and bytes of a message that this datagram of `sender` completes; else None."""
        magic = data[:4]
        if magic == b"LC02" and len(data) >= _SHORT.size:
            return self._short(data, sender)
        if magic == b"LC03" and len(data) >= _LONG.size:
            return self._long(data, sender)
        self.rejected += 1
        return None

    def _short(self, data: bytes, sender: object) -> tuple[str, bytes] | None:
        whole = _split(data[_SHORT.size :])
        if whole is None or self._follow(sender, _SHORT.unpack_from(data)[1]) is None:
            self.rejected += 1
            return None
        return whole

    def _long(self, data: bytes, sender: object) -> tuple[str, bytes] | None:
        _, number, size, _, piece, count = _LONG.unpack_from(data)
        known = self._senders.get(sender)
        now = self._clock()
        if known is None or known.message != number or now - known.begun > PATIENCE:
            following = self._follow(sender, number) if 0 < size <= LONGEST and piece < count else None
            if following is None:
                self.rejected += 1
                return None
            self.rejected += len(following.pieces)
            known = following
            known.pieces, known.message, known.count, known.begun = {}, number, count, now
        held = sum(map(len, known.pieces.values())) + len(data) - _LONG.size
        if count != known.count or piece >= count or piece in known.pieces or held > size + 64:
            self.rejected += 1
            return None
        known.pieces[piece] = data[_LONG.size :]
        if len(known.pieces) < count:
            return None
        whole = _split(b"".join(known.pieces[place] for place in range(count)))
        known.pieces, known.message = {}, -1
        if whole is None or len(whole[1]) != size:
            self.rejected += count
            return None
        return whole

    def _follow(self, sender: object, number: int) -> _Sender | None:
        """Returns the sender of a new message after counting its losses; None for an old message."""
        known = self._senders.get(sender)
        if known is None:
            while len(self._senders) >= SENDERS:
                del self._senders[next(iter(self._senders))]
            known = self._senders[sender] = _Sender(number)
            return known
        ahead = (number - known.number) % (1 << 32)
        if ahead == 0 or ahead >= 1 << 31:
            return None
        self.lost += ahead - 1 if ahead < 1 << 16 else 0
        known.number = number
        return known


def _split(data: bytes) -> tuple[str, bytes] | None:
    channel, zero, body = data.partition(b"\0")
    if not zero or len(channel) > 63 or not channel.isascii():
        return None
    return channel.decode("ascii"), body


class Transmitter:
    """Sends messages of this process to a group."""

    def __init__(self, url: str) -> None:
        """Opens the socket. Raises DriverError for a bad URL."""
        self._group = parse_url(url)
        self._number = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((self._group.interface, 0))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, self._group.ttl)
        interface = socket.inet_aton(self._group.interface)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)

    def send(self, channel: str, data: bytes) -> None:
        """Sends a message, in pieces if it is long. Raises OSError for data that the network does not
        accept."""
        number, self._number = self._number, (self._number + 1) % (1 << 32)
        whole = channel.encode("ascii") + b"\0" + data
        if len(whole) <= PIECE:
            self.send_raw(_SHORT.pack(b"LC02", number) + whole)
            return
        count, named = -(-len(whole) // PIECE), len(whole) - len(data)
        for piece in range(count):
            begin = piece * PIECE
            head = _LONG.pack(b"LC03", number, len(data), max(begin - named, 0), piece, count)
            self.send_raw(head + whole[begin : begin + PIECE])

    def send_raw(self, datagram: bytes) -> None:
        """Sends one datagram unchanged. Raises as `send`."""
        self._socket.sendto(datagram, (self._group.address, self._group.port))

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()


class Receiver:
    """Receives messages of others in a group."""

    def __init__(self, url: str) -> None:
        """Joins the group. Raises DriverError for a bad URL, and if no multicast arrives."""
        group = parse_url(url)
        self.datagrams = Datagrams()
        """Assembled messages, and counts of lost ones."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        try:
            if hasattr(socket, "SO_REUSEPORT"):
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            if sys.platform == "linux":
                self._socket.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
            self._socket.bind((group.address, group.port))
            member = socket.inet_aton(group.address) + socket.inet_aton(group.interface)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            self._socket.close()
            raise DriverError(f"lcm: {url}: {error.strerror}; {VALID}") from error

    def poll(self) -> Iterator[tuple[str, bytes, Address]]:
        """Yields channel, bytes and sender of the messages that arrived, oldest first; a bounded number."""
        for _ in range(PER_POLL):
            try:
                data, sender = self._socket.recvfrom(65536)
            except BlockingIOError:
                return
            whole = self.datagrams.take(data, sender)
            if whole is not None:
                yield *whole, sender

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()
