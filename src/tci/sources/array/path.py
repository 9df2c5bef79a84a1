"""A path to numbers within a message: `sensors[sensor_pos=2].taxels[].z`.

| step | what it takes |
|---|---|
| `name` | a field |
| `name[]` | each item of a list |
| `name[3]` | one item, from 0; -1 is the last |
| `name[0:64]` | the items from 0 to 63; without a number from the first, or to the last |
| `name[key=value]` | the items whose field `key` is `value`; `*` stands for any letters |

If the items have no such field, `key` may be a list beside them: the items at whose place it has `value` are
taken, as control_msgs/DynamicJointState needs.

Text is read as JSON if the path goes on below it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError, FrameError

STEP = re.compile(r"([A-Za-z_]\w*)((?:\[[^\]]*\])*)")
INDEX = re.compile(r"-?\d+")
SLICE = re.compile(r"(-?\d+)?:(-?\d+)?")
PICK = re.compile(r"([A-Za-z_]\w*)=(.*)")
SPLIT = re.compile(r"\.(?![^\[]*\])")
"""A dot that is not in brackets."""
SEVERAL = re.compile(r"/(?![^\[]*\])")
"""A stroke that is not in brackets, between the paths of several pads."""


class FieldPath:
    """A path that was taken apart. Raises DriverError for one that can't be meant."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.steps: list[tuple[str, list[str]]] = []
        for part in SPLIT.split(text):
            match = STEP.fullmatch(part)
            picks = re.findall(r"\[([^\]]*)\]", match[2]) if match else []
            if match is None or not all(
                not one or INDEX.fullmatch(one) or SLICE.fullmatch(one) or PICK.fullmatch(one)
                for one in picks
            ):
                raise DriverError(
                    f"path={text}: {part!r}; valid: name, name[], name[3], name[0:9], name[key=value]"
                )
            self.steps.append((match[1], picks))

    def values(self, message: Mapping[str, Any]) -> NDArray[np.generic]:
        """The numbers (n,) at the path. Raises FrameError if there are none."""
        here: list[Any] = [message]
        for name, picks in self.steps:
            below = []
            for one in here:
                holder = self._fields(one, name)
                found = [holder[name]]
                for pick in picks:
                    found = [inner for each in found for inner in self._pick(each, holder, pick)]
                below += found
            here = below
        parts = [np.atleast_1d(np.asarray(one)).ravel() for one in here]
        if not parts:
            raise FrameError(f"{self.text}: nothing is there")
        values = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if values.dtype.kind not in "buif":
            raise FrameError(f"{self.text}: {values.dtype.name}, no numbers")
        return values

    def _fields(self, one: Any, name: str) -> Mapping[str, Any]:
        if isinstance(one, str):
            try:
                one = json.loads(one)
            except ValueError as error:
                raise FrameError(f"{self.text}: text above {name} is no JSON: {error}"[:150]) from None
        if not isinstance(one, Mapping) or name not in one:
            valid = ", ".join(map(str, one)) if isinstance(one, Mapping) else "no field"
            raise FrameError(f"{self.text}: no {name}; valid: {valid}"[:300])
        return one

    def _pick(self, items: Any, holder: Mapping[str, Any], pick: str) -> Iterator[Any]:
        if isinstance(items, str | Mapping) or not hasattr(items, "__len__"):
            raise FrameError(f"{self.text}: [{pick}] of something that is no list")
        if not pick:
            yield from items
        elif INDEX.fullmatch(pick):
            if not -len(items) <= int(pick) < len(items):
                raise FrameError(f"{self.text}: [{pick}]; there are {len(items)}")
            yield items[int(pick)]
        elif cut := SLICE.fullmatch(pick):
            part = items[slice(*(int(one) if one else None for one in cut.groups()))]
            yield from [part] if isinstance(part, np.ndarray) else part
        else:
            key, _, value = pick.partition("=")
            keys = [one.get(key) if isinstance(one, Mapping) else None for one in items]
            beside = holder.get(key)
            if all(one is None for one in keys) and beside is not None and len(beside) == len(items):
                keys = list(beside)
            chosen = [
                one for one, own in zip(items, keys, strict=True) if own is not None and _is(own, value)
            ]
            if not chosen:
                there = ", ".join(dict.fromkeys(str(one) for one in keys if one is not None))
                raise FrameError(f"{self.text}: no {pick}; valid: {key}={there or 'none'}"[:300])
            yield from chosen


def _is(own: Any, value: str) -> bool:
    if isinstance(own, str):
        return fnmatchcase(own, value)
    try:
        return bool(float(own) == float(value))
    except (TypeError, ValueError):
        return False
