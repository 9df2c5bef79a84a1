"""Messages as nested objects, for ROS 1 and rosbridge, which do not transport messages as CDR bytes."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tci.errors import FrameError
from tci.recording.rosmsg.cdr import DTYPES, NUMBERS, MessageType, item_of

TIMES = ("Time", "Duration")
Fields = Sequence[tuple[str, str]]


class Trees:
    """Converts messages between a flat list of values and the nested objects of one library.

    - `new(type, fields)` makes an object from its fields; `type` is `package/Name`, or "" for the message
      itself.
    - `get(object, name)` returns one field of an object.
    - `time` has the library's names of the fields for seconds and nanoseconds.
    """

    def __init__(
        self,
        new: Callable[[str, Mapping[str, Any]], Any],
        get: Callable[[Any, str], Any],
        time: tuple[str, str],
    ) -> None:
        self._new, self._get, self._time = new, get, time

    def grow(self, kind: MessageType, values: Sequence[Any]) -> Any:
        """Returns a message as an object of the library. The `values` are in the order of the message's
        fields; if the message has a header, `sec`, `nanosec` and `frame_id` come first."""
        fields: dict[str, Any] = {}
        if kind.headed:
            sec, nanosec, frame = values[:3]
            stamp = self._instant("builtin_interfaces/Time", sec, nanosec)
            fields["header"] = self._new("std_msgs/Header", {"stamp": stamp, "frame_id": frame})
            values = values[3:]
        return self._new("", fields | self._grow(kind, kind.fields, values))

    def flatten(self, kind: MessageType, found: Any) -> dict[str, Any]:
        """Returns the fields of a message by name, as `tci.recording.rosmsg.cdr.decode` does.

        Raises FrameError if an array of numbers contains a value that is no number.
        """
        flat: dict[str, Any] = {}
        if kind.headed:
            header = self._get(found, "header")
            flat["sec"], flat["nanosec"] = self._seconds(self._get(header, "stamp"))
            flat["frame_id"] = str(self._get(header, "frame_id"))
        return flat | self._flatten(kind, kind.fields, found)

    def _grow(self, kind: MessageType, fields: Fields, values: Sequence[Any]) -> dict[str, Any]:
        grown: dict[str, Any] = {}
        for (type_, name), value in zip(fields, values, strict=True):
            item, many = item_of(type_)
            if item in NUMBERS or item == "string":
                grown[name] = _plain(item, value) if many is not None else value
            elif many is None:
                grown[name] = self._inner(kind, item, value)
            else:
                grown[name] = [self._inner(kind, item, inner) for inner in value]
        return grown

    def _inner(self, kind: MessageType, item: str, value: Sequence[Any]) -> Any:
        if item.split("/")[-1] in TIMES:
            return self._instant(item, *value)
        full = next(name for name, _ in kind.needs if name.split("/")[-1] == item.split("/")[-1])
        return self._new(full, self._grow(kind, kind.inside(item), value))

    def _instant(self, item: str, sec: int, nanosec: int) -> Any:
        return self._new(item, {self._time[0]: int(sec), self._time[1]: int(nanosec)})

    def _flatten(self, kind: MessageType, fields: Fields, found: Any) -> dict[str, Any]:
        flat: dict[str, Any] = {}
        for type_, name in fields:
            item, many = item_of(type_)
            value = self._get(found, name)
            if item in NUMBERS:
                flat[name] = _numbers(name, item, value) if many is not None else value
            elif item == "string":
                flat[name] = [str(text) for text in value] if many is not None else str(value)
            elif many is None:
                flat[name] = self._outer(kind, item, value)
            else:
                flat[name] = [self._outer(kind, item, inner) for inner in value]
        return flat

    def _outer(self, kind: MessageType, item: str, found: Any) -> dict[str, Any]:
        if item.split("/")[-1] in TIMES:
            sec, nanosec = self._seconds(found)
            return {"sec": sec, "nanosec": nanosec}
        return self._flatten(kind, kind.inside(item), found)

    def _seconds(self, instant: Any) -> tuple[int, int]:
        return int(self._get(instant, self._time[0])), int(self._get(instant, self._time[1]))


def _plain(item: str, value: Any) -> Any:
    """Returns the value of an array field in a form that ROS accepts: bytes if the type `item` of its
    elements is uint8, otherwise a list."""
    if item == "uint8":
        return np.asarray(value, dtype=np.uint8).tobytes()
    return np.asarray(value).tolist() if item in NUMBERS else list(value)


def _numbers(name: str, item: str, value: Any) -> Any:
    if isinstance(value, bytes):
        return np.frombuffer(value, dtype=np.uint8)
    try:
        if isinstance(value, str):  # rosbridge sends bytes in JSON as base64
            return np.frombuffer(base64.b64decode(value, validate=True), dtype=DTYPES[item])
        return np.array(value, dtype=DTYPES[item])
    except (TypeError, ValueError, OverflowError) as error:
        raise FrameError(f"{name} holds no {item}: {error}") from None
