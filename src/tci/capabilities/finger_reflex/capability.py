"""A finger reflex: a hand hangs relaxed, lets go when a finger is pressed from outside, and holds what
touches its palm.

The fingers hang half bent, as a person's do, since a straight finger can't give way to a press on its inner
side. A press that opening doesn't answer, as on a nail, or on a hand that is open, is left by the pressed
finger alone: it bends or turns aside. While the hand holds something its fingers press by themselves, so only
a pull counts then (`LightGrasp`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.light_grasp import Grips, LightGrasp, forces_of
from tci.capabilities.needs import Need
from tci.capabilities.retreat import hopeful, why_not
from tci.errors import TciError
from tci.messages import GenericCommand, Mode, Order, Perception
from tci.messages.frames import Array, read_only
from tci.robot.generic_fingers import FINGERS, FLEXIONS, JOINTS

NEAR = 0.05
"""Angle [rad] within which a hand hangs relaxed already when it begins, and is open when it lets go."""
SOON = 0.1
"""Time [s] for which an open hand bears a press before the pressed finger gives way alone. Assumed: whoever
presses a hand until it is open takes less to notice."""


@dataclass(frozen=True, slots=True, eq=False)
class LetGo:
    """A hand whose finger is pressed, or whose grasp ended: it lets go."""

    felt: float
    """Time [s] of the last press on its fingers, or of the end of a grasp."""
    pressed: str
    """The finger that was pressed; empty if a grasp ended."""
    met: frozenset[int]
    """Identities of all contacts at that time: a further one is a reason to judge the hand's way anew."""
    stays: str = ""
    """Why the hand stays where it is; empty if it moves."""
    alone: bool = False
    """True if the pressed finger gives way by itself: opening would press back, or did not end the press."""
    since: float = np.inf
    """Time [s] of the last decision where to go; infinite after a grasp."""


@dataclass(frozen=True, slots=True, eq=False)
class FingerMemory:
    """Memory of a finger reflex."""

    grips: Grips
    """How each hand holds."""
    open: Mapping[str, LetGo]
    """The hands that let go; the others hang relaxed, or hold."""
    bend: frozenset[str] = frozenset()
    """The hands that this step sent to where they hang."""


