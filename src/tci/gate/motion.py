"""All servos under command: the mode of each, where it goes, and what is sent for it."""

from __future__ import annotations

from collections.abc import Sequence
from operator import is_

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.frames import Array, frozen
from tci.gate.acceptance import (
    FAR_OFF,
    check_command,
    check_limits,
    check_start,
    check_switch,
    refuse_degrees,
)
from tci.gate.body_guard import BodyGuard
from tci.gate.bounds import MARGIN
from tci.gate.freshness import Freshness
from tci.gate.joint_group import JointGroup, groups_of, make_chain
from tci.gate.joint_monitor import Reference
from tci.gate.kernels.targets import is_far_off
from tci.gate.self_collision import SelfCollision
from tci.gate.settings import GateSettings, Tally
from tci.gate.speeds import Slope, Speeds
from tci.gate.stop_plan import StopTrajectory
from tci.gate.torque import TorqueLimiter
from tci.gate.trajectory import Guard
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.reasons import Code, Reason
from tci.robot.description import Robot

REST = float(np.deg2rad(3.0))
"""Measured speed [rad/s] below which a servo is at rest. Ours."""
STILL = 1e-6
"""Commanded speed [rad/s] that is only rounding."""
DEGREE = float(np.rad2deg(1.0))
"""Degrees in a radian."""
TARGETS = (Mode.POSITION, Mode.IMPEDANCE)
"""Modes whose commands are angles."""
FASTEST = 1e6
"""No servo is asked for more [rad/s]: larger numbers overflow where they are divided."""


