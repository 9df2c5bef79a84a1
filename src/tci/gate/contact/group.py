"""One group of servos that move together, and what is known of its contact."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError, UnknownNameError
from tci.gate.contact.bearing import Bearing, Borne
from tci.gate.contact.noticing import Noticing, Seen
from tci.gate.contact.others import First
from tci.gate.contact.path import Path
from tci.gate.contact.settings import OnContact
from tci.gate.contact.softness import Softness
from tci.gate.contact.streams import Stream
from tci.gate.contact.weights import Sag, Sags
from tci.gate.joint_monitor import Reference
from tci.messages import JointReading
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot

_log = logging.getLogger("tci")

OFTEN, WITHIN = 3, 10.0
"""So many reactions of a part within so many seconds [s] end in STOP: somebody is there, and a behaviour
insists."""
MOVES = float(np.deg2rad(2.0))
"""Speed [rad/s] above which a reference moves a part, and so may have made a force."""


class Way(NamedTuple):
    """Where servos go on the gate's own order."""

    servos: NDArray[np.intp]
    """(k,)."""
    angles: Array
    """(k,) [rad]."""
    speed: float | None
    """[rad/s]; None is their full speed."""


@dataclass(slots=True)
class Group:
    """One group of servos that move together."""

    servos: NDArray[np.intp]
    parts: tuple[str, ...]
    wanted: OnContact = "retreat"
    """What it does that made a contact."""
    waist: bool = False
    """It carries the upper body of a robot that stands."""
    answer: OnContact = "retreat"
    """What it does now."""
    path: Path = field(default_factory=Path)
    noticing: Noticing = field(default_factory=Noticing)
    softness: Softness = field(default_factory=Softness)
    own: frozenset[int] = field(init=False)
    """The same servos."""
    sags: Sags = field(init=False)
    stream: Stream = field(init=False)
    sag: Sag = field(default_factory=Sag)
    before: Borne | None = None
    """What all joints bore before the contact."""
    push: Array = field(default_factory=lambda: np.zeros(0))
    """Where its joints pushed whom they met (k,), see `Seen.push`."""
    thing: str | None = None
    """What it met, in words, if nobody is to be freed there."""
    first: First | None = None
    """Whom it met; None without a reaction."""
    goal: Array | None = None
    """Where the present way back ends [rad]; None without a reaction."""
    beyond: float = 0.0
    """How far it went [rad] since its path was used up."""
    since: float = 0.0
    """When the reference reached the goal [s]; inf while it moves."""
    free: float | None = None
    """When the contact was over [s]."""
    reactions: deque[float] = field(default_factory=deque)
    moved: float = -np.inf
    """When the reference moved last [s]."""
    expected: float = 0.0
    """Force [N] that a capability handles itself."""
    until: float = -np.inf
    """How long it does [s]."""
    led: int | None = None
    """Identity of the contact that leads it, harder than a capability handles: it gives way to that one as
    long as it is the strongest, and the group does not go into it."""
    unloaded: bool = False
    """Its references went to where its joints bear their weight only."""
    eased: float = -np.inf
    """When it got a smaller share of its stiffness last [s]."""
    slow: bool = False
    """It is freed on an operator's word."""

    def __post_init__(self) -> None:
        self.own, self.sags = frozenset(self.servos.tolist()), Sags(self.servos)
        self.stream = Stream(self.servos)

    @property
    def name(self) -> str:
        return " and ".join(self.parts)

    def references(self, reference: Reference, position: Array) -> Array:
        """References (k,) [rad]; where it has none, where the joint is."""
        whole = position.copy()
        whole[reference.servos] = reference.position
        found: Array = whole[self.servos]
        return found

    def bears(self, joints: JointReading, bearing: Bearing) -> Array:
        """What its joints bear more than before the contact (k,), as `Seen.bears`."""
        return bearing.beyond(joints, self.before)[self.servos]

    def back(self, seen: Seen, before: float, *, pulled: bool) -> Array:
        """Where its way back ends (k,) [rad] that leaves what it met after `before` [s], or (`pulled`) what
        its joints pull at."""
        pull = seen.pull if pulled else np.zeros(len(seen.pull))
        return self.path.back(seen.here, before, seen.own, pull)

    @property
    def answers(self) -> bool:
        """It answers a contact that is not over."""
        return self.goal is not None and self.free is None

    @property
    def too_often(self) -> Reason | None:
        """Why the gate must stop: it met something too often."""
        if len(self.reactions) < OFTEN:
            return None
        return Reason(Code.CONTACT, f"{self.name} met something {OFTEN} times within {WITHIN:.0f} s")

    def goes(self, goal: Array) -> Array:
        self.goal, self.since, self.free = goal, np.inf, None
        return goal


def make_groups(
    robot: Robot,
    numbers: Sequence[int],
    answers: Mapping[str, OnContact],
    *,
    stands: bool,
) -> tuple[dict[int, Group], dict[str, set[int]]]:
    """Groups of servos that answer contact, by number, and their numbers, by generic part. Legs carry the
    robot, so they stop and stay stiff, and a grasp loads the fingers on purpose: neither answers.

    Args:
        robot: whose servos they are.
        numbers: group of each servo (n_servos,).
        answers: what parts do that made a contact, by name.
        stands: whether soles tell when the robot stands.

    Raises UnknownNameError for a part that the robot lacks, TciError for one that does not answer.
    """
    own = {
        part.name: {numbers[one.servo] for one in part.servos if one.servo is not None}
        for part in robot.parts
    }
    others = set[int]().union(*(own[part.name] for part in robot.parts if part.kind in ("leg", "fingers")))
    parts = {name: found - others for name, found in own.items()}
    groups = dict[int, Group]()
    for number in dict.fromkeys(numbers):
        if number not in others:
            servos = [servo for servo, group in enumerate(numbers) if group == number]
            names = tuple(name for name, found in parts.items() if number in found)
            groups[number] = Group(np.array(servos), names or (robot.servos[servos[0]].robot_part,))
    for number in (number for part in robot.parts if part.kind == "torso" for number in parts[part.name]):
        groups[number].waist = True
    for name, answer in answers.items():
        if name not in parts:
            raise UnknownNameError("part", name, parts)
        if not parts[name] and answer != "stop":
            able = ", ".join(part for part, found in parts.items() if found)
            raise TciError(f"contact: {name} {answer}; valid: answers of {able}; legs and fingers have none")
        for number in parts[name]:
            groups[number].wanted = answer
        if stands and answer != "stop" and any(groups[number].waist for number in parts[name]):
            _log.warning(
                f"contact: {name} {answer}: only while no sole is loaded; a {robot.name} that stands stops "
                "it, since whoever pushes it, or a load, would make it lean"
            )
    return groups, parts
