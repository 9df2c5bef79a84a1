"""Touch and angles of an Inspire hand from the DDS topics of the maker's bridge, which runs on Unitree's
robots: `rt/inspire_hand/{touch,state}/{l,r}`. The bridge calls a single hand r, whichever it is.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from cyclonedds.idl import IdlStruct

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.source import FingerAngles, Sample
from tci.robot.tactile_devices import hand_joints
from tci.shared import inspire_dds
from tci.shared.interface_node import InterfaceNode, latest
from tci.shared.interfaces import check_interface

USUAL = {"left": "192.168.123.210", "right": "192.168.123.211"}
"""Addresses of the hands in the example that comes with Unitree's bridge."""
PAUSE = 0.002
"""Time [s] between two looks for messages."""


class InspireTopics:
    """The topics of one hand."""

    def __init__(self, interface: str, domain: int, side: str) -> None:
        self._interface, self._domain, self._side = interface, domain, side
        self._names = [joint.name for joint in hand_joints(inspire_dds.DEVICE)]
        self._node: InterfaceNode | None = None
        self._reader: Any = None
        self._states: Any = None
        self._other: Any = None

    def open(self) -> None:
        """Raises DriverError for an interface that is not there."""
        check_interface(self._interface, force=True)
        self._node = InterfaceNode(self._interface, self._domain)
        self._reader = self._node.reader(inspire_dds.topic("touch", self._side), inspire_dds.TOUCH)
        self._states = self._node.reader(inspire_dds.topic("state", self._side), inspire_dds.STATE)
        self._heard, self._crossed = 0, 0
        other = next(side for side in inspire_dds.LETTERS if side != self._side)
        self._other = self._node.reader(inspire_dds.topic("touch", other), inspire_dds.TOUCH)

    def read(self, wait: float) -> Iterator[Sample | FingerAngles]:
        """Touch first: where the bridge can't read the angles it sends zeros, and touch all the same. Raises
        FrameError for a message that is none of this type."""
        if self._reader is None:
            raise ConnectionResetError("not open")
        end = time.monotonic() + wait
        while time.monotonic() < end:
            self._crossed += len(latest(self._other))
            found: list[IdlStruct] = latest(self._reader)
            states: list[IdlStruct] = latest(self._states)
            if found or states:
                self._heard += len(found)
                if found:
                    yield from self._samples(found[-1].raw)  # type: ignore[attr-defined] # set by carry_raw
                if states:
                    yield self._angles(states[-1].raw)  # type: ignore[attr-defined]
                return
            time.sleep(PAUSE)

    def diagnose(self) -> Iterator[Finding]:
        """Whether the bridge publishes this hand, or only the other one."""
        name = inspire_dds.topic("touch", self._side)
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
            self._reader = self._states = self._other = None
            self._node.close()
            self._node = None

    def _angles(self, data: bytes) -> FingerAngles:
        angles = inspire_dds.state_in(data)["angle_act"] / inspire_dds.FULL
        return FingerAngles(dict(zip(self._names, angles.tolist(), strict=True)))

    @staticmethod
    def _samples(data: bytes) -> list[Sample]:
        return [Sample(pad, values) for pad, values in inspire_dds.pads_in(data).items()]
