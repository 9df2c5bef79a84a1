"""Datagrams of LCM, sent and received without LCM's own library.

TCI does not use LCM's own library for two reasons. Damaged datagrams crash the library's receiver. The
library also joins the multicast group on the interface of the default route, which may belong to a public
network.

A short message is one datagram. The datagram contains:

- `LC02` and the message number,
- the channel name with a zero byte,
- the bytes of the message.

A long message is sent in pieces, with one piece per datagram. Each datagram contains:

- `LC03` and the message number,
- the size of the message,
- the offset of the piece, its index, and the number of pieces,
- the piece. The first piece begins with the channel name and a zero byte.

All numbers are big-endian. Each sender numbers its messages consecutively, so a receiver can count lost
messages.
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
"""Default URL of LCM. With ttl=0, messages stay on this machine."""
VALID = f"valid: {URL}; with ttl=1 everybody on the local network may read and command"
PER_POLL = 1024
"""Largest number of datagrams that one call of `poll` reads. Assumed: usually fewer datagrams wait, so one
call reads them all. If very many datagrams arrive, this number bounds the time of the call."""
BUFFER = 1 << 18
"""Size [bytes] of the operating system's send and receive buffers. Assumed: twice the length of the longest
message is sufficient."""
LONGEST = 1 << 17
"""Length [bytes] of the longest accepted message. Assumed: a message of TCI fits in two datagrams of the
largest size."""
SENDERS = 64
"""Largest number of senders for which message numbers and pieces are stored. Assumed: fewer programs send;
the number bounds the used memory."""
PATIENCE = 0.1
"""Longest time [s] from the first to the last piece of a message. Assumed: a sender sends all pieces of a
message without a pause."""
PIECE = 65_487 if sys.platform == "linux" else 1435
"""Largest number of bytes of a message in one datagram. The value depends on the operating system, as in
LCM's own library, since some systems refuse longer datagrams."""
_SHORT, _LONG = struct.Struct(">4sI"), struct.Struct(">4sIIIHH")
IP_MULTICAST_ALL = 49
"""Number of the Linux socket option IP_MULTICAST_ALL, which Python does not define. By default, a socket also
receives messages from interfaces on which only other programs joined the group. `Receiver` switches this
default off."""


@dataclass(frozen=True, slots=True)
class Group:
    """A multicast group, and the largest distance (`ttl`, in network hops) that the group's datagrams
    travel."""

    address: str
    port: int
    ttl: int

    @property
    def interface(self) -> str:
        """Address of the interface on which the group is joined. With ttl=0: the loopback interface. With a
        higher ttl: the interface of the default route."""
        return "0.0.0.0" if self.ttl else "127.0.0.1"


def parse_url(url: str) -> Group:
    """Returns the multicast group of an LCM URL. Raises DriverError if the URL is invalid."""
    found = re.fullmatch(r"udpm://(\d+\.\d+\.\d+\.\d+):(\d{1,5})(?:\?ttl=(\d{1,3}))?", url)
    if found is None or not 224 <= int(found[1].split(".")[0]) <= 239 or not 0 < int(found[2]) < 65536:
        raise DriverError(f"lcm: {url!r}; {VALID}")
    return Group(found[1], int(found[2]), min(int(found[3] or 0), 255))


Address = tuple[str, int]
"""Address and port from which a datagram was sent."""


@dataclass(slots=True)
class _Sender:
    """Number of the latest message of one sender, and the received pieces of a message that is not complete
    yet."""

    number: int
    pieces: dict[int, bytes] = field(default_factory=dict)
    message: int = -1
    """Number of the message that is not complete yet; -1 if there is none."""
    count: int = 0
    """Number of pieces in which the message was sent."""
    begun: float = 0.0


class Datagrams:
    """Assembles complete messages from datagrams."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._senders: dict[object, _Sender] = {}
        self.lost = 0
        """Number of messages that were lost."""
        self.rejected = 0
        """Number of rejected datagrams: damaged datagrams, duplicates, and pieces of messages that were never
        completed."""

    def take(self, data: bytes, sender: object) -> tuple[str, bytes] | None:
        """Handles a datagram of `sender`. If the datagram completes a message, returns the channel and the
        bytes of the message, otherwise None."""
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
        """Records that message `number` of `sender` has arrived, and counts the messages lost before it.
        Returns the stored data of the sender, or None if the message is not new."""
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
    """Sends messages of this process to a multicast group."""

    def __init__(self, url: str) -> None:
        """Opens the socket. Raises DriverError if `url` is invalid."""
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
        """Sends a message, in pieces if it is long. Raises OSError if the network does not accept the
        data."""
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
        """Sends one datagram unchanged. Raises OSError if the network does not accept the datagram."""
        self._socket.sendto(datagram, (self._group.address, self._group.port))

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()


class Receiver:
    """Receives the messages that are sent to a multicast group."""

    def __init__(self, url: str) -> None:
        """Joins the group. Raises DriverError if `url` is invalid, or if the group can't be joined."""
        group = parse_url(url)
        self.datagrams = Datagrams()
        """Assembles messages from datagrams, and counts lost messages."""
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
        """Yields channel, bytes and sender of each message that has arrived, the oldest first. Reads at most
        `PER_POLL` datagrams."""
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
