"""`unitree:INTERFACE[/DOMAIN]`: a Unitree G1 over its own DDS topics.

DDS topics:

- `rt/lowstate` (from the robot, 500 Hz): angles, speeds and torques of all motors, and the pelvis's IMU.
- `rt/arm_sdk` (from the driver): targets and gains of waist and arms, and a weight. By this weight, the robot
  mixes these targets with the targets of its own controller.
- `rt/lowcmd` (from the driver, with `?control=all`): targets and gains of all motors.
- `rt/dex3/...` or `rt/inspire_hand/...`: states, touch and commands of the hands (`hands`, `inspire_hand`).

This DDS has no passwords. Therefore the user must name the network interface, and the driver refuses an
interface that other machines may reach. A separate process (`keeper`) sends the commands. If the driver's
process is killed, the keeper still returns the control of the motors to the robot's own controller.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.drivers.remote.source_clock import SourceClock
from tci.errors import DriverError, FrameError
from tci.gate.partial_gate import PartialGate
from tci.gate.safe_command import SafeCommand
from tci.messages import JointReading, Reading
from tci.messages.clock import Every, MonotonicClock
from tci.messages.frames import read_only
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.shared.interface_node import MOST, InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.address import parse_unitree
from tci.wires.unitree.finger_motors import FingerMotors
from tci.wires.unitree.handover import Phase
from tci.wires.unitree.hands import Hand, patches_of
from tci.wires.unitree.health import Health
from tci.wires.unitree.held_motors import HeldMotors, Status
from tci.wires.unitree.inspire_fingers import InspireFingers
from tci.wires.unitree.inspire_hand import InspireHand
from tci.wires.unitree.keeper import LOOK
from tci.wires.unitree.motors import (
    MOTORS,
    NAMES,
    SIDES,
    VARIANTS,
    absent,
    commanded,
    hand_motor,
    inspire_joint,
)
from tci.wires.unitree.set_points import SetPoints
from tci.wires.unitree.switcher import Switcher
from tci.wires.unitree.wire import decode_state

WAIT = 5.0
"""Time [s] that a new driver waits for the first state. Assumed: DDS discovery takes a second."""
BRIDGE = 2.0
"""Time [s] that a new driver waits for the bridge of a hand that a source feels: without it the hand's
fingers are not moved. Assumed: longer than DDS discovery."""
LEAST_FORCE = 1.0
"""Smallest acceleration [m/s2] that a pelvis's accelerometer measures. If a state has a smaller value, the
accelerometer counts as absent. Assumed: simulations send zeros, and a real robot is never in free fall."""


class UnitreeDriver(Driver):
    """Driver of a G1, armed only on request. An armed driver takes control of the motors slowly, without a
    jerk."""

    def __init__(
        self,
        robot: Robot,
        address: str = "",
        *,
        arm: bool = False,
        skin: bool = True,
        felt: Collection[str] = (),
        wait: float = WAIT,
    ) -> None:
        """Connects to the robot over the network interface in `address`, such as `eth0`.

        An armed driver takes control of waist and arms in their present posture within a second. With
        `?control=all`, an armed driver takes control of all motors, and first switches off the robot's own
        controller, which keeps the balance. With `skin=False`, the driver does not read the hands' press
        sensors, so that other drivers can read the skin. `felt` are the patches that sources beside it feel.

        Raises DriverError if other machines may reach the interface, if no state arrives within `wait` [s],
        or if an armed driver finds the robot not ready. The robot is not ready, for example, if a motor
        reports an error, another program commands the robot, or L2+B is pressed on the remote.
        """
        self.where = parse_unitree(address)
        if skin:
            kept = {patch.name for patch in patches_of(robot)} | {*felt}
            patches = tuple(patch for patch in robot.patches if patch.name in kept)
            robot = robot.model_copy(update={"patches": patches})
        super().__init__(
            DriverInfo.of(
                robot,
                "unitree",
                clock=MonotonicClock(),
                armed=arm,
                lease_name=f"unitree:{self.where}",
                streams=True,
            )
        )
        self._slots = slots_of(robot)
        self._health = Health(simulation=self.where.simulation)
        self._source = SourceClock()
        self._joints: JointReading | None = None
        self._phase = Phase.WAITING
        self._set_points = SetPoints(robot, self._slots, whole=self.where.whole)
        self._fingers: list[FingerMotors | InspireFingers] = []
        self._held: HeldMotors | None = None
        self._began, self._look = self.clock.now(), Every(LOOK)
        self._node = InterfaceNode(self.where.interface, self.where.domain)
        try:
            self._states = self._node.reader("rt/lowstate", messages.STATE, keep=MOST)
            hands: list[Hand | InspireHand] = [Hand(robot, side, self._node, skin=skin) for side in SIDES]
            hands += [InspireHand(robot, side, self._node, skin=skin, felt=frozenset(felt)) for side in SIDES]
            self._hands = [hand for hand in hands if hand.there]
            self._wait(wait)
            for hand in self._hands:
                hand.given_up = not hand.heard
            unreached = self._unreached()
            unmeasured = frozenset(
                servo for hand in self._hands if not hand.heard for servo in hand.servos.tolist()
            )
            gate = PartialGate(
                robot, unreached, period=self.period, stale_after=self.gate.stale_after, streams=True,
                unwatched=unmeasured,
            )  # fmt: skip
            self.info = replace(self.info, gate=gate, unreached=unreached, unmeasured=unmeasured)
            if arm:
                self._arm()
        except BaseException:
            self._close()
            raise

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        try:
            where = parse_unitree(address)
        except DriverError as error:
            return (Finding(Level.FAULT, "network", str(error), "see docs/unitree.md"),)
        steps = [Finding(Level.OK, "network", f"{where.interface} is there and private")]
        try:
            # hands have their own findings: a source beside this driver may read them
            cls(robot, address, felt=[patch.name for patch in robot.patches]).close()
        except DriverError as error:
            advice = "switch the robot on, plug its cable in, and give this end an address of its network"
            return (*steps, Finding(Level.FAULT, "states", str(error), advice))
        return (*steps, Finding(Level.OK, "states", "rt/lowstate arrives with right checksums"))

    def diagnose(self) -> tuple[Finding, ...]:
        self._check_open()
        health, found = self._health, []
        variant = int(health.state["mode_machine"])
        count = VARIANTS.get(variant, (MOTORS, ()))[0]
        found.append(Finding(Level.OK, "variant", f"{count} motors (mode_machine {variant})"))
        wrong = {"wrong": float(health.wrong)}
        level = Level.WARNING if health.wrong else Level.OK
        advice = "another program may send states that are none of the robot's" if health.wrong else ""
        found.append(
            Finding(level, "checksums", f"{health.wrong} states with a wrong one", advice, figures=wrong)
        )
        # the motors of the body have a process of their own
        writers = {self.where.topic: self._node.other_writers(self.where.topic) - (self._held is not None)}
        for hand in self._hands:
            if len(hand.servos):
                writers[hand.commands] = self._node.other_writers(hand.commands)
        for name, others in writers.items():
            if others > 0:
                advice = "end them: only one may command the robot"
                found.append(
                    Finding(Level.FAULT, "commands", f"{others} other programs write {name}", advice)
                )
        if health.lasting:
            found.append(Finding(Level.FAULT, "robot", health.lasting, "the robot can't be armed like this"))
        for hand in self._hands:
            if hand.fault:
                found.append(Finding(Level.FAULT, "hand", hand.fault, "the robot can't be armed like this"))
            if isinstance(hand, InspireHand):
                found.append(hand.diagnose(self.clock.now()))
        heat = health.state["motor"]["temperature"][:MOTORS]
        hottest = int(np.argmax(heat.max(axis=1)))
        words = f"the warmest is {NAMES[hottest]}: {heat[hottest].max()} C"
        found.append(Finding(Level.OK, "motors", words))
        return tuple(found)

    def _receive(self) -> Reading:
        self._hear()
        if self._held is not None:
            self._follow(self._held.poll())
            look = self._look.due(self.clock.now())
            for fingers in self._fingers:
                if look:
                    hand = fingers.hand
                    hand.fault = hand.fault or self._node.fault_of_writers(hand.commands)
                if why := fingers.hand.fault:
                    fingers.release()
                    self.gate.stop(Reason(Code.ROBOT_REFUSES, f"the fingers are switched off: {why}"))
                fingers.repeat(self.clock.now())
        now = self.clock.now()
        for hand in () if self._health.passing(now) else self._hands:
            if silent := hand.silent(now):
                self.gate.hold(Reason(Code.JOINTS_STALE, silent))
        assert self._joints is not None  # the constructor waits for joint data
        return Reading(self._joints, tuple(frame for hand in self._hands for frame in hand.frames))

    def _send(self, safe: SafeCommand) -> None:
        assert self._held is not None  # armed drivers hold motors
        assert self._joints is not None  # the constructor waits for joint data
        if self._phase is Phase.WAITING and not self._held.status.lasting:
            self._take()
            return
        self._held.follow(*self._set_points.of(safe, self._joints))
        for fingers in self._fingers:
            fingers.obey(safe)

    def _halt(self) -> None:
        assert self._held is not None  # armed drivers hold motors
        self._hear()
        assert self._joints is not None  # the constructor waits for joint data
        self._held.follow(*self._set_points.here(self._health.posture, self._joints))
        for fingers in self._fingers:
            fingers.hold()

    def _close(self) -> None:
        for fingers in self._fingers:
            fingers.release()
        if self._held is not None:
            self._held.close()
        self._node.close()

    def _hear(self) -> None:
        """Reads the latest states of the body and the hands. Joint data is updated only after all hands with
        fingers have sent a state."""
        now = self.clock.now()
        for hand in self._hands:
            hand.poll(now)
        for sample in latest(self._states):
            try:
                state, right = decode_state(sample.raw)
            except FrameError:
                self._health.wrong += 1
                continue
            if not self._health.see(state, right, now):
                continue
            stamp = self._source.place(sample.sample_info.source_timestamp * 1e-9, now)
            known = all(
                self._alone(hand) if not hand.heard else not hand.overdue(now) for hand in self._hands
            )
            if stamp is not None and known:
                stamps = [hand.stamp for hand in self._hands if isinstance(hand, Hand) and len(hand.servos)]
                self._joints = self._reading(state, min(stamp, now, *stamps), now)

    def _alone(self, hand: Hand | InspireHand) -> bool:
        """True if the robot is read without a hand's angles: a source feels this hand, and its bridge was
        given time to answer."""
        beside = isinstance(hand, InspireHand) and hand.beside
        return beside and (self.clock.now() - self._began > BRIDGE)

    def _reading(self, state: Any, stamp: float, now: float) -> JointReading:
        motors = state["motor"][self._slots]
        before = self._joints  # the stamp is that of the oldest part, and the number belongs to it
        sequence = 0 if before is None else before.sequence + (stamp != before.stamp)
        position, velocity, torque = (motors[name].astype(float) for name in ("q", "dq", "tau_est"))
        for hand in self._hands:
            if len(hand.servos):
                hand.fill(position, velocity, torque, now)
        position, velocity, torque = read_only(position), read_only(velocity), read_only(torque)
        force = state["accelerometer"].astype(float)
        measured = np.linalg.norm(force) >= LEAST_FORCE
        gravity = read_only(-force) if measured else None
        return JointReading(stamp, sequence, position, velocity, torque, gravity=gravity)

    def _wait(self, seconds: float) -> None:
        """Waits for the first state of all joints. Raises DriverError if no state arrives within `seconds`
        [s]."""
        end = time.monotonic() + seconds
        while self._joints is None:
            self._hear()
            if time.monotonic() > end:
                why, topic = self._health.passing(self.clock.now()), "rt/lowstate"
                if not why:
                    why, topic = next((hand.missing, hand.topic) for hand in self._hands if not hand.heard)
                raise DriverError(f"{why} within {seconds:g} s on {self.where}, topic {topic}")
            time.sleep(0.002)

    def _unreached(self) -> dict[int, str]:
        """Returns the servos that commands can't move: the reason by servo index."""
        variant = int(self._health.state["mode_machine"])
        gone = absent(variant, simulation=self.where.simulation)
        count = VARIANTS.get(variant, (MOTORS, ()))[0]
        found = {
            servo: f"{hand.missing}, topic {hand.topic}"
            for hand in self._hands
            if not hand.heard
            for servo in hand.servos.tolist()
        }
        for servo, slot in enumerate(self._slots.tolist()):
            if slot < 0:
                continue
            if slot in gone:
                found[servo] = f"this robot has {count} motors, and not this one"
            elif slot not in commanded(whole=self.where.whole):
                found[servo] = "rt/arm_sdk moves waist and arms; valid: ?control=all behind the address"
        return found

    def _arm(self) -> None:
        """Takes control of the motors. Raises DriverError with the reason if the robot is not ready."""
        faults = [self._health.lasting, *(hand.fault for hand in self._hands)]
        if why := next(filter(None, faults), ""):
            raise DriverError(f"the robot can't be armed: {why}")
        self._fingers = [
            FingerMotors(self._node, hand) if isinstance(hand, Hand) else InspireFingers(self._node, hand)
            for hand in self._hands
            if len(hand.servos) and hand.heard
        ]
        if self.where.whole:
            Switcher(self._node).release()
        self._held = HeldMotors(self.where, self.period, self._node, self._health)
        self._take()
        self._held.wait()
        self._phase = Phase.LEADING
        self._joints = None
        self._wait(WAIT)

    def _take(self) -> None:
        assert self._held is not None and self._joints is not None
        self._held.holds = self._set_points.holds(self._joints)
        self._held.take()

    def _follow(self, status: Status) -> None:
        """Adapts the gate to the keeper's `status`: the gate stops after a lasting fault, and holds while TCI
        does not control the motors."""
        before, self._phase = self._phase, status.phase
        if status.lasting:
            self.gate.stop(Reason(Code.ROBOT_REFUSES, f"the motors are handed back: {status.reason}"))
            for fingers in self._fingers:
                fingers.release()
        elif status.phase is Phase.LEADING:
            if before is not Phase.LEADING:
                self.gate.drop()  # the robot's posture may have changed
        elif not self._health.passing(self.clock.now()):
            why = f": {status.reason}" if status.reason else ""
            words = f"the robot's own controller has the motors, weight {status.weight:.1f}{why}"
            self.gate.hold(Reason(Code.ROBOT_REFUSES, words))


