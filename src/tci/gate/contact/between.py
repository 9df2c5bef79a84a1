"""Between two persons whom skin feels on both sides: where a group goes so that neither is pressed."""

from __future__ import annotations

from tci.gate.contact.group import Group
from tci.gate.contact.noticing import Seen
from tci.gate.contact.scene import Scene
from tci.gate.contact.softness import LIGHT
from tci.messages.frames import Array


def leave_both(scene: Scene, group: Group, seen: Seen) -> Array | None:
    """With each new frame, where a group on its way back goes (k,) [rad] that presses two persons; None if
    there are none or if it can't."""
    first = group.first
    if first is None or not scene.places.known or group.thing or seen.felt.force <= LIGHT:
        return None
    if not (group.answer == "retreat" or group.slow):
        return None
    if not first.between:
        if min(seen.felt.sides) <= scene.settings.felt_of(group.parts):
            return None
        group.path.clear()
        group.first = first = first.next(seen, scene.now, between=True)
    frame = {identity: one.force for identity, one in seen.felt.contacts.items()}
    if frame == first.frame:
        return group.goal
    first.frame = frame
    pressed = [one for one in scene.on(group) if one.force > LIGHT]
    goal: Array = seen.here + scene.places.way_out(seen, pressed, seen.references - seen.here)
    first.between = not scene.tips(group, seen, goal)
    return group.goes(goal) if first.between else None
