"""Contact as a cause of its own: a part that meets something on its way goes back where it came from.

A joint that is held differs from one that lags: a lagging joint is where its reference was a moment ago, a
held one is nowhere on that way, or stands while its reference went on. That, or a force on skin that began
or grew while the part moved, means contact. The answer is the gate's own order: back along the
measured path, further while the joint is still held; where no path is left the reference goes to where
the joint is, so that nothing presses. Nobody else's order to these servos passes until the contact has been
over for a while. A resting part that somebody presses gives way, and obeys.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import UnknownNameError
from tci.gate.contact.felt import Felt, FeltForces
from tci.gate.contact.following import CLEAR, PROGRESS, Following
from tci.gate.joint_monitor import Reference
from tci.messages import Answer, Contacts, JointReading, Met
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot

KEPT = 3.0
"""Length [s] of the path that is remembered: more than any way back needs."""
STEP = float(np.deg2rad(0.2))
"""Angle [rad] between two postures of the path."""
EARLIER = 0.15
"""Time [s] by which the way back ends before the contact was seen: by then the joint was not held yet."""
FURTHER = float(np.deg2rad(3.0))
"""Angle [rad] of each further way back while the joint is still held."""
AT_REST = 0.6
"""Fraction of `held` at which a joint counts as held once its reference has rested for `lag` and a little:
nothing lags then, so less tells more."""
SETTLES = 0.12
"""Time [s] after the end of a way back at which a joint is judged: it lags by less."""
LIGHT = 5.0
"""Force [N] on skin below which a contact is over, as a person feels it."""
UNLOADED = 1.0
"""Force [N] on skin below which nothing bends a resting joint."""
YIELDS = float(np.deg2rad(0.3))
"""Angle [rad] by which somebody bends a soft joint before its reference follows: more than encoders step, and
half of what 15 N bend a stiff arm by."""
FREES = float(np.deg2rad(10.0))
"""Speed [rad/s] with which `free` moves: slow enough to be stopped by hand."""
OFTEN, WITHIN = 3, 10.0
"""So many reactions of a part within so many seconds [s] end in STOP: somebody is there, and a behaviour
insists."""
FELT_LATE = 0.2
"""Time [s] by which skin feels later whom a joint already told: frames of 50 Hz, conditioned."""
ROOM = 0.2
"""Fraction of the way to the first person by which a part leaves a second one, whom it met on its way back:
at 0.5 it pressed the first again where they stand 5 mm apart, at 0 the second."""
MADE = 0.3
"""Time [s] after its reference moved last within which a part may have made a contact."""
EXPECTED_FOR = 0.5
"""Time [s] after which an `ExpectContact` expires: a capability that is silent for so long handles
nothing."""
MOVES = float(np.deg2rad(2.0))
"""Speed [rad/s] above which a reference moves a part, and so may have made a force."""


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """When a contact counts, and how the gate answers it."""

    held: float = float(np.deg2rad(2.0))
    """Angle [rad] outside the recent references at which a joint counts as held. At half of it dry friction
    of 5 % of the torque and masses wrong by 20 % count too; at double a stiff servo presses with twice the
    force."""
    lag: float = 0.1
    """Time [s] by which a healthy joint follows: three periods of 100 Hz, a reading of 14 ms, a servo of
    60 rad/s."""
    told: float = 5.0
    """Force [N] on skin from which on a contact is told, in `SafeCommand.met`."""
    felt: float = 15.0
    """Force [N] on skin above which a part that made the contact answers, and a resting part that somebody
    presses gives way. ISO/TS 15066 permits 65 N and more; people guide an arm with less than this."""
    stands: bool = True
    """Whether a joint that stands while its reference goes on is held."""
    quiet: float = 0.5
    """Time [s] without contact after which the part obeys again."""
    answers: Mapping[str, Literal["retreat", "soft", "stop"]] = field(default_factory=dict)
    """What a generic part does that made a contact, by its name: go back (which is the default), give way
    where it is, or stay stiff where its reference stopped."""


class Way(NamedTuple):
    """Where servos go on the gate's own order."""

    servos: NDArray[np.intp]
    """(k,)."""
    angles: Array
    """(k,) [rad]."""
    speed: float | None
    """[rad/s]; None is their full speed."""


