"""Format of YARP's messages as bytes. All integers are little-endian.

- A number is `YA`, an int32 value and `RP`.
- A connection begins with a header: the number 7777 + `Carrier.code`, int32 length of the name, sender's name
  and NUL.
- A message begins with an index: number 10, count of blocks (1 byte), byte 1, and 8 bytes FF. Then the int32
  lengths of the blocks follow, and int32 0.
- The first block is a command. The short form of a command is int32 0, `~`, a letter, 00 01. The long form is
  int32 length, `~`, 00 00 01, and a text with NUL.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from yarpwire.errors import WireError
from yarpwire.source import LONGEST, Source

INDEX = struct.Struct("<2si2sBB8x")
MAGIC = 7777
LONGEST_NAME = 1000
"""Largest length [bytes] of a name in a header, including the final NUL. YARP has an equal limit."""
MOST_BLOCKS = 255
DATA, CALL, ADMIN, QUIT = "D", "d", "a", "q"
"""Kinds of commands: data, a call (data that needs a reply), an order to the port itself, and the end
of the connection."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """The envelope of a message: a number and a time."""

    count: int
    """Number of the message, which increases by one with each message."""
    time: float
    """Time of measurement [s] on the sender's clock."""

    def __str__(self) -> str:
        return f"{self.count} {self.time:.15g}"


@dataclass(frozen=True, slots=True)
class Command:
    """The part of a message that precedes its body."""

    kind: str
    """DATA, CALL, ADMIN, QUIT, or another letter of YARP's text commands."""
    rest: str = ""
    """Text after the letter `kind`. If the kind is DATA, the text is the envelope."""

    @property
    def stamp(self) -> Stamp | None:
        """The envelope as a Stamp; None if the envelope is not a number and a time."""
        words = self.rest.split()
        try:
            stamp = Stamp(int(words[0]), float(words[1]))
        except (ValueError, IndexError):
            return None
        return stamp if math.isfinite(stamp.time) and len(words) == 2 else None


COMMAND = struct.Struct("<ixc")
LETTERS = {letter.encode(): Command(letter) for letter in (DATA, CALL, ADMIN)}


_FILL = b"\xff" * 8


def number(value: int) -> bytes:
    """Returns `value` as the bytes of a number: `YA`, int32, `RP`."""
    return struct.pack("<2si2s", b"YA", value, b"RP")


_TEN = number(10)


def read_number(source: Source) -> int:
    """Reads a number (`YA`, int32, `RP`) and returns its value. Raises WireError if the bytes are no
    number."""
    head, value, tail = struct.unpack("<2si2s", source.take(8))
    if (head, tail) != (b"YA", b"RP"):
        raise WireError(f"{head!r} ... {tail!r} where a yarp number begins with b'YA' and ends with b'RP'")
    return int(value)


def header(code: int, name: str) -> bytes:
    """Returns the header of a connection, with the carrier's code and the sender's name."""
    text = name.encode() + b"\0"
    if len(text) > LONGEST_NAME:
        raise WireError(f"a name of {len(text)} bytes; valid: below {LONGEST_NAME}")
    return number(MAGIC + code) + struct.pack("<i", len(text)) + text


def read_name(source: Source) -> str:
    """Reads the sender's name, which follows the number at the beginning of a header."""
    length = struct.unpack("<i", source.take(4))[0]
    if not 1 <= length <= LONGEST_NAME:
        raise WireError(f"a sender's name of {length} bytes; valid: 1 to {LONGEST_NAME}")
    return source.take(length).split(b"\0")[0].decode("utf-8", errors="replace")


def pack_message(blocks: Sequence[bytes]) -> bytes:
    """Returns the bytes of a message: the index, which contains the number and the lengths of the blocks, and
    then the blocks."""
    if len(blocks) > MOST_BLOCKS:
        raise WireError(f"a message of {len(blocks)} blocks; valid: up to {MOST_BLOCKS}")
    count = len(blocks)
    lengths = _words(count + 1).pack(*map(len, blocks), 0)
    return b"".join((_TEN, bytes((count, 1)), _FILL, lengths, *blocks))


def read_message(source: Source) -> list[bytes]:
    """Returns the blocks of a message. Raises WireError if a length is invalid."""
    return [source.take(length) for length in _lengths(source)]


def read_payload(source: Source) -> bytes:
    """Returns all blocks of a message in one piece, since the boundaries between blocks have no meaning."""
    return source.take(sum(_lengths(source)))


def _lengths(source: Source) -> tuple[int, ...]:
    head, size, tail, blocks, replies = INDEX.unpack(source.take(INDEX.size))
    if head != b"YA" or size != 10 or tail != b"RP":
        raise WireError(f"{head!r} {size} {tail!r} where an index begins with b'YA' 10 b'RP'")
    count = blocks + replies
    lengths: tuple[int, ...] = _words(count).unpack(source.take(4 * count))
    if count and (min(lengths) < 0 or sum(lengths) > min(LONGEST, source.left())):
        most = min(LONGEST, source.left())
        raise WireError(f"blocks of {lengths[:4]} ... bytes; valid: 0 to {most} in all")
    return lengths[:blocks]


@cache
def _words(count: int) -> struct.Struct:
    """Returns the binary format of `count` integers of 32 bits. The formats are cached; there are few, since
    `count` is at most 510."""
    return struct.Struct(f"<{count}i")


def pack_command(kind: str, rest: str = "") -> bytes:
    """Returns a command as bytes: in the short form (only the letter `kind`), or with `rest` in the long form
    (a text). QUIT always has the long form."""
    if not rest and kind != QUIT:
        return b"\0\0\0\0~" + kind.encode() + b"\0\1"
    text = f"{kind} {rest}".rstrip().encode() + b"\0"
    return struct.pack("<i4s", len(text), b"~\0\0\1") + text


def unpack_command(payload: bytes) -> tuple[Command, bytes]:
    """Returns the command at the beginning of a message, and the body after the command."""
    if len(payload) < 8 or payload[4:5] != b"~":
        raise WireError(
            f"a message begins with {payload[:8]!r}; valid: a command, 8 bytes with '~' as the fifth"
        )
    length, letter = COMMAND.unpack_from(payload)
    if length == 0:
        return LETTERS.get(letter) or Command(letter.decode("latin-1")), payload[8:]
    if not 1 <= length <= len(payload) - 8 or letter != b"\0":
        raise WireError(f"a command of {length} bytes; valid: 1 to {len(payload) - 8}")
    text = payload[8 : 8 + length].split(b"\0")[0].decode("utf-8", errors="replace")
    if not text:
        raise WireError("an empty command")
    return Command(text[0], text[1:].strip()), payload[8 + length :]
