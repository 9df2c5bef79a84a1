"""When a contact counts, and how the gate answers it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tci.robot.clearance import Fixture


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """When a contact counts, and how the gate answers it."""

    held: float = float(np.deg2rad(2.0))
    """Angle [rad] outside the recent references at which a joint counts as held. At half of it dry friction
    of 5 % of the torque and masses wrong by 20 % count too; at double a stiff servo presses with twice the
    force."""
    lag: float = 0.1
    """Time [s] by which a healthy joint follows: three periods of 100 Hz, a reading of 14 ms, a servo of
    60 rad/s."""
    told: float = 5.0
    """Force [N] on skin from which on a contact is told, in `SafeCommand.met`."""
    felt: float = 15.0
    """Force [N] on skin above which a part that made the contact answers, and a resting part that somebody
    presses gives way. ISO/TS 15066 permits 65 N and more; people guide an arm with less than this."""
    stands: bool = True
    """Whether a joint that stands while its reference goes on is held."""
    quiet: float = 0.5
    """Time [s] without contact after which the part obeys again."""
    answers: Mapping[str, Literal["retreat", "soft", "stop"]] = field(default_factory=dict)
    """What a generic part does that made a contact, by its name: go back (which is the default), give way
    where it is, or stay stiff where its reference stopped."""
    fixtures: tuple[Fixture, ...] = ()
    """Tables and other things beside the robot: an arm that meets one stops there, since nobody is to be
    freed. What stands where nothing is declared may be somebody."""
