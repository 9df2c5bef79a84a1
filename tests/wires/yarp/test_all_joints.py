"""Calls for all joints of a board, as in iCub's tutorials. Fingers, eyes and hands obey. A joint that can't
be moved stays at its angle."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

import tci
from tci.drivers.simulated import SimulatedDriver
from tci.messages import JointReading
from tci.robot.description import Robot
from tci.simulation.world import World
from tci.wires.yarp.served_board import ServedBoard
from yarpwire.calls_v3 import answer_v3
from yarpwire.calls_v4 import answer_v4
from yarpwire.values import Vocab

POSITION = Vocab("pos")
TUTORIAL = (-30, 30, 15, 60, *[0] * 12)
"""Angles [deg] to which the public tutorial sends all joints of an arm."""
LISTING_1 = (-16.1, 83.3, 0, 15.5, -59, -0.45, 0, 0.3, 50, 24, 90, 5, 90, 16, 90, 115)
"""Angles [deg] of the reflex motion of iCub in the paper's Listing 1, as printed."""
NAO_LISTING_1 = (1.19, -1.10, 2.07, 0.04, 0.0, 0.0)
"""Angles [rad] of NAO's reflex motion in Listing 1. The hand is closed."""


class Board:
    """A board of a simulated robot without a network: calls, gate and physics run in one thread."""

    def __init__(self, robot: Robot, part: str) -> None:
        self.driver = SimulatedDriver(robot, world=World(robot, skin=False))
        self.served = ServedBoard(part, robot.servos_of(part))
        self.refused: list[str] = []

    def call(self, dialect: str, *items: Any) -> list[Any]:
        """Makes a call, and returns its answer after the gate's decision."""
        self.advance(0.1)
        answer: Any = (answer_v3 if dialect == "3" else answer_v4)(_unawaited(self.served), [*items])
        self.advance(0.1)
        return answer

    def advance(self, seconds: float) -> JointReading:
        for now in self.driver.ticks(duration=seconds):
            joints = self.driver.read().joints
            orders = self.served.book.take()
            safe = self.driver.gate.step(orders, joints, now)
            self.refused += [reason.text for reason in safe.refusals]
            self.served.book.judge(safe.orders, safe.refusals)
            self.driver.write(safe)
            self.served.update(joints, self.driver.gate.modes)
        return joints


def _unawaited(board: ServedBoard) -> ServedBoard:
    """Makes calls return before the loop has judged them, because the loop runs in the same thread."""
    board.book.begin = board.book.settle = lambda: None
    return board


def words(dialect: str, name: str, values: Any) -> list[Any]:
    """Returns the call for all joints in the form of a dialect."""
    v3 = {"modes": [Vocab("set"), Vocab("icmd"), Vocab("cmds")], "move": [Vocab("set"), Vocab("poss")]}
    v4 = {"modes": ["setControlModeAllRPC"], "move": ["positionMoveAllRPC"]}
    return [*(v3 if dialect == "3" else v4)[name], [*values]]


@pytest.mark.parametrize("dialect", ["3", "4"])
@pytest.mark.parametrize(
    ("robot", "part", "angles"),
    [
        ("icub", "left_arm", TUTORIAL),
        ("icub", "right_arm", LISTING_1),
        ("icub", "head", (-10, 5, 20, 12, -15, 10)),
        ("nao", "RArm", np.rad2deg(NAO_LISTING_1)),
        ("nao-whole", "LLeg", (30, 5, -10, 20, 10, 5)),
    ],
)
def test_a_call_for_all_joints_of_a_board_moves_all(dialect: str, robot: str, part: str, angles: Any) -> None:
    board = Board(tci.load_robot(robot), part)
    call = partial(board.call, dialect)
    ok = [Vocab("ok")]
    assert call(*words(dialect, "modes", [POSITION] * board.served.count)) == ok
    assert call(*words(dialect, "move", angles)) == ok
    board.served.speeds[:] = 60.0
    assert call(*words(dialect, "move", angles)) == ok
    joints = board.advance(6.0)
    assert board.refused == []
    for servo, angle in zip(board.served.servos, angles, strict=True):
        low, high = servo.limits.lower, servo.limits.upper
        wanted = 0.0 if low is None or high is None else np.clip(np.deg2rad(angle), low, high)
        assert joints.position[servo.index] == pytest.approx(wanted, abs=np.deg2rad(1.0)), servo.name
    if angles is not TUTORIAL:  # this call commands the thumb to 10 degrees below its limit
        assert board.served.is_done(None)


def test_a_joint_that_can_not_be_moved_is_refused_by_name() -> None:
    board = Board(tci.load_robot("nao-whole"), "LLeg")
    board.call("3", Vocab("set"), Vocab("pos"), 0, 10.0)
    assert "LHipYawPitch can't be moved" in board.refused[0]
