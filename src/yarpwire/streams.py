"""Commands that clients stream to the port `command:i` of a served board: a list of a head and a Vector.

In YARP 3.x, the head for position is `[dpos]` for all joints, `[dpo] j` for joint j, and `[dpog] n (j ..)`
for n joints. In 4.x, the name of the interface precedes the head: `[ipod] [dpos]`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from yarpwire.board import Stream
from yarpwire.board_service import BoardService
from yarpwire.dialect import V4, Dialect
from yarpwire.errors import CallError
from yarpwire.values import Vocab

STEMS = {"dpo": Stream.POSITION, "vmo": Stream.VELOCITY, "dtq": Stream.TORQUE}
INTERFACES = {"dpo": "ipod", "vmo": "ivel", "dtq": "itrq", "pos": "ipos"}


def obey(board: BoardService, items: Sequence[Any], dialect: Dialect) -> None:
    """Executes a streamed command. Raises CallError if the command is unknown or impossible."""
    if len(items) != 2 or not all(isinstance(item, list) for item in items):
        raise CallError(f"a streamed command of {len(items)} items; valid: a head and a list of numbers")
    head = [item.word if isinstance(item, Vocab) else item for item in items[0]]
    interface = head.pop(0) if dialect is V4 and head else ""
    word = head[0] if head and isinstance(head[0], str) else ""
    stem, kind = word[:3], word[3:]
    if dialect is V4 and INTERFACES.get(stem) != interface:
        raise CallError(f"streamed command [{interface}] [{word}] is not known")
    joints: Sequence[Any] | None = None
    if kind == "" and len(head) == 2:
        joints = [head[1]]
    elif kind == "g" and len(head) == 3 and isinstance(head[2], list):
        joints = head[2]
    elif kind != "s":
        raise CallError(f"streamed command {head[:3]} is not known")
    numbers = items[1]
    if not all(isinstance(number, int | float) for number in numbers):
        raise CallError(f"a streamed command with {str(numbers)[:40]}; valid: numbers")
    if (stem, kind) == ("pos", "s"):
        board.move(None, numbers)
    elif stem in STEMS:
        board.stream(STEMS[stem], joints, numbers)
    else:
        raise CallError(f"streamed command [{word}] is not known")
