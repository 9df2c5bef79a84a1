"""What is done to the three switches of a NAO's head, as gestures."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tci.body import GenericBody
from tci.capabilities.touch_words.tactile_gestures import NONE, Strokes, follow
from tci.messages import Contact, Perception
from tci.robot.description import Robot
from tci.robot.per_robot import per_robot


@dataclass(frozen=True, slots=True, eq=False)
class HeadTouch:
    """A sequence of touches of the head, as far as it has come."""

    strokes: Strokes = field(default_factory=Strokes)
    strongest: Contact | None = None
    onset: float = 0.0
    felt: float = 0.0
    said: bool = False
    """True if it was told as held."""


@dataclass(frozen=True, slots=True)
class HeadGesture:
    name: str
    """Empty if it is none of the known gestures."""
    strongest: Contact
    onset: float
    felt: float


@per_robot
def head_switches(robot: Robot) -> str | None:
    """Name of the patch of three switches on the head; None if the robot has none."""
    for patch in robot.patches:
        if patch.sensor.switch and patch.channels == 3 and robot.part(patch.part).kind == "head":
            return patch.name
    return None


def state_of(perception: Perception, patch: str, body: GenericBody) -> tuple[str, Contact | None]:
    """The state of the switches, such as `100` for the front one, and a contact on them."""
    order = np.argsort(-body.skin.surfaces[patch].positions[:, 0])
    pressed = np.zeros(len(order), bool)
    found = None
    for contact in perception.contacts:
        if contact.patch == patch:
            pressed[contact.taxels] = True
            found = contact if found is None or contact.force > found.force else found
    return "".join("1" if one else "0" for one in pressed[order]), found


def feel_head(
    memory: HeadTouch, patch: str, perception: Perception, body: GenericBody
) -> tuple[HeadTouch, HeadGesture | None]:
    """The memory after a perception, and the gesture that is told now."""
    now = perception.stamp
    state, contact = state_of(perception, patch, body)
    if state == NONE and memory.strokes == Strokes():
        return memory, None
    if contact is not None:
        first = memory.strongest is None
        stronger = memory.strongest is None or contact.force > memory.strongest.force
        memory = replace(
            memory, strongest=contact if stronger else memory.strongest, felt=now,
            onset=now if first else memory.onset,
        )  # fmt: skip
    strokes, told, over = follow(memory.strokes, state, now)
    strongest, said, gesture = memory.strongest, memory.said, None
    # a gesture that is held is told once, and its end is no gesture
    if strongest is not None and not said and (told or over):
        gesture = HeadGesture(told, strongest, memory.onset, memory.felt)
    if over:
        return HeadTouch(strokes), gesture
    return replace(memory, strokes=strokes, said=said or bool(told)), gesture
