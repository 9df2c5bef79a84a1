"""Well-formed Bottles with wrong values: calls, streamed commands, orders to a port, states, events."""

from __future__ import annotations

import inspect
import math
import random
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import tci
from tci.messages import Order
from tci.wires.yarp.order_book import OrderBook
from tci.wires.yarp.served_board import ServedBoard
from tci.wires.yarp.skin_events import decode_events
from yarpwire.bottle import decode_bottle, encode_bottle
from yarpwire.calls_v3 import answer_v3
from yarpwire.calls_v4 import CALLS, answer_v4
from yarpwire.dialect import DIALECTS, V3, V4, Dialect
from yarpwire.errors import CallError, WireError
from yarpwire.incoming import Delivery
from yarpwire.message import ADMIN, Command
from yarpwire.port import Port
from yarpwire.state import BoardState, decode_state, encode_state
from yarpwire.streams import obey
from yarpwire.text import from_text, to_text
from yarpwire.values import Dict, Float32, Int8, Int64, Vocab, Vocab64

HOSTILE: tuple[Any, ...] = (
    math.inf, -math.inf, math.nan, 1e300, 0.5, -1, 99, 1 << 31, 1 << 40, -(1 << 63), (1 << 63) - 1,
    "abc", "", "0", "\udcff", "/\udcff", "a\nb", "\N{SNOWMAN}" * 40, b"", b"\xff", Int8(-1), Int64(1 << 40),
    Float32(math.inf), Vocab("zzzz"), Vocab64("setposit"), Vocab(0), Dict([["gain", 2.0]]),
    [], [[]], [math.nan], ["abc"], [1 << 40] * 2, [[0], [1]],
)  # fmt: skip
V3_CALLS = (
    "[set] [pos] 0 10.0", "[set] [poss] (1.0 2.0 3.0 4.0 5.0 6.0)", "[set] [posg] 2 (0 1) (10.0 20.0)",
    "[set] [rel] 0 1.0", "[set] [vel] 1 20.0", "[set] [vels] (1.0 2.0 3.0 4.0 5.0 6.0)", "[set] [acc] 1 20.0",
    "[set] [velg] 2 (0 1) (10.0 20.0)", "[set] [vmos] (1.0 2.0 3.0 4.0 5.0 6.0)", "[set] [sto] 0",
    "[set] [stos]", "[set] [stog] 2 (0 1)", "[set] [icmd] [cmod] 0 [posd]",
    "[set] [icmd] [cmds] ([pos] [pos] [posd] [posd] [pos] [pos])",
    "[set] [icmd] [cmog] 2 (0 1) ([pos] [vel])", "[set] [intm] [mode] 0 [comp]",
    "[set] [intm] [modg] 2 (0 1) ([stif] [comp])", "[set] [iimp] [ipr] 0 (0.5 0.01)",
    "[set] [torq] [ref] 0 0.5", "[set] [torq] [refs] (0.5 0.5 0.5 0.5 0.5 0.5)", "[get] [encs]",
    "[get] [enc] 0", "[get] [esp] 0", "[get] [vel] 0", "[get] [vels]", "[get] [acc] 0", "[get] [name] 0",
    "[get] [llim] 0", "[get] [vlim] 0", "[get] [don] 0", "[get] [dons]", "[get] [dong] 2 (0 1)",
    "[get] [prot]",
    "[get] [icmd] [cmod] 0", "[get] [icmd] [cmog] 2 (0 1)", "[get] [icmd] [cmds]", "[get] [intm] [mode] 0",
    "[get] [intm] [modg] 2 (0 1)", "[get] [iimp] [ipr] 0", "[get] [iimp] [llim] 0", "[get] [torq] [trq] 0",
    "[get] [torq] [trqs]", "[get] [torq] [rng] 0", "[get] [axes]", "[get] [type] 0", "[help]",
)  # fmt: skip
V4_ARGUMENTS: dict[str, Any] = {
    "j": 0, "joint": 0, "js": [0, 1], "joints": [0, 1], "value": 10.0, "values": [10.0, 20.0],
    "mode": int(Vocab("pos")),
    "modes": [int(Vocab("pos")), int(Vocab("vel"))], "k": 0.5, "d": 0.01,
}  # fmt: skip
STREAMS = (
    "([dpo] 0) (10.0)", "([dpos]) (1.0 2.0 3.0 4.0 5.0 6.0)", "([dpog] 2 (0 1)) (10.0 20.0)",
    "([vmo] 0) (10.0)", "([vmog] 2 (0 1)) (10.0 20.0)", "([dtqg] 2 (0 1)) (1.0 2.0)",
    "([poss]) (1.0 2.0 3.0 4.0 5.0 6.0)",
)  # fmt: skip
ORDERS = (
    '[add] "tcp://nobody"', '[add] "/nobody"', '[del] "/nobody"', '[list] [out] "/nobody"',
    "[list] [in]", "[ver]",
)  # fmt: skip
EVENT = [
    [[1, 3, 4, 2], [0.1, 0.2, 0.3], [1.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0, 0.0, 1.0], [3, 4], 12.0]
]


