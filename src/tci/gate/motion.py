"""All servos under command: their control modes, their motions, and the torques that are sent to them."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.acceptance import by_servo, check_angles, check_command, check_limits
from tci.gate.bounds import MARGIN
from tci.gate.commanded_groups import CommandedGroups
from tci.gate.freshness import Freshness
from tci.gate.immovable import Immovable, is_movable
from tci.gate.joint_monitor import MonitorSettings, Reference
from tci.gate.loads import accelerating
from tci.gate.mode_switches import REST, STILL, ModeSwitches
from tci.gate.settings import GateSettings, Tally
from tci.gate.speeds import Slope
from tci.gate.torque import TorqueLimiter
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import Array, frozen
from tci.reasons import Code, Reason, decimals
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool

DEGREE = float(np.rad2deg(1.0))
"""Degrees in a radian."""
TARGETS = (Mode.POSITION, Mode.IMPEDANCE)
"""Modes whose commands are angles."""
SHARES = (Mode.STIFFNESS, Mode.DAMPING)
"""Quantities that can be set in every control mode."""
FASTEST = 1e6
"""Upper bound on requested speeds [rad/s]. Without this bound, calculations with a very large speed could
overflow."""


class Motion:
    """Moves the servos under command, each in its own mode, one step per control period."""

    def __init__(
        self, robot: Robot, *, period: float, settings: GateSettings, streams: bool, tally: Tally
    ) -> None:
        """Starts without servos under command; `period` [s] is the period of the control loop, and `streams`
        is explained at `Gate.streams`. Raises the errors that SelfCollision raises."""
        self.robot = robot
        self._settings = settings
        self._tally = tally
        self.groups = CommandedGroups(robot, period=period, settings=settings)
        """Servos under command, without those in torque mode."""
        self.groups.rehearse()
        self._torque = TorqueLimiter(
            robot, period, speed_share=settings.speed_share, push=(settings.monitor or MonitorSettings()).push
        )
        self._fed = np.full(len(robot.servos), -np.inf)
        self._velocity = np.zeros(len(robot.servos))
        self._freshness = Freshness(period)
        self._slope = Slope(len(robot.servos))
        self._switches = ModeSwitches(robot, self.groups, self._torque, self._slope, streams=streams)
        self._powered: NDArray[np.bool_] | None = None
        self._back: set[int] = set()  # groups in torque mode that go back from another link
        self._fixed = {servo.index for servo in robot.servos if not is_movable(servo)}
        self._immovable = Immovable(robot)
        self._shares = np.zeros(len(robot.servos))
        self._stiffness: dict[int, float] = {}
        self._damping: dict[int, float] = {}

    def load(self, tools: Mapping[str, Tool]) -> None:
        """Sets what links carry, by the name of the link. Raises CommandError while servos are so fast that
        they could not stop with it."""
        self.groups.slow(accelerating(self.robot, tools))
        self._torque.load(tools)

    @property
    def modes(self) -> list[Mode]:
        """Control mode of every servo."""
        return self.groups.modes

    @property
    def reference(self) -> Reference:
        """Present references of the servos under command. Servos in torque mode come last; their references
        are their measured positions."""
        return self.groups.reference()

    @property
    def targets(self) -> Array:
        """Targets (k,) [rad] of the servos under command, those in torque mode last. The target of a servo in
        torque mode is its measured position."""
        targets = [chain.limiter.target for chain in self.groups.chains]
        return np.concatenate([*targets, self.groups.measured[self._torque.servos]])

    def ahead(self, time: float) -> Array:
        """Returns the positions (k,) [rad] that the servos under command will have after `time` [s]. The
        order is that of `reference`: servos in torque mode come last, with their measured positions."""
        planned = [chain.limiter.ahead(time) for chain in self.groups.chains]
        return np.concatenate([*planned, self.groups.measured[self._torque.servos]])

    @property
    def moves(self) -> bool:
        """True if the reference of any servo moves now."""
        return any((np.abs(chain.limiter.state[1]) > STILL).any() for chain in self.groups.chains)

    def see(self, joints: JointReading, now: float, *, believed: bool) -> None:
        """Records the measured positions and speeds of all servos, if the data is new at `now` [s]. Data with
        `believed` False is not used: the monitor has found it untrustworthy."""
        if not self._freshness.see(joints, now, believed=believed):
            return
        self.groups.look(joints.position)
        self._velocity = joints.velocity
        self._powered = joints.powered
        self._slope.step(joints)
        self._switches.see(joints)

    def refuse(self, joints: JointReading) -> None:
        """Records a reading that can't be used. A repetition of this reading with a new stamp can't be used
        either."""
        self._freshness.refuse(joints)

    def fault_of_age(self, now: float, stale_after: float) -> Reason | None:
        """Returns the reason to stop at `now` [s] if the joint data is older than `stale_after` [s]; else
        None."""
        age = self._freshness.age(now)
        if age <= stale_after:
            return None
        since = f"for {age * 1e3:.0f} ms" if age < np.inf else "yet"
        return Reason(Code.JOINTS_STALE, f"no new joint data {since}")

    def halt(self, kept: AbstractSet[int] = frozenset()) -> None:
        """Stops all servos but those that move with `kept` within their limits, and removes all targets,
        velocities and commanded torques, and all switches that wait for rest."""
        self._switches.let_all_go()
        for chain in self.groups.chains:
            if kept.isdisjoint(chain.servos):
                chain.limiter.halt()
        self._torque.halt()

    def hold(self, servos: AbstractSet[int]) -> None:
        """Stops `servos`, and those that move with them, within their limits."""
        for chain in self.groups.chains:
            if not servos.isdisjoint(chain.servos):
                chain.limiter.halt()

    def retreat(self, servos: NDArray[np.intp], angles: Array, most: float | None = None) -> None:
        """Sends servos to `angles` (k,) [rad] on the gate's own order, in whichever mode they are, at most
        with the speed `most` [rad/s], each as soon as it can: the one that presses need not wait for
        the one that has the longest way. Switches that waited for their rest are forgotten, with the commands
        that came for the new mode. Servos that nobody commanded go on from where they are."""
        self._switches.let_go({*servos.tolist()})
        with suppress(CommandError):  # one without limits stays stiff
            self.groups.moving(np.setdiff1d(servos, self._torque.servos).tolist())
        for chain in self.groups.chains:
            mine = np.isin(servos, chain.servos)
            if not mine.any():
                continue
            limiter, places = chain.limiter, chain.places(servos[mine].tolist())
            limiter.drive_at(places, np.full(len(places), np.nan))
            target, speed = limiter.target.copy(), limiter.speed.copy()
            fastest = limiter.bounds.velocity[places]
            target[places] = angles[mine]
            speed[places] = fastest if most is None else np.minimum(fastest, most)
            limiter.aim(limiter.bounds.inside(target), speed, together=False)

    @property
    def unanswered(self) -> Array:
        """Torques (k,) [N m] that no reading answered, in the order of `reference`."""
        return np.concatenate([np.zeros(self.groups.count), self._torque.unanswered])

    def drop(self) -> None:
        """Ends the command of all servos. Control modes do not change: servos in torque mode stay in torque
        mode, with a commanded torque of 0."""
        self._switches.forget()
        self.groups.drop()
        self._torque.relax()
        self._torque.forget()

    def accept(self, order: PlatformOrder, now: float) -> list[Reason]:
        """Accepts an order. Returns one reason for each value that was clamped, and for a switch that waits
        for rest. If the order can't be accepted, raises CommandError and changes nothing."""
        if order.mode in SHARES and isinstance(order, PlatformCommand):
            return self._share(check_command(self.robot, order))
        order = self._immovable.left_out(order)
        if isinstance(order, PlatformSwitch):
            return self._switches.switch(order, now)
        command = check_command(self.robot, order)
        self._check_modes(command)
        if command.mode in TARGETS:
            check_angles(self.robot, command)
        if self._switches.keep(command, now):
            return []
        match command.mode:
            case Mode.VELOCITY:
                clamped = self._drive(command)
            case Mode.TORQUE:
                clamped = self._push(command)
            case _:
                return self._aim(command)
        self._fed[command.servos] = now
        return clamped

    def _aim(self, command: PlatformCommand) -> list[Reason]:
        """Sets the targets of the servos in a command. Returns the reasons for values that were clamped."""
        sent = np.empty(len(command.servos))
        for chain in self.groups.moving(command.servos.tolist()):
            chain.aim(command, sent)
        return self.clamps(command, sent, "rad")

    def step(self, now: float) -> list[Reason]:
        """Moves the servos by one period. Returns the reasons for motions that were ended to avoid
        self-collisions."""
        self._switches.begin_period()
        near: list[Reason] = []
        longest, body = self._settings.command_timeout, self.groups.body
        blind = self._freshness.overdue(self._freshness.age(now))
        moving = [chain for chain in self.groups.chains if not chain.limiter.rests]
        for chain in moving if body is None or not moving else body.turns(moving):
            limiter = chain.limiter
            if limiter.drives:
                late = [place for place in chain.driven if now - self._fed[chain.servos[place]] > longest]
                if late:
                    limiter.drive_at(late, np.zeros(len(late)))
            if limiter.outside:
                limiter.measured = self.groups.measured[chain.index]
            limiter.step(blind=blind)
            self.groups.note_motion()
            if (ended := limiter.ended) is not None:
                near.append(replace(ended, text=f"stopped on the way: {ended}"))
                self._tally.near_misses += ended.code is Code.SELF_COLLISION
        if self._torque.servos.size:
            self._torque.relax(np.flatnonzero(now - self._fed > longest))
            near += self._keep_apart(self._freshness.age(now)) + self._withheld()
        return near

    def _keep_apart(self, age: float) -> list[Reason]:
        """Takes servos in torque mode back whose motion would bring links too near each other. Returns the
        reasons for those that begin to go back."""
        body, loose = self.groups.body, self._torque.servos
        if body is None or not np.isfinite(age):
            return []
        ways, moves = self._torque.ways(self._velocity, age), np.abs(self._velocity[loose]) > REST
        groups, told, back = np.array(self.groups.group_of)[loose], [], set()
        for group in dict.fromkeys(groups.tolist()):
            own = groups == group
            with_others = np.where(own | moves, ways, 0.0)
            near = body.fault_of_way(loose, with_others, self.groups.chains, self.groups.measured)
            if near is None:
                continue
            self._torque.go_back(loose[own], ways[own])
            back.add(group)
            if group not in self._back:
                told.append(replace(near, text=f"goes back: {near}"))
                self._tally.near_misses += 1
        self._back = back
        return told

    def _withheld(self) -> list[Reason]:
        names = [self.robot.servos[servo].name for servo in self._torque.withheld()]
        words = "its readings repeat whatever the torque; it gets no more until one differs"
        return [Reason(Code.CLAMPED, f"{name}: {words}", (name,)) for name in names]

    def torques(self, now: float, *, due: bool) -> Array:
        """Returns the torques (k,) [N m] of the servos under command at `now` [s], in the order of
        `reference`.

        The torque is 0 for servos that are off and for servos in another mode than torque mode. `due` is True
        if the gate takes a step now; otherwise the torques do not change, except that they become smaller as
        joint data grows old.
        """
        others = self.groups.count
        if not self._torque.servos.size:
            return frozen(np.zeros(others))
        age = self._freshness.age(now)
        trust = np.full(len(self._torque.servos), self._freshness.trust(age))
        drives = bool(trust[0] == 1.0)
        if self._powered is not None:
            trust[~self._powered[self._torque.servos]] = 0.0
        if due:
            torque = self._torque.step(
                self.groups.measured, self._velocity, self._slope.speed,
                age=min(age, 1.0), span=self._slope.span, trust=trust, drives=drives,
            )  # fmt: skip
        else:
            torque = self._torque.again(trust=trust)
        return frozen(np.concatenate([np.zeros(others), torque]))

    def _push(self, command: PlatformCommand) -> list[Reason]:
        """Sets the torques of the servos in a command, which are in torque mode. Returns the reasons for
        values that were clamped."""
        sent = self._torque.ask(command.servos, command.values)
        return self.clamps(command, sent, "N m")

    def _check_modes(self, command: PlatformCommand) -> None:
        """Raises CommandError unless all limits of the servos are known and all of them are in the mode of
        the command, or wait to be switched to it."""
        for servo in command.servos.tolist():
            if servo in self._fixed:
                check_limits(self.robot.servos[servo])
            own = self._switches.mode_of(servo)
            if own is not command.mode:
                raise CommandError(
                    f"{self.robot.servos[servo].name} is in {own.value} mode, the command is "
                    f"in {command.mode.value} mode; valid: switch the mode first",
                    code=Code.WRONG_MODE,
                )

    def _drive(self, command: PlatformCommand) -> list[Reason]:
        """Sets the velocities of servos in velocity mode, and returns the reasons for velocities that were
        reduced. If one velocity exceeds its limit, all velocities of the command are reduced by one factor.
        """
        servos = command.servos.tolist()
        limits = np.array([self.robot.servos[servo].limits.velocity for servo in servos])
        most = np.minimum(command.speed, self._settings.speed_share * limits)
        values = command.values.astype(float)
        fastest = np.max(np.minimum(np.abs(values), FASTEST) / most, initial=1.0)
        sent = np.clip(values, -FASTEST, FASTEST) / fastest
        wanted = by_servo(command.servos, sent)
        for chain in self.groups.moving(servos):
            mine = [servo for servo in chain.servos if servo in wanted]
            chain.limiter.drive_at(chain.places(mine), np.array([wanted[servo] for servo in mine]))
        return self.clamps(command, sent, "rad/s")

    def settle(self, now: float) -> tuple[list[Reason], list[tuple[PlatformOrder, Reason]]]:
        """Switches servos that waited for rest and have come to rest, and executes the latest commands in
        their new modes. Returns the reasons for values that were clamped, and what was refused."""
        clamped: list[Reason] = []
        due, refused = self._switches.settle(now)
        for command, since in due:
            if command.mode in TARGETS or now - since <= self._settings.command_timeout:
                try:
                    clamped += self.accept(command, since)
                except CommandError as error:
                    refused.append((command, error.reason))
        return clamped, refused

    def take_shares(self) -> tuple[dict[int, float], dict[int, float]]:
        """Returns stiffness and damping (0..1), by servo index, that were commanded since the last call."""
        shares = self._stiffness, self._damping
        self._stiffness, self._damping = {}, {}
        return shares

    def soften(self, shares: Mapping[int, float]) -> None:
        """Sets the stiffness of servos (0..1) on the gate's own order."""
        self._stiffness.update(shares)
        self._shares[[*shares]] = [*shares.values()]

    def _share(self, command: PlatformCommand) -> list[Reason]:
        """Takes fractions of stiffness or damping. Returns the reasons for values that were clamped."""
        sent = np.clip(command.values, 0.0, 1.0)
        if command.mode is Mode.STIFFNESS:
            self._check_stiffness(command)
            self._shares[command.servos] = sent
        shares = self._stiffness if command.mode is Mode.STIFFNESS else self._damping
        shares.update(by_servo(command.servos, sent))
        return self.clamps(command, sent, command.mode.value)

    def _check_stiffness(self, command: PlatformCommand) -> None:
        """Raises CommandError if the command raises the stiffness of a joint that has yielded to an outside
        force. A stiffer joint would jump back to its equilibrium."""
        reference, monitor = self.reference, self._settings.monitor
        if monitor is None:
            return
        place = {servo: index for index, servo in enumerate(reference.servos.tolist())}
        for servo, share in by_servo(command.servos, command.values).items():
            if servo not in place or self.modes[servo] is not Mode.IMPEDANCE or share <= self._shares[servo]:
                continue
            deviation = abs(float(reference.position[place[servo]] - self.groups.measured[servo]))
            if deviation > monitor.following_error:
                raise CommandError(
                    f"{self.robot.servos[servo].name} is {np.rad2deg(deviation):.1f} degrees from its "
                    f"equilibrium; valid: no more stiffness than {self._shares[servo]:.2f} there",
                    code=Code.LIMITS_EXCEEDED,
                )

    def clamps(self, command: PlatformCommand, sent: Array, unit: str) -> list[Reason]:
        """Returns a reason for each servo whose accepted value in `sent` (k,) differs from the requested
        value in `command`, and adds 1 to the count of this servo's clamps. The reasons give the values in
        `unit`."""
        clamped: list[Reason] = []
        rows = zip(command.servos.tolist(), command.values.tolist(), sent.tolist(), strict=True)
        for servo, asked, allowed in rows:
            if abs(asked - allowed) > 2 * MARGIN:
                name = self.robot.servos[servo].name
                self._tally.clamps[name] += 1
                digits = decimals(asked, allowed, 2)
                both = (_amount(value, unit, digits) for value in (asked, allowed))
                text = f"{name}: {' asked, clamped to '.join(both)}"
                clamped.append(Reason(Code.CLAMPED, text, (name,)))
        return clamped


def _amount(value: float, unit: str, digits: int) -> str:
    """Returns a value with its unit, with so many decimals. An angle is also given in degrees, so that a
    caller who confused radians and degrees notices the error."""
    text = f"{value:.{digits}f} {unit}"
    degrees = f"{text} ({value * DEGREE:.{digits}f} {unit.replace('rad', 'degrees')})"
    return degrees if "rad" in unit else text
