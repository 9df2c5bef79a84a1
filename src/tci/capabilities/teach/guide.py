"""How an arm goes where hands push it: admittance from the forces on its skin (Hogan 1985).

A guided arm behaves like a damper D with a virtual mass M. A stiff pad and a delay T swing if D is below k T;
the mass keeps a light D calm, since the person's own hand gives way at the frequencies that it takes off: in
a model of a hand of 0.6 kg on pads of 0.8 to 2 N/mm, with delays of 30 to 70 ms, 18 N s/m swing by 10 N with
no mass, and by 1 N with 0.9 to 1.8 kg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tci.body import GenericBody
from tci.errors import TciError
from tci.messages import Contact, Perception
from tci.messages.frames import Array, read_only

LEVER = 0.08
"""Least lever [m]: a push nearer to the axes turns the arm as if it were here, else it would jump."""
QUICK = 0.02
"""Period [s] of a loop from which on the damping grows with it, as the delay does: at 40 ms and 18 N s/m
hands swing by 10 N and lose the arm, at double of it few do."""


@dataclass(frozen=True, slots=True)
class Feel:
    """What a guided arm feels like at the place where it is pushed. Raises TciError for a setting out of
    range."""

    damping: float = 18.0
    """Force per speed [N s/m]: 0.2 m/s take 4 N and the threshold, and double of it in a loop of 40 ms."""
    mass: float = 1.3
    """Virtual mass [kg]. At half of it a pad of 2 N/mm swings, at double the arm is slow to stop."""
    threshold: float = 0.5
    """Least force [N] that moves it: what skin at rest may feel by itself."""
    fastest: float = 0.5
    """Speed [m/s] of a pushed place that is never exceeded."""

    def __post_init__(self) -> None:
        ranges = {
            "damping": (5.0, 500.0),
            "mass": (0.1, 20.0),
            "threshold": (0.05, 5.0),
            "fastest": (0.05, 1.0),
        }
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise TciError(f"feel: {name} {getattr(self, name)}; valid: {least:g} to {most:g}")


def guided(
    feel: Feel, most: float, part: str, contacts: Sequence[Contact], rates: Array, elapsed: float,
    perception: Perception, body: GenericBody,
) -> Array:  # fmt: skip
    """The speeds (n,) [rad/s] of a guided part.

    Nobody is pressed harder by it: a touched place moves into whoever touches it only to lower a larger
    force elsewhere, and never beyond `most`.

    Args:
        feel: how it feels.
        most: force [N] up to which a contact may be loaded to lower a larger one.
        part: what is guided.
        contacts: who pushes it; also on what it carries, such as its fingers.
        rates: its speeds (n,) [rad/s] before.
        elapsed: since then [s].
        perception: what is felt now.
        body: the robot's body.
    """
    damping = feel.damping * max(1.0, elapsed / QUICK)
    share = 1.0 - np.exp(-elapsed * damping / feel.mass)
    if not contacts:
        return read_only((1.0 - share) * rates)
    force = np.array([one.force for one in contacts])
    away = np.array([-body.jacobian(perception, one, part).T @ one.n_T for one in contacts])
    lever = max(float(force @ (away**2).sum(axis=1)) / float(force.sum()), LEVER**2)
    push = force @ away
    total = float(np.linalg.norm(push)) / lever**0.5
    wanted = push * max(0.0, 1.0 - feel.threshold / max(total, 1e-9)) / (damping * lever)
    after = rates + share * (wanted - rates)
    speed = float(np.abs(away @ after).max()) if len(contacts) else 0.0
    after = after * min(1.0, feel.fastest / max(speed, 1e-9))
    largest = min(float(force.max()), most)
    room = np.maximum(largest - force, 0.0) / damping
    return body.yield_to(perception, contacts, after, room, part)
