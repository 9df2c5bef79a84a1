"""Messages of an Inspire hand over DDS, as the maker's bridge on Unitree's robots sends and takes them.

`rt/inspire_hand/{state,touch,ctrl}/{l,r}`: sequences of int16 or octets, bounded, without a stamp or a
counter (inspire_hand_ws fc754900, *.idl).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import byte, int8, int16, sequence
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.robot.tactile_devices import device
from tci.shared.dds_types import carry_raw

HEAD = b"\0\1\0\0"
"""First bytes of each message: little-endian CDR."""
DEVICE = "inspire-rh56dftp"
LETTERS = {"left": "l", "right": "r"}
FULL = 1000
"""Value of an angle at its open end; 0 is bent."""
LEAVES = -1
"""Value of a commanded angle that leaves a joint as it is."""
ANGLE = 1
"""Bit of a command's `mode`: its angles count. Without it the hand does not move to them."""
TURNS = {"tip": "tip", "top": "top", "middle": "middle", "pad": "palm"}
"""What the bridge calls the pads of a finger: its palm is the pad nearest to the palm."""
NUMBERS = {"little": "one", "ring": "two", "middle": "three", "index": "four", "thumb": "five"}
_SIZES = {(place, pad.name): pad.channels for pad in device(DEVICE).pads for place in (*pad.fingers, "palm")}
PADS: Mapping[str, int] = {
    **{
        f"{finger}_{pad}": _SIZES[finger, pad]
        for finger in NUMBERS
        for pad in TURNS
        if (finger, pad) in _SIZES
    },
    "palm": _SIZES["palm", "palm"],
}
"""Number of taxels of each pad, in the order of the message."""
STATES: Mapping[str, int] = dict.fromkeys(("pos_act", "angle_act", "force_act", "current"), 6)
FLAGS: Mapping[str, int] = dict.fromkeys(("err", "status", "temperature"), 6)
SETS: Mapping[str, int] = dict.fromkeys(("pos_set", "angle_set", "force_set", "speed_set"), 6)


def topic(what: str, side: str) -> str:
    """`what` is state, touch or ctrl."""
    return f"rt/inspire_hand/{what}/{LETTERS[side]}"


def field_of(pad: str) -> str:
    """The bridge's name of a pad such as `index_tip` or `palm`."""
    finger, _, place = pad.partition("_")
    return f"finger{NUMBERS[finger]}_{TURNS[place]}_touch" if place else "palm_touch"


def _kind(name: str, words: Mapping[str, int], octets: Mapping[str, int], **more: Any) -> type[IdlStruct]:
    # as `octet`: Cyclone 0.10, which the vendor pins, does not know the newer type of `uint8`
    members: dict[str, Any] = {one: sequence[int16, size] for one, size in words.items()}  # type: ignore[misc] # cyclonedds' own form
    members |= {one: sequence[byte, size] for one, size in octets.items()}  # type: ignore[misc] # cyclonedds' own form
    made = make_idl_struct(name, f"inspire.{name}", members | more)
    return carry_raw(autoid("sequential")(final(made)))


FIELDS: Mapping[str, int] = {field_of(pad): size for pad, size in PADS.items()}
TOUCH = _kind("inspire_hand_touch", FIELDS, {})
STATE = _kind("inspire_hand_state", STATES, FLAGS)
CTRL = _kind("inspire_hand_ctrl", SETS, {}, mode=int8)


def encode(sequences: Iterable[NDArray[Any]], tail: bytes = b"") -> bytes:
    """The bytes of a message that consists of sequences, and of `tail` behind them."""
    data = bytearray(HEAD)
    for values in sequences:
        data += bytes(-len(data) % 4) + len(values).to_bytes(4, "little") + values.tobytes()
    return bytes(data) + tail


def decode(data: bytes, words: Mapping[str, int], octets: Mapping[str, int]) -> tuple[dict[str, Any], bytes]:
    """The sequences of int16 and of octets in a message by their names, each of the given length, and what
    follows them. Raises FrameError if a sequence has another length: the bridge sends half-filled messages
    where reading the hand failed."""
    found: dict[str, Any] = {}
    at = len(HEAD)
    if data[:at] != HEAD:
        raise FrameError(f"a message of an Inspire hand that begins with {data[:at].hex()}")
    for sizes, form in ((words, np.dtype("<i2")), (octets, np.dtype("u1"))):
        for name, size in sizes.items():
            at += -at % 4
            count, begin = int.from_bytes(data[at : at + 4], "little"), at + 4
            at = begin + size * form.itemsize
            if count != size or at > len(data):
                raise FrameError(f"{name} of an Inspire hand has {count} values, expected {size}")
            found[name] = np.frombuffer(data, form, size, begin)
    return found, data[at:]


def pads_in(data: bytes) -> dict[str, NDArray[np.int16]]:
    """The taxels of each pad in a message of touch. Raises FrameError if the message is none."""
    found, _ = decode(data, FIELDS, {})
    return {pad: found[field_of(pad)] for pad in PADS}


def state_in(data: bytes) -> dict[str, Any]:
    """The fields of a message of state. Raises FrameError if the message is none, or if all six angles are 0:
    the bridge leaves zeros where reading the hand failed, and no hand bends all its joints as far."""
    found, _ = decode(data, STATES, FLAGS)
    if not found["angle_act"].any():
        raise FrameError("all angles of an Inspire hand are 0: the bridge could not read it")
    return found