def slots_of(robot: Robot) -> NDArray[np.intp]:
    """Returns the slot (n_servos,) of each servo's motor in the robot's messages. The slot of a finger's
    motor is -1.

    The slot is found by the servo's address in the binding or, without an address, by the servo's name.
    Raises DriverError if a servo has no motor, or if two servos share a motor.
    """
    binding = robot.binding("unitree")
    owners: dict[str, str] = {}
    slots = []
    for servo in robot.servos:
        finger = hand_motor(robot, servo.name) or inspire_joint(robot, servo.name)
        usual = str(NAMES.index(servo.name)) if servo.name in NAMES else ""
        to = binding.address(servo.name, usual)
        if finger is not None:
            to = f"{finger[0]}:{finger[1]}"
        elif not (to.isascii() and to.isdigit() and int(to) < MOTORS):
            raise DriverError(
                f"{servo.name} has the motor {to!r}; valid: 0 to {MOTORS - 1}, as the `to` of an address in "
                "the binding to unitree; left:0 to right:6 for a finger of a Dex3, left:index of an Inspire"
            )
        if to in owners:
            raise DriverError(f"{servo.name} and {owners[to]} have the motor {to}; valid: one each")
        owners[to] = servo.name
        slots.append(-1 if finger is not None else int(to))
    return np.array(slots, dtype=np.intp)
