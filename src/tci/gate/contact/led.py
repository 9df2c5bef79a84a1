"""Whether a hand leads a group, or the group went into the hand."""

from __future__ import annotations

from tci.gate.contact.group import Group
from tci.gate.contact.noticing import Seen
from tci.gate.contact.places import ROOM
from tci.gate.contact.scene import Scene

LEAVING, OUTWARD = 0.01, 0.5
"""Speed [m/s] with which a place must leave whoever presses it, and share of its whole speed: where it goes
along them, a patch whose normal is 30 degrees off could take pressing for leaving."""


def led(scene: Scene, group: Group, seen: Seen) -> bool:
    """True if somebody leads a group, harder than a capability handles: a way back would lead into them."""
    allowed = scene.allowed(group)
    met = group.led is None and group.noticing.sure and scene.moves(group)
    if met or seen.felt.force <= allowed:
        return False
    handled = scene.now < group.until or (group.led is not None and group.softness.soft)
    if not handled and seen.felt.made <= allowed:
        return False
    strongest = max(seen.felt.contacts, key=lambda one: seen.felt.contacts[one].force)
    into = scene.places.into_strongest(seen, scene.on(group))
    came, speed = float(into @ group.path.came(seen.here, seen.own)), speed_into(scene, group, seen)
    if group.led != strongest or speed > 0.0 or (speed < 0.0 and not handled):
        # its way back would press them or, if somebody handled them so far, would not leave them
        alone = min(seen.felt.sides) <= allowed and not group.noticing.sure
        goes = leaves(scene, group, seen) or (came > ROOM and speed <= 0.0)
        went = group.led is None and seen.felt.made > allowed and speed > 0.0
        leads = came > -ROOM and not went if handled else alone and goes
        group.led = strongest if leads and into.any() else None
    if came > (ROOM if group.led is None else 0.0):
        group.path.clear()  # what it goes into them later is its way back
    return group.led is not None


def crept(scene: Scene, group: Group, seen: Seen) -> bool:
    """True if a group presses somebody into whom it goes, and came, more slowly than what counts as
    motion."""
    if seen.felt.force <= scene.allowed(group) or speed_into(scene, group, seen) <= 0.0:
        return False
    into = scene.places.into_strongest(seen, scene.on(group))
    return bool(into @ group.path.came(seen.here, seen.own) < -ROOM)


def leaves(scene: Scene, group: Group, seen: Seen) -> bool:
    """True if a group's reference leaves whoever presses it most, and does not go along them."""
    speed, out = scene.places.speed_out(seen, scene.on(group))
    return out > max(LEAVING, OUTWARD * speed)


def speed_into(scene: Scene, group: Group, seen: Seen) -> float:
    """Speed [m/s] with which a group's reference goes into whoever presses it most."""
    return float(scene.places.into_strongest(seen, scene.on(group)) @ seen.rates)
