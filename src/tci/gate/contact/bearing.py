"""Which joints bear more than a moment ago, by their measured torques: the earliest sign of a contact.

While all references cruise, a robot's own motion changes torques slowly, and what accelerations take is known
roughly. So what a joint bears more comes from outside, long before a stiff servo is bent by degrees. When
references rest again, a joint is also compared with what it bore before they accelerated: whoever was met
meanwhile would else count as what it always bore. Over a wire torques tell only as far as `trust` says.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import DescriptionError, UnknownNameError
from tci.gate.contact.following import FAST
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.trust import Trust
from tci.gate.contact.weights import FRICTION, WRONG, longest_levers
from tci.gate.joint_monitor import Reference
from tci.messages import JointReading, Mode
from tci.messages.frames import Array
from tci.robot.clearance import without_skin
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics, inertia_range
from tci.robot.joint_calibration import JointCalibration, Tool

BARE = 30.0
"""Force [N] at the end of the arm that counts, without skin."""
SHARE = 0.2
"""Fraction of its torque limit by which a joint must bear more at least. Dry friction is 5 %, and healthy
robots of rigid bodies with wrong masses came to a tenth of what counts."""
MOMENT = 0.15
"""Length [s] of the moment: a weight's lever changes little meanwhile."""
ONSET = 0.1
"""Time [s] within which a contact that is noticed now began: torques of later tell of it already."""
EVEN = 1e-4
"""Change [rad/s] of a velocity reference in one period that is none."""
TAKES = 4.0
"""What accelerating changes a torque by at most, as a multiple of what the model's links take: masses may be
20 % off, rotors as heavy as links, a servo overshoots, and what accelerated before may brake now."""
AHEAD, BACK = 2.0, 0.5
"""The same of what links take in the posture where they are, and rotors as heavy as links in any posture, in
the direction in which accelerating takes it, and in the other: a servo overshoots."""
TELLS = 0.4
"""Fraction of what counts below which nothing is told, nor where somebody is."""
RISES = 0.25
"""The same from which on a joint may bear the first of what counts later: what dry friction is that
turned."""
VISCOUS = 0.5
"""Fraction of its torque limit that friction of a joint may take more at full speed than at rest: an iCub's
wrist takes 0.4."""
SHORTEST = 1e-6
"""Shortest time [s] between two references. Of the first nobody knows how fast it came."""
PIECE = 0.01
"""Time [s] within which changes of speed count as one."""


