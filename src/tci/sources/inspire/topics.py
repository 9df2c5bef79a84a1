"""Touch of an Inspire hand from the DDS topics of the maker's bridge, which runs on Unitree's robots.

`rt/inspire_hand/touch/l` and `.../r`, type `inspire::inspire_hand_touch`: 17 sequences of int16 in the order
of the registers, 2208 bytes, without a stamp or a counter. The bridge calls a single hand r, whichever it is.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import int16, sequence

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.source import Sample
from tci.errors import FrameError, RecordingError
from tci.recording.rosmsg.cdr import MessageType, decode
from tci.shared.dds_types import carry_raw
from tci.shared.interface_node import InterfaceNode, latest
from tci.shared.interfaces import check_interface

TURNS = {"tip": "tip", "top": "top", "middle": "middle", "pad": "palm"}
"""What the bridge calls the pads of a finger: its palm is the pad nearest to the palm."""
NUMBERS = {"little": "one", "ring": "two", "middle": "three", "index": "four", "thumb": "five"}
TOPIC = "rt/inspire_hand/touch/"
LETTERS = {"left": "l", "right": "r"}
USUAL = {"left": "192.168.123.210", "right": "192.168.123.211"}
"""Addresses of the hands in the example that comes with Unitree's bridge."""
PAUSE = 0.002
"""Time [s] between two looks for messages."""


def field_of(pad: str) -> str:
    """The bridge's name of a pad such as `index_tip` or `palm`."""
    finger, _, place = pad.partition("_")
    return f"finger{NUMBERS[finger]}_{TURNS[place]}_touch" if place else "palm_touch"


class InspireTopics:
    """The touch topic of one hand."""

    def __init__(self, interface: str, domain: int, side: str, pads: dict[str, int]) -> None:
        """`pads` is the number of taxels of each pad, in the order of the message."""
        self._interface, self._domain, self._side = interface, domain, side
        self._fields = {field_of(pad): pad for pad in pads}
        self._type = MessageType(
            "inspire/msg/touch", tuple(("int16[]", name) for name in self._fields), headed=False
        )
        members: dict[str, Any] = {field_of(pad): sequence[int16, size] for pad, size in pads.items()}  # type: ignore[misc] # cyclonedds' own form
        self._kind = carry_raw(
            final(make_idl_struct("inspire_hand_touch", "inspire.inspire_hand_touch", members))
        )
        self._node: InterfaceNode | None = None
        self._reader: Any = None
        self._other: Any = None

    def open(self) -> None:
        """Raises DriverError for an interface that is not there."""
        check_interface(self._interface, force=True)
        self._node = InterfaceNode(self._interface, self._domain)
        self._reader = self._node.reader(TOPIC + LETTERS[self._side], self._kind)
        self._heard, self._crossed = 0, 0
        other = next(side for side in LETTERS if side != self._side)
        self._other = self._node.reader(TOPIC + LETTERS[other], self._kind)

    def read(self, wait: float) -> list[Sample]:
        """Raises FrameError for a message that is none of this type."""
        if self._reader is None:
            raise ConnectionResetError("not open")
        end = time.monotonic() + wait
        while time.monotonic() < end:
            self._crossed += len(latest(self._other))
            found: list[IdlStruct] = latest(self._reader)
            if found:
                self._heard += len(found)
                return self._samples(found[-1].raw)  # type: ignore[attr-defined] # set by carry_raw
            time.sleep(PAUSE)
        return []

    def diagnose(self) -> Iterator[Finding]:
        """Whether the bridge publishes this hand, or only the other one."""
        name = TOPIC + LETTERS[self._side]
        if self._reader is None or self._heard:
            return
        if self._crossed:
            said = f"nobody publishes {name}, but the other hand's topic is there"
            advice = "the maker's bridge calls a single hand r: try the other side="
        else:
            said = f"nobody publishes {name} on {self._interface}, domain {self._domain}"
            advice = (
                "start the maker's bridge on the robot's computer, or read the hand itself: "
                f"inspire:{USUAL[self._side]} as Unitree sets it up, inspire:192.168.11.210 as sold"
            )
        yield Finding(Level.WARNING, name, said, advice)

    def close(self) -> None:
        if self._node is not None:
            self._reader = self._other = None
            self._node.close()
            self._node = None

    def _samples(self, data: bytes) -> list[Sample]:
        try:
            message = decode(self._type, data)
        except RecordingError as error:
            raise FrameError(str(error)) from None
        return [Sample(pad, message[name]) for name, pad in self._fields.items()]
