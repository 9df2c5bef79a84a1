"""On a way back, and after it: where a group goes next, and when it is over."""

from __future__ import annotations

import numpy as np

from tci.gate.contact.between import leave_both
from tci.gate.contact.following import CLEAR
from tci.gate.contact.group import MOVES, Group
from tci.gate.contact.noticing import SIGN, Seen
from tci.gate.contact.path import FURTHER, STEP
from tci.gate.contact.scene import Scene
from tci.gate.contact.softness import LIGHT
from tci.messages.frames import Array

SETTLES = 0.12
"""Time [s] after the end of a way back at which a joint is judged: it lags by less."""
SETTLED = 0.02
"""The same [s] beyond the lag of joints that is known."""
STILL = 0.5
"""Fraction of the torque that counts from which on a joint still presses after a way back: twice what dry
friction is that turned."""
EASES = 0.25
"""The same from which on a part eases that bears the opposite of what it bore when it met the first. It may
be no more than dry friction that turned, so the way is short."""
UNLOADS = float(np.deg2rad(0.05))
"""Angle [rad] by which a reference goes nearer to its joint at least: as fine as encoders tell."""
SWINGS = 0.5
"""Share of what a joint bears that counts while its part still swings after a way back."""


def go_on(scene: Scene, group: Group, seen: Seen) -> Array | None:
    """On a way back, and after it: where to go next, or None."""
    assert group.goal is not None
    assert group.first is not None
    here, settings = seen.here, scene.settings
    between = leave_both(scene, group, seen)
    if between is not None:
        return between
    mine = np.isin(seen.reference.servos, seen.servos[seen.own])
    if (np.abs(seen.reference.velocity[mine]) > 1e-6).any():
        group.since = np.inf
        if not group.first.meets_another(
            seen,
            group.goal,
            scene.following.side,
            held=settings.held,
            felt=settings.felt_of(group.parts),
            now=scene.now,
        ):
            return None
        return _leave(scene, group, seen)
    group.since = min(group.since, scene.now)
    lag = float(scene.following.lags[seen.servos[seen.own]].max())
    if scene.now - group.since < min(SETTLES, lag + SETTLED):
        return None
    clear = CLEAR * settings.held
    group.sag.look(seen.references, here, seen.weights)
    held = bool(((seen.errors > clear) & (np.abs(seen.pull - group.sag.bent) > clear)).any())
    # a joint that nobody commands may have been moved on purpose: it is a reason to go on, not to wait
    bent = (bool(group.path) or group.first.steps > 0) and seen.bent > settings.held
    # a joint that still swings bears its own motion, too
    rests = not (np.abs(seen.joints.velocity[seen.servos]) >= MOVES).any()
    most = float(np.abs(seen.bears).max()) * (1.0 if rests else SWINGS)
    against = float(np.dot(seen.bears, group.push)) < -SIGN
    behind = most > 1.0 and group.first.may_turn and against
    # who is behind it would be pressed more
    further = bool(group.path) and not (against and rests)
    pressed = behind or (most > STILL and further)
    still = held or seen.felt.force > LIGHT
    thing = bool(group.thing) and (still or bent or pressed) and scene.thing(group, seen) is not None
    # at a thing there is no way back: what it bears there is no reason to go on
    if thing and still and not (group.answer == "stop" and not group.slow):
        if np.abs(here - group.goal).max() >= STEP:
            group.free = None
            return group.goes(here)
        # it lies there with its weight, and its next motion may lead away
        scene.forces.settle(seen.felt.contacts)
    elif still or ((bent or pressed) and not thing):
        group.free = None
        if group.answer == "stop" and not group.slow:
            return None
        group.thing = None
        if group.answer == "retreat" or group.slow:
            further = bent and not held and group.first.bends_more(seen, settings.held)
            if further or group.first.presses_another(seen, settings.held):
                return _leave(scene, group, seen)
            if behind:
                leaves = group.first.steps > 0
                return group.goes(group.first.room(here)) if leaves else _leave(scene, group, seen)
            out = None if held else _out(scene, group, seen)
            if group.path:
                goal = group.back(seen, np.inf, pulled=held)
                into = scene.places.into_strongest(seen, scene.on(group))
                if out is not None and into @ (goal - here) > 0.0:
                    group.path.clear()
                elif np.abs(goal - here).max() > STEP and not scene.tips(group, seen, goal):
                    return group.goes(goal)
            if out is not None:
                group.beyond += float(np.abs(out - here).max())
                return group.goes(out)
            if bent and not held:
                return group.goes(group.first.room(here))
        # nowhere to go: the reference goes where the joint is, and as far again if no weight bent it so
        goal = here - np.where(np.abs(seen.pull) > seen.weights, seen.pull, 0.0)
        return None if np.array_equal(goal, group.goal) else group.goes(goal)
    if against and most > EASES and not group.thing and group.first.may_ease:
        group.free = None
        return group.goes(group.first.eased(seen))
    if not group.thing and group.first.may_press(seen.references - here):
        return group.goes(group.first.last(here))
    stays = group.unloaded or group.thing or group.answer == "stop"
    unloaded = None if stays else _unloads(scene, group, seen)
    if unloaded is not None:
        group.unloaded = True
        return group.goes(unloaded)
    release(scene, group)
    return None


def _out(scene: Scene, group: Group, seen: Seen) -> Array | None:
    """Where a group goes (k,) [rad] that no path leads away from whoever its skin feels: out of there,
    all in all as far as a way back is long, since a patch may report a force for ever. Not into whoever held
    its joints."""
    assert group.first is not None
    way = scene.places.out(seen, scene.on(group))
    if way is None or group.beyond + np.abs(way).max() > FURTHER or group.first.pushed(way):
        return None
    return None if scene.tips(group, seen, seen.here + way) else seen.here + way


def _unloads(scene: Scene, group: Group, seen: Seen) -> Array | None:
    """Where the references of a soft group go (k,) [rad], so that its joints bear their weight only: when
    their stiffness comes back, they press nobody. None if nothing is known or to be done."""
    if not scene.softens(group) or seen.joints.torque is None:
        return None
    bears = seen.joints.torque[seen.servos]
    weighs = scene.bearing.weighs(seen.joints, group.before)[seen.servos]
    share = np.clip(weighs / np.where(bears == 0.0, np.inf, bears), 0.0, 1.0)
    goal: Array = seen.here + share * (seen.references - seen.here)
    return goal if np.abs(goal - seen.references).max() > UNLOADS else None


def _leave(scene: Scene, group: Group, seen: Seen) -> Array:
    """From somebody whom the group met on its way back: where it goes."""
    assert group.first is not None
    group.path.clear()
    group.first = group.first.next(seen, scene.now)
    return group.goes(group.first.room(seen.here))


def release(scene: Scene, group: Group) -> None:
    """A contact seems over: after a while the part obeys again."""
    group.free = scene.now if group.free is None else group.free
    if scene.now - group.free > scene.settings.quiet:
        group.goal, group.first, group.slow = None, None, False
        group.path.clear()