@dataclass(slots=True)
class _Group:
    """One group of servos that move together."""

    servos: NDArray[np.intp]
    parts: tuple[str, ...]
    answer: Literal["retreat", "soft", "stop"] = "retreat"
    path: deque[tuple[float, Array]] = field(default_factory=deque)
    outside: int = 0
    """Successive new readings outside the recent references."""
    seen: float = 0.0
    """When the first of them was measured [s]."""
    goal: Array | None = None
    """Where the present way back ends [rad]; None without a reaction."""
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
    clear: float = -np.inf
    """When nothing held any of its joints last [s]."""
    bent: Array | None = None
    """Angles [rad] between reference and joint when it rested unloaded: gravity's work."""
    soft: bool = False
    """Somebody presses the resting part, and its reference follows."""
    slow: bool = False
    """It is freed on an operator's word."""
    first: Mapping[int, Array] = field(default_factory=dict)
    """Normals (3,) of the contacts from which it goes back, by their identity."""
    begun: float = -np.inf
    """When [s]."""
    there: Array = field(default_factory=lambda: np.zeros(0))
    """Where it met them (k,) [rad]."""
    pull: Array = field(default_factory=lambda: np.zeros(0))
    """Angles (k,) [rad] by which its joints were behind when it met the first."""
    pressed: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    """Joints (k,) that press the first since then."""
    behind: int = 0
    """Successive readings in which a joint is held on its way back."""

    @property
    def name(self) -> str:
        return " and ".join(self.parts)


class _Seen(NamedTuple):
    """What a new reading says of one group."""

    joints: JointReading
    reference: Reference
    own: NDArray[np.intp]
    """Its servos that follow a reference."""
    worst: int
    """The one that follows least."""
    error: float
    """By how much [rad]."""
    felt: Felt
    loosest: int
    """The servo that nobody commands and that left its place by most."""
    bent: float
    """By how much [rad]."""


DOES = {"retreat": "goes back", "soft": "gives way", "stop": "stops"}


