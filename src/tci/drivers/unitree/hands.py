"""Press sensors of Dex3 hands as patches of skin.

The binding of the description says which patch is on which hand: `<address of="PATCH" to="left"/>`. Its
channels are the 12 values of each sensor, one sensor after the other; the message tells how many there are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.source_clock import SourceClock
from tci.drivers.unitree import messages
from tci.drivers.unitree.node import UnitreeNode, latest
from tci.drivers.unitree.wire import TAXELS, decode_hand
from tci.errors import DriverError, FrameError
from tci.frames import read_only
from tci.messages import SkinFrame
from tci.robot.description import Patch, Robot

SIDES = ("left", "right")
NO_VALUE = 30_000.0
"""Reading of a place without a sensor (the vendor's)."""


def patches_of(robot: Robot) -> tuple[Patch, ...]:
    """Returns the patches that the binding puts on a hand, and those that are felt through joints; a G1 sends
    no others."""
    named = {address.of for address in robot.binding("unitree").addresses}
    return tuple(patch for patch in robot.patches if patch.through_joints or patch.name in named)


class HandSkin:
    """Frames of the patches on both hands."""

    def __init__(self, robot: Robot, node: UnitreeNode) -> None:
        """Opens a reader for each patch that the binding puts on a hand. Raises DriverError for another
        address."""
        binding = robot.binding("unitree")
        self._hands: list[_Hand] = []
        for patch in patches_of(robot):
            if patch.through_joints:
                continue
            side = binding.address(patch.name, "")
            if side not in SIDES:
                raise DriverError(f"{patch.name} is on the hand {side!r}; valid: {', '.join(SIDES)}")
            self._hands.append(_Hand(patch, side, node))

    def frames(self, now: float) -> tuple[SkinFrame, ...]:
        """Returns the latest frame of each patch that has sent one, at `now` [s]. Raises DriverError for a
        hand with another number of sensors."""
        found = [hand.read(now) for hand in self._hands]
        return tuple(frame for frame in found if frame is not None)


class _Hand:
    """One hand."""

    def __init__(self, patch: Patch, side: str, node: UnitreeNode) -> None:
        self._patch, self._topic = patch, f"rt/dex3/{side}/state"
        self._states = node.reader(self._topic, messages.HAND_STATE)
        self._source = SourceClock()
        self._lost: NDArray[np.uint32] | None = None
        self._frame: SkinFrame | None = None

    def read(self, now: float) -> SkinFrame | None:
        """Returns the latest frame; None before the first."""
        for sample in latest(self._states):
            try:
                pads = decode_hand(sample.raw).pads
            except FrameError:
                continue
            if TAXELS * len(pads) != self._patch.channels:
                raise DriverError(
                    f"{self._topic} has {len(pads)} press sensors of {TAXELS} values, {self._patch.name} has "
                    f"{self._patch.channels} channels; valid: as many as values"
                )
            stamp = self._source.place(sample.sample_info.source_timestamp * 1e-9, now)
            if stamp is not None:
                sequence = 0 if self._frame is None else self._frame.sequence + 1
                values = read_only(self._values(pads).ravel(), np.float32)
                self._frame = SkinFrame(self._patch.name, min(stamp, now), sequence, values)
        return self._frame

    def _values(self, pads: Any) -> NDArray[np.float32]:
        """Returns the readings (p, 12); NaN without a value, and of sensors that have just lost data."""
        values: NDArray[np.float32] = pads["pressure"].copy()
        values[values == NO_VALUE] = math.nan
        lost = pads["lost"].copy()
        if self._lost is not None and len(self._lost) == len(lost):
            values[lost != self._lost] = math.nan
        self._lost = lost
        return values
