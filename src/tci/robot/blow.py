"""How hard a moving part strikes somebody who stands in its way, and how slow it must be for a given force.

The mass of the moving links alone predicts half of the force: stiff servos go on pushing until the contact is
noticed. So a blow is that of one degree of freedom: the effective mass 1 / (n^T J M^-1 J^T n) behind the
place, along the direction n of the blow (Khatib 1995), carried by the servos' stiffness and damping up to the
force at which the first servo stalls, against a mass on a spring (Haddadin, Albu-Schaeffer, Hirzinger 2009).
The servos' reference moves on at the speed of the blow until the reaction.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, TciError
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.kernels.blow import Drives, behind, peak, spare

BANDWIDTH = 100.0
"""Natural frequency [rad/s] of a servo, critically damped. Nobody publishes it; those of good humanoids are
between 60 and 150."""
ROTOR = 0.5
"""Inertia of a motor at its joint, as a fraction of the links' own. Nobody publishes it; with the gears of
humanoids it is between 0 and 1."""
REACTION = 0.05
"""Time [s] from a contact until the reference stands: a skin frame, a late reading, three periods of 100 Hz,
and the way to brake."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Struck:
    """A region of a person's body, free to move."""

    name: str
    stiffness: float
    """[N/m]."""
    mass: float
    """[kg]."""
    force: float
    """Force [N] of a blow that it may get."""


PEOPLE = (
    Struck(name="chest", stiffness=25e3, mass=40.0, force=280.0),
    Struck(name="abdomen", stiffness=10e3, mass=40.0, force=220.0),
    Struck(name="back", stiffness=35e3, mass=40.0, force=420.0),
    Struck(name="upper arm", stiffness=30e3, mass=3.0, force=300.0),
    Struck(name="lower arm", stiffness=40e3, mass=2.0, force=320.0),
    Struck(name="hand", stiffness=75e3, mass=0.6, force=280.0),
)
"""Regions of adults: twice the quasi-static forces of ISO/TS 15066:2016, Annex A, as two public sources print
them. Skull and face are left out: no force is permitted there."""


def checked_people(whose: str, people: Sequence[Struck]) -> tuple[Struck, ...]:
    """`people` as a tuple. Raises TciError, which names `whose` setting it is, for anything else."""
    found = tuple(people) if isinstance(people, Iterable) else None
    if found is None or not all(isinstance(one, Struck) for one in found):
        valid = "a sequence of tci.body.Struck, such as tci.body.PEOPLE; () for nobody"
        raise TciError(f"{whose}: people {people!r}; valid: {valid}")
    return found


class Striker(NamedTuple):
    """What is behind one place of a robot, along one direction."""

    mass: float
    """Effective mass [kg] of links and motors."""
    stiffness: float
    """[N/m] of the servos."""
    damping: float
    """[N s/m] of the servos."""
    stall: float
    """Force [N] at which the first servo has its most torque."""

    def force_on(self, struck: Struck, speed: float, *, reaction: float = REACTION) -> float:
        """Largest force [N] of a blow at `speed` [m/s], noticed `reaction` [s] after the first touch. Raises
        CommandError for a speed or a time below 0."""
        if not (0.0 <= speed < np.inf and 0.0 <= reaction < np.inf):
            raise CommandError(f"a blow at {speed} m/s, noticed after {reaction} s; valid: 0 or more")
        return float(peak(*self, speed, struck.stiffness, struck.mass, reaction))


class Strikers:
    """Finds what is behind the places of one robot."""

    def __init__(self, robot: Robot) -> None:
        self._drives = drives_of(robot)

    def behind(self, inertia: Array, moved: Array) -> Striker | None:
        """What is behind a place that servo speeds move by `moved` (n_servos,) [m/rad] along the direction of
        the blow. `inertia` (n_servos, n_servos) [kg m2] is that of the links. None if no servo moves the
        place."""
        room, found = np.empty((len(moved), len(moved) + 1)), np.empty(4)
        return Striker(*found.tolist()) if behind(inertia, moved, self._drives, room, found) else None


def drives_of(robot: Robot) -> Drives:
    """What each servo can do, in the order of `Robot.servos`."""
    limits = [servo.limits for servo in robot.servos]
    # a servo has at least the torque that its acceleration limit needs
    accelerations = read_only([one.acceleration or 20.0 for one in limits])
    return Drives(read_only([one.torque or 0.0 for one in limits]), accelerations, ROTOR, BANDWIDTH)


def spared(blows: ArrayLike, people: Sequence[Struck], *, margin: float = 1.0) -> tuple[float, float]:
    """The largest share of the speeds of m blows, at most 1, at which `margin` times their force exceeds
    nothing that `people` may get, and the largest force [N] at that share, without the margin. `blows` (m, 5)
    are the numbers of a `Striker` and its speed [m/s]."""
    rows = np.asarray(blows, np.float64).reshape(-1, 5)
    regions = np.array([(one.stiffness, one.mass, one.force) for one in people]).reshape(-1, 3)
    share, force = spare(rows, regions, margin, REACTION)
    return share, force
