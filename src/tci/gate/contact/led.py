"""Whether a hand leads a group, harder than a capability handles."""

from __future__ import annotations

import numpy as np

from tci.gate.contact.group import Group
from tci.gate.contact.noticing import Seen
from tci.gate.contact.places import ROOM
from tci.gate.contact.scene import Scene


def led(scene: Scene, group: Group, seen: Seen) -> bool:
    """True if somebody leads a group whose contact a capability handles, harder than that: a way back would
    lead into them."""
    handled = scene.now < group.until or (group.led is not None and group.softness.soft)
    if not handled or seen.felt.force <= scene.allowed(group):
        return False
    strongest = max(seen.felt.contacts, key=lambda one: seen.felt.contacts[one].force)
    into = scene.places.into_strongest(seen, scene.on(group))
    if group.led != strongest or speed_into(scene, group, seen) > 0.0:
        # its way back would press them, or would not leave them
        leads = bool(into.any()) and float(into @ group.path.came(seen.here, seen.own)) > -ROOM
        group.led = strongest if leads else None
    if group.led is not None and into @ group.path.came(seen.here, seen.own) > 0.0:
        group.path.clear()  # what it goes into them later is its way back
    return group.led is not None


def speed_into(scene: Scene, group: Group, seen: Seen) -> float:
    """Speed [m/s] with which a group's reference goes into whoever presses it most."""
    rates = np.zeros(len(seen.joints.position))
    rates[seen.reference.servos] = seen.reference.velocity
    return float(scene.places.into_strongest(seen, scene.on(group)) @ rates[seen.servos])
