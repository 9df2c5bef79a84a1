"""The gate, the last step before a command is sent: no command passes that violates a limit.

The gate checks in this order:

- The joint data is usable.
- The robot follows its references (`joint_monitor`).
- Each command has a valid shape and finite values, and its servos have known limits and are in the command's
  mode (`acceptance`, `motion`).
- Commanded positions keep limits and couplings: the gate clamps and reports positions that do not (`bounds`).
- Over time, the motion keeps the limits of velocity, acceleration and jerk (`trajectory`) or torque
  (`torque`).
- The robot does not collide with itself (`self_collision`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, DriverError, TciError
from tci.gate.acceptance import fault_of_reading
from tci.gate.answering import Answering
from tci.gate.commanded_groups import WayBack
from tci.gate.contact.settings import ContactSettings
from tci.gate.joint_monitor import JointMonitor
from tci.gate.loads import load_of
from tci.gate.motion import Motion
from tci.gate.pace import Pace
from tci.gate.safe_command import GateState as GateState
from tci.gate.safe_command import GateToken
from tci.gate.safe_command import SafeCommand as SafeCommand
from tci.gate.settings import GateCounts as GateCounts
from tci.gate.settings import GateSettings as GateSettings
from tci.gate.settings import Tally
from tci.messages import Contacts, JointReading, Met, Mode, PlatformOrder
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool
from tci.robot.like import RobotLike, as_robot


class Gate:
    """Converts requested commands to commands that a driver may write, one step per control period.

    A servo is under command after its first accepted command or mode switch. The motion of such a servo
    starts at the measured position of the servo. All commanded servos of one robot part reach their targets
    at the same time. If a coupling contains servos of two parts, all servos of both parts reach their targets
    at the same time. Each servo is in one control mode; only a PlatformSwitch changes the mode. If a servo
    moves then, its motion goes on from its present reference; where `streams` is False, it rests first.
    """

    def __init__(
        self,
        robot: RobotLike,
        *,
        period: float,
        stale_after: float,
        settings: GateSettings | None = None,
        streams: bool = False,
    ) -> None:
        """Raises TciError if a time is not finite or not above 0, and DescriptionError if the model can't be
        read.

        Args:
            robot: The robot.
            period: Period [s] of the control loop.
            stale_after: Age [s] of joint data above which the gate stops the robot (state HOLD).
            settings: Settings that the description does not contain.
            streams: True if the robot follows a stream of set-points in all its modes, see `streams`.
        """
        robot = as_robot(robot)
        if not 0.0 < period < np.inf or not 0.0 < stale_after < np.inf:
            raise TciError(f"period {period} s, stale_after {stale_after} s; valid: above 0 and finite")
        self._robot, self._period, self._stale_after = robot, period, stale_after
        self._streams = streams
        self._settings = settings or GateSettings()
        self.state = GateState.RUN
        self.reason: Reason | None = None
        """Reason why the gate holds or has stopped, as of the latest step. The value is None in the state
        RUN."""
        self._seal = GateToken(robot.name)
        self._issued: SafeCommand | None = None
        self._tally = Tally()
        self._motion = Motion(
            robot, period=period, settings=self._settings, streams=streams, tally=self._tally
        )
        monitor = self._settings.monitor
        self._monitor = None if monitor is None else JointMonitor(robot, monitor)
        self._answering = Answering(robot, self._settings.contact)
        self._stopped: Reason | None = None
        self._held: Reason | None = None
        self._loads: dict[str, Tool] = {}
        self._pace = Pace(robot.name, period)
        self.drop()

    @property
    def robot(self) -> Robot:
        """Robot whose limits the gate enforces."""
        return self._robot

    @property
    def period(self) -> float:
        """Time [s] between steps. The period is constant, because each step limits velocity, acceleration and
        jerk for one period of this length."""
        return self._period

    @property
    def stale_after(self) -> float:
        """Age [s] of joint data above which the gate stops the robot until newer data arrives."""
        return self._stale_after

    @property
    def streams(self) -> bool:
        """True if the robot follows a stream of set-points in all its modes, so that its modes may change
        while it moves. False if its own controllers plan the motion in some mode, or take time to change
        their mode: then the gate brakes a moving part, and switches it at rest."""
        return self._streams

    @property
    def settings(self) -> GateSettings:
        """Settings of the gate that the robot's description does not contain."""
        return self._settings

    @property
    def counts(self) -> GateCounts:
        """Numbers of steps, holds, stops, refusals and clamps since the gate was created."""
        return self._tally.counts

    @property
    def targets(self) -> Array:
        """Targets [rad] of the servos under command, in the order of `SafeCommand.servos`."""
        return self._motion.targets

    def ahead(self, time: float) -> Array:
        """Returns the positions (k,) [rad] that the servos under command will have after `time` [s] if no new
        command arrives.

        The order is that of `SafeCommand.servos`. Some robots need their path in advance: their drivers call
        this method.
        """
        return self._motion.ahead(float(time))

    @property
    def ways_back(self) -> Mapping[int, WayBack]:
        """The whole ways of servos that leave a contact on the gate's own order, by servo.

        A robot that plans its own motion gets a way at once, so that it frees whoever it presses also if its
        link is lost next. The gate judges limits and self-collision of the straight way, where it knows a
        model; it may change the way in each step.
        """
        return self._motion.groups.ways_back(self._answering.blocked)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Control mode of every servo."""
        return tuple(self._motion.modes)

    def load(self, part: str, mass: float, centre: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Declares what a part carries, such as a tool in a hand: `mass` [kg], 0 if it is empty again, with
        its `centre` (3,) [m] in the frame of the part's last link. Joints that carry it accelerate less,
        torque mode counts it as inertia, and what its weight bends is not held by somebody.

        The last link is the palm of an arm's hand. Takes up to 0.1 s, so declare it at rest. Raises
        UnknownNameError for an unknown part, CommandError for a robot without a model, for a load that
        can't be, and for one that servos in motion could not stop.
        """
        link, tool = load_of(self._robot, part, mass, centre)
        loads = self._loads | {link: tool}
        self._motion.load(loads)
        self._loads = loads
        self._answering.load(self._loads)

    def stop(self, reason: Reason | str) -> None:
        """Stops the robot within its limits and accepts no command until `reset`. If the gate has already
        stopped, the first reason is kept.

        A `reason` that is only a text gets the code OTHER.
        """
        if self._stopped is None:
            self._stopped = Reason.of(reason or "stopped without a reason")
            self._tally.stops += 1

    def hold(self, reason: Reason | str | None) -> None:
        """Holds the robot in the next step (state HOLD), for a reason that the control loop or the driver
        detects, such as missed periods.

        If `reason` is None or an empty text, nothing changes. The latest of several reasons is reported.
        """
        if reason:
            self._held = Reason.of(reason)

    def held(self, joints: JointReading, now: float) -> Reason | None:
        """Why a step at `now` [s] would refuse orders: the state STOP, a `hold`, or a reading that can't be
        used. None if nothing is known that would."""
        fault = fault_of_reading(self._robot, joints, now, self._stale_after)
        return self._stopped or fault or self._held

    def reset(self) -> None:
        """Ends the state STOP. Only an operator should call this method.

        No servo moves: each servo waits at its position for a new command. The control modes do not change,
        and earlier targets are forgotten. Raises CommandError while the robot is still decelerating: wait
        until the robot is at rest.
        """
        if self._motion.moves:
            raise CommandError("the robot still moves; valid: reset at rest, after a stop")
        if touched := self._answering.touched:
            raise CommandError(
                f"still in contact: {', '.join(touched)}; valid: reset when nothing presses, "
                "gate.free() to move away slowly",
                code=Code.CONTACT,
            )
        self._stopped = None
        self.drop()
        if self._monitor is not None:
            self._monitor.reset()

    @property
    def met(self) -> tuple[Met, ...]:
        """Contacts that this gate noticed in its last step, and parts that obey nobody yet; of a gate that
        doesn't answer contact, what the driver told of the one that does."""
        return self._answering.met

    def tell_met(self, met: Sequence[Met]) -> None:
        """Says what the gate of the robot's process noticed. Without effect on a gate that answers contact
        itself."""
        self._answering.tell_met(met)

    def set_contact(self, settings: ContactSettings) -> None:
        """Changes when a contact counts, and how each part answers it. Raises CommandError if something is in
        contact, or if another gate answers contact; UnknownNameError for a part that the robot lacks; and
        TciError for two fixtures of one name, or any beside a robot without a model."""
        self._answering.change(settings)
        self._settings = replace(self._settings, contact=settings)

    def free(self) -> None:
        """Moves every part that is in contact away from it, at most with 10 degrees per second: back along
        the path that it came, or, where no path is known, to where it is pushed. Works in the state STOP too,
        which goes on.

        Only an operator should call this method. Raises CommandError if nothing is in contact, or if the gate
        has stopped because angles or servos are not what they seem: then no way is known.
        """
        self._answering.free(self._stopped)

    def drop(self) -> None:
        """Ends the command of all servos, for a driver that has lost the connection to its robot.

        Each servo waits at its position for a new command. The control modes do not change. The state STOP
        does not end. If the gate has found the joint data untrustworthy, the gate continues to ignore this
        data.
        """
        if self._monitor is not None:
            self._monitor.forget()
        self._answering.forget()
        self._motion.drop()
        self._reference = self._motion.reference
        self._torque = np.zeros(len(self._reference.servos))

    def step(
        self,
        commands: Sequence[PlatformOrder] | PlatformOrder,
        joints: JointReading,
        now: float,
        *,
        refused: Sequence[Reason] = (),
        contacts: Contacts | None = None,
    ) -> SafeCommand:
        """Returns the command that a driver may write at time `now` [s].

        `commands` are the new commands, or one new command; `joints` is the latest joint reading. Call this
        method once per period, also without commands, because motions continue. A late call takes only one
        step, and an early call takes no step. Several steps at once would make the robot move faster than its
        limits. If all calls come late, the gate logs one warning.

        A command that can't be accepted raises no exception, because the robot needs a next position in any
        case. The command is refused as a whole, counted, and listed in `SafeCommand.refusals`; present
        motions continue. If an argument has a wrong type, that is a programming error and Python raises its
        usual exception. `refused` contains the reasons why other orders could not be converted to commands.
        These reasons are reported and counted too.
        """
        self._tally.steps += 1
        reason = self.reason = self._judge(joints, now, contacts)
        self._tally.torque_steps += self._answering.torques_tell
        refusals = list(refused)
        clamped: list[Reason] = [*self._answering.told]
        taken: list[PlatformOrder] = []
        refused_orders: list[tuple[PlatformOrder, Reason]] = []
        if not reason:
            late_clamps, refused_orders = self._motion.settle(now)
            clamped += late_clamps
            refusals += [why for _, why in refused_orders]
        for command in (commands,) if isinstance(commands, PlatformOrder) else commands:
            try:
                if reason:
                    self._answering.closed(command, now)
                    raise CommandError(f"{self.state.value}: {reason}", code=Code.GATE_CLOSED)
                if not isinstance(command, PlatformOrder):
                    words = f"a {type(command).__name__} is not in the robot's own joints"
                    raise CommandError(f"{words}; valid: the result of GenericBody.to_platform")
                if command.mode is Mode.EXPECTED_CONTACT:
                    self._answering.expect(command, now)
                    taken.append(command)
                    continue
                if (overtaken := self._answering.overtakes(command, joints, now)) is not None:
                    clamped.append(overtaken)
                    refused_orders.append((command, overtaken))
                    continue
                clamped += self._motion.accept(command, now)
                self._answering.accepted(command, now)
                taken.append(command)
            except CommandError as error:
                refusals.append(error.reason)
                refused_orders.append((command, error.reason))
        self._tally.refusals += len(refusals)
        if due := self._pace.is_due(now):
            clamped += self._motion.step(now)
        reference = self._reference = self._motion.reference
        self._torque = self._motion.torques(now, due=due)
        stiffness, damping = self._motion.take_shares()
        self._issued = SafeCommand(
            seal=self._seal,
            stamp=now,
            state=self.state,
            **reference._asdict(),
            torque=self._torque,
            stiffness=MappingProxyType(stiffness),
            damping=MappingProxyType(damping),
            clamped=tuple(clamped),
            refusals=tuple(refusals),
            reason=reason,
            met=self.met,
            orders=tuple(taken),
            refused=tuple(refused_orders),
        )
        return self._issued

    def check_out(self, safe: SafeCommand) -> None:
        """Raises DriverError unless `safe` is the latest command of this gate and was not written before.
        Drivers call this method before they write."""
        if self._issued is None or safe is not self._issued:
            raise DriverError(
                "not the latest command of this driver's gate, or written before; "
                "valid: write(gate.step(...)), once per step"
            )
        self._issued = None

    def _judge(self, joints: JointReading, now: float, contacts: Contacts | None) -> Reason | None:
        """Checks a joint reading at the time `now` [s], and sets the state of the gate (RUN, HOLD or STOP).
        Returns the reason why nothing may move now; None if the robot may move."""
        if back := self._pace.went_back(now):
            self.stop(Reason(Code.TIME_WENT_BACK, f"time went back by {back:.3f} s"))
        reason = fault_of_reading(self._robot, joints, now, self._stale_after)
        if reason:
            self._motion.refuse(joints)
        else:
            # also in the state STOP: a joint must not be braked on the basis of wrong data
            monitor, own = self._monitor, self._answering
            if monitor is not None:
                fault = monitor.step(
                    joints, self._reference, self._motion.unanswered, lags=own.lags, excused=own.excused
                )
                if fault is not None:
                    self.stop(fault)
            self._motion.see(joints, now, believed=monitor is None or not monitor.misled)
            reason = self._motion.fault_of_age(now, self._stale_after)
        blind = bool(reason)
        ways, often = self._answering.step(
            self._motion, joints, self._reference, now, contacts, self._stopped, blind=blind, held=self._held
        )
        if often is not None:
            self.stop(often)
        reason, self._held = reason or self._held, None
        if self._stopped:
            self.state, reason = GateState.STOP, self._stopped
        elif reason:
            self._tally.holds += self.state is not GateState.HOLD
            self.state = GateState.HOLD
        else:
            self.state = GateState.RUN
        if reason:
            self._motion.halt(frozenset() if blind else self._answering.blocked)
        for way in ways:
            self._motion.retreat(*way)
        if (stays := self._answering.stays) is not None:
            self._motion.hold(stays)
        return reason

    @property
    def disobey(self) -> frozenset[int]:
        """Servos that obey nobody now, since their part leaves a contact or waits for one that does."""
        return self._answering.disobey