class ContactReaction:
    """Notices contacts of a robot's groups of servos, and says where each of them must go."""

    def __init__(self, robot: Robot, groups: Sequence[int], settings: ContactSettings) -> None:
        """`groups` (n_servos,) is the number of each servo's group. Raises UnknownNameError if the settings
        name a part that the robot lacks."""
        self._robot, self._settings = robot, settings
        self._groups: dict[int, _Group] = {}
        # legs carry the robot, so they stop and stay stiff; a grasp loads the fingers on purpose
        others = {
            groups[one.servo]
            for part in robot.parts
            if part.kind in ("leg", "fingers")
            for one in part.servos
            if one.servo is not None
        }
        parts: dict[str, set[int]] = {
            part.name: {groups[one.servo] for one in part.servos if one.servo is not None} - others
            for part in robot.parts
        }
        for number in dict.fromkeys(groups):
            if number in others:
                continue
            own = [servo for servo, group in enumerate(groups) if group == number]
            names = [name for name, numbers in parts.items() if number in numbers]
            self._groups[number] = _Group(np.array(own), tuple(names) or (robot.servos[own[0]].robot_part,))
        for name, answer in settings.answers.items():
            if name not in parts:
                raise UnknownNameError("part", name, parts)
            for number in parts[name]:
                self._groups[number].answer = answer
        self._forces = FeltForces(parts, lambda number: self._moves(self._groups[number]))
        self._following = Following(
            len(robot.servos), held=settings.held, lag=settings.lag, known=settings.stands
        )
        self._stamp = self._now = -np.inf
        self._freeing = False
        self.blocked: frozenset[int] = frozenset()
        """Servos that obey nobody else now."""
        self.reason: Reason | None = None
        """Why the gate must stop: a part met something too often."""
        self.met: tuple[Met, ...] = ()
        """The contacts of the latest reading, from the lower threshold on."""

    def expect(self, servos: NDArray[np.intp], force: float, now: float) -> None:
        """Leaves contact up to `force` [N] on the skin of these servos' groups to a capability."""
        for group in self._groups_of(servos):
            group.expected, group.until = force, now + EXPECTED_FOR

    def ordered(self, servos: NDArray[np.intp]) -> None:
        """Somebody's order moves these servos, so they don't give way any more."""
        for group in self._groups_of(servos):
            group.soft = False

    def free(self) -> None:
        """Sends every part that is in contact back with the next reading, slowly."""
        self._freeing = True

    def _groups_of(self, servos: NDArray[np.intp]) -> Iterator[_Group]:
        return (one for one in self._groups.values() if np.isin(servos, one.servos).any())

    def forget(self) -> None:
        """Forgets paths and reactions, since the servos are under command no more."""
        self.blocked, self.reason, self.met = frozenset(), None, ()
        for group in self._groups.values():
            group.goal, group.soft, group.slow, group.expected = None, False, False, 0.0
        self._forget_times()

    def _forget_times(self) -> None:
        """After the clock went back. Ways back that have begun go on."""
        self._following.forget()
        self._stamp = -np.inf
        for group in self._groups.values():
            group.reactions.clear()
            group.outside, group.since, group.free = 0, np.inf, None
            group.moved = group.clear = -np.inf
            if group.goal is None:
                group.path.clear()

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
        self._note_motion(reference)
        if joints.stamp <= self._stamp:
            return [], []
        self._stamp = joints.stamp
        felt = self._forces.step(contacts)
        freeing, self._freeing = self._freeing, False
        bent = self._following.bent(joints)
        loose = bool((bent > self._settings.held).any())
        if not (self.blocked or felt or freeing or loose) and self._following.near(joints, reference):
            self._walk_all(joints, reference)
            self._following.learn(joints, reference)
            self.met = ()
            return [], []
        error = self._following.error(joints, reference)
        ways: list[Way] = []
        told: list[Reason] = []
        met: list[Met] = []
        for number, group in self._groups.items():
            own = group.servos[np.isfinite(error[group.servos])]
            if group.goal is None and not self._moves_now(group):
                self._following.rest(group.servos, joints)
            if not own.size:
                continue
            worst = int(own[np.argmax(error[own])])
            left = np.nan_to_num(bent[group.servos])
            loosest = int(group.servos[np.argmax(left)])
            seen = _Seen(
                joints, reference, own, worst, float(error[worst]), felt.get(number, Felt()), loosest,
                float(left.max()),
            )  # fmt: skip
            goal: Array | None
            if group.goal is None:
                goal, why = self._look(group, seen, freeing=freeing)
                if why:
                    told.append(why)
            else:
                group.slow = group.slow or freeing
                goal = self._judge(group, seen)
            if goal is not None:
                speed = FREES if group.slow else None
                ways.append(Way(own, goal[np.isin(group.servos, own)], speed))
            met += self._tell(group, seen)
        if met:
            self._following.doubt()
        else:
            self._following.learn(joints, reference)
        self.met = tuple(met)
        self.blocked = frozenset(
            int(s) for one in self._groups.values() if one.goal is not None for s in one.servos
        )
        return ways, told

    def _look(self, group: _Group, seen: _Seen, *, freeing: bool) -> tuple[Array | None, Reason | None]:
        """At a group that nothing has met so far: where it must go, and why."""
        rests = self._now - group.moved > self._settings.lag + PROGRESS
        held = seen.error > self._settings.held * (AT_REST if rests else 1.0)
        if seen.error < CLEAR * self._settings.held:
            group.clear = seen.joints.stamp
        # somebody who moves it while the others rest does so on purpose
        bent = self._moves_now(group) and seen.bent > self._settings.held
        group.outside = group.outside + 1 if held or bent else 0
        if group.outside == 1:
            group.seen = seen.joints.stamp
        allowed = group.expected if self._now < group.until else 0.0
        expected = LIGHT < seen.felt.force <= allowed
        since: tuple[float, int | None] | None = None
        what = f"{seen.felt.force:.0f} N on its skin"
        if group.outside >= 2 and self._moves(group) and not expected:
            behind = np.rad2deg(seen.error)
            what = f"{self._robot.servos[seen.worst].name} is held {behind:.1f} degrees behind"
            if not held:
                servo, angle = self._robot.servos[seen.loosest].name, np.rad2deg(seen.bent)
                what = f"{servo}, which nobody commands, is bent by {angle:.1f} degrees"
            since = min(group.seen - EARLIER, group.clear - self._settings.lag), seen.worst
        elif seen.felt.made > max(self._settings.felt, allowed):
            since = seen.joints.stamp - EARLIER, None
        elif freeing and (held or seen.felt.force > LIGHT):
            since, group.slow = (np.inf, seen.worst if held else None), True
        if since is None:
            self._walk(group, seen.joints)
            return self._yield(group, seen, max(self._settings.felt, allowed)), None
        position = seen.joints.position
        if group.answer == "retreat" or group.slow:
            before, worst = since
            goal = self._back(group, seen, before, pulled=worst is not None)
        elif group.answer == "soft":
            goal = position[group.servos].copy()
        else:
            goal = self._references(group, seen.reference, position)
        self._note_first(group, seen, seen.felt.own)
        self._begin(group, goal, freed=group.slow)
        return goal, Reason(Code.CONTACT, f"{group.name} met something: {what}; it {DOES[group.answer]}")

    def _yield(self, group: _Group, seen: _Seen, most: float) -> Array | None:
        """A resting part that is pressed with more than `most` [N] follows the hand: its reference stays as
        far from the joint as gravity alone bends it."""
        here = seen.joints.position[group.servos]
        reference = self._references(group, seen.reference, seen.joints.position)
        if group.bent is None or (seen.felt.force < UNLOADED and not self._moves(group)):
            group.bent = np.clip(reference - here, -self._settings.held, self._settings.held)
        if seen.felt.force > most and not self._moves(group):
            group.soft = True
        elif seen.felt.force <= LIGHT:
            group.soft = False
        goal: Array = here + group.bent
        return goal if group.soft and np.abs(goal - reference).max() > YIELDS else None

    def _moves(self, group: _Group) -> bool:
        """True if a group may have made a contact: it moves, or did a moment ago, and not because somebody
        pushes it."""
        return not group.soft and self._now - group.moved < MADE

    def _moves_now(self, group: _Group) -> bool:
        """True while the latest readings may tell of a reference that moved."""
        return self._now - group.moved <= self._settings.lag

    def _references(self, group: _Group, reference: Reference, position: Array) -> Array:
        """References (k,) [rad] of a group; where it has none, where the joint is."""
        whole = position.copy()
        whole[reference.servos] = reference.position
        found: Array = whole[group.servos]
        return found

    def _tell(self, group: _Group, seen: _Seen) -> Iterator[Met]:
        over = group.goal is None or group.free is not None
        held = group.outside >= 2 or (group.goal is not None and seen.error > 0.5 * self._settings.held)
        if over and not held and seen.felt.force < self._settings.told:
            return
        answer: Answer = "told"
        if group.goal is not None:
            answer = group.answer
        elif group.soft:
            answer = "soft"
        elif self._now < group.until and seen.felt.force <= group.expected:
            answer = "expected"
        joint = self._robot.servos[seen.worst].name if held else None
        for part in group.parts:
            yield Met(part, seen.felt.force, joint, seen.error if held else 0.0, answer)

    def _judge(self, group: _Group, seen: _Seen) -> Array | None:
        """On a way back, and after it: where to go next, or None."""
        mine = np.isin(seen.reference.servos, seen.own)
        if (np.abs(seen.reference.velocity[mine]) > 1e-6).any():
            group.since = np.inf
            if not self._meets_another(group, seen):
                return None
            group.path.clear()
            here = seen.joints.position[group.servos]
            room = here + ROOM * (group.there - here)
            self._note_first(group, seen, ())
            return self._go(group, room)
        group.since = min(group.since, self._now)
        if self._now - group.since < SETTLES:
            return None
        held = seen.error > CLEAR * self._settings.held
        # a joint that nobody commands may have been moved on purpose: it is a reason to go on, not to wait
        bent = bool(group.path) and seen.bent > self._settings.held
        if held or bent or seen.felt.force > LIGHT:
            group.free = None
            if group.answer == "stop" and not group.slow:
                return None
            here = seen.joints.position
            if group.path and (group.answer == "retreat" or group.slow):
                return self._go(group, self._back(group, seen, np.inf, pulled=held))
            # nowhere to go: the reference goes where the joint is
            same = group.goal is not None and np.array_equal(here[group.servos], group.goal)
            return None if same else self._go(group, here[group.servos].copy())
        group.free = self._now if group.free is None else group.free
        if self._now - group.free > self._settings.quiet:
            group.goal, group.slow = None, False
            group.path.clear()
        return None

    def _meets_another(self, group: _Group, seen: _Seen) -> bool:
        """True if a way back loads somebody else: with more than the first still bears, or so that a joint is
        held where it goes."""
        assert group.goal is not None
        where = seen.reference.servos == seen.worst
        way = group.goal[group.servos == seen.worst] - seen.reference.position[where]
        goes = float(seen.reference.velocity[where][0])
        # not while it brakes
        ahead = goes * self._following.side[seen.worst] > 0.0 and goes * float(way[0]) > 0.0
        pull = self._following.pull[group.servos]
        group.pressed &= pull * group.pull > 0.0
        ahead = ahead and not group.pressed[group.servos == seen.worst].any()
        group.behind = group.behind + 1 if ahead and seen.error > self._settings.held else 0
        if not group.first and self._now - group.begun < FELT_LATE:
            group.first = seen.felt.of(())
        first, another = seen.felt.other_than(group.first)
        return group.behind >= 2 or another > max(self._settings.felt, first)

    def _note_first(self, group: _Group, seen: _Seen, contacts: Collection[int]) -> None:
        group.first, group.there = seen.felt.of(contacts), seen.joints.position[group.servos]
        group.begun = self._now
        group.pull = self._following.pull[group.servos]
        group.pressed = group.pull != 0.0

    def _go(self, group: _Group, goal: Array) -> Array:
        group.goal, group.since, group.free = goal, np.inf, None
        return goal

    def _walk_all(self, joints: JointReading, reference: Reference) -> None:
        for group in self._groups.values():
            group.outside, group.soft, group.clear = 0, False, joints.stamp
            self._walk(group, joints)
            if not self._moves_now(group):
                self._following.rest(group.servos, joints)
            if not self._moves(group):
                here = joints.position
                group.bent = self._references(group, reference, here) - here[group.servos]

    def _begin(self, group: _Group, goal: Array, *, freed: bool) -> None:
        self._go(group, goal)
        group.outside, group.behind, group.soft = 0, 0, False
        if freed:
            return
        group.reactions.append(self._now)
        while self._now - group.reactions[0] > WITHIN:
            group.reactions.popleft()
        if len(group.reactions) >= OFTEN:
            words = f"{group.name} met something {OFTEN} times within {WITHIN:.0f} s"
            self.reason = Reason(Code.CONTACT, words)

    def _back(self, group: _Group, seen: _Seen, before: float, *, pulled: bool) -> Array:
        """The latest posture of the path before the time `before` [s] that is `FURTHER` away from here; if
        `pulled`, away from where the joints that are behind press. The path is used up to there. Else the
        posture that is farthest away, or here: never nearer to what they push, so a joint that somebody
        pushed off its way stays where it was pushed."""
        here: Array = seen.joints.position[group.servos]
        own, pull = np.isin(group.servos, seen.own), self._following.pull[group.servos]
        path = list(group.path)
        best, most, last = here.copy(), 0.0, len(path)
        for number in reversed(range(len(path))):
            stamp, posture = path[number]
            way = (posture - here)[own]
            by_pull = pulled and pull.any()
            away = float(-(pull[own] @ way) / np.linalg.norm(pull) if by_pull else np.abs(way).max())
            if away > most:
                best, most, last = posture, away, number
                if stamp <= before and away >= FURTHER:
                    break
        group.path = deque(path[:last])
        if not pulled:
            return best
        yields: Array = np.where(pull > 0.0, np.minimum(best, here), np.maximum(best, here))
        return np.where(pull == 0.0, best, yields)

    def _walk(self, group: _Group, joints: JointReading) -> None:
        here = joints.position[group.servos]
        if not group.path or np.abs(here - group.path[-1][1]).max() > STEP:
            group.path.append((joints.stamp, here.copy()))
        while joints.stamp - group.path[0][0] > KEPT:
            group.path.popleft()
            if not group.path:
                group.path.append((joints.stamp, here.copy()))

    def _note_motion(self, reference: Reference) -> None:
        moving = reference.servos[np.abs(reference.velocity) > MOVES].tolist()
        for group in self._groups.values():
            if not {*group.servos.tolist()}.isdisjoint(moving):
                group.moved = self._now
