"""Changes of control mode: at once where the robot streams set-points or rests, else after braking."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

import numpy as np

from tci.errors import CommandError
from tci.gate.acceptance import check_switch
from tci.gate.commanded_groups import CommandedGroups
from tci.gate.joint_monitor import JUDGED
from tci.gate.speeds import Lags, Slope, Speeds
from tci.gate.torque import TorqueLimiter
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.reasons import Code, Reason
from tci.robot.description import Robot

REST = float(np.deg2rad(3.0))
"""Measured speed [rad/s] below which a servo is at rest, so that its mode may be switched. Assumed: above an
encoder's noise, and slow enough for a switch without a jolt."""
STILL = 1e-6
"""Commanded speed [rad/s] below which a joint counts as at rest. Assumed: above rounding errors."""
PUSHED = float(np.deg2rad(10.0))
"""Measured speed [rad/s] up to which a stiff joint counts as at rest once it had the time to settle: its
servo holds it, and whoever touches the part pushes it a little. Without this a reflex waited for the touch to
end: 8 N moved the elbow of a NAO at 7 degrees/s."""
HELD = float(np.deg2rad(1.0))
"""Distance [rad] from its resting reference within which a servo holds its joint."""
PATIENCE = 0.5
"""Time [s] after the told end of braking for which a switch waits until its servos rest. Assumed: a joint
that moves for longer is moved by hand."""


@dataclass(slots=True)
class WaitingSwitch:
    """A change of mode for which servos brake, and what they were told to do afterwards."""

    servos: tuple[int, ...]
    mode: Mode
    rests: float
    """Time [s] at which the servos should rest."""
    commands: list[tuple[PlatformCommand, float]] = field(default_factory=list)
    """Commands in the new mode, each with the time [s] at which it came."""

    def names(self, command: PlatformCommand) -> bool:
        """True if the command moves a servo that waits here."""
        return not {*self.servos}.isdisjoint(command.servos.tolist())

    def keep(self, command: PlatformCommand, now: float) -> None:
        """Keeps a command, in place of earlier ones to the same servos."""
        named = {*command.servos.tolist()}
        older = [one for one in self.commands if not named.issuperset(one[0].servos.tolist())]
        self.commands = [*older, (command, now)]


