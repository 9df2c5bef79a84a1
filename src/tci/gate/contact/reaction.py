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
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.contact.balance import Balance
from tci.gate.contact.easing import Easing
from tci.gate.contact.felt import Felt
from tci.gate.contact.following import CLEAR
from tci.gate.contact.group import MOVES, Group, Way, make_groups
from tci.gate.contact.noticing import Seen, bounds
from tci.gate.contact.onset import meet
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.scene import Scene
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.softness import LIGHT
from tci.gate.contact.streams import PAUSE, STREAMED
from tci.gate.contact.waiting import Waiting
from tci.gate.contact.way_back import go_on, release
from tci.gate.contact.weights import bends
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
from tci.reasons import Reason
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool

FREES = float(np.deg2rad(10.0))
"""Speed [rad/s] with which `free` moves: slow enough to be stopped by hand."""
EXPECTED_FOR = 0.5
"""Time [s] after which an `ExpectContact` expires: a capability that is silent for so long handles
nothing."""


class ContactReaction:
    """Notices contacts of a robot's groups of servos, and says where each of them must go."""

    def __init__(self, robot: Robot, groups: Sequence[int], settings: ContactSettings) -> None:
        """`groups` (n_servos,) is the number of each servo's group. Raises the errors of `make_groups`."""
        self._robot, self._settings = robot, settings
        for part in settings.of_parts:
            robot.part(part)
        balance = Balance(robot)
        self._groups, parts = make_groups(robot, groups, settings.answers, stands=balance.known)
        weight = OwnWeight(robot)
        self._scene = Scene(robot, settings, balance, weight, self._groups, parts)
        self._waiting = Waiting(robot, self._groups)
        self._easing = Easing(robot, weight)
        self._position: Array | None = None
        self.load({})
        self._stamp = -np.inf
        self._freeing = False
        self.blocked: frozenset[int] = frozenset()
        """Servos that obey nobody else now, since they leave a contact."""
        self.led: frozenset[int] = frozenset()
        """Servos that somebody leads, harder than a capability handles: they need not follow now."""
        self.overshoots: frozenset[int] = frozenset()
        """Servos that ran beyond their references and brake, or yield to what motion asks of their motors."""
        self.reason: Reason | None = None
        """Why the gate must stop: a part met something too often."""
        self.softer: dict[int, float] = {}
        """New shares (0..1) of stiffness, by servo, of parts that just met somebody."""
        self.met: tuple[Met, ...] = ()
        """The contacts of the latest reading, from the lower threshold on."""

    def load(self, tools: Mapping[str, Tool]) -> None:
        """Sets what links carry, by the name of the link: its weight bends joints, too."""
        self._excused = bends(self._robot, tools)
        self._easing.load(self._robot, tools)
        self._scene.bearing.load(tools)
        self._scene.overloads.load(self._scene.bearing.dynamics)

    @property
    def torques_tell(self) -> bool:
        """Measured torques of the latest reading tell of contact."""
        return self._scene.bearing.tells

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
            if one.stream.refuses(
                self._robot,
                order,
                position,
                now,
                blocked=bool(blocked & one.own),
                handled=self._scene.handled(one) > 0.0,
            )
        ]
        if blocked:
            own = (part for one in self._groups.values() if blocked & one.own for part in one.parts)
            parts = ", ".join(self.touched or own)
            return f"{parts} met something; valid: commands half a second after the contact"
        if found:
            names = ", ".join(one.name for one in found)
            return (
                f"{names} met something while this stream of orders went on; valid: {STREAMED[order.mode]}, "
                f"or no order for {PAUSE:g} s"
            )
        return None

    def closed(self, order: PlatformOrder, now: float) -> None:
        """Notes an order at `now` [s] that did not pass for another cause: a stream goes on."""
        if self._position is not None and isinstance(order, PlatformOrder):
            with suppress(CommandError):
                self.refuses(order, self._position, now)

    def accepted(self, order: PlatformOrder, now: float) -> None:
        """Somebody's order passed at `now` [s]: servos that it moves don't give way any more, and those that
        it makes softer sag."""
        for group in self._groups_of(order.servos):
            if order.mode in CONTROL_MODES:
                group.softness.soft = False
            elif order.mode is Mode.STIFFNESS and isinstance(order, PlatformCommand):
                group.sags.told(order.servos, order.values, now)
                self._easing.told(order.servos)

    @property
    def lags(self) -> Array:
        """Time (n_servos,) [s] by which a joint lags at most that nothing holds."""
        return self._scene.following.lags

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
            self._groups, contacts or (), self._settings, self._position, joints.powered, now
        )

    def give_back(self, joints: JointReading, commanded: NDArray[np.intp], now: float) -> dict[int, float]:
        """New shares (0..1) of stiffness, by servo, of those that `ease` made softer and that are among the
        `commanded` (k,) again."""
        pressed = frozenset(one.part for one in self.met)
        return self._easing.give_back(self._groups, pressed, joints.position, commanded, joints.powered, now)

    def forget(self) -> None:
        """Forgets paths and reactions, since the servos are under command no more."""
        self.blocked, self.led, self.reason, self.met = frozenset(), frozenset(), None, ()
        self._scene.soles = []
        for group in self._groups.values():
            group.goal, group.slow, group.expected = None, False, 0.0
            group.softness.soft = False
        self._waiting.forget()
        self._forget_times()

    def _forget_times(self) -> None:
        """After the clock went back. Ways back that have begun go on."""
        self._scene.following.forget()
        self._scene.bearing.forget()
        self._scene.overloads.forget()
        self._stamp = -np.inf
        for group in self._groups.values():
            group.reactions.clear()
            group.since, group.free, group.moved = np.inf, None, -np.inf
            group.until, group.led = -np.inf, None
            group.noticing.forget()
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
        answering = [one for one in self._groups.values() if one.answers]
        answer = {part for one in answering for part in one.parts}
        most = {
            part: self._settings.felt_of(one.parts) for one in self._groups.values() for part in one.parts
        }
        pressed = {one.part for one in self.met if one.force > most[one.part] and one.answer != "expected"}
        return tuple(sorted(answer | pressed))

    def step(
        self, joints: JointReading, reference: Reference, now: float, contacts: Contacts | None
    ) -> tuple[list[Way], list[Reason]]:
        """One period: the ways that begin now, and what to tell."""
        scene = self._scene
        if now < scene.following.latest:
            self._forget_times()
        scene.now = now
        scene.following.remember(reference, now)
        scene.bearing.remember(reference, now)
        scene.overloads.remember(reference, joints.position, now)
        self._note_motion(reference)
        if joints.stamp <= self._stamp:
            return [], []
        self._stamp, self._position = joints.stamp, joints.position
        self._easing.forget()
        felt, scene.contacts = scene.forces.step(contacts, joints.stamp), contacts or ()
        if contacts is not None:  # while frames do not fit it goes on standing
            scene.soles = scene.balance.loaded(contacts)
        freeing, self._freeing = self._freeing, False
        self.softer = {}
        bent = scene.following.bent(joints)
        bears = scene.bearing.more(joints, scene.following.lags, scene.following.runs.swing(joints.stamp))
        loose = bool((bent > scene.settings.held).any() or (np.abs(bears) > 1.0).any())
        if not (self.blocked or felt or freeing or loose) and scene.following.near(joints, reference):
            self._walk_all(joints, reference)
            scene.following.learn(joints, reference)
            self.met, self.led, self.overshoots = (), frozenset(), frozenset()
            self._waiting.forget()
            return [], []
        error = scene.following.error(joints, reference, scene.overloads)
        self.overshoots = frozenset(np.flatnonzero(scene.following.beyond).tolist())
        soft = any(one.sags.soft for one in self._groups.values())
        weights = self._easing.weights(joints.position) if soft else np.zeros(len(error))
        ways: list[Way] = []
        told: list[Reason] = []
        met: list[Met] = []
        for number, group in self._groups.items():
            own = np.isfinite(error[group.servos])
            if group.goal is None and not scene.moves_now(group):
                scene.following.rest(group.servos, joints)
            if not own.any():
                # in torque mode nothing is behind a reference, so only skin can tell that it is not over
                if group.goal is not None and felt.get(number, Felt()).force <= LIGHT:
                    release(scene, group)
                continue
            here = joints.position[group.servos]
            behind = group.references(reference, joints.position) - here
            sags = group.sags.look(behind, weights[group.servos], now, moves=scene.moves_now(group))
            excused = self._excused[group.servos]
            bound = bounds(excused, scene.settings, rests=scene.rests(group)) + sags
            excused = excused + sags
            errors = error[group.servos]
            left = bent[group.servos]
            left[~(left >= excused)] = 0.0
            seen = Seen(
                joints, reference, group.servos, here,
                scene.following.pull[group.servos], own, errors, bound, excused,
                int(np.where(own, errors / bound, -1.0).argmax()), felt.get(number, Felt()), left,
                bears[group.servos] if group.goal is None else group.bears(joints, scene.bearing),
            )  # fmt: skip
            goal: Array | None
            # after a way back, who still bends a joint that nobody commands is pressed with its full torque
            takes = (seen.loose > scene.settings.held) & (group.goal is not None)
            if group.goal is None:
                goal, why = meet(scene, group, seen, freeing=freeing)
                if why:
                    told.append(why)
                    self.reason = group.too_often or self.reason
            else:
                if freeing:
                    group.slow, group.thing = True, None
                goal = go_on(scene, group, seen)
            if scene.softens(group) and group.answers and not (group.thing or group.answer == "stop"):
                weighs = scene.bearing.weighs(joints, group.before)
                late = errors > CLEAR * scene.settings.held
                self.softer |= self._easing.yields(group, seen, weighs, late, now)
            if goal is not None:
                speed = FREES if group.slow else None
                sent = own | takes
                ways.append(Way(group.servos[sent], np.where(own, goal, here)[sent], speed))
            met += self._tell(group, seen)
        if met:
            scene.following.doubt()
        else:
            scene.following.learn(joints, reference)
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

    def _tell(self, group: Group, seen: Seen) -> Iterator[Met]:
        over = group.goal is None or group.free is not None
        least = max(0.5 * self._scene.settings.held, seen.excused)
        held = group.noticing.sure or (group.goal is not None and seen.error > least)
        if over and not held and seen.felt.force < self._settings.told_of(group.parts):
            return
        answer: Answer = "told"
        if group.goal is not None:
            answer = "stop" if group.thing else group.answer
        elif group.softness.soft:
            answer = "soft"
        elif self._scene.now < group.until and seen.felt.force <= group.expected:
            answer = "expected"
        worst, error, bears = seen.worst, seen.error if held else 0.0, np.abs(seen.bears)
        loaded = error <= least and bool((bears > 1.0).any()) and (held or not over)
        if loaded:  # only torques tell
            worst, error = int(seen.servos[np.argmax(bears)]), 0.0
        joint = self._robot.servos[worst].name if held or loaded else None
        for part in group.parts:
            yield Met(part, seen.felt.force, joint, error, answer)

    def _walk_all(self, joints: JointReading, reference: Reference) -> None:
        for group in self._groups.values():
            here = joints.position[group.servos]
            group.softness.let_go(self._scene.now)
            group.noticing.nothing(joints.stamp)
            group.path.walk(here, joints.stamp)
            if not self._scene.moves_now(group):
                self._scene.following.rest(group.servos, joints)
            if not (self._scene.moves(group) or group.softness.soft):
                bent = group.references(reference, joints.position) - here
                group.softness.rest(bent, group.moved)

    def _note_motion(self, reference: Reference) -> None:
        moving = reference.servos[np.abs(reference.velocity) > MOVES].tolist()
        for group in self._groups.values():
            if not group.own.isdisjoint(moving):
                group.moved = self._scene.now
