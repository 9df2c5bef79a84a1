"""Bottles as text, for example `1 2.5 hello (3 4) [set] {1 2 3}`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from yarpwire.errors import WireError
from yarpwire.values import FALSE, TRUE, Value, Vocab, Vocab64

DEEPEST = 32
BARE = re.compile(r"[A-Za-z_][A-Za-z0-9_.\-]*\Z")
"""Strings that need no quotes."""
TOKEN = re.compile(
    r"""[\s,]+ | (?P<open>\() | (?P<close>\)) | \[(?P<vocab>[^\]\s]{0,8})\] | \{(?P<blob>[\d\s]*)\}
    | "(?P<quoted>(?:[^"\\]|\\.)*)" | (?P<word>[^\s,()"\[\]{}]+)""",
    re.VERBOSE | re.DOTALL,
)
ESCAPES = {"n": "\n", "r": "\r", "0": "\0"}
INTEGER = re.compile(r"[+-]?\d+\Z", re.ASCII)
FLOAT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z|[+-]?(inf|nan)\Z", re.ASCII)


def to_text(items: Sequence[Any]) -> str:
    """Returns the items of a Bottle in the text form of YARP."""
    return " ".join(_item(item) for item in items)


def _item(item: Any) -> str:
    if isinstance(item, bool):
        item = TRUE if item else FALSE
    if isinstance(item, Vocab | Vocab64):
        return {0: "false", int(TRUE): "true"}.get(int(item), f"[{item.word}]")
    if isinstance(item, int):
        return str(int(item))
    if isinstance(item, float):
        return repr(float(item))
    if isinstance(item, bytes):
        return "{" + " ".join(str(byte) for byte in item) + "}"
    if isinstance(item, str):
        return item if BARE.match(item) and item not in ("true", "false", "null") else _quoted(item)
    return f"({to_text(item)})"


def _quoted(text: str) -> str:
    for plain, escaped in (("\\", "\\\\"), ('"', '\\"'), ("\n", "\\n"), ("\r", "\\r"), ("\0", "\\0")):
        text = text.replace(plain, escaped)
    return f'"{text}"'


def from_text(text: str) -> list[Any]:
    """Returns the items of a Bottle in text form. Raises WireError if the text is invalid, for example if a
    list is not closed or lists nest too deeply."""
    open_lists: list[list[Any]] = [[]]
    at = 0
    while at < len(text):
        found = TOKEN.match(text, at)
        if found is None:
            raise WireError(f"{text[at : at + 20]!r} at character {at} is no item of a Bottle")
        at = found.end()
        kind = found.lastgroup
        if kind == "open":
            if len(open_lists) > DEEPEST:
                raise WireError(f"lists nested deeper than {DEEPEST}")
            open_lists.append([])
        elif kind == "close":
            if len(open_lists) == 1:
                raise WireError(f"')' at character {at - 1} closes nothing")
            inner = open_lists.pop()
            open_lists[-1].append(inner)
        elif kind is not None:
            open_lists[-1].append(_parse(kind, found[kind]))
    if len(open_lists) > 1:
        raise WireError(f"{len(open_lists) - 1} lists are not closed")
    return open_lists[0]


def _parse(kind: str, text: str) -> Value:
    if kind == "vocab":
        return Vocab(text) if 0 < len(text) <= 4 else Vocab64(text) if text else Vocab(0)
    if kind == "blob":
        numbers = [int(number) for number in text.split() if len(number) < 4]
        if any(number > 255 for number in numbers) or len(numbers) != len(text.split()):
            raise WireError(f"a blob of {text[:40]!r}; valid: numbers from 0 to 255")
        return bytes(numbers)
    if kind == "quoted":
        return re.sub(r"\\(.)", lambda m: ESCAPES.get(m[1], m[1]), text, flags=re.DOTALL)
    if INTEGER.match(text):
        if len(text) > 24 or not -(1 << 63) <= int(text) < 1 << 63:
            raise WireError(f"integer {text[:40]}; valid: up to 64 bits")
        return int(text)
    if FLOAT.match(text):
        return float(text)
    return {"true": TRUE, "false": FALSE, "null": Vocab("null")}.get(text, text)
