"""Contact as a cause of its own: a part that meets something on its way goes back where it came from.

A joint that is held differs from one that lags: a lagging joint is where its reference was a moment ago, a
held one is nowhere on that way, or stands while its reference went on. That, or a force on skin that began
while the part moved, means contact. The answer is the gate's own order: back along the measured path, further
while the joint is still held; where no path is left the reference goes to where the joint is, so that nothing
presses. Nobody else's order to these servos passes until the contact has been over for a while.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tci.gate.joint_monitor import Reference
from tci.messages import Contacts, JointReading, Mode
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
SETTLES = 0.12
"""Time [s] after the end of a way back at which a joint is judged: it lags by less."""
PROGRESS, SLOWEST, SHARE = 0.05, float(np.deg2rad(2.0)), 0.4
"""A joint stands if within `PROGRESS` [s] it went less than `SHARE` of the way that its reference went,
whatever its lag, and that way is at least `SLOWEST` [rad]: more than coarse encoders and friction explain."""
STANDS = float(np.deg2rad(10.0))
"""Measured speed [rad/s] towards its reference below which a joint may be held."""
OVERSHOOT = 0.1
"""Fraction of the way within `lag` by which a servo of 60 rad/s and a damping of 0.7 overshoots when its
reference turns."""
LIGHT = 5.0
"""Force [N] on skin below which a contact is over, as a person feels it."""
OFTEN, WITHIN = 3, 10.0
"""So many reactions of a part within so many seconds [s] end in STOP: somebody is there, and a behaviour
insists."""
MADE = 0.3
"""Time [s] after its reference moved last within which a part may have made a contact."""
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
    felt: float = 15.0
    """Force [N] on skin above which a part that made the contact goes back. ISO/TS 15066 permits 65 N and
    more; people guide an arm with less than this."""
    stands: bool = True
    """Whether a joint that stands while its reference goes on is held."""
    quiet: float = 0.5
    """Time [s] without contact after which the part obeys again."""


@dataclass(slots=True)
class _Group:
    """One group of servos that move together."""

    servos: NDArray[np.intp]
    name: str
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


class ContactReaction:
    """Notices contacts of a robot's groups of servos, and says where each of them must go."""

    def __init__(self, robot: Robot, groups: Sequence[int], settings: ContactSettings) -> None:
        """`groups` (n_servos,) is the number of each servo's group."""
        self._robot, self._settings = robot, settings
        self._groups = {}
        # legs carry the robot, so they stop and stay stiff; a grasp loads the fingers on purpose
        others = {
            groups[one.servo]
            for part in robot.parts
            if part.kind in ("leg", "fingers")
            for one in part.servos
            if one.servo is not None
        }
        for number in dict.fromkeys(groups):
            if number in others:
                continue
            own = [servo for servo, group in enumerate(groups) if group == number]
            self._groups[number] = _Group(np.array(own), robot.servos[own[0]].robot_part)
        self._parts: dict[str, set[int]] = {
            part.name: {groups[one.servo] for one in part.servos if one.servo is not None} - others
            for part in robot.parts
        }
        self._past: deque[tuple[float, Array]] = deque()
        self._made: dict[int, frozenset[int]] = {}  # by contact: the groups that moved when it began
        self._readings: deque[tuple[float, Array]] = deque()
        self._side = np.zeros(len(robot.servos))  # where each joint pushes: 1 towards larger angles
        self._stamp = -np.inf
        self.blocked: frozenset[int] = frozenset()
        """Servos that obey nobody else now."""
        self.reason: Reason | None = None
        """Why the gate must stop: a part met something too often."""

    def forget(self) -> None:
        """Forgets paths and reactions, since the servos are under command no more."""
        self.blocked, self.reason = frozenset(), None
        for group in self._groups.values():
            group.goal = None
        self._forget_times()

    def _forget_times(self) -> None:
        """After the clock went back. Ways back that have begun go on."""
        self._past.clear()
        self._readings.clear()
        self._stamp = -np.inf
        for group in self._groups.values():
            group.reactions.clear()
            group.outside, group.since, group.free, group.moved = 0, np.inf, None, -np.inf
            if group.goal is None:
                group.path.clear()

    @property
    def touched(self) -> tuple[str, ...]:
        """Names of the parts with a contact that is not over."""
        return tuple(one.name for one in self._groups.values() if one.goal is not None and one.free is None)

    def step(
        self, joints: JointReading, reference: Reference, now: float, contacts: Contacts | None
    ) -> tuple[list[tuple[NDArray[np.intp], Array]], list[Reason]]:
        """One period: the ways back that begin now, as servos (k,) and angles (k,) [rad], and what to
        tell."""
        if self._past and now < self._past[-1][0]:
            self._forget_times()
        self._remember(reference, now)
        if joints.stamp <= self._stamp:
            return [], []
        self._stamp = joints.stamp
        felt = self._felt(contacts, now)
        if not self.blocked and not felt and self._follows(joints, reference):
            self._walk_all(joints)
            return [], []
        error = self._error(joints)
        ways: list[tuple[NDArray[np.intp], Array]] = []
        told: list[Reason] = []
        for number, group in self._groups.items():
            own = group.servos[np.isfinite(error[group.servos])]
            if not own.size:
                continue
            worst = int(own[np.argmax(error[own])])
            goal: Array | None
            force = felt.get(number, 0.0)
            if group.goal is None:
                held = error[worst] > self._settings.held
                group.outside = group.outside + 1 if held else 0
                if group.outside == 1:
                    group.seen = joints.stamp
                made = now - group.moved < MADE
                if group.outside >= 2 and made:
                    behind = np.rad2deg(error[worst])
                    what = f"{self._robot.servos[worst].name} is held {behind:.1f} degrees behind"
                    goal = self._back(group, joints.position, group.seen - EARLIER, worst, self._side[worst])
                elif force > self._settings.felt:
                    what = f"{force:.0f} N on its skin"
                    goal = self._back(group, joints.position, joints.stamp - EARLIER)
                else:
                    self._walk(group, joints)
                    continue
                told.append(Reason(Code.CONTACT, f"{group.name} met something: {what}; it goes back"))
                self._begin(group, now)
            else:
                goal = self._judge(group, own, worst, joints, reference, float(error[worst]), force, now)
            if goal is not None:
                group.goal, group.since, group.free = goal, np.inf, None
                ways.append((own, goal[np.isin(group.servos, own)]))
        self.blocked = frozenset(
            int(s) for one in self._groups.values() if one.goal is not None for s in one.servos
        )
        return ways, told

    def _judge(
        self,
        group: _Group,
        own: NDArray[np.intp],
        worst: int,
        joints: JointReading,
        reference: Reference,
        error: float,
        force: float,
        now: float,
    ) -> Array | None:
        """After a way back: where to go next, or None."""
        mine = np.isin(reference.servos, own)
        if (np.abs(reference.velocity[mine]) > 1e-6).any():
            group.since = np.inf
            return None
        group.since = min(group.since, now)
        if now - group.since < SETTLES:
            return None
        if error > 0.5 * self._settings.held or force > LIGHT:
            group.free = None
            if group.path:
                held = error > 0.5 * self._settings.held
                return self._back(group, joints.position, np.inf, worst if held else None, self._side[worst])
            # nowhere to go: the reference goes where the joint is
            here: Array = joints.position[group.servos]
            return None if group.goal is not None and np.array_equal(here, group.goal) else here.copy()
        group.free = now if group.free is None else group.free
        if now - group.free > self._settings.quiet:
            group.goal = None
            group.path.clear()
        return None

    def _follows(self, joints: JointReading, reference: Reference) -> bool:
        """True if every joint is so near its present reference that nothing can hold it."""
        behind = joints.position[reference.servos] - reference.position
        return not behind.size or float(np.abs(behind).max()) < 0.5 * self._settings.held

    def _error(self, joints: JointReading) -> Array:
        """Angle (n_servos,) [rad] of each joint outside its recent references, more than `held` if it stands
        while they went on; NaN for servos that follow no reference."""
        begin = joints.stamp - self._settings.lag
        times = np.array([time for time, _ in self._past])
        rows = np.array([row for _, row in self._past])
        inside = (times >= begin) & (times <= joints.stamp)
        inside[max(int(np.searchsorted(times, begin, side="right")) - 1, 0)] = True
        low, high = rows[inside].min(axis=0), rows[inside].max(axis=0)
        outside = np.maximum(joints.position - high, low - joints.position)
        error: Array = np.maximum(outside - OVERSHOOT * (high - low), 0.0)
        self._side = np.where(joints.position < 0.5 * (low + high), 1.0, -1.0)
        # a joint whose velocity says that it goes on is not held: its encoder is wrong, as the monitor tells
        goes = self._side * joints.velocity > STANDS
        self._readings.append((joints.stamp, joints.position))
        while joints.stamp - self._readings[1][0] >= PROGRESS if len(self._readings) > 2 else False:
            self._readings.popleft()
        since, before = self._readings[0]
        passed = joints.stamp - since
        if self._settings.stands and PROGRESS <= passed < 2.0 * PROGRESS:
            lags = np.linspace(0.0, self._settings.lag, 6)
            last = rows[np.maximum(np.searchsorted(times, joints.stamp - lags, side="right") - 1, 0)]
            first = rows[np.maximum(np.searchsorted(times, since - lags, side="right") - 1, 0)]
            ways = last - first
            least = np.where(
                (ways > 0.0).all(axis=0) | (ways < 0.0).all(axis=0), np.abs(ways).min(axis=0), 0.0
            )
            gone = (joints.position - before) * np.sign(ways[0])
            stands = (least > SLOWEST) & (gone < SHARE * least)
            error[stands] = np.maximum(error, self._settings.held + least - gone)[stands]
        error[goes] = 0.0
        return error

    def _walk_all(self, joints: JointReading) -> None:
        for group in self._groups.values():
            group.outside = 0
            self._walk(group, joints)

    def _begin(self, group: _Group, now: float) -> None:
        group.outside = 0
        group.reactions.append(now)
        while now - group.reactions[0] > WITHIN:
            group.reactions.popleft()
        if len(group.reactions) >= OFTEN:
            words = f"{group.name} met something {OFTEN} times within {WITHIN:.0f} s"
            self.reason = Reason(Code.CONTACT, words)

    def _back(
        self, group: _Group, position: Array, before: float, held: int | None = None, side: float = 0.0
    ) -> Array:
        """The latest posture of the path before the time `before` [s] that takes the joint `held` away from
        what it pushes on `side`, or without one any joint, by `FURTHER`; the path is used up to there. Else
        the posture that takes it farthest away, or here: never nearer to what it pushes."""
        here: Array = position[group.servos]
        place = None if held is None else int(np.searchsorted(group.servos, held))
        best, most = here.copy(), 0.0
        while group.path:
            stamp, posture = group.path.pop()
            way = posture - here
            away = float(np.abs(way).max() if place is None else -side * way[place])
            if stamp <= before and away >= FURTHER:
                return posture
            if away > most:
                best, most = posture, away
        return best

    def _walk(self, group: _Group, joints: JointReading) -> None:
        here = joints.position[group.servos]
        if not group.path or np.abs(here - group.path[-1][1]).max() > STEP:
            group.path.append((joints.stamp, here.copy()))
        while joints.stamp - group.path[0][0] > KEPT:
            group.path.popleft()
            if not group.path:
                group.path.append((joints.stamp, here.copy()))

    def _remember(self, reference: Reference, now: float) -> None:
        whole = np.full(len(self._robot.servos), np.nan)
        stiff = [mode is not Mode.TORQUE for mode in reference.modes]
        whole[reference.servos[stiff]] = reference.position[stiff]
        self._past.append((now, whole))
        while len(self._past) > 2 and now - self._past[1][0] > self._settings.lag + 2.0 * PROGRESS + 0.05:
            self._past.popleft()
        moving = reference.servos[np.abs(reference.velocity) > MOVES].tolist()
        for group in self._groups.values():
            if not {*group.servos.tolist()}.isdisjoint(moving):
                group.moved = now

    def _felt(self, contacts: Contacts | None, now: float) -> Mapping[int, float]:
        """Largest force [N] on skin by group, of contacts that began while the group moved: the robot made
        these."""
        if contacts is None:  # unknown: frames did not fit
            return {}
        found: dict[int, float] = {}
        made: dict[int, frozenset[int]] = {}
        for contact in contacts:
            moving = self._made.get(contact.identity)
            if moving is None:
                mine = self._parts.get(contact.part, ())
                moving = frozenset(n for n in mine if now - self._groups[n].moved < MADE)
            made[contact.identity] = moving
            for group in moving:
                found[group] = max(found.get(group, 0.0), contact.force)
        self._made = made
        return found
