"""Joint groups under command: the servos of each group, and the motion of the group."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.acceptance import check_start
from tci.gate.body_guard import BodyGuard
from tci.gate.immovable import is_movable
from tci.gate.joint_group import JointGroup, groups_of, make_chain
from tci.gate.joint_monitor import Reference
from tci.gate.self_collision import SelfCollision
from tci.gate.settings import GateSettings
from tci.gate.stop_plan import StopTrajectory
from tci.gate.trajectory import Guard
from tci.messages import Mode, PlatformCommand
from tci.messages.frames import Array, frozen
from tci.reasons import Reason
from tci.robot.description import Robot

YIELDED = float(np.deg2rad(1.0))
"""Distance [rad] from its moving equilibrium above which a compliant servo has yielded to a force. Assumed: a
servo in motion lags by less, and a stiff servo that starts at this distance does not jolt."""


class WayBack(NamedTuple):
    """The whole way of a servo that leaves a contact on the gate's own order."""

    end: float
    """Angle [rad]."""
    speed: float
    """[rad/s]; all servos of a group arrive together, when its limits of speed and acceleration permit."""


class CommandedGroups:
    """Joint groups under command, by group number. A servo joins its group at its measured position."""

    def __init__(self, robot: Robot, *, period: float, settings: GateSettings) -> None:
        """Starts with no groups under command; `period` [s] is the period of the control loop. Raises
        TciError if the robot can't be checked for self-collision."""
        self._robot, self._period, self._settings = robot, period, settings
        self._made_for = robot
        self.group_of = groups_of(robot)
        """Number of each servo's group."""
        self._chains: dict[int, JointGroup] = {}
        self._chain_of: dict[int, JointGroup]
        """The group that moves each servo under command."""
        self.chains: list[JointGroup]
        """All groups, in the order in which `reference` has their servos."""
        self.count: int
        """Number of servos that the groups move."""
        self._others: dict[int, list[JointGroup]] = {}
        self.modes = [servo.modes[0] for servo in robot.servos]
        """Control mode of every servo."""
        self.measured: Array = np.zeros(len(robot.servos))
        """Latest measured angles (n_servos,) [rad]."""
        margin = settings.self_collision
        body = None if robot.model is None or margin is None else SelfCollision(robot, margin=margin)
        self.body = None if body is None else BodyGuard(body, period=period)
        """Check for self-collision of the stops that the gate plans before each step; None if the check is
        disabled."""
        self._loose: NDArray[np.intp] = np.zeros(0, np.intp)  # the servos in torque mode
        self._reference: Reference | None
        self._note_change()

    def rehearse(self) -> None:
        """Moves a copy of the first group that can move, for one period; nobody follows it. The first motion
        of a process loads the planner and the compiled loops, which takes longer than later motions."""
        servos = [servo.index for servo in self._robot.servos if is_movable(servo)]
        servos = [servo for servo in servos if self.group_of[servo] == self.group_of[servos[0]]]
        if not servos:
            return
        limits = [self._robot.servos[servo].limits for servo in servos]
        here = np.zeros(len(self._robot.servos))
        here[servos] = [((one.lower or 0.0) + (one.upper or 0.0)) / 2.0 for one in limits]
        chain = make_chain(
            self._robot, servos, here, old=None, fresh=(), period=self._period,
            speed_share=self._settings.speed_share, guard=self._guard(-1, servos),
        )  # fmt: skip
        values, speeds = here[servos] + 0.1, np.ones(len(servos))
        chain.aim(PlatformCommand(Mode.POSITION, chain.index, values, speeds), np.empty(len(servos)))
        chain.limiter.step()

    def slow(self, shares: Array) -> None:
        """Lets servos accelerate by these shares (n_servos,) of their limits only. Raises CommandError if
        servos in motion could not stop within their limits then; then nothing changes."""
        before, self._robot = self._robot, _slowed(self._made_for, shares)
        try:
            chains = {group: self._chain(group, {*chain.servos}) for group, chain in self._chains.items()}
        except CommandError:
            self._robot = before
            raise
        self._chains.update(chains)
        self._note_change()

    def look(self, measured: Array) -> None:
        """Stores the `measured` angles (n_servos,) [rad]. If a coupling of a group contains servos outside
        this group, adapts the bounds of the coupling to the angles of these servos."""
        self.measured = measured
        if self._loose.size:
            self._reference = None
        for chain in self._leaning:
            chain.look_outside(measured)

    def drop(self) -> None:
        """Removes all groups. The control modes of the servos do not change."""
        self._chains.clear()
        self._note_change()

    def _note_change(self) -> None:
        """Works out anew what depends on the groups and modes."""
        self.chains = list(self._chains.values())
        self._chain_of = {servo: chain for chain in self.chains for servo in chain.servos}
        self._leaning = [chain for chain in self.chains if chain.leans]
        self.count = sum(len(chain.servos) for chain in self.chains)
        self._others.clear()
        self._reference = None
        self._servos = frozen(np.concatenate([*(chain.index for chain in self.chains), self._loose]))
        self._modes = tuple([self.modes[servo] for servo in self._servos.tolist()])

    def reference(self) -> Reference:
        """Present references of the servos under command. The servos in torque mode come last, with their
        measured angles as references."""
        if self._reference is None:
            states = [chain.limiter.whole_state for chain in self.chains]
            if self._loose.size or not states:
                still = np.zeros(self._loose.size)
                states.append(np.array([self.measured[self._loose], still, still]))
            self._reference = Reference(self._servos, self._modes, *frozen(np.concatenate(states, axis=1)))
        return self._reference

    def ways_back(self, servos: AbstractSet[int]) -> dict[int, WayBack]:
        """The ways of `servos`, which leave contacts. Without those of groups whose straight way from where
        they were measured would bring links too near each other."""
        found = dict[int, WayBack]()
        for number, chain in self._chains.items():
            mine = servos & set(chain.servos)
            if not mine:
                continue
            limiter = chain.limiter
            way = limiter.target - self.measured[chain.index]
            others = [other for group, other in self._chains.items() if group != number]
            if self.body is not None and self.body.fault_of_way(chain.index, way, others, self.measured):
                continue
            speed = np.abs(way) / _lasts(np.abs(way), limiter.speed, limiter.bounds.acceleration)
            for servo in mine:
                place = chain.place[servo]
                found[servo] = WayBack(float(limiter.target[place]), float(speed[place]))
        return found

    def note_motion(self) -> None:
        """The caller has moved a group."""
        self._reference = None

    def moving(self, servos: Sequence[int]) -> list[JointGroup]:
        """Returns the groups that move `servos`. Servos without a command so far join their groups at their
        measured positions. Raises CommandError if a servo can't be added to its group now."""
        known = dict.fromkeys(map(self._chain_of.get, servos))
        if None not in known:
            return [chain for chain in known if chain]
        wanted: dict[int, set[int]] = {}
        for servo in servos:
            wanted.setdefault(self.group_of[servo], set()).add(servo)
        chains: dict[int, JointGroup] = {}
        for group, mine in wanted.items():
            old = self._chains.get(group)
            if old is not None and mine.issubset(old.servos):
                chains[group] = old
            else:
                chains[group] = self._chain(group, mine.union(old.servos if old else ()))
        if any(self._chains.get(group) is not chain for group, chain in chains.items()):
            self._chains.update(chains)
            self._note_change()
        return list(chains.values())

    def switch(self, servos: Sequence[int], mode: Mode, loose: set[int], speed: Array) -> None:
        """Switches `servos` to `mode`. Raises CommandError if some servos can't be switched; in this case
        nothing changes.

        A servo that follows its reference goes on from this reference, also while it moves. All others go on
        from their measured angles.

        Args:
            servos: Indices of the servos.
            mode: The new mode.
            loose: All servos of the robot that are in torque mode after the switch.
            speed: Measured velocities (n_servos,) [rad/s]; 0 for servos at rest.
        """
        fresh = [servo for servo in servos if self._starts_anew(servo)]
        starts = np.zeros(len(speed))
        starts[fresh] = speed[fresh]
        chains: dict[int, JointGroup | None] = {}
        for group in {self.group_of[servo] for servo in servos}:
            mine = {servo for servo in servos if self.group_of[servo] == group}
            old = self._chains.get(group)
            kept = (({*old.servos} if old else set()) | mine) - loose
            if old is not None and kept == {*old.servos} and kept.isdisjoint(fresh):
                chains[group] = old
            else:
                chains[group] = self._chain(group, kept, fresh, starts) if kept else None
        for servo in servos:
            self.modes[servo] = mode
        self._loose = np.array(sorted(loose), np.intp)
        for group, chain in chains.items():
            if chain is not None:
                self._chains[group] = chain
                places = chain.places([servo for servo in chain.servos if servo in servos])
                velocity = 0.0 if mode is Mode.VELOCITY else np.nan
                chain.limiter.drive_at(places, np.full(len(places), velocity))
            else:
                self._chains.pop(group, None)
        self._note_change()

    def _starts_anew(self, servo: int) -> bool:
        """True if a servo has no reference from which it could go on after a change of mode: nobody commands
        it, it is in torque mode, or it is compliant and not at its equilibrium. A compliant servo in motion
        is never exactly there, so it goes on from its reference while it is near."""
        chain = self._chains.get(self.group_of[servo])
        if chain is None or servo not in chain.servos:
            return True
        if self.modes[servo] is not Mode.IMPEDANCE:
            return False
        state = chain.limiter.whole_state[:, chain.servos.index(servo)]
        return not state[1] or bool(abs(state[0] - self.measured[servo]) > YIELDED)

    def _chain(
        self, group: int, servos: set[int], fresh: Sequence[int] = (), speed: Array | None = None
    ) -> JointGroup:
        """Returns a new `JointGroup` for the `servos` of group number `group`. Servos in `fresh` start at
        their measured angles, with the velocities `speed` (n_servos,) [rad/s]. Raises CommandError if a servo
        can't join the motion now."""
        old = self._chains.get(group)
        check_start(self._robot, {*servos} - ({*old.servos} - {*fresh} if old else set()), self.measured)
        chain = make_chain(
            self._robot,
            sorted(servos),
            self.measured,
            old=old,
            fresh=fresh,
            period=self._period,
            speed_share=self._settings.speed_share,
            guard=self._guard(group, sorted(servos)),
            speed=speed,
        )
        driven = [s for s in chain.servos if self.modes[s] is Mode.VELOCITY]
        places = [p for p in chain.places(driven) if not np.isfinite(chain.limiter.drive[p])]
        if places:
            chain.limiter.drive_at(places, np.zeros(len(places)))
        return chain

    def _guard(self, group: int, servos: Sequence[int]) -> Guard:
        """Returns a function that checks if a planned stop of a group's `servos` causes a self-collision."""
        index = np.array(servos)

        def fault(stop: StopTrajectory) -> Reason | None:
            if self.body is None:
                return None
            others = self._others.get(group)
            if others is None:
                others = [chain for other, chain in self._chains.items() if other != group]
                self._others[group] = others
            return self.body.fault(index, stop, others, self.measured)

        return fault


def _slowed(robot: Robot, shares: Array) -> Robot:
    """A robot whose servos have these shares (n_servos,) of their acceleration limits."""
    servos = []
    for servo, share in zip(robot.servos, shares.tolist(), strict=True):
        most = servo.limits.acceleration
        limits = servo.limits.model_copy(update={"acceleration": None if most is None else share * most})
        servos.append(servo.model_copy(update={"limits": limits}))
    return robot.model_copy(update={"servos": tuple(servos)})


def _lasts(ways: Array, speed: Array, acceleration: Array) -> float:
    """Time [s] of `ways` (n,) [rad] from rest to rest, all within `speed` (n,) [rad/s] and `acceleration`
    (n,) [rad/s2]."""
    cruises = ways * acceleration > speed**2
    times = np.where(cruises, ways / speed + speed / acceleration, 2.0 * np.sqrt(ways / acceleration))
    return max(float(times.max()), 1e-3)