class Motion:
    """Moves the servos under command, each in its own mode, one step per control period."""

    def __init__(self, robot: Robot, *, period: float, settings: GateSettings, tally: Tally) -> None:
        """`period` [s] of the control loop. Raises what SelfCollision raises."""
        self.robot = robot
        self._period = period
        self._settings = settings
        self._tally = tally
        limits = [servo.limits for servo in robot.servos]
        self._lower = np.array([limit.lower for limit in limits], dtype=float)
        self._upper = np.array([limit.upper for limit in limits], dtype=float)
        self._groups = groups_of(robot)
        self._chains: dict[int, JointGroup] = {}
        self._torque = TorqueLimiter(robot, period, speed_share=settings.speed_share)
        self._fed = np.full(len(robot.servos), -np.inf)
        self._measured = self._velocity = self._speed = np.zeros(len(robot.servos))
        self._freshness = Freshness(period)
        self._speeds, self._slope = Speeds(len(robot.servos)), Slope(len(robot.servos))
        self._powered: NDArray[np.bool_] | None = None
        self._switched: set[int] = set()
        self._known: set[int] = set()
        self._shares = np.zeros(len(robot.servos))
        margin = settings.self_collision
        body = None if robot.model is None or margin is None else SelfCollision(robot, margin=margin)
        self._body = None if body is None else BodyGuard(body, period=period)
        self._shown: Reference | None = None
        self._none = frozen(np.zeros(0))
        self._states: list[Array] = []
        self._shown_of: list[JointGroup] | None = None
        self.modes = [servo.modes[0] for servo in robot.servos]
        """Control mode of every servo."""

    @property
    def reference(self) -> Reference:
        """What is told to the servos now; those in torque mode come last, where they were measured."""
        chains = list(self._chains.values())
        states = [chain.limiter.whole_state for chain in chains]
        loose = self._torque.servos
        rests = len(states) == len(self._states) and all(map(is_, states, self._states))
        if self._shown is not None and rests and not loose.size:
            return self._shown
        if self._shown is not None and not loose.size and chains == self._shown_of:
            servos, modes = self._shown.servos, self._shown.modes
        else:
            servos = frozen(np.concatenate([*(chain.index for chain in chains), loose]))
            modes = tuple(self.modes[servo] for servo in servos.tolist())
        self._states, self._shown_of = states, None if loose.size else chains
        if loose.size or not states:
            states = [*states, np.zeros((3, loose.size))]
            states[-1][0] = self._measured[loose]
        told = frozen(np.concatenate(states, axis=1))
        self._shown = Reference(
            servos=servos,
            modes=modes,
            position=told[0],
            velocity=told[1],
        )
        return self._shown

    @property
    def targets(self) -> Array:
        """Where the servos under command are going [rad], in the order of `reference`."""
        targets = [chain.limiter.target for chain in self._chains.values()]
        return np.concatenate([*targets, self._measured[self._torque.servos]])

    def ahead(self, time: float) -> Array:
        """Where the servos under command will be [rad] in `time` [s], in the order of `reference`."""
        planned = [chain.limiter.ahead(time) for chain in self._chains.values()]
        return np.concatenate([*planned, self._measured[self._torque.servos]])

    @property
    def moves(self) -> bool:
        """Whether any servo is told to move now."""
        return any((np.abs(chain.limiter.state[1]) > STILL).any() for chain in self._chains.values())

    def see(self, joints: JointReading, now: float, *, believed: bool) -> None:
        """Where all servos were measured, and how fast they were, if it is new at `now` [s] and believed."""
        if not self._freshness.see(joints, now, believed=believed):
            return
        self._measured, self._velocity = joints.position, joints.velocity
        self._powered = joints.powered
        self._speed = self._speeds.step(joints)
        self._slope.step(joints)
        for chain in self._chains.values():
            chain.look_outside(joints.position)

    def refuse(self, joints: JointReading) -> None:
        """A reading can't be used, now or under a fresh stamp."""
        self._freshness.refuse(joints)

    def fault_of_age(self, now: float, stale_after: float) -> Reason | None:
        """Returns why nothing may move at `now` [s], if what is known is older than `stale_after` [s]."""
        age = self._freshness.age(now)
        if age <= stale_after:
            return None
        return Reason(Code.JOINTS_STALE, f"no new joint data for {age * 1e3:.0f} ms")

    def halt(self) -> None:
        """Stop all servos within their limits; targets, velocities and torques are forgotten."""
        for chain in self._chains.values():
            chain.limiter.halt()
        self._torque.halt()

    def drop(self) -> None:
        """No servo is under command any more but those in torque mode, which get none; modes stay."""
        self._chains.clear()
        self._torque.relax()

    def accept(self, command: PlatformOrder, now: float) -> list[str]:
        """Take an order over; says what was clamped. Raises CommandError, then it had no effect."""
        if isinstance(command, PlatformSwitch):
            self._switch(command)
            return []
        servos, values, speeds = check_command(self.robot, command)
        mode = command.mode
        for servo in servos.tolist():
            if servo not in self._known:
                check_limits(self.robot.servos[servo])
                self._known.add(servo)
            if self.modes[servo] is not mode:
                raise CommandError(
                    f"{self.robot.servos[servo].name} is in {self.modes[servo].value} mode, the command is "
                    f"a {mode.value}; valid: switch the mode first",
                    code=Code.WRONG_MODE,
                )
        if mode in TARGETS:
            if is_far_off(servos, values, self._lower, self._upper, FAR_OFF):
                refuse_degrees(self.robot, command)
            clamped = self._aim(command, servos, values, speeds)
        else:
            clamped = self._push(command) if mode is Mode.TORQUE else self._drive(command)
        self._fed[servos] = now
        return clamped

    def step(self, now: float) -> list[str]:
        """Move by one period; says which motions were ended so that the robot does not hit itself."""
        self._switched.clear()
        longest = self._settings.command_timeout
        near: list[str] = []
        chains = self._chains.values()
        moving = [chain for chain in chains if not chain.limiter.rests]
        for chain in moving if self._body is None or not moving else self._body.turns(chains, moving):
            late = [place for place in chain.driven if now - self._fed[chain.servos[place]] > longest]
            if late:
                chain.limiter.drive_at(late, np.zeros(len(late)))
            chain.limiter.step()
            if chain.limiter.ended:
                near.append(f"stopped on the way: {chain.limiter.ended}")
        if self._torque.servos.size:
            self._torque.relax(np.flatnonzero(now - self._fed > longest))
        self._tally.near_misses += len(near)
        return near

    def torques(self, now: float, *, due: bool) -> Array:
        """Torque (k,) [N m] of each servo of `reference` at `now` [s]; 0 for those in another mode, and for
        those that are off. Where no step is `due` they stay, and end with the trust in their data."""
        if not self._torque.servos.size:
            if len(self._none) != (others := len(self.reference.servos)):
                self._none = frozen(np.zeros(others))
            return self._none
        others = sum(len(chain.servos) for chain in self._chains.values())
        age = self._freshness.age(now)
        trust = np.full(len(self._torque.servos), self._freshness.trust(age))
        if self._powered is not None:
            trust[~self._powered[self._torque.servos]] = 0.0
        if due:
            torque = self._torque.step(
                self._measured, self._velocity, self._slope.speed,
                age=min(age, 1.0), span=self._slope.span, trust=trust,
            )  # fmt: skip
        else:
            torque = self._torque.again(trust=trust)
        return frozen(np.concatenate([np.zeros(others), torque]))

    def _push(self, command: PlatformCommand) -> list[str]:
        """Torques for servos in torque mode."""
        sent = self._torque.ask(command.servos, command.values)
        return self.clamps(command, sent.tolist(), "N m")

    def _aim(
        self, command: PlatformCommand, servos: NDArray[np.intp], values: Array, speeds: Array
    ) -> list[str]:
        """Give servos in position or impedance mode new targets."""
        sent = np.empty(len(servos))
        chains = self._chains_with(servos.tolist())
        if max(chain.aim(servos, values, speeds, sent) for chain in chains) <= 2 * MARGIN:
            return []
        return self.clamps(command, sent.tolist(), "degrees")

    def _drive(self, command: PlatformCommand) -> list[str]:
        """Drive servos in velocity mode; where one can't be as fast, all slow down by the same share."""
        servos = command.servos.tolist()
        limits = np.array([self.robot.servos[servo].limits.velocity for servo in servos], dtype=float)
        most = np.minimum(command.speed, self._settings.speed_share * limits)
        values = command.values.astype(float)
        fastest = np.max(np.minimum(np.abs(values), FASTEST) / most, initial=1.0)
        sent = np.clip(values, -FASTEST, FASTEST) / fastest
        wanted = dict(zip(servos, sent.tolist(), strict=True))
        for chain in self._chains_with(servos):
            mine = [servo for servo in chain.servos if servo in wanted]
            chain.limiter.drive_at(chain.places(mine), np.array([wanted[servo] for servo in mine]))
        return self.clamps(command, sent.tolist(), "degrees/s")

    def check_stiffness(self, command: PlatformCommand) -> None:
        """Raises CommandError where more stiffness would throw a compliant joint back to its equilibrium."""
        told = self.reference
        place = {servo: index for index, servo in enumerate(told.servos.tolist())}
        for servo, share in zip(command.servos.tolist(), command.values.tolist(), strict=True):
            if servo not in place or self.modes[servo] is not Mode.IMPEDANCE or share <= self._shares[servo]:
                continue
            away = abs(float(told.position[place[servo]] - self._measured[servo]))
            monitor = self._settings.monitor
            if monitor is not None and away > monitor.following_error:
                raise CommandError(
                    f"{self.robot.servos[servo].name} is {np.rad2deg(away):.1f} degrees from its "
                    f"equilibrium; valid: no more stiffness than {self._shares[servo]:.2f} there",
                    code=Code.LIMITS_EXCEEDED,
                )
        self._shares[command.servos] = np.clip(command.values, 0.0, 1.0)

    def clamps(self, command: PlatformCommand, sent: Sequence[float], unit: str) -> list[str]:
        """Count and name the servos for which another value counts than the one asked for."""
        clamped: list[str] = []
        for servo, asked, allowed in zip(command.servos.tolist(), command.values.tolist(), sent, strict=True):
            if abs(asked - allowed) > 2 * MARGIN:
                name = self.robot.servos[servo].name
                self._tally.clamps[name] += 1
                factor = DEGREE if unit.startswith("degrees") else 1.0
                clamped.append(
                    f"{name}: {asked * factor:.2f} {unit} asked, clamped to {allowed * factor:.2f}"
                )
        return clamped

    def _switch(self, switch: PlatformSwitch) -> None:
        """Put servos that rest under command in another mode, where they are. Raises CommandError."""
        check_switch(self.robot, switch)
        servos = [servo for servo in switch.servos.tolist() if self.modes[servo] is not switch.mode]
        told = self.reference
        moving = {
            *told.servos[np.abs(told.velocity) > STILL].tolist(),
            *np.flatnonzero(np.abs(self._speed) > REST).tolist(),
        }
        for servo in servos:
            if servo in self._switched:
                raise CommandError(
                    f"{self.robot.servos[servo].name} was switched in this period; valid: one mode at a time",
                    code=Code.WRONG_MODE,
                )
            if servo in moving:
                words = f"is moving; valid: switch to {switch.mode.value} at rest"
                raise CommandError(f"{self.robot.servos[servo].name} {words}", code=Code.IN_MOTION)
        loose = {*self._torque.servos.tolist(), *servos}
        if switch.mode is not Mode.TORQUE:
            loose -= set(servos)
        # A joint that yielded is elsewhere than its equilibrium: it goes on from where it is.
        fresh = [servo for servo in servos if self.modes[servo] in (Mode.IMPEDANCE, Mode.TORQUE)]
        chains: dict[int, JointGroup | None] = {}
        for group in {self._groups[servo] for servo in servos}:
            mine = {servo for servo in servos if self._groups[servo] == group}
            old = self._chains.get(group)
            kept = ({*old.servos} if old else set()) | mine
            chains[group] = self._chain(group, kept - loose, fresh) if kept - loose else None
        self._shown = None
        for servo in servos:
            self.modes[servo] = switch.mode
        self._switched.update(servos)
        self._torque.set_servos(sorted(loose))
        for group, chain in chains.items():
            if chain is not None:
                self._chains[group] = chain
                places = chain.places([servo for servo in chain.servos if servo in servos])
                velocity = 0.0 if switch.mode is Mode.VELOCITY else np.nan
                chain.limiter.drive_at(places, np.full(len(places), velocity))
            else:
                self._chains.pop(group, None)

    def _chains_with(self, servos: Sequence[int]) -> list[JointGroup]:
        """The chains that move `servos`, which join them where they are. Raises CommandError."""
        wanted: dict[int, set[int]] = {}
        for servo in servos:
            wanted.setdefault(self._groups[servo], set()).add(servo)
        chains = {}
        for group, mine in wanted.items():
            old = self._chains.get(group)
            if old is not None and mine.issubset(old.servos):
                chains[group] = old
            else:
                chains[group] = self._chain(group, mine.union(old.servos if old else ()))
        self._chains.update(chains)
        return list(chains.values())

    def _chain(self, group: int, servos: set[int], fresh: Sequence[int] = ()) -> JointGroup:
        """A chain for the group. Raises CommandError when some servos can't join its motion now."""
        old = self._chains.get(group)
        check_start(self.robot, {*servos} - ({*old.servos} - {*fresh} if old else set()), self._measured)
        chain = make_chain(
            self.robot,
            sorted(servos),
            self._measured,
            old=old,
            fresh=fresh,
            period=self._period,
            speed_share=self._settings.speed_share,
            guard=self._guard(group, sorted(servos)),
        )
        driven = [s for s in chain.servos if self.modes[s] is Mode.VELOCITY]
        places = [p for p in chain.places(driven) if not np.isfinite(chain.limiter.drive[p])]
        if places:
            chain.limiter.drive_at(places, np.zeros(len(places)))
        return chain

    def _guard(self, group: int, servos: Sequence[int]) -> Guard:
        """What looks at the robot's body before `servos` of a group get nearer to it."""
        index = np.array(servos, dtype=np.intp)

        def fault(stop: StopTrajectory) -> Reason | None:
            if self._body is None:
                return None
            others = [chain for other, chain in self._chains.items() if other != group]
            return self._body.fault(index, stop, others, self._measured)

        return fault