class ModeSwitches:
    """The switches of one robot's servos, and those that wait for rest."""

    def __init__(
        self, robot: Robot, groups: CommandedGroups, torque: TorqueLimiter, slope: Slope, *, streams: bool
    ) -> None:
        """`streams` is explained at `Gate.streams`; `slope` are the mean speeds of the latest readings."""
        self._robot, self._groups, self._torque, self._streams = robot, groups, torque, streams
        self._slope, self._lags = slope, Lags(len(robot.servos))
        self._speeds, self._speed = Speeds(len(robot.servos)), np.zeros(len(robot.servos))
        self._switched: set[int] = set()
        self._waiting: list[WaitingSwitch] = []

    def see(self, joints: JointReading) -> None:
        """Notes a new reading."""
        self._speed = self._speeds.step(joints)
        if not self._streams:
            self._lags.step(joints, self._groups.reference())

    def forget(self) -> None:
        """Forgets all switches that wait."""
        self._waiting.clear()

    def begin_period(self) -> None:
        """Servos may be switched once more; those in torque mode that wait for rest are braked."""
        self._switched.clear()
        for switch in self._waiting:
            loose = [servo for servo in switch.servos if self._groups.modes[servo] is Mode.TORQUE]
            self._torque.halt(np.array(loose, np.intp))

    def keep(self, command: PlatformCommand, now: float) -> bool:
        """Keeps a command for the time after the switch if one of its servos waits; else returns False."""
        waits = next((switch for switch in self._waiting if switch.names(command)), None)
        if waits is not None:
            waits.keep(command, now)
        return waits is not None

    def mode_of(self, servo: int) -> Mode:
        """The mode in which a command is accepted: the present one, or the one that the servo waits for."""
        waits = (switch.mode for switch in reversed(self._waiting) if servo in switch.servos)
        return next(waits, self._groups.modes[servo])

    def let_all_go(self) -> None:
        self.let_go({servo for switch in self._waiting for servo in switch.servos})

    def switch(self, switch: PlatformSwitch, now: float) -> list[Reason]:
        """Switches servos to another mode, in motion or once they rest. In the second case returns the reason
        with the braking time. Raises CommandError if a servo can't be switched."""
        check_switch(self._robot, switch)
        if switch.mode is Mode.TORQUE:
            self._torque.check(switch.servos)
        for servo in switch.servos.tolist():
            if servo in self._switched and self._groups.modes[servo] is not switch.mode:
                name = self._robot.servos[servo].name
                words = f"{name} was switched in this period; valid: one mode at a time"
                raise CommandError(words, code=Code.WRONG_MODE)
        awaited = {s for one in self._waiting if one.mode is switch.mode for s in one.servos}
        self.let_go({*switch.servos.tolist()} - awaited)
        servos = [
            s for s in switch.servos.tolist() if self._groups.modes[s] is not switch.mode and s not in awaited
        ]
        if not servos:
            return []
        if self._streams or not self._moving(servos):
            self._change(servos, switch.mode)
            return []
        return [self._brake(servos, switch.mode, now)]

    def _change(self, servos: Sequence[int], mode: Mode) -> None:
        """Changes the mode of servos now. Raises CommandError if they can't go on in this mode now."""
        loose = {*self._torque.servos.tolist(), *servos}
        if mode is not Mode.TORQUE:
            loose -= {*servos}
        self._groups.switch(servos, mode, loose, np.where(np.abs(self._speed) > REST, self._speed, 0.0))
        self._switched.update(servos)
        self._torque.set_servos(sorted(loose))

    def _moving(self, servos: Sequence[int]) -> bool:
        """True if one of the servos moves: its reference, or its joint by measurement."""
        if (np.abs(self._speed[list(servos)]) > REST).any():
            return True
        reference = self._groups.reference()
        return not set(servos).isdisjoint(reference.servos[np.abs(reference.velocity) > STILL].tolist())

    def _brake(self, servos: Sequence[int], mode: Mode, now: float) -> Reason:
        """Brakes servos that will switch to `mode` at rest. Returns a reason with the braking time: that of
        the references, and the lag with which the joints follow."""
        longest = 0.0
        for chain in self._groups.chains:
            places = chain.places([servo for servo in chain.servos if servo in servos])
            if places:
                longest = max(longest, chain.limiter.stops_in(places))
                chain.limiter.drive_at(places, np.zeros(len(places)))
        longest += self._lags.of(servos)
        for servo in servos:
            if self._groups.modes[servo] is Mode.TORQUE:
                longest = max(
                    longest, abs(self._speed[servo]) / (self._robot.servos[servo].limits.acceleration or 1.0)
                )
        self._waiting.append(WaitingSwitch(tuple(servos), mode, rests=now + longest))
        parts = ", ".join(dict.fromkeys(self._robot.servos[servo].robot_part for servo in servos))
        text = f"{parts} switches to {mode.value} in {1e3 * longest:.0f} ms, at rest"
        return Reason(Code.SWITCHES_AT_REST, text, tuple(self._robot.servos[servo].name for servo in servos))

    def _settled(self, switch: WaitingSwitch, now: float) -> bool:
        """True if servos that wait for a switch rest: by measurement, or held by their servos at resting
        references."""
        if not self._moving(switch.servos):
            return True
        if now < switch.rests or not all(self._groups.modes[servo] in JUDGED for servo in switch.servos):
            return False
        reference, servos = self._groups.reference(), list(switch.servos)
        mine = np.isin(reference.servos, servos)
        off = np.abs(reference.position - self._groups.measured[reference.servos])[mine]
        rests = np.count_nonzero(mine) == len(servos) and (np.abs(reference.velocity[mine]) <= STILL).all()
        # a guessed speed follows so late that the mean of the last 20 ms may know better
        speed = np.fmin(np.abs(self._speed), np.abs(self._slope.speed))[servos]
        return bool(rests and off.max() <= HELD and speed.max() <= PUSHED)

    def settle(
        self, now: float
    ) -> tuple[list[tuple[PlatformCommand, float]], list[tuple[PlatformOrder, Reason]]]:
        """Switches servos that waited for rest and have come to rest. Returns the latest commands in their
        new modes, each with the time [s] at which it came, and what was refused."""
        due: list[tuple[PlatformCommand, float]] = []
        refused: list[tuple[PlatformOrder, Reason]] = []
        for switch in self._waiting.copy():
            order = PlatformSwitch(np.array(switch.servos, np.intp), switch.mode)
            if not self._settled(switch, now):
                if now > switch.rests + PATIENCE:
                    self.let_go({*switch.servos})
                    moving = [servo for servo in switch.servos if self._moving([servo])]
                    names = ", ".join(self._robot.servos[servo].name for servo in moving)
                    words = f"{names} kept moving; valid: switch to {switch.mode.value} at rest"
                    refused.append((order, Reason(Code.IN_MOTION, words)))
                continue
            self._waiting.remove(switch)
            try:
                self._change(switch.servos, switch.mode)
            except CommandError as error:
                refused.append((order, error.reason))
                continue
            due += switch.commands
        return due, refused

    def let_go(self, servos: AbstractSet[int]) -> None:
        """Forgets the switches for which some of `servos` wait; they stay in their present modes."""
        kept = []
        for switch in self._waiting:
            left = [servo for servo in switch.servos if servo not in servos]
            if len(left) == len(switch.servos):
                kept.append(switch)
                continue
            for chain in self._groups.chains:
                gone = chain.places([s for s in chain.servos if s in servos and s in switch.servos])
                here = [
                    place for place in gone if self._groups.modes[chain.servos[place]] is not Mode.VELOCITY
                ]
                if here:
                    chain.limiter.drive_at(here, np.full(len(here), np.nan))
            if left:
                kept.append(WaitingSwitch(tuple(left), switch.mode, rests=switch.rests))
        self._waiting = kept