def spoiled(items: Sequence[Any], chance: random.Random) -> list[Any]:
    """Returns items some of which are replaced, removed or duplicated, in any nested list."""
    found = _copy(list(items))
    for _ in range(chance.randint(1, 2)):
        inner = found
        while deeper := [item for item in inner if isinstance(item, list)]:
            if chance.random() < 0.5:
                break
            inner = chance.choice(deeper)
        at = chance.randrange(len(inner) + 1)
        match chance.randrange(6):
            case 0:
                del inner[at : at + 1]
            case 1:
                inner[at:at] = inner[at : at + 1]
            case _:
                inner[at : at + 1] = [_copy(chance.choice(HOSTILE))]
    return found


def sent(items: Sequence[Any], dialect: Dialect, chance: random.Random) -> list[Any]:
    """Returns the items as a receiver decodes them, after sending as bytes or as text. Raises WireError if
    the items can't be sent."""
    if chance.random() < 0.5:
        return from_text(to_text(items).encode(errors="replace").decode())
    return decode_bottle(encode_bottle(items, dialect), dialect)


def strange_messages(port: Port) -> Callable[[random.Random], None]:
    """Returns a function that sends one strange message through all readers of a served board, a driver and
    `port`."""
    boards = {dialect: _board() for dialect in DIALECTS.values()}
    calls = {V3: [from_text(call) for call in V3_CALLS], V4: [_call(name) for name in CALLS]}
    streams = {V3: [from_text(text) for text in STREAMS], V4: [_of_v4(from_text(text)) for text in STREAMS]}
    states = {dialect: encode_state(board.state, dialect) for dialect, board in boards.items()}
    orders = [from_text(order) for order in ORDERS]

    def answer(items: list[Any], dialect: Dialect) -> None:
        said = (answer_v3 if dialect is V3 else answer_v4)(boards[dialect], items)
        if not isinstance(said, bytes):
            assert encode_bottle(said, dialect)
            assert to_text(said)

    def stream(items: list[Any], dialect: Dialect) -> None:
        with suppress(CallError):
            obey(boards[dialect], items, dialect)

    def order(items: list[Any], dialect: Dialect) -> None:
        body = encode_bottle(items, dialect)
        said = port._deliver(Delivery(Command(ADMIN), "admin", 0.0, body))
        assert isinstance(said, list | tuple)
        assert encode_bottle(said, dialect)

    def state(items: list[Any], dialect: Dialect) -> None:
        found: BoardState = decode_state(items, dialect)
        assert len(found.position) <= 256

    takes: tuple[tuple[Callable[[list[Any], Dialect], object], Callable[[Dialect], list[Any]]], ...] = (
        (answer, lambda dialect: calls[dialect]), (stream, lambda dialect: streams[dialect]),
        (order, lambda dialect: orders), (state, lambda dialect: [states[dialect]]),
        (lambda items, dialect: decode_events(items), lambda dialect: [EVENT]),
    )  # fmt: skip

    def take(chance: random.Random) -> None:
        dialect = port.dialect
        receive, samples = chance.choices(takes, (10, 6, 1, 2, 2))[0]
        dialect = dialect if receive is order else chance.choice([V3, V4])
        with suppress(WireError):
            receive(sent(spoiled(chance.choice(samples(dialect)), chance), dialect, chance), dialect)

    return take


class _Nobody(OrderBook):
    """Drops all orders, because there is no loop that could judge them."""

    def put(self, order: Order, undo: Callable[[], None] | None = None) -> None:
        pass


def _board() -> ServedBoard:
    board = ServedBoard("LArm", tci.load_robot("nao").servos_of("LArm"))
    board.book = _Nobody()
    return board


def _call(name: str) -> list[Any]:
    return [name, *(V4_ARGUMENTS[one] for one in list(inspect.signature(CALLS[name]).parameters)[1:])]


def _of_v4(items: list[Any]) -> list[Any]:
    interfaces = {"dpo": "ipod", "vmo": "ivel", "dtq": "itrq", "pos": "ipos"}
    return [[Vocab(interfaces[items[0][0].word[:3]]), *items[0]], items[1]]


def _copy(items: Any) -> Any:
    return type(items)([_copy(item) for item in items]) if isinstance(items, list) else items
