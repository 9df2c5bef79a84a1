"""When a contact counts, and how the gate answers it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from tci.errors import TciError
from tci.robot.clearance import Fixture

OnContact = Literal["retreat", "soft", "stop"]
"""What a part does that made a contact: it goes back, gives way where it is, or stays stiff where its
reference stopped."""
RANGES = {
    "held": (1e-3, float(np.deg2rad(6.0))), "lag": (1e-3, 1.0), "told": (0.0, 65.0), "felt": (1.0, 65.0),
    "quiet": (0.1, 10.0),
}  # fmt: skip
"""Valid settings: beyond 6 degrees the joint monitor stops the robot, and 65 N are the least quasi-static
limit of ISO/TS 15066."""


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """When a contact counts, and how the gate answers it. Raises TciError for a setting out of range."""

    held: float = float(np.deg2rad(2.0))
    """Angle [rad] outside the recent references at which a joint counts as held. At half of it dry friction
    of 5 % of the torque and masses wrong by 20 % count too; at double a stiff servo presses with twice the
    force."""
    lag: float = 0.1
    """Time [s] by which a healthy joint follows: three periods of 100 Hz, a reading of 14 ms, a servo of
    60 rad/s."""
    told: float = 5.0
    """Force [N] on skin from which on a contact is told, in `SafeCommand.met`: a handshake by GentleHumanoid
    (2511.04679) has as much at most."""
    felt: float = 15.0
    """Force [N] on skin above which a part that made the contact answers, and a resting part that somebody
    presses gives way. ISO/TS 15066 permits 65 N and more; people guide an arm with less than this."""
    of_parts: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Other `told` and `felt` [N] for generic parts, by name, and for those that move with them."""
    stands: bool = True
    """Whether a joint that stands while its reference goes on is held."""
    softens: bool = True
    """Whether servos take a share of their stiffness in every mode: a part goes back from somebody softly."""
    quiet: float = 0.5
    """Time [s] without contact after which the part obeys again."""
    answers: Mapping[str, OnContact] = field(default_factory=dict)
    """What a generic part does that made a contact, by its name; others go back."""
    fixtures: tuple[Fixture, ...] = ()
    """Tables and other things beside the robot: an arm that meets one stops there, since nobody is to be
    freed. What stands where nothing is declared may be somebody."""

    def __post_init__(self) -> None:
        for name, (least, most) in RANGES.items():
            if not least <= getattr(self, name) <= most:
                raise TciError(f"contact: {name} {getattr(self, name)}; valid: {least:.3g} to {most:.3g}")
        for part, (told, felt) in self.of_parts.items():
            if not 0.0 <= told <= felt <= RANGES["felt"][1]:
                raise TciError(f"contact: {part} told {told}, felt {felt}; valid: 0 <= told <= felt <= 65")
        able = get_args(OnContact)
        for part, answer in self.answers.items():
            if answer not in able:
                raise TciError(f"contact: {part} answers by {answer}; valid: {', '.join(able)}")

    def told_of(self, parts: Iterable[str]) -> float:
        """`told` [N] for parts that move together."""
        return min((self.of_parts[part][0] for part in parts if part in self.of_parts), default=self.told)

    def felt_of(self, parts: Iterable[str]) -> float:
        """`felt` [N] for parts that move together."""
        return min((self.of_parts[part][1] for part in parts if part in self.of_parts), default=self.felt)