@dataclass(frozen=True)
class FingerReflex(Capability[FingerMemory]):
    """Opens a hand whose fingers are pressed from outside, and closes one whose palm is touched. Where
    opening would press back or did not help, the pressed finger gives way alone; where that would press back
    too, the hand stays.

    Raises TciError for a setting out of range.
    """

    needs = (Need("skin on a finger", ("fingers",), FINGERS, switches=False),)
    grasp: LightGrasp = LightGrasp()  # noqa: RUF009 - frozen
    """How a hand holds what touches its palm: each finger presses with 1 N."""
    touch: float = 0.3
    """Smallest force [N] on a finger that makes a relaxed hand let go: at double of it, a light tap with a
    finger tip is missed."""
    curl: float = 0.5
    """Flexion [rad] beyond the open hand at which fingers hang: then they can give way by 1 cm near the
    knuckle and by 4 cm at the tips. Assumed; a person's hang at about that."""
    speed: float = 0.5
    """Speed [rad/s] with which fingers bend back: slow enough to stop at whoever is still there."""
    quiet: float = 0.5
    """Time [s] without a press after which an open hand bends back."""

    def __post_init__(self) -> None:
        for name in ("touch", "curl", "speed", "quiet"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"finger reflex: {name} {getattr(self, name)}; valid: above 0, finite")

    def init(self, body: GenericBody) -> FingerMemory:
        return FingerMemory({}, {})

    def step(
        self, memory: FingerMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], FingerMemory]:
        now, open_, bend = perception.stamp, dict(memory.open), set[str]()
        orders, grips = self.grasp.step(memory.grips, perception, body)
        commands, forces = list(orders), forces_of(perception.contacts)
        met = frozenset(perception.contacts.identity.tolist())
        for part in body.parts("fingers"):
            before = memory.grips.get(part)
            if grips[part].closed:
                open_.pop(part, None)
                continue
            ended, pressed = before is not None and before.closed, self._pressed(forces.get(part, {}))
            if pressed or ended:
                open_[part], goal = (
                    (LetGo(now, pressed, met), None)  # a grasp opens by itself
                    if ended
                    else self._let_go(open_.get(part), pressed, met, perception, body, part)
                )
                if goal is not None:
                    commands.append(GenericCommand(part, Mode.POSITION, goal))
                continue
            begins = before is None
            if begins or (part in open_ and now - open_[part].felt >= self.quiet):
                open_.pop(part, None)
                if begins and all(patch.part != part for patch in self.needs[0].skin_of(body.robot)):
                    continue  # fingers that feel nothing stay as they are
                hangs = self.relaxed(part, body)
                if not begins or np.abs(perception.posture[part] - hangs).max() > NEAR:
                    commands.append(GenericCommand(part, Mode.POSITION, hangs, self.speed))
                    bend.add(part)
        return tuple(commands), FingerMemory(grips, open_, frozenset(bend))

    def relaxed(self, part: str, body: GenericBody) -> Array:
        """How a hand hangs: generic angles (n,) [rad]."""
        target: Array = np.array(body.robot.part(part).initial_posture)
        bent = [joint for joint in FLEXIONS if body.has_joint(part)[joint]]
        target[bent] += self.curl
        return read_only(target)

    def _let_go(
        self, was: LetGo | None, pressed: str, met: frozenset[int], perception: Perception,
        body: GenericBody, part: str,
    ) -> tuple[LetGo, Array | None]:  # fmt: skip
        """A hand whose finger is `pressed`, and where it is sent anew: generic angles (n,) [rad]."""
        now, here, opened = perception.stamp, perception.posture[part], body.robot.part(part).initial_posture
        known = was if was is not None and not was.stays and met <= was.met else None
        if known and (known.alone or now - known.since < SOON or np.abs(opened - here).max() > NEAR):
            return replace(known, felt=now, pressed=pressed, met=met), None
        stays = "" if known else why_not(perception, body, part, opened)
        alone = self._alone(perception, body, part, pressed) if known or stays else None
        after = LetGo(now, pressed, met, "" if alone is not None else stays, alone is not None, now)
        if alone is not None:
            return after, alone
        changed = was is None or was.alone or bool(was.stays) != bool(stays)
        return after, (here if stays else opened) if changed else None

    def _alone(self, perception: Perception, body: GenericBody, part: str, finger: str) -> Array | None:
        """Where the joints of one finger, and what their motors move too, take it away from whoever presses
        it: generic angles (n,) [rad]; None if they can't."""
        own = [k for k, one in enumerate(perception.contacts) if (one.part, one.segment) == (part, finger)]
        here, goals = perception.posture[part], list[Array]()
        for group in body.tied(part):
            if any(JOINTS[joint] in (f"{finger}_flexion", f"{finger}_spread") for joint in group):
                for way in (self.curl, -self.curl):
                    goal = np.array(here)
                    goal[list(group)] += way
                    goals.append(_within(perception, body, part, goal))
        for one in hopeful(perception, body, part, np.array(goals), own) if goals else ():
            if not why_not(perception, body, part, goals[one], answers=own):
                return goals[one]
        return None

    def claims(self, memory: FingerMemory) -> frozenset[str]:
        """The hands that hold, let go, or are sent to where they hang."""
        return self.grasp.claims(memory.grips) | frozenset(memory.open) | memory.bend

    def notes(self, memory: FingerMemory) -> tuple[str, ...]:
        return tuple(
            f"{part} stays: its {one.pressed} is pressed, but {one.stays}"
            if one.stays
            else f"{part} gives way with its {one.pressed}, which is pressed"
            if one.alone
            else f"{part} lets go: its {one.pressed} is pressed"
            for part, one in memory.open.items()
            if one.pressed
        )

    def _pressed(self, forces: Mapping[str, float]) -> str:
        """The finger that is pressed most; empty if none is. `forces` [N] by segments of the hand."""
        on_fingers = [finger for finger in FINGERS if forces.get(finger, 0.0) >= self.touch]
        return max(on_fingers, key=forces.__getitem__, default="")


def _within(perception: Perception, body: GenericBody, part: str, goal: Array) -> Array:
    """Generic angles (n,) [rad] as near to `goal` as the limits of the motors permit."""
    assert perception.joints is not None
    own, position = body.joint_maps[part], np.array(perception.joints.position)
    limits = [body.robot.servos[servo].limits for servo in own.servos.tolist()]
    lower = [-np.inf if one.lower is None else one.lower for one in limits]
    upper = [np.inf if one.upper is None else one.upper for one in limits]
    position[own.servos] = np.clip(own.to_robot(goal, position), lower, upper)
    return read_only(own.to_generic(position))
