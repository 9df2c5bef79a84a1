"""What a policy can see of one generic part: functions of a perception, the same on every robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from tci.body.generic_body import GenericBody
from tci.messages import Perception
from tci.messages.frames import Array, read_only

CONTACTS = 4
"""Contacts that `contacts` sees: the strongest. Assumed: more than two hands with a few fingers are rare."""


def no_goal() -> Array:
    return read_only(np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One generic part at one instant."""

    perception: Perception
    body: GenericBody
    part: str
    home: Array
    """Posture (n,) [rad] of the part when the policy began."""
    before: Array
    """Posture (n,) [rad] at the policy's previous instant."""
    elapsed: float
    """Time [s] since then; 0 at the first instant."""
    goal: Array = field(default_factory=no_goal)
    """What was asked for, in the unit of the task, such as a force (1,) [N]; (0,) if nothing was."""

    @property
    def posture(self) -> Array:
        """Generic angles (n,) [rad]."""
        return self.perception.posture[self.part]


@dataclass(frozen=True, slots=True)
class Observation:
    """Something that a policy sees."""

    see: Callable[[View], ArrayLike]
    """The values, of any shape. It must give the same for the same view."""
    scale: float | tuple[float, ...] = 1.0
    """What counts as 1 for the policy, in the unit of the values: one number for all, or a row of numbers
    that repeats."""


def posture(view: View) -> Array:
    """Generic angles (n,) [rad]."""
    return view.posture


def home(view: View) -> Array:
    """Posture (n,) [rad] when the policy began."""
    return view.home


def offset(view: View) -> Array:
    """How far (n,) [rad] the part is from `home`: the same numbers on robots with another initial posture."""
    return view.posture - view.home


def velocity(view: View) -> Array:
    """Generic velocities (n,) [rad/s] from two postures, since some robots measure no velocity."""
    if view.elapsed <= 0.0:
        return np.zeros(len(view.posture))
    return (view.posture - view.before) / view.elapsed


def goal(view: View) -> Array:
    """What was asked for (g,), in the unit of the task."""
    return view.goal


def contacts(view: View) -> Array:
    """The strongest contacts on the part (4, 7), one row each, 0 where there is none. Columns: 1 on the
    forearm, 0 on the upper arm, -1 elsewhere; u; sine and cosine of theta (0 elsewhere); force [N]; force [N]
    on the strongest taxel; area [cm2]."""
    rows = np.zeros((CONTACTS, 7))
    if not len(view.perception.contacts):
        return rows
    own = [contact for contact in view.perception.contacts if contact.part == view.part]
    own.sort(key=lambda contact: -contact.force)
    for row, contact in zip(rows, own, strict=False):
        place = -1.0, 0.0, 0.0, 0.0
        if not math.isnan(contact.u):  # fingers and palms are segments without u and theta
            sin, cos = math.sin(contact.theta), math.cos(contact.theta)
            place = float(contact.segment == "forearm"), contact.u, sin, cos
        row[:] = *place, contact.force, contact.peak, 1e4 * contact.area
    return rows


def taxels(view: View) -> Array:
    """Force (k,) [N] on each taxel of the part. Robots have other taxels, so a policy that sees them runs on
    one robot only."""
    skin, surfaces = view.perception.skin, view.body.skin.surfaces
    own = [(p, patch) for p, patch in enumerate(view.body.robot.patches) if patch.part == view.part]
    forces = [] if skin is None else [skin.on(p) * surfaces[patch.name].areas for p, patch in own]
    return np.concatenate([np.zeros(0), *forces])


OBSERVATIONS: Mapping[str, Observation] = MappingProxyType(
    {
        "posture": Observation(posture),
        "home": Observation(home),
        "offset": Observation(offset),
        "velocity": Observation(velocity, scale=3.0),  # arms of the packaged robots reach 3 to 8 rad/s
        "contacts": Observation(contacts, scale=(1.0, 1.0, 1.0, 1.0, 10.0, 10.0, 10.0)),
        "taxels": Observation(taxels),
        "goal": Observation(goal),
    }
)
"""What a policy can see, by the name that stands in its file."""
