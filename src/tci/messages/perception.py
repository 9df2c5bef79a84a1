"""What a capability perceives: pressure on the skin, contacts, the generic posture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.messages.contacts import Contacts, Frozen
from tci.messages.frames import Array, read_only
from tci.messages.met import Met
from tci.messages.readings import JointReading
from tci.reasons import Reason


@dataclass(frozen=True, slots=True, eq=False)
class SkinState(Frozen):
    """Pressure on the whole skin at one instant. A `SkinState` lists only active taxels, which are those
    above their threshold."""

    taxels: NDArray[np.int64]
    """Index (p + 1,) of each patch's first taxel within the whole skin, in the robot's order; the last
    element is the number of taxels."""
    stamp: Array
    """Time (p,) [s] of each patch's latest frame; NaN before the first frame."""
    sequence: NDArray[np.int64]
    """Sequence number (p,) of each patch's latest frame; -1 before the first frame."""
    begin: NDArray[np.int64]
    """Index (p + 1,) of each patch's first active taxel in the arrays of active taxels (k,); the last element
    is k."""
    active: NDArray[np.int32]
    """Index (k,) of each active taxel within its patch: patch by patch, and in increasing order on each
    patch."""
    pressure: Array
    """Pressure (k,) [Pa] on each active taxel, positive."""
    vector: Array | None = None
    """Force (k, 3) [N] on each active taxel, in the frame of the patch's link; None if the taxels do not
    measure three axes."""
    masked: NDArray[np.bool_] | None = None
    """True (n,) for each taxel of the whole skin that is masked, so that its values are ignored; None if no
    taxel is masked."""

    def on(self, patch: int) -> Array:
        """Returns the pressure (taxels,) [Pa] on all taxels of one patch; 0 for taxels that are not
        active."""
        own = slice(*self.begin[patch : patch + 2].tolist())
        pressure = np.zeros(self.taxels[patch + 1] - self.taxels[patch])
        pressure[self.active[own]] = self.pressure[own]
        return read_only(pressure)

    def by_patch(self, names: Iterable[str]) -> dict[str, Array]:
        """Returns a dictionary from the name of each patch that has sent a frame to the pressures (taxels,)
        [Pa] on its taxels.

        `names` (p,) contains the names of all patches, in the robot's order.
        """
        return {name: self.on(p) for p, name in enumerate(names) if not np.isnan(self.stamp[p])}


@dataclass(frozen=True, slots=True)
class Support:
    """Predicted static stability of a standing robot after a motion of one leg."""

    forces: Mapping[str, float]
    """Present force [N] on the soles of each leg, by the name of the leg's part."""
    margin: float
    """Distance [m] of the centre of mass, projected along the normal of the support polygon, from the edge of
    the polygon. The distance is positive inside and negative outside. The corners of the polygon are on the
    loaded soles of all legs except the moved leg. If no such sole is loaded, if these soles span no area, or
    if the model has no masses, the value is -inf."""


@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """All data that a capability gets at one instant. A perception is plain data with the same form for every
    robot.

    Methods of `GenericBody` compute results that depend on the robot.
    """

    stamp: float
    """Present time [s], on the driver's clock."""
    posture: Mapping[str, Array]
    """Generic joint angles (n,) [rad] of each generic part, by name (eqs. 1-2)."""
    contacts: Contacts
    """Contacts in the latest frames of the skin."""
    ended: tuple[int, ...] = ()
    """Identities of contacts that ended since the previous perception."""
    skin: SkinState | None = None
    """Pressure on the whole skin; None if the perception was created without a robot."""
    joints: JointReading | None = None
    """The robot's own joints, for the methods of `GenericBody`. A capability that reads these joints directly
    does not run on every robot. The value is None if the perception was created without a robot."""
    met: tuple[Met, ...] = ()
    """What the gate that owns the robot said of contact last, one for each part: also where no skin feels it,
    since a joint is held."""
    held: Reason | None = None
    """Why the robot is held in this period, as far as it is known before the capability's step: the gate
    refuses all orders now. None if it is not held."""
