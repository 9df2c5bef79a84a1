"""What the gate does about contacts: a part that meets something on its way goes back where it came from.

A held joint (`following`), one that bears more than a moment ago (`bearing`), a bent one that nobody
commands (`noticing`), or a force on skin that began or grew while the part moved (`felt`) means contact. The
answer is the gate's own order: back along the measured path (`path`), further while the joint is still held,
but not into somebody else (`others`); where no path is left the reference goes to where the joint is, so that
nothing presses. Nobody else's order to these servos passes until the contact has been over for a while. A
resting part that somebody presses gives way (`softness`), and obeys.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tci.gate.contact.balance import Balance
from tci.gate.contact.bearing import Bearing
from tci.gate.contact.between import Between
from tci.gate.contact.easing import Easing
from tci.gate.contact.felt import Felt, FeltContact, FeltForces
from tci.gate.contact.following import CLEAR, PROGRESS, Following
from tci.gate.contact.group import Group, Way, make_groups
from tci.gate.contact.noticing import EARLIER, SIGN, SOONER, Seen, bounds
from tci.gate.contact.others import First
from tci.gate.contact.path import STEP
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.softness import LIGHT
from tci.gate.contact.streams import NEAR, PAUSE
from tci.gate.contact.things import Things
from tci.gate.contact.waiting import Waiting
from tci.gate.contact.weights import Sag, bends
from tci.gate.joint_monitor import Reference
from tci.messages import (
    CONTROL_MODES,
    Answer,
    Contacts,
    JointReading,
    Met,
    Mode,
    PlatformCommand,
    PlatformOrder,
)
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Patch, Robot
from tci.robot.joint_calibration import Tool

SETTLES = 0.12
"""Time [s] after the end of a way back at which a joint is judged: it lags by less."""
SETTLED = 0.02
"""The same [s] beyond the lag of joints that is known."""
FREES = float(np.deg2rad(10.0))
"""Speed [rad/s] with which `free` moves: slow enough to be stopped by hand."""
OFTEN, WITHIN = 3, 10.0
"""So many reactions of a part within so many seconds [s] end in STOP: somebody is there, and a behaviour
insists."""
MADE = 0.3
"""Time [s] after its reference moved last within which a part may have made a contact."""
EXPECTED_FOR = 0.5
"""Time [s] after which an `ExpectContact` expires: a capability that is silent for so long handles
nothing."""
MOVES = float(np.deg2rad(2.0))
"""Speed [rad/s] above which a reference moves a part, and so may have made a force."""
STILL = 0.5
"""Fraction of the torque that counts from which on a joint still presses after a way back: twice what dry
friction is that turned."""
SWINGS = 0.5
"""Share of what a joint bears that counts while its part still swings after a way back."""
DOES = {"retreat": "goes back", "soft": "gives way", "stop": "stops"}


class ContactReaction:
    """Notices contacts of a robot's groups of servos, and says where each of them must go."""

    def __init__(self, robot: Robot, groups: Sequence[int], settings: ContactSettings) -> None:
        """`groups` (n_servos,) is the number of each servo's group. Raises the errors of `make_groups`."""
        self._robot, self._settings = robot, settings
        self._balance, self._soles = Balance(robot), list[Patch]()
        known = self._balance.known
        self._groups, parts = make_groups(robot, groups, settings.answers, stands=known)
        self._forces = FeltForces(parts, lambda number: self._moves(self._groups[number]))
        self._following = Following(
            len(robot.servos), held=settings.held, lag=settings.lag, known=settings.stands
        )
        self._things = Things(robot, settings.fixtures)
        self._between = Between(robot)
        self._waiting = Waiting(robot, self._groups)
        self._bearing = Bearing(robot, known=settings.stands)
        self._easing = Easing(robot)
        self._position: Array | None = None
        self.load({})
        self._contacts: Contacts | None = None
        self._stamp = self._now = -np.inf
        self._freeing = False
        self.blocked: frozenset[int] = frozenset()
        """Servos that obey nobody else now, since they leave a contact."""
        self.led: frozenset[int] = frozenset()
        """Servos that somebody leads, harder than a capability handles: they need not follow now."""
        self.reason: Reason | None = None
        """Why the gate must stop: a part met something too often."""
        self.met: tuple[Met, ...] = ()
        """The contacts of the latest reading, from the lower threshold on."""

    def load(self, tools: Mapping[str, Tool]) -> None:
        """Sets what links carry, by the name of the link: its weight bends joints, too."""
        self._excused = bends(self._robot, tools)
        self._easing.load(self._robot, tools)

    def expect(self, servos: NDArray[np.intp], force: float, now: float) -> None:
        """Leaves contact up to `force` [N] on the skin of these servos' groups to a capability."""
        for group in self._groups_of(servos):
            group.expected, group.until = force, now + EXPECTED_FOR

    def refuses(self, order: PlatformOrder, position: Array, now: float) -> str | None:
        """Why an order at `now` [s] must not pass, in words, while the servos are at `position` (n_servos,)
        [rad]; None if it may. Raises CommandError for an invalid order."""
        named = np.ravel(order.servos).tolist()
        # an order that is invalid may name 10.0
        blocked = {servo for servo in self.blocked | self.waits if servo in named}
        found = [
            one
            for one in self._groups_of(order.servos)
            if one.stream.refuses(self._robot, order, position, now, blocked=bool(blocked & one.own))
        ]
        if blocked:
            parts = ", ".join(self.touched) or self._robot.servos[min(blocked)].robot_part
            return f"{parts} met something; valid: commands half a second after the contact"
        if found:
            names = ", ".join(one.name for one in found)
            return (
                f"{names} met something while this stream of orders went on; valid: one that begins within "
                f"{NEAR:g} degrees of where it is, or no order for {PAUSE:g} s"
            )
        return None

    def accepted(self, order: PlatformOrder, now: float) -> None:
        """Somebody's order passed at `now` [s]: servos that it moves don't give way any more, and those that
        it makes softer sag."""
        for group in self._groups_of(order.servos):
            if order.mode in CONTROL_MODES:
                group.softness.soft = False
            elif order.mode is Mode.STIFFNESS and isinstance(order, PlatformCommand):
                group.sags.told(order.servos, order.values, now)
                self._easing.told(order.servos)

    def sag_as(self, before: ContactReaction) -> None:
        """Takes over from one with other settings which joints were told to be softer."""
        self._easing = before._easing
        for number, group in self._groups.items():
            group.sags = before._groups[number].sags

    def free(self) -> None:
        """Sends every part that is in contact back with the next reading, slowly."""
        self._freeing = True

    def _groups_of(self, servos: NDArray[np.intp]) -> Iterator[Group]:
        named = np.ravel(servos).tolist()
        return (one for one in self._groups.values() if not one.own.isdisjoint(named))

    def ease(
        self, contacts: Contacts | None, joints: JointReading, now: float
    ) -> tuple[dict[int, float], list[Reason]]:
        """While angles are not what they seem: shares (0..1) of stiffness by servo, and what to tell, of each
        part that still answers a contact, or whose skin feels more than it answers from on."""
        if self._position is None:
            return {}, []
        return self._easing.look(
            self._groups, contacts or (), self._settings.felt, self._position, joints.powered, now
        )

    def give_back(self, joints: JointReading, commanded: NDArray[np.intp], now: float) -> dict[int, float]:
        """New shares (0..1) of stiffness, by servo, of those that `ease` made softer and that are among the
        `commanded` (k,) again."""
        pressed = frozenset(one.part for one in self.met)
        return self._easing.give_back(self._groups, pressed, joints.position, commanded, joints.powered, now)

    def forget(self) -> None:
        """Forgets paths and reactions, since the servos are under command no more."""
        self.blocked, self.led, self.reason, self.met = frozenset(), frozenset(), None, ()
        self._soles = []
        for group in self._groups.values():
            group.goal, group.slow, group.expected = None, False, 0.0
            group.softness.soft = False
        self._waiting.forget()
        self._forget_times()

    def _forget_times(self) -> None:
        """After the clock went back. Ways back that have begun go on."""
        self._following.forget()
        self._bearing.forget()
        self._stamp = -np.inf
        for group in self._groups.values():
            group.reactions.clear()
            group.since, group.free, group.moved = np.inf, None, -np.inf
            group.until, group.led = -np.inf, None
            group.noticing.forget()
            group.stream.forget()
            if group.goal is None:
                group.path.clear()

    @property
    def waits(self) -> frozenset[int]:
        """Servos that obey nobody while other parts leave a contact."""
        return self._waiting.servos - self.blocked

    @property
    def stays(self) -> frozenset[int]:
        """Those of them that must not move: all but what gives way to somebody who presses it."""
        waits = self.waits
        return waits.difference(*(one.own for one in self._groups.values() if waits and one.softness.soft))

    @property
    def waiting(self) -> tuple[Met, ...]:
        """The parts that obey nobody though nothing is met there now."""
        servos = self.blocked | self._waiting.servos
        if not servos:
            return ()
        groups = (one for one in self._groups.values() if not servos.isdisjoint(one.own))
        there = {one.part for one in self.met}
        parts = (part for group in groups for part in group.parts if part not in there)
        return tuple(Met(part, 0.0, None, 0.0, "waits") for part in parts)

    @property
    def touched(self) -> tuple[str, ...]:
        """Names of the parts that answer a contact which is not over, or are pressed with more than anybody
        expects."""
        answering = [one for one in self._groups.values() if one.goal is not None and one.free is None]
        answer = {part for one in answering for part in one.parts}
        most = self._settings.felt
        pressed = {one.part for one in self.met if one.force > most and one.answer != "expected"}
        return tuple(sorted(answer | pressed))

    def step(
        self, joints: JointReading, reference: Reference, now: float, contacts: Contacts | None
    ) -> tuple[list[Way], list[Reason]]:
        """One period: the ways that begin now, and what to tell."""
        if now < self._following.latest:
            self._forget_times()
        self._now = now
        self._following.remember(reference, now)
        self._bearing.remember(reference, now)
        self._note_motion(reference)
        if joints.stamp <= self._stamp:
            return [], []
        self._stamp, self._position = joints.stamp, joints.position
        self._easing.forget()
        felt, self._contacts = self._forces.step(contacts, joints.stamp), contacts
        if contacts is not None:  # while frames do not fit it goes on standing
            self._soles = self._balance.loaded(contacts)
        freeing, self._freeing = self._freeing, False
        bent = self._following.bent(joints)
        bears = self._bearing.more(joints, self._settings.lag)
        loose = bool((bent > self._settings.held).any() or (np.abs(bears) > 1.0).any())
        if not (self.blocked or felt or freeing or loose) and self._following.near(joints, reference):
            self._walk_all(joints, reference)
            self._following.learn(joints, reference)
            self.met, self.led = (), frozenset()
            self._waiting.forget()
            return [], []
        error = self._following.error(joints, reference)
        ways: list[Way] = []
        told: list[Reason] = []
        met: list[Met] = []
        for number, group in self._groups.items():
            own = np.isfinite(error[group.servos])
            if group.goal is None and not self._moves_now(group):
                self._following.rest(group.servos, joints)
            if not own.any():
                # in torque mode nothing is behind a reference, so only skin can tell that it is not over
                if group.goal is not None and felt.get(number, Felt()).force <= LIGHT:
                    self._release(group)
                continue
            here = joints.position[group.servos]
            sags = group.sags.look(np.abs(group.references(reference, joints.position) - here), now)
            excused = self._excused[group.servos]
            bound = bounds(excused, self._settings, rests=self._rests(group)) + sags
            excused = excused + sags
            errors = error[group.servos]
            left = bent[group.servos]
            left[~(left >= excused)] = 0.0
            seen = Seen(
                joints, reference, group.servos, here,
                self._following.pull[group.servos], own, errors, bound, excused,
                int(np.where(own, errors / bound, -1.0).argmax()), felt.get(number, Felt()), left,
                bears[group.servos] if group.goal is None else group.bears(joints, self._bearing),
            )  # fmt: skip
            goal: Array | None
            # after a way back, who still bends a joint that nobody commands is pressed with its full torque
            takes = (seen.loose > self._settings.held) & (group.goal is not None)
            if group.goal is None:
                goal, why = self._look(group, seen, freeing=freeing)
                if why:
                    told.append(why)
            else:
                if freeing:
                    group.slow, group.thing = True, None
                goal = self._judge(group, seen)
            if goal is not None:
                speed = FREES if group.slow else None
                sent = own | takes
                ways.append(Way(group.servos[sent], np.where(own, goal, here)[sent], speed))
            met += self._tell(group, seen)
        if met:
            self._following.doubt()
        else:
            self._following.learn(joints, reference)
        self.met = tuple(met)
        self.blocked = frozenset(
            int(s) for one in self._groups.values() if one.goal is not None for s in one.servos
        )
        self.led = frozenset(
            int(s)
            for one in self._groups.values()
            if one.led is not None and one.softness.soft
            for s in one.servos
        )
        return ways, told + self._waiting.look(felt, joints.position, reference)

    def _more(self, seen: Seen) -> str:
        place = int(np.argmax(np.abs(seen.bears)))
        servo = int(seen.servos[place])
        torque = abs(float(seen.bears[place])) * self._bearing.least[servo]
        return f"{self._robot.servos[servo].name} bears {torque:.1f} N m more than a moment ago"

    def _look(self, group: Group, seen: Seen, *, freeing: bool) -> tuple[Array | None, Reason | None]:
        """At a group that nothing has met so far: where it must go, and why."""
        noticing = group.noticing
        noticing.look(seen, self._settings, moves=self._moves_now(group))
        allowed = group.expected if self._now < group.until else 0.0
        if not freeing and self._led(group, seen, allowed):
            away = not group.softness.soft and self._into(group, seen) < 0.0
            return self._soften(group, seen, allowed, moves=away), None
        expected = LIGHT < seen.felt.force <= allowed
        pulled, what = False, f"{seen.felt.force:.0f} N on its skin"
        if noticing.sure and self._moves(group) and not expected:
            servo, angle = self._robot.servos[seen.worst].name, np.rad2deg(seen.error)
            what = f"{servo} is held {angle:.1f} degrees behind"
            if noticing.bears and not noticing.held:
                what = self._more(seen)
            elif not noticing.held:
                servo, angle = self._robot.servos[seen.loosest].name, np.rad2deg(seen.bent)
                what = f"{servo}, which nobody commands, is bent by {angle:.1f} degrees"
            before, pulled = noticing.before(float(self._following.lags[seen.worst])), True
        elif seen.felt.made > max(self._settings.felt, allowed):
            before = max(seen.felt.since - SOONER, seen.joints.stamp - EARLIER)
        elif freeing and (noticing.held or seen.felt.force > LIGHT):
            before, pulled, group.slow = np.inf, noticing.held, True
        else:
            return self._soften(group, seen, allowed, moves=self._moves(group)), None
        group.sag, group.before, group.push = Sag(), self._bearing.before, seen.push
        stands = group.waist and bool(self._soles)
        group.answer = "stop" if stands else group.wanted
        group.thing = None if group.slow else self._thing(group, seen)
        stays = group.answer == "stop" and not group.slow
        if stays and not stands:
            goal = self._references(group, seen)
        elif stays or group.thing or group.answer == "soft":
            goal = seen.here  # a reference ahead of the joint would press on
        else:
            goal = self._back(group, seen, before, pulled=pulled)
            if self._tips(group, seen, goal):
                goal, group.answer = seen.here, "soft"
        group.first = First(seen.felt.of(seen.felt.own), seen, self._now)
        self._begin(group, goal)
        does = DOES["stop" if group.thing else group.answer]
        return goal, Reason(Code.CONTACT, f"{group.name} met {group.thing or 'something'}: {what}; it {does}")

    def _led(self, group: Group, seen: Seen, allowed: float) -> bool:
        """True if somebody leads a group whose contact a capability handles, harder than that, up to
        `allowed` [N]: a way back would lead into them."""
        handled = self._now < group.until or (group.led is not None and group.softness.soft)
        if not handled or seen.felt.force <= max(self._settings.felt, allowed):
            return False
        strongest = max(seen.felt.contacts, key=lambda one: seen.felt.contacts[one].force)
        if group.led != strongest or self._into(group, seen) > 0.0:
            leads = self._between.leads(group, seen, self._contacts or ())
            group.led = strongest if leads else None
        if group.led is not None:
            self._between.forget_way_in(group, seen, self._contacts or ())
        return group.led is not None

    def _into(self, group: Group, seen: Seen) -> float:
        return self._between.speed_into(group, seen, self._contacts or ())

    def _soften(self, group: Group, seen: Seen, allowed: float, *, moves: bool) -> Array | None:
        """Where the reference of a group goes that somebody presses, if it gives way."""
        group.path.walk(seen.here, seen.joints.stamp)
        if group.waist and self._soles:  # whoever pushes it, or a load, would make it lean
            group.softness.soft = False
            return None
        noticing = group.noticing
        return group.softness.step(
            seen.here, self._references(group, seen), seen.felt.force,
            most=max(self._settings.felt, allowed), held=self._settings.held, moves=moves,
            moved=group.moved, bent=noticing.sure and noticing.held, rests=self._rests(group), now=self._now,
        )  # fmt: skip

    def _tips(self, group: Group, seen: Seen, goal: Array) -> bool:
        """True if a standing robot would not stand any more with the group at `goal` (k,) [rad]."""
        there = seen.joints.position.copy()
        there[group.servos] = goal
        return self._balance.tips(self._soles, seen.joints.position, there)

    def _thing(self, group: Group, seen: Seen) -> str | None:
        """What the group met if nobody is to be freed there, in words."""
        reference = seen.joints.position.copy()
        reference[seen.reference.servos] = seen.reference.position
        felt = [one for one in seen.felt.contacts.values() if one.force > LIGHT]
        others: dict[str, list[FeltContact]] = {}
        for one in self._contacts or ():
            if one.part not in group.parts and one.force > LIGHT:
                link = self._robot.patch(one.patch).link
                others.setdefault(link, []).append(FeltContact(one.force, one.n_T, one.p_T))
        return self._things.met(group.servos, seen.joints.position, reference, felt, others)

    def _references(self, group: Group, seen: Seen) -> Array:
        return group.references(seen.reference, seen.joints.position)

    def _back(self, group: Group, seen: Seen, before: float, *, pulled: bool) -> Array:
        pull = seen.pull if pulled else np.zeros(len(seen.pull))
        return group.path.back(seen.here, before, seen.own, pull)

    def _moves(self, group: Group) -> bool:
        """True if a group may have made a contact: it moves, or did a moment ago, and not because somebody
        pushes it."""
        return not group.softness.soft and self._now - group.moved < MADE

    def _rests(self, group: Group) -> bool:
        """True if a group has rested for so long that nothing lags any more."""
        return self._now - group.moved > self._settings.lag + PROGRESS

    def _moves_now(self, group: Group) -> bool:
        """True while the latest readings may tell of a reference that moved."""
        return self._now - group.moved <= self._settings.lag

    def _tell(self, group: Group, seen: Seen) -> Iterator[Met]:
        over = group.goal is None or group.free is not None
        least = max(0.5 * self._settings.held, seen.excused)
        held = group.noticing.sure or (group.goal is not None and seen.error > least)
        if over and not held and seen.felt.force < self._settings.told:
            return
        answer: Answer = "told"
        if group.goal is not None:
            answer = "stop" if group.thing else group.answer
        elif group.softness.soft:
            answer = "soft"
        elif self._now < group.until and seen.felt.force <= group.expected:
            answer = "expected"
        worst, error = seen.worst, seen.error
        if error <= least and group.noticing.bears:  # only torques tell
            worst, error = int(seen.servos[np.argmax(np.abs(seen.bears))]), 0.0
        joint = self._robot.servos[worst].name if held else None
        for part in group.parts:
            yield Met(part, seen.felt.force, joint, error if held else 0.0, answer)

    def _release(self, group: Group) -> None:
        """A contact seems over: after a while the part obeys again."""
        group.free = self._now if group.free is None else group.free
        if self._now - group.free > self._settings.quiet:
            group.goal, group.first, group.slow = None, None, False
            group.path.clear()

    def _judge(self, group: Group, seen: Seen) -> Array | None:
        """On a way back, and after it: where to go next, or None."""
        assert group.goal is not None
        assert group.first is not None
        here, settings = seen.here, self._settings
        between = self._between.leave(
            group, seen, self._contacts or (), felt=settings.felt, now=self._now,
            tips=lambda goal: self._tips(group, seen, goal),
        )  # fmt: skip
        if between is not None:
            return between
        mine = np.isin(seen.reference.servos, seen.servos[seen.own])
        if (np.abs(seen.reference.velocity[mine]) > 1e-6).any():
            group.since = np.inf
            if not group.first.meets_another(
                seen, group.goal, self._following.side, held=settings.held, felt=settings.felt, now=self._now
            ):
                return None
            return self._leave(group, seen)
        group.since = min(group.since, self._now)
        lag = float(self._following.lags[seen.servos[seen.own]].max())
        if self._now - group.since < min(SETTLES, lag + SETTLED):
            return None
        clear = CLEAR * settings.held
        group.sag.look(self._references(group, seen), here, seen.weights)
        held = bool(((seen.errors > clear) & (np.abs(seen.pull - group.sag.bent) > clear)).any())
        # a joint that nobody commands may have been moved on purpose: it is a reason to go on, not to wait
        bent = (bool(group.path) or group.first.steps > 0) and seen.bent > settings.held
        # a joint that still swings bears its own motion, too
        rests = not (np.abs(seen.joints.velocity[seen.servos]) >= MOVES).any()
        most = float(np.abs(seen.bears).max()) * (1.0 if rests else SWINGS)
        behind = most > 1.0 and group.first.may_turn and float(np.dot(seen.bears, group.push)) < -SIGN
        pressed = behind or (most > STILL and bool(group.path))
        still = held or seen.felt.force > LIGHT
        thing = bool(group.thing) and (still or bent or pressed) and self._thing(group, seen) is not None
        # at a thing there is no way back: what it bears there is no reason to go on
        if still or ((bent or pressed) and not thing):
            group.free = None
            if group.answer == "stop" and not group.slow:
                return None
            if thing:
                return None if np.abs(here - group.goal).max() < STEP else group.goes(here)
            group.thing = None
            if group.answer == "retreat" or group.slow:
                further = bent and not held and group.first.bends_more(seen, settings.held)
                if further or group.first.presses_another(seen, settings.held):
                    return self._leave(group, seen)
                if behind:
                    leaves = group.first.steps > 0
                    return group.goes(group.first.room(here)) if leaves else self._leave(group, seen)
                if group.path:
                    goal = self._back(group, seen, np.inf, pulled=held)
                    if np.abs(goal - here).max() > STEP and not self._tips(group, seen, goal):
                        return group.goes(goal)
                if bent and not held:
                    return group.goes(group.first.room(here))
            # nowhere to go: the reference goes where the joint is, and as far again if no weight bent it so
            goal = here - np.where(np.abs(seen.pull) > seen.weights, seen.pull, 0.0)
            return None if np.array_equal(goal, group.goal) else group.goes(goal)
        if not group.thing and group.first.may_press(self._references(group, seen) - here):
            return group.goes(group.first.last(here))
        self._release(group)
        return None

    def _leave(self, group: Group, seen: Seen) -> Array:
        """From somebody whom the group met on its way back: where it goes."""
        assert group.first is not None
        group.path.clear()
        group.first = group.first.next(seen, self._now)
        return group.goes(group.first.room(seen.here))

    def _walk_all(self, joints: JointReading, reference: Reference) -> None:
        for group in self._groups.values():
            here = joints.position[group.servos]
            group.softness.let_go(self._now)
            group.noticing.nothing(joints.stamp)
            group.path.walk(here, joints.stamp)
            if not self._moves_now(group):
                self._following.rest(group.servos, joints)
            if not (self._moves(group) or group.softness.soft):
                bent = group.references(reference, joints.position) - here
                group.softness.rest(bent, group.moved)

    def _begin(self, group: Group, goal: Array) -> None:
        group.goes(goal)
        group.noticing.outside, group.softness.soft = 0, False
        if group.slow or group.thing:
            return
        group.reactions.append(self._now)
        while self._now - group.reactions[0] > WITHIN:
            group.reactions.popleft()
        if len(group.reactions) >= OFTEN:
            words = f"{group.name} met something {OFTEN} times within {WITHIN:.0f} s"
            self.reason = Reason(Code.CONTACT, words)

    def _note_motion(self, reference: Reference) -> None:
        moving = reference.servos[np.abs(reference.velocity) > MOVES].tolist()
        for group in self._groups.values():
            if not group.own.isdisjoint(moving):
                group.moved = self._now