class Bearing:
    """Compares measured torques with those of a moment ago."""

    def __init__(self, robot: Robot, weight: OwnWeight, *, known: bool) -> None:
        """`known`: torques are what they seem, and it is known when joints accelerate; else motion without a
        contact must show it first."""
        self._robot, self._weight = robot, weight
        self._trust = Trust(known=known)
        self.tells = False
        """Torques of the latest reading tell of contact."""
        self.dynamics: Dynamics | None = None
        """Of the links with what they carry; None without masses."""
        levers = longest_levers(robot)
        limits = np.array([servo.limits.torque or np.inf for servo in robot.servos])
        self.least = np.where(levers > 0.0, np.maximum(SHARE * limits, BARE * levers), np.inf)
        """Torque (n_servos,) [N m] beyond which what a joint bears more comes from outside, while nothing
        accelerates."""
        self.counts = self.least
        """The same at the latest reading."""
        self.rose = np.full(len(robot.servos), np.inf)
        """Since when each joint bears more [s], little as it may be; inf where it does not."""
        self._velocity = np.zeros(len(robot.servos))
        fastest = np.array([servo.limits.velocity or np.inf for servo in robot.servos])
        self._limits = np.where(np.isfinite(limits), limits, 0.0)
        self._viscous = VISCOUS * self._limits / fastest
        self._dry = FRICTION * self._limits
        self._changes: deque[_Change] = deque()
        self._changed = -np.inf  # when [s] references changed their speed, or joints swung, last
        self._modes: tuple[Mode, ...] = ()
        self._loose, self._asked = np.zeros(0, bool), np.zeros(0, np.intp)
        self._torques: deque[tuple[float, Array]] = deque()
        self._even: deque[_Even] = deque()
        self._latest = self._began = np.inf
        self._swung = -np.inf
        self._turned = np.ones(len(self.least), bool)
        self.load({})

    def load(self, tools: Mapping[str, Tool]) -> None:
        """Sets what links carry, by the name of the link."""
        robot, self.dynamics = without_skin(self._robot), None
        try:
            self._inertia = inertia_range(robot, tuple(tools.items())).largest
            self.dynamics = Dynamics(robot, JointCalibration(robot=robot.name, tools=dict(tools)))
        except (DescriptionError, UnknownNameError):
            self._inertia = np.full((len(self.least),) * 2, np.inf)

    def forget(self) -> None:
        self._changes.clear()
        self._torques.clear()
        self._even.clear()
        self.rose[:] = np.inf
        self._trust.forget()
        self._latest, self._changed, self._swung = np.inf, -np.inf, -np.inf

    def remember(self, reference: Reference, now: float) -> None:
        """Notes how fast references accelerate at `now` [s]."""
        if self._latest == np.inf:
            self._began = now
        before, self._velocity = self._velocity, np.zeros(len(self.least))
        self._velocity[reference.servos] = reference.velocity
        if np.abs(self._velocity - before).max(initial=0.0) > EVEN:
            self._changed, began = now, min(self._latest, now - SHORTEST)
            if self._changes and now - self._changes[-1].began <= PIECE:
                began, before = self._changes.pop()[::2]
            self._changes.append(_Change(began, now, before, self._velocity))
        self._latest = now
        if reference.modes != self._modes:
            self._modes = reference.modes
            self._loose = np.array([mode is Mode.TORQUE for mode in reference.modes], bool)
        self._asked = reference.servos[self._loose]

    @property
    def before(self) -> Borne | None:
        """What joints bore before a contact that is noticed now."""
        if not (self._trust.earned and self._even and self._torques):
            return None
        known = self._torques[-1][0] - self._even[0].stamp > ONSET
        return self._borne(self._even[0], self.least) if known else None

    def beyond(self, joints: JointReading, before: Borne | None) -> Array:
        """By how much torques are away from `before` (n_servos,), as multiples of what comes from outside; 0
        where one is unknown."""
        if joints.torque is None or before is None:
            return np.zeros(len(self.least))
        return _multiples(joints.torque - before.torque, self._counts(joints, before))

    def weighs(self, joints: JointReading, before: Borne | None) -> Array:
        """What joints bear (n_servos,) [N m] where they are without anybody: as before the contact, but for
        dry friction, and what their weight changed since; by the model's masses alone if that is unknown."""
        now = self._weight.torques(joints.position)
        if before is None:
            return now
        borne = before.torque + now - before.weight
        least: Array = borne - np.clip(borne, -self._dry, self._dry)
        return least

    def _counts(self, joints: JointReading, before: Borne) -> Array:
        return before.counts + np.abs(self._weight.torques(joints.position) - before.weight)

    def more(self, joints: JointReading, lags: Array, swing: NDArray[np.intp]) -> Array:
        """What each joint bears more than a moment ago, or than before references accelerated (n_servos,), as
        multiples of what comes from outside; 0 without measured torques. Joints lag by `lags` (n_servos,)
        [s] at most, and motors of servos that `swing` (k,) give all they have."""
        self.tells = False
        self._trust.read(joints.stamp)
        if not self._trust.regular:
            self._torques.clear()
            return np.zeros(len(self.least))
        if joints.torque is None:
            self.forget()  # nobody may compare what comes later with what was before
            return np.zeros(len(self.least))
        torques, changes, even = self._torques, self._changes, self._even
        torques.append((joints.stamp, joints.torque))
        if swing.size:
            rate, own = np.zeros(len(self.least)), self._inertia.diagonal()[swing]
            rate[swing] = self._limits[swing] / np.where(own > 0.0, own, np.inf)
            swings = self._velocity + PIECE * rate
            changes.append(_Change(joints.stamp, joints.stamp, self._velocity, swings))
            self._changed = self._swung = joints.stamp
        lag = self._lag(lags)
        uneven = self._changed + lag
        first = joints.stamp - MOMENT if joints.stamp <= uneven else max(joints.stamp - MOMENT, uneven)
        while torques[0][0] < first:
            torques.popleft()
        while changes and changes[0].ended + lag < torques[0][0]:
            changes.popleft()
        self.counts = self.least + self._takes()
        found = _multiples(joints.torque - torques[0][1], self.counts)
        while len(even) > 1 and joints.stamp - even[1].stamp > MOMENT:
            even.popleft()
        if joints.stamp > uneven:
            even.append(_Even(joints.stamp, joints.torque, joints.position, self._velocity))
        # what brought it here may still swing at first
        still = joints.stamp > max(self._began, self._swung) + lag
        if even and even[0].stamp < uneven and still:
            counts = self._since(joints, even[0], joints.stamp - lag)
            since = _multiples(joints.torque - even[0].torque, counts)
            # one that bears less was loaded by motion
            more = (np.abs(since) > np.abs(found)) & (np.abs(joints.torque) > np.abs(even[0].torque))
            found, self.counts = np.where(more, since, found), np.where(more, counts, self.counts)
        found[self._asked] = 0.0  # somebody asks for these torques
        if not self._trust.earned:
            moves = len(torques) > 1 and bool((np.abs(self._velocity) > FAST).any())
            self._trust.show(float(np.abs(found).max()), moves=moves)
            return np.zeros(len(found))
        self.tells = True
        self.rose = np.where(np.abs(found) > RISES, np.minimum(self.rose, joints.stamp), np.inf)
        return found

    def _lag(self, lags: Array) -> float:
        """The longest of those (n_servos,) [s] whose references changed their speed lately."""
        if self._changes:
            self._turned = np.any([one.rate != 0.0 for one in self._changes], axis=0)
        return float(lags[self._turned].max(initial=0.0))

    def _borne(self, one: _Even, counts: Array) -> Borne:
        return Borne(one.torque, counts, self._weight.torques(one.position))

    def _since(self, joints: JointReading, even: _Even, since: float) -> Array:
        """Changes of torques (n_servos,) [N m] since they were `even` beyond which they come from outside, by
        what references did from `since` [s] on, in the direction in which each changed."""
        assert joints.torque is not None
        change = joints.torque - even.torque
        counts = self._counts(joints, self._borne(even, self.least))
        recent = [one for one in self._changes if one.ended >= since]
        if self.dynamics is None:
            return np.full(len(counts), np.inf) if recent else counts
        if not (np.abs(change) > TELLS * counts).any():
            return counts
        links, turns = self._turning(joints.position, joints.velocity)
        _, turned = self._turning(even.position, even.velocity)
        rates = np.array([one.rate for one in recent]).reshape(-1, len(change))
        parts = (links + np.diag(self._inertia.diagonal())) * rates[:, None]
        rises, falls = np.maximum(parts, 0.0).sum(axis=2), np.maximum(-parts, 0.0).sum(axis=2)
        speeds = np.array([self._velocity, *(one.before for one in recent)]) - even.velocity
        rubs = self._viscous * np.array([speeds.max(axis=0), -speeds.min(axis=0)])
        up, down = np.maximum(rubs, 0.0) + np.maximum([turns - turned, turned - turns], 0.0)
        up += (AHEAD * rises + BACK * falls).max(axis=0, initial=0.0)
        down += (AHEAD * falls + BACK * rises).max(axis=0, initial=0.0)
        counts += WRONG * (np.abs(turns) + np.abs(turned))
        return np.asarray(counts + np.where(change > 0.0, up, down))

    def _turning(self, position: Array, velocity: Array) -> tuple[Array, Array]:
        """Inertia (n_servos, n_servos) [kg m2], and torques (n_servos,) [N m] by which links turn others."""
        assert self.dynamics is not None
        inertia, bias = self.dynamics.at(position, velocity)
        return inertia, bias - self.dynamics.at(position, np.zeros(len(velocity)))[1]

    def _takes(self) -> Array:
        """By how much torques (n_servos,) [N m] may change since references changed their speed."""
        changes = self._changes
        if not changes:
            return np.zeros(len(self.least))
        rate = np.max([np.abs(one.rate) for one in changes], axis=0)
        moved = rate > 0.0
        takes: Array = TAKES * (self._inertia[:, moved] @ rate[moved])
        takes += self._viscous * np.ptp([changes[0].before, *(one.after for one in changes)], axis=0)
        return takes


def _multiples(change: Array, counts: Array) -> Array:
    found: Array = change / counts
    found[np.isnan(found)] = 0.0
    return found


class Borne(NamedTuple):
    """What joints bore at one instant."""

    torque: Array
    """(n_servos,) [N m]."""
    counts: Array
    """Change (n_servos,) [N m] beyond which it comes from outside."""
    weight: Array
    """What the links took (n_servos,) [N m]: their levers may change."""


class _Even(NamedTuple):
    """A reading while references rest or cruise."""

    stamp: float
    torque: Array
    position: Array
    velocity: Array
    """Of the references (n_servos,) [rad/s]."""


class _Change(NamedTuple):
    """References changed their speed."""

    began: float
    ended: float
    """[s]."""
    before: Array
    after: Array
    """Speeds (n_servos,) [rad/s]."""

    @property
    def rate(self) -> Array:
        """How fast (n_servos,) [rad/s2]. Within less than a piece, a servo notices little."""
        rate: Array = (self.after - self.before) / max(self.ended - self.began, PIECE)
        return rate
