"""The moment in which a group meets something: whether it does, and what it does then."""

from __future__ import annotations

import numpy as np

from tci.gate.contact.group import WITHIN, Group
from tci.gate.contact.led import crept, leaves, led
from tci.gate.contact.noticing import EARLIER, SOONER, Seen
from tci.gate.contact.others import First
from tci.gate.contact.scene import Scene
from tci.gate.contact.softness import LIGHT
from tci.gate.contact.weights import Sag
from tci.messages.frames import Array
from tci.messages.met import DOES
from tci.reasons import Code, Reason


def meet(scene: Scene, group: Group, seen: Seen, *, freeing: bool) -> tuple[Array | None, Reason | None]:
    """At a group that nothing has met so far: where it must go, and why."""
    noticing = group.noticing
    noticing.look(seen, scene.settings, moves=scene.moves_now(group))
    if not freeing and led(scene, group, seen):
        away = not group.softness.soft and leaves(scene, group, seen)
        return _soften(scene, group, seen, moves=away), None
    expected = LIGHT < seen.felt.force <= scene.handled(group)
    pulled, what = False, f"{seen.felt.force:.0f} N on its skin"
    if noticing.sure and scene.may_hold(group) and not expected:
        servo, angle = scene.robot.servos[seen.worst].name, np.rad2deg(seen.error)
        what = f"{servo} is held {angle:.1f} degrees behind"
        if noticing.bears and not noticing.held:
            what = _more(scene, seen)
        elif not noticing.held:
            servo, angle = scene.robot.servos[seen.loosest].name, np.rad2deg(seen.bent)
            what = f"{servo}, which nobody commands, is bent by {angle:.1f} degrees"
        rose = float(scene.bearing.rose[seen.servos].min())
        before, pulled = min(noticing.before(float(scene.following.lags[seen.worst])), rose - SOONER), True
    elif seen.felt.made > scene.allowed(group) or crept(scene, group, seen):
        before = max(seen.felt.since - SOONER, seen.joints.stamp - EARLIER)
    elif freeing and (noticing.held or seen.felt.force > LIGHT):
        before, pulled, group.slow = np.inf, noticing.held, True
    else:
        return _soften(scene, group, seen, moves=scene.moves(group)), None
    group.sag, group.before, group.push = Sag(), scene.bearing.before, seen.push
    stands = group.waist and bool(scene.soles)
    group.answer = "stop" if stands else group.wanted
    group.thing = None if group.slow else scene.thing(group, seen)
    stays = group.answer == "stop" and not group.slow
    if stays and not stands:
        goal = seen.references
    elif stays or group.thing or group.answer == "soft":
        goal = seen.here  # a reference ahead of the joint would press on
    else:
        goal = group.back(seen, before, pulled=pulled)
        if scene.tips(group, seen, goal):
            goal, group.answer = seen.here, "soft"
    group.first = First(seen.felt.of(seen.felt.own), seen, scene.now)
    _begin(scene, group, goal)
    does = DOES["stop" if group.thing else group.answer]
    does += " softly" * (scene.softens(group) and does == DOES["retreat"])
    return goal, Reason(Code.CONTACT, f"{group.name} met {group.thing or 'something'}: {what}; it {does}")


def _soften(scene: Scene, group: Group, seen: Seen, *, moves: bool) -> Array | None:
    """Where the reference of a group goes that somebody presses, if it gives way."""
    group.path.walk(seen.here, seen.joints.stamp)
    if group.waist and scene.soles:  # whoever pushes it, or a load, would make it lean
        group.softness.soft = False
        return None
    noticing = group.noticing
    return group.softness.step(
        seen.here, seen.references, seen.felt.force,
        most=scene.allowed(group), held=scene.settings.held, moves=moves,
        moved=group.moved, bent=noticing.sure and noticing.held, rests=scene.rests(group), now=scene.now,
    )  # fmt: skip


def _begin(scene: Scene, group: Group, goal: Array) -> None:
    group.goes(goal)
    group.beyond, group.unloaded = 0.0, False
    group.noticing.outside, group.softness.soft = 0, False
    if group.slow or group.thing:
        return
    group.reactions.append(scene.now)
    while scene.now - group.reactions[0] > WITHIN:
        group.reactions.popleft()


def _more(scene: Scene, seen: Seen) -> str:
    place = int(np.argmax(np.abs(seen.bears)))
    servo = int(seen.servos[place])
    torque = abs(float(seen.bears[place])) * scene.bearing.counts[servo]
    return f"{scene.robot.servos[servo].name} bears {torque:.1f} N m more than a moment ago"
