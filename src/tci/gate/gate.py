"""The gate: the last step before the wire. No command passes that a limit forbids.

Order of checks: usable joint data; whether the robot does what it is told (`joint_monitor`); for each command
its shape, finite values, known limits and the servo's mode (`acceptance`, `motion`); position and couplings,
clamped and reported (`bounds`); over time velocity, acceleration and jerk (`trajectory`) or torque
(`torque`); and the robot's own body (`self_collision`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from tci.errors import CommandError, DriverError, TciError
from tci.frames import Array
from tci.gate.acceptance import check_command, fault_of_reading
from tci.gate.joint_monitor import JointMonitor
from tci.gate.motion import Motion
from tci.gate.safe_command import GateState as GateState
from tci.gate.safe_command import GateToken
from tci.gate.safe_command import SafeCommand as SafeCommand
from tci.gate.settings import GateCounts as GateCounts
from tci.gate.settings import GateSettings as GateSettings
from tci.gate.settings import Tally
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder
from tci.reasons import Code, Reason
from tci.robot.description import Robot

EARLY = 0.05
"""Share of a period by which a step may come early and still move. Assumed: the jitter of timers."""
CATCH_UP = 0.5
"""Share of a period that a late call may make up for in the next. Assumed: jitter,
but no burst, is caught up."""
STEADY = 0.1
"""Share by which two late calls may differ and still come from a loop at a rate of its own. Assumed: what a
busy machine delays comes at odd times."""
SHARES = (Mode.STIFFNESS, Mode.DAMPING)
_log = logging.getLogger("tci")
_NONE: MappingProxyType[int, float] = MappingProxyType({})


class Gate:
    """Turns commands into what may be written, one step per control period.

    A servo is under command from its first accepted command or switch on, starting where it was
    measured. The commanded servos of one robot part, and of parts that couplings tie to it, move in the
    same time. Each servo is in one control mode; only a PlatformSwitch changes it.
    """

    def __init__(
        self, robot: Robot, *, period: float, stale_after: float, settings: GateSettings | None = None
    ) -> None:
        """`period` of the control loop [s]; joint data older than `stale_after` [s] means hold.

        Raises TciError for times that are not above 0 and finite, DescriptionError for a model that
        can't be read.
        """
        if not 0.0 < period < np.inf or not 0.0 < stale_after < np.inf:
            raise TciError(f"period {period} s, stale_after {stale_after} s; valid: above 0 and finite")
        self._robot, self._period, self._stale_after = robot, period, stale_after
        self._settings = settings or GateSettings()
        self.state = GateState.RUN
        self.reason: Reason | None = None
        """Reason for its state in the latest step; None while it runs."""
        self._seal = GateToken(robot.name)
        self._issued: SafeCommand | None = None
        self._tally = Tally()
        self._motion = Motion(robot, period=period, settings=self._settings, tally=self._tally)
        self._monitor = (
            JointMonitor(robot, self._settings.monitor) if self._settings.monitor is not None else None
        )
        self._told, self._pushed = self._motion.reference, np.zeros(0)
        self._stopped: Reason | None = None
        self._held: Reason | None = None
        self._credit, self._before = 1.0, -np.inf
        self._pace = 0.0

    @property
    def robot(self) -> Robot:
        """The robot whose limits it keeps."""
        return self._robot

    @property
    def period(self) -> float:
        """Time [s] from one step to the next. It does not change: the limits count for it."""
        return self._period

    @property
    def stale_after(self) -> float:
        """Age [s] of joint data beyond which it holds."""
        return self._stale_after

    @property
    def settings(self) -> GateSettings:
        """Settings that the description does not hold."""
        return self._settings

    @property
    def counts(self) -> GateCounts:
        """Numbers of events since the gate was made."""
        return self._tally.counts

    @property
    def targets(self) -> Array:
        """Targets [rad] of the servos under command, in the order of `SafeCommand.servos`."""
        return self._motion.targets

    def ahead(self, time: float) -> Array:
        """Returns the angles [rad] of the servos under command in `time` [s] if no other command comes, in
        the order of `SafeCommand.servos`: for robots that take trajectories."""
        return self._motion.ahead(time)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The control mode of every servo."""
        return tuple(self._motion.modes)

    def stop(self, reason: Reason | str) -> None:
        """Stops the robot within its limits and accepts nothing until `reset`. The first reason stays.

        A text alone is a reason of the code OTHER.
        """
        if self._stopped is None:
            self._stopped = Reason.of(reason or "stopped without a reason")
            self._tally.stops += 1

    def hold(self, reason: Reason | str | None) -> None:
        """Holds in the next step, for a reason that the loop knows: missed periods, a silent process.

        None, or an empty text, changes nothing; of several reasons the latest is told.
        """
        if reason:
            self._held = Reason.of(reason)

    def reset(self) -> None:
        """Leaves STOP, for an operator. Nothing moves: each servo waits for a command, where it is then.

        Control modes stay; what servos were asked for before is forgotten. Raises CommandError while
        the robot is still told to move: it would lose the rest of its stop.
        """
        if self._motion.moves:
            raise CommandError("the robot has not come to rest yet; valid: reset at rest")
        self._stopped = None
        self.drop()
        if self._monitor is not None:
            self._monitor.reset()

    def drop(self) -> None:
        """Ends all commands, for a driver whose robot was away. Each servo waits for a command,
        where it is then; modes stay, and so do STOP and a doubt in its joint data."""
        if self._monitor is not None:
            self._monitor.forget()
        self._motion.drop()
        self._told = self._motion.reference
        self._pushed = np.zeros(len(self._told.servos))

    def step(
        self,
        commands: Sequence[PlatformOrder] | PlatformOrder,
        joints: JointReading,
        now: float,
        *,
        refused: Sequence[Reason] = (),
    ) -> SafeCommand:
        """Returns what may be written at time `now` [s], for new `commands` or one, and the latest `joints`.

        Call it once per period, also without commands: motions go on. A late call takes one step, and a
        call before its time none, so that what is written is never faster than the limits; a loop that is
        late each time is warned of once. A command
        that can't be accepted does not raise, since the robot needs a next position all the same: it is
        refused whole, counted, and named in `refusals`; what was running goes on. An argument of another
        type is a mistake in the program and raises what Python raises. `refused` are reasons why others did
        not even become commands; they are told and counted with the rest.
        """
        self._tally.steps += 1
        reason = self.reason = self._judge(joints, now)
        refusals = list(refused)
        clamped: list[str] = []
        taken: list[PlatformOrder] = []
        stiffness: dict[int, float] = {}
        damping: dict[int, float] = {}
        for command in (commands,) if isinstance(commands, PlatformOrder) else commands:
            try:
                if reason:
                    raise CommandError(f"{self.state.value}: {reason}", code=Code.GATE_CLOSED)
                if not isinstance(command, PlatformOrder):
                    kind = type(command).__name__
                    raise CommandError(
                        f"a {kind} is in no robot's joints; valid: what GenericBody.to_platform gives"
                    )
                if isinstance(command, PlatformCommand) and command.mode in SHARES:
                    shares = stiffness if command.mode is Mode.STIFFNESS else damping
                    clamped += self._set_share(command, shares)
                else:
                    clamped += self._motion.accept(command, now)
                taken.append(command)
            except CommandError as error:
                refusals.append(error.reason)
        self._tally.refusals += len(refusals)
        due = self._is_due(now)
        if due:
            clamped += self._motion.step(now)
        told = self._told = self._motion.reference
        self._pushed = self._motion.torques(now, due=due)
        self._issued = SafeCommand(
            seal=self._seal,
            stamp=now,
            state=self.state,
            servos=told.servos,
            modes=told.modes,
            position=told.position,
            velocity=told.velocity,
            torque=self._pushed,
            stiffness=MappingProxyType(stiffness) if stiffness else _NONE,
            damping=MappingProxyType(damping) if damping else _NONE,
            clamped=tuple(clamped),
            refusals=tuple(refusals),
            reason=reason,
            orders=tuple(taken),
        )
        return self._issued

    def check_out(self, safe: SafeCommand) -> None:
        """Raises DriverError, for drivers, unless `safe` is the latest of this gate and not yet written."""
        if self._issued is None or safe is not self._issued:
            raise DriverError(
                "not the latest command of this link's gate, or written before; "
                "valid: write(gate.step(...)), once per step"
            )
        self._issued = None

    def _judge(self, joints: JointReading, now: float) -> Reason | None:
        """Sets the state, and returns the reason why nothing may move now; None when all is well."""
        if -np.inf < now < self._before - self.period:
            words = f"time went back by {self._before - now:.3f} s"
            self.stop(Reason(Code.TIME_WENT_BACK, words))
            self._before = now - self.period
        reason = fault_of_reading(self.robot, joints, now, self.stale_after)
        if reason:
            self._motion.refuse(joints)
        else:
            monitor = self._monitor  # also while it is stopped: what brakes a joint must not believe a lie
            if monitor is not None and (fault := monitor.step(joints, self._told, self._pushed)):
                self.stop(fault)
            self._motion.see(joints, now, believed=monitor is None or not monitor.misled)
            reason = self._motion.fault_of_age(now, self.stale_after)
        reason, self._held = reason or self._held, None
        if self._stopped:
            self.state, reason = GateState.STOP, self._stopped
        elif reason:
            self._tally.holds += self.state is not GateState.HOLD
            self.state = GateState.HOLD
        else:
            self.state = GateState.RUN
        if reason:
            self._motion.halt()
        return reason

    def _is_due(self, now: float) -> bool:
        """Returns True if a step is due at `now` [s]: there are no more steps than periods, and no burst."""
        if not math.isfinite(now):
            return False
        if self._before > -np.inf:
            passed = max(0.0, now - self._before) / self.period
            self._look_at_rate(passed)
            self._credit = min(self._credit + passed, 1.0 + CATCH_UP)
        self._before = max(self._before, now)
        if self._credit < 1.0 - EARLY:
            return False
        self._credit -= 1.0
        return True

    def _look_at_rate(self, passed: float) -> None:
        """Warns of a loop at a rate of its own, at its second late call; `passed` [periods] since the last.

        A loop that was ever in time is only delayed, and told of that by who runs it.
        """
        if passed <= 1.0 + CATCH_UP:
            self._pace = math.nan
        elif abs(passed - self._pace) <= STEADY * passed:
            self._pace = math.nan
            rate = 1.0 / (passed * self.period)
            _log.warning(
                f"{self.robot.name}: gate.step is called every {1e3 / rate:.4g} ms and plans for "
                f"{1e3 * self.period:.4g} ms: motions take {passed:.3g} times as long; valid: a step in each "
                f"of link.ticks(), or connect to 'sim' with rate={rate:.4g}; other links have the rate of "
                "their binding in the robot's description"
            )
        elif not math.isnan(self._pace):
            self._pace = passed

    def _set_share(self, command: PlatformCommand, shares: dict[int, float]) -> list[str]:
        """Takes shares 0..1 of stiffness or damping, and returns what was clamped. Raises CommandError."""
        check_command(self.robot, command)
        if command.mode is Mode.STIFFNESS:
            self._motion.check_stiffness(command)
        sent = np.clip(command.values, 0.0, 1.0)
        shares.update(zip(command.servos.tolist(), sent.tolist(), strict=True))
        return self._motion.clamps(command, sent.tolist(), command.mode.value)
