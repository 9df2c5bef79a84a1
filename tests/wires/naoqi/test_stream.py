"""Smooth motion: the response of a model of ALMotion to the driver's stream of targets, compared with plain
set-points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from helpers.served import needs_qi
from tci.drivers.driver import NativePart
from tci.gate.gate import Gate, SafeCommand
from tci.messages import JointReading
from tci.robot.catalogue import load_robot

needs_qi()

from tci.robot.joint_map import initial_position
from tci.wires.naoqi.stream import AHEAD, CATCH_UP, Stream
from tci.wires.naoqi.words import CYCLE

ROBOT = load_robot("nao")
PERIOD = 0.005
FASTEST = 8.0
NAME = "LElbowRoll"
INDEX = next(servo.index for servo in ROBOT.servos if servo.name == NAME)


class Done:
    def __init__(self, fault: str = "") -> None:
        self._fault = fault

    def isFinished(self) -> bool:
        return True

    def hasError(self) -> bool:
        return bool(self._fault)

    def error(self) -> str:
        return self._fault


class Motion:
    """Model of ALMotion as documented. Every 20 ms the model reads the latest target and moves to the target
    at the requested fraction of the top speed. Without a new target the model rests there."""

    def __init__(self, angle: float, *, answers: Any = None) -> None:
        self.angle = self.target = angle
        self.share = 0.0
        self.calls: list[tuple[float, float]] = []
        self._due = 0.0
        self._step = (angle, 0.0)
        self._answers = answers or (lambda: Done())

    def setAngles(self, names: list[str], angles: list[float], share: float, _async: bool = False) -> Done:
        if NAME in names:
            angle = angles[names.index(NAME)]
            self.calls.append((angle, share))
            self.target, self.share = angle, share
        return self._answers()

    def advance(self, now: float) -> None:
        if now >= self._due - 1e-9:
            self._due = now + CYCLE
            self._step = (self.target, self.share)
        target, share = self._step
        most = share * FASTEST * PERIOD
        self.angle += float(np.clip(target - self.angle, -most, most))


def swing(send: Any) -> tuple[np.ndarray, np.ndarray, Motion]:
    """Returns the speeds (n,) [rad/s] of the reference and of the robot, and the model of ALMotion, for a
    swing of the elbow through a gate."""
    gate = Gate(ROBOT, period=PERIOD, stale_after=1.0)
    position = np.array(initial_position(ROBOT))
    motion = Motion(float(position[INDEX]))
    arm = NativePart("LArm", ROBOT.servos_of("LArm"))
    commands = [arm.command({NAME: -0.1}, speed=2.0)]
    rows = []
    for tick in range(160):
        now = tick * PERIOD
        measured = position.copy()
        measured[INDEX] = motion.angle
        joints = JointReading(now, tick, measured, np.zeros(len(measured)))
        safe = gate.step(commands, joints, now)
        commands = []
        send(motion, safe, gate.ahead(AHEAD), measured)
        before = motion.angle
        motion.advance(now)
        at = safe.servos.tolist().index(INDEX)
        rows.append((safe.velocity[at], (motion.angle - before) / PERIOD))
    reference, robot = np.array(rows).T
    return reference, robot, motion


def stream() -> Stream:
    count = len(ROBOT.servos)
    names = [servo.name for servo in ROBOT.servos]
    return Stream(names, np.full(count, -3.0), np.full(count, 3.0), np.full(count, FASTEST))


def test_a_steady_motion_is_steady_on_the_robot_and_stutters_without_the_look_ahead() -> None:
    def plain(motion: Motion, safe: SafeCommand, ahead: np.ndarray, measured: np.ndarray) -> None:
        at = safe.servos.tolist().index(INDEX)
        motion.setAngles([NAME], [float(safe.position[at])], 1.0)

    def rests(run: Any) -> int:
        reference, robot, _ = run
        steady = np.flatnonzero(reference > 0.95 * reference.max())[8:]
        assert len(steady) > 20
        return int((robot[steady] < 0.25 * reference.max()).sum())

    ours = stream()
    assert rests(swing(ours.send)) == 0
    assert rests(swing(plain)) > 10


def test_it_arrives_where_it_was_sent_and_never_beyond() -> None:
    ours = stream()
    _, _, motion = swing(ours.send)
    assert motion.angle == pytest.approx(-0.1, abs=1e-3)
    assert max(target for target, _ in motion.calls) <= -0.1 + 1e-6
    assert min(share for _, share in motion.calls) > 0.0
    assert max(share for _, share in motion.calls) <= 1.0


def test_a_servo_at_rest_is_left_alone_and_a_moving_one_gets_at_most_a_target_each_10_ms() -> None:
    ours = stream()
    _, _, motion = swing(ours.send)
    assert len(motion.calls) < 100
    count = len(motion.calls)
    safe_count = [0]

    def counted(inner: Motion, safe: SafeCommand, ahead: np.ndarray, measured: np.ndarray) -> None:
        safe_count[0] += 1

    swing(counted)
    assert count <= safe_count[0] // 2 + 10


def test_where_it_turns_it_is_as_fast_as_from_the_target_before() -> None:
    """The measured position always lies behind the previous target. Without a new target the robot must soon
    come to rest."""
    ours, gate = stream(), Gate(ROBOT, period=PERIOD, stale_after=1.0)
    position = np.array(initial_position(ROBOT))
    motion = Motion(float(position[INDEX]))
    arm = NativePart("LArm", ROBOT.servos_of("LArm"))
    for tick, way in enumerate((0.04, -0.02, -0.03)):
        joints = JointReading(tick * CYCLE, tick, position, np.zeros(len(position)))
        safe = gate.step([arm.command({NAME: -0.1})], joints, tick * CYCLE)
        ahead = gate.ahead(AHEAD).copy()
        ahead[safe.servos.tolist().index(INDEX)] = position[INDEX] + way
        ours.send(motion, safe, ahead, position)
    shares = [share for _, share in motion.calls]
    assert np.array(shares) * FASTEST * CATCH_UP == pytest.approx([0.04, 0.06, 0.03])


def test_targets_wait_while_the_robot_has_not_taken_the_one_before() -> None:
    class Busy(Done):
        def isFinished(self) -> bool:
            return False

    ours = stream()
    gate = Gate(ROBOT, period=PERIOD, stale_after=1.0)
    position = np.array(initial_position(ROBOT))
    motion = Motion(float(position[INDEX]), answers=Busy)
    arm = NativePart("LArm", ROBOT.servos_of("LArm"))
    commands = [arm.command({NAME: -0.1})]
    for tick in range(20):
        now = tick * PERIOD
        joints = JointReading(now, tick, position, np.zeros(len(position)))
        safe = gate.step(commands, joints, now)
        ours.send(motion, safe, gate.ahead(AHEAD), position)
        commands = []
    assert len(motion.calls) == 1


def test_what_the_robot_refuses_is_counted_in_its_words() -> None:
    ours = stream()
    gate = Gate(ROBOT, period=PERIOD, stale_after=1.0)
    position = np.array(initial_position(ROBOT))
    motion = Motion(float(position[INDEX]), answers=lambda: Done("ALMotion: too hot\nmore"))
    arm = NativePart("LArm", ROBOT.servos_of("LArm"))
    for tick in range(40):
        now = tick * PERIOD
        joints = JointReading(now, tick, position, np.zeros(len(position)))
        commands = [arm.command({NAME: -0.1})] if tick == 0 else []
        safe = gate.step(commands, joints, now)
        ours.send(motion, safe, gate.ahead(AHEAD), position)
    assert list(ours.errors) == [f"setAngles of {NAME}: ALMotion: too hot"]
