"""Order of a patch's channels among the values that the patch's port sends. A port may send more values than
the patch has channels. For example, the skin of iCub's upper arm has 35 modules of ten taxels each. The port
of this skin sends 768 values: twelve for each module, with room for 64 modules.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.errors import DriverError
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot
from tci.wires.yarp.facts import facts_port
from yarpwire.errors import WireError
from yarpwire.network import Network

MODULE, PADS = 12, (6, 10)
"""Number of values of a skin module, and the places of the module's thermal pads among these values."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinLayout:
    """Places of the channels of one patch among the values of its port."""

    count: int
    """Number of values that the port sends."""
    places: NDArray[np.intp] | None = None
    """Index (channels,) of each channel's value among the values of the port; None if the two orders are
    equal."""

    @classmethod
    def of(cls, robot: Robot, patch: Patch) -> SkinLayout:
        """Returns the layout of a patch from the robot's binding to YARP.

        Raises DriverError if the modules in the binding have another number of taxels than the patch.
        """
        address = robot.binding("yarp").entry(patch.name)
        if address is None or address.channels is None:
            return cls(patch.channels)
        taxels = [place for place in range(MODULE) if place not in PADS]
        places = [MODULE * module + place for module in address.modules for place in taxels]
        if len(places) != patch.channels:
            raise DriverError(f"modules of {len(places)} taxels for {patch.name}; valid: {patch.channels}")
        return cls(address.channels, np.array(places, dtype=np.intp))

    def to_port(self, values: Array, rest: float) -> Array:
        """Returns the values of the port for the `values` of a patch. Values that belong to no taxel are
        `rest`."""
        if self.places is None:
            return values
        wide = np.full(self.count, rest)
        wide[self.places] = values
        return wide

    def from_port(self, values: Array, source: str) -> Array:
        """Returns the values of the patch's channels from the `values` of the port.

        `source` names the port in messages. Raises WireError if the number of values is wrong.
        """
        if len(values) != self.count:
            raise WireError(f"{source} sends {len(values)} values; valid: {self.count} by the description")
        return values if self.places is None else values[self.places]


def check_order(layout: SkinLayout, patch: Patch, prefix: str, network: Network) -> None:
    """Raises DriverError if the order of a patch's taxels on the robot at `prefix` is unknown.

    If the robot's binding lists modules for this patch, the order of the modules is certain only if TCI
    serves the robot. On other robots, the binding's order is an assumption, and the order of the taxels
    counts as unknown.
    """
    if layout.places is not None and not network.lives(facts_port(prefix)):
        raise DriverError(
            f"the places of the {layout.count} values of {patch.name} are only in the robot's own skin file; "
            f"valid: a description with that file (docs/add-a-skin.md), or yarp:...,without={patch.name}"
        )
