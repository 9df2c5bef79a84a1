"""The served NAO and programs without TCI, which use the genuine `qi` library over a real socket."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from helpers.served import Served, needs_qi
from helpers.still_nao import StillNao
from tci.robot.catalogue import load_robot

ROBOT = load_robot("nao")
PATIENCE = 60.0


def wait_for(what: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


def order_until(order: Callable[[], object], what: Callable[[], bool]) -> None:
    """Gives an order, and again each 5 s until `what()` is true: a server that stood still for 0.3 s drops
    the orders from before."""
    end = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < end, "it never came"
        order()
        again = time.monotonic() + 5.0
        while not what() and time.monotonic() < again:
            time.sleep(0.01)


def session_with(port: int) -> Any:
    import qi

    session = qi.Session()
    session.connect(f"tcp://127.0.0.1:{port}")
    session.waitForService("ALMotion", _async=True).value(60_000)
    return session


@pytest.fixture(scope="module")
def session() -> Iterator[Any]:
    needs_qi()
    one = Served("nao", "naoqi:127.0.0.1:0")
    found = session_with(one.port)
    yield found
    found.close()
    one.kill()


@pytest.mark.xdist_group("served nao")
def test_angles_stiffness_and_limits(session: Any) -> None:
    motion = session.service("ALMotion")
    assert motion.getBodyNames("RArm")[0] == "RShoulderPitch"
    assert motion.getBodyNames("Body") == [servo.name for servo in ROBOT.servos]
    ((lower, upper, speed, torque),) = motion.getLimits("LElbowRoll")
    assert (lower, upper) == pytest.approx((math.radians(-88.5), math.radians(-2.0)))
    assert (speed, torque) == (pytest.approx(math.radians(305.4)), 2.0)
    order_until(
        lambda: motion.setAngles(["HeadYaw", "HeadPitch"], [0.4, -0.2], 0.3),
        lambda: abs(motion.getAngles("HeadYaw", True)[0] - 0.4) < 0.01,
    )
    wait_for(lambda: motion.getAngles("Head", False) == pytest.approx([0.4, -0.2], abs=1e-3))
    motion.changeAngles("HeadYaw", -0.1, 0.3)
    wait_for(lambda: abs(motion.getAngles("HeadYaw", True)[0] - 0.3) < 0.01)
    motion.setStiffnesses("LArm", 0.6)
    wait_for(lambda: motion.getStiffnesses("LElbowRoll") == pytest.approx([0.6]))
    motion.wakeUp()
    wait_for(lambda: motion.getStiffnesses("LElbowRoll") == [1.0])
    assert motion.robotIsWakeUp()


@pytest.mark.xdist_group("served nao")
def test_blocking_motions_return_when_they_are_there_and_block_nobody_else(session: Any) -> None:
    motion = session.service("ALMotion")
    motion.angleInterpolationWithSpeed("RElbowRoll", 0.6, 0.5)
    assert motion.getAngles("RElbowRoll", True) == pytest.approx([0.6], abs=0.02)
    slow = motion.angleInterpolation("RElbowRoll", 1.0, 2.0, True, _async=True)
    assert len(motion.getAngles("Body", True)) == 14
    assert slow.isRunning()
    slow.value(60_000)
    assert motion.getAngles("RElbowRoll", True) == pytest.approx([1.0], abs=0.02)
    motion.angleInterpolation(["RElbowRoll"], [-0.2], [0.5], False)
    assert motion.getAngles("RElbowRoll", True) == pytest.approx([0.8], abs=0.02)
    for move, place in ((motion.openHand, 1.0), (motion.closeHand, 0.0)):
        move("LHand")
        assert motion.getAngles("LHand", True) == pytest.approx([place], abs=0.02)


SERIES = {
    "lists": ("angleInterpolation", ["LShoulderPitch", "LElbowRoll"], [[1.0, 1.4], [-0.5]],
              [[0.1, 0.3], [0.2]], True),
    "one joint": ("angleInterpolation", "LShoulderPitch", [1.0, 1.4], [0.1, 0.3], True),
    "Bezier": ("angleInterpolationBezier", ["LShoulderPitch", "LElbowRoll"], [[0.1, 0.3], [0.2]],
               [[[1.0, [3, -0.1, 0.0], [3, 0.1, 0.0]], [1.4, [3, -0.1, 0.0], [3, 0.1, 0.0]]],
                [[-0.5, [3, -0.1, 0.0], [3, 0.1, 0.0]]]]),
}  # fmt: skip


@pytest.mark.parametrize("call", SERIES)
def test_a_series_moves_through_all_its_angles(call: str) -> None:
    """Each target comes with the speed that brings the joint there in time."""
    method, *arguments = SERIES[call]
    with StillNao() as nao:
        session = session_with(nao.port)
        motion = session.service("ALMotion")
        (start,) = motion.getAngles("LShoulderPitch", False)
        moved = getattr(motion, method)(*arguments, _async=True)
        seen: list[tuple[float, float]] = []
        while moved.isRunning():
            seen += targets(nao, "LShoulderPitch")
            time.sleep(0.005)
        moved.value()
        assert seen == [(1.0, pytest.approx(abs(1.0 - start) / 0.1)), (1.4, pytest.approx(0.4 / 0.2))]
        session.close()


@pytest.mark.xdist_group("served nao")
def test_it_goes_to_its_usual_postures(session: Any) -> None:
    """Angles of StandInit as NAOqi's ROS driver has them (nao_driver, init_pose.py)."""
    posture, motion = session.service("ALRobotPosture"), session.service("ALMotion")
    assert {"Stand", "StandInit", "StandZero", "Crouch", "Sit"} <= {*posture.getPostureList()}
    for name, family in (("StandInit", "Standing"), ("Sit", "Sitting")):
        assert posture.goToPosture(name, 0.8)
        assert (posture.getPosture(), posture.getPostureFamily()) == (name, family)
        if name == "StandInit":
            for side, sign in (("L", 1.0), ("R", -1.0)):
                arm = motion.getAngles(f"{side}Arm", True)[:4]
                assert arm == pytest.approx([1.39, 0.34 * sign, -1.39 * sign, -1.04 * sign], abs=0.06)
    with pytest.raises(RuntimeError, match="valid: Stand, StandInit"):
        posture.goToPosture("Headstand", 0.5)


def test_a_killed_series_goes_no_further() -> None:
    with StillNao() as nao:
        session = session_with(nao.port)
        motion = session.service("ALMotion")
        (start,) = motion.getAngles("LShoulderPitch", False)
        moved = motion.angleInterpolation("LShoulderPitch", [0.1, 0.2], [0.3, 0.6], False, _async=True)
        wait_for(
            lambda: [value for value, _ in targets(nao, "LShoulderPitch")] == [pytest.approx(start + 0.1)]
        )
        motion.killAll()
        moved.value(2000)
        assert [value for value, _ in targets(nao, "LShoulderPitch")] == [pytest.approx(start + 0.1)]
        session.close()


def targets(nao: StillNao, name: str) -> list[tuple[float, float]]:
    """Executes the orders that have arrived. Returns angle [rad] and speed [rad/s] of those for one servo."""
    index = next(servo.index for servo in ROBOT.servos if servo.name == name)
    return [
        (float(order.values[at]), float(np.broadcast_to(order.speed, order.values.shape)[at]))
        for order in nao.obey()
        for at in np.flatnonzero(order.servos == index)
    ]


@pytest.mark.xdist_group("served nao")
def test_killing_tasks_stops_where_it_is(session: Any) -> None:
    motion = session.service("ALMotion")
    motion.angleInterpolationWithSpeed("RShoulderPitch", 0.0, 0.5)
    order_until(
        lambda: motion.setAngles("RShoulderPitch", 1.5, 0.05),
        lambda: motion.getAngles("RShoulderPitch", True)[0] > 0.05,
    )
    motion.killAll()
    wait_for(lambda: abs(_speed(motion, "RShoulderPitch")) < 1e-3)
    assert motion.getAngles("RShoulderPitch", True)[0] < 1.2


def _speed(motion: Any, name: str) -> float:
    before = motion.getAngles(name, True)[0]
    time.sleep(0.1)
    return float(motion.getAngles(name, True)[0] - before) / 0.1


@pytest.mark.xdist_group("served nao")
def test_memory_has_joints_touch_and_skin(session: Any) -> None:
    memory = session.service("ALMemory")
    motion = session.service("ALMotion")
    key = "Device/SubDeviceList/LElbowRoll/Position/Sensor/Value"
    assert memory.getData(key) == pytest.approx(motion.getAngles("LElbowRoll", True)[0], abs=0.01)
    _, seconds, micros = memory.getTimestamp(key)
    assert abs(seconds + 1e-6 * micros - time.time()) < PATIENCE
    assert len(memory.getData("TCI/Skin/left_forearm")) == 240
    first = memory.getData("TCI/Skin/left_forearm/Sequence")
    wait_for(lambda: memory.getData("TCI/Skin/left_forearm/Sequence") > first)
    assert {"FrontTactilTouched", "TCI/Gate", key} <= set(memory.getDataListName())
    assert memory.getListData(["no/such/key", "FrontTactilTouched"]) == [None, 0.0]
    assert memory.getData("TCI/Gate")[0] in ("run", "hold")
    with pytest.raises(RuntimeError, match="no data at key no/such/key"):
        memory.getData("no/such/key")
    memory.insertData("My/Value", [1, 2.5, "three"])
    assert memory.getData("My/Value") == [1, 2.5, "three"]


HOSTILE: list[tuple[str, tuple[Any, ...]]] = [
    ("setAngles", ("LElbowRoll", float("nan"), 0.5)),
    ("setAngles", ("LElbowRoll", float("inf"), 0.5)),
    ("setAngles", ("LElbowRoll", 1e300, 0.5)),
    ("setAngles", ("LElbowRoll", -1.0, 0.0)),
    ("setAngles", ("LElbowRoll", -1.0, -0.5)),
    ("setAngles", ("LElbowRoll", -1.0, 50.0)),
    ("setAngles", ("LElbowRoll", -1.0, float("nan"))),
    ("setAngles", ("LElbowRoll", [-1.0, -1.0], 0.5)),
    ("setAngles", (["LElbowRoll", "LElbowYaw"], [-1.0], 0.5)),
    ("setAngles", ("LElbowRoll", "fast", 0.5)),
    ("setAngles", ("Tail", 0.0, 0.5)),
    ("setAngles", (["LElbowRoll"] * 5000, [0.0] * 5000, 0.5)),
    ("setAngles", ({"a": 1}, 0.0, 0.5)),
    ("setStiffnesses", ("Body", 2.0)),
    ("setStiffnesses", ("Body", float("nan"))),
    ("changeAngles", ("LElbowRoll", float("nan"), 0.5)),
    ("angleInterpolation", ("LElbowRoll", -1.0, 0.0, True)),
    ("angleInterpolation", ("LElbowRoll", [[-1.0, 0.0]], [[1.0]], True)),
    ("angleInterpolation", ("LElbowRoll", [[-1.0, 0.0]], [[2.0, 1.0]], True)),
    ("angleInterpolation", (["LElbowRoll", "LElbowYaw"], [[-1.0, 0.0]], [[1.0, 2.0]], True)),
    ("angleInterpolation", ("LElbowRoll", [[-1.0, float("nan")]], [[1.0, 2.0]], True)),
    ("angleInterpolation", ("LElbowRoll", [], [], True)),
    ("angleInterpolationBezier", (["LElbowRoll"], [[1.0]], [0.5])),
    ("closeHand", ("LElbowRoll",)),
    ("angleInterpolationWithSpeed", ("LElbowRoll", float("nan"), 0.5)),
    ("getAngles", (["x" * 100_000], True)),
    ("getLimits", (7,)),
]


def test_what_can_not_be_is_refused_in_words_and_moves_nothing() -> None:
    with StillNao() as nao:
        session = session_with(nao.port)
        motion, memory = session.service("ALMotion"), session.service("ALMemory")
        for name, arguments in HOSTILE:
            with pytest.raises(RuntimeError, match="valid"):
                getattr(motion, name)(*arguments)
        with pytest.raises(RuntimeError, match="valid"):
            memory.getListData(["k"] * 5000)
        with pytest.raises(RuntimeError, match="valid"):
            memory.getListData([["k"]])
        for number in range(1000):
            memory.insertData(f"fill/{number}", number)
        with pytest.raises(RuntimeError, match="no room"):
            memory.insertData("one/more", 1)
        assert nao.board.take() == []
        session.close()


def test_33_a_flood_of_targets_leaves_only_the_latest_of_each_joint() -> None:
    with StillNao() as nao:
        sessions = [session_with(nao.port) for _ in range(4)]

        def flood(session: Any, number: int) -> None:
            motion = session.service("ALMotion")
            for step in range(500):
                motion.setAngles(["LElbowRoll", "HeadYaw"], [-0.5 - 1e-4 * step, 1e-3 * number], 0.5)

        threads = [threading.Thread(target=flood, args=item) for item in zip(sessions, range(4), strict=True)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        sessions[0].service("ALMotion").setAngles("LElbowRoll", -1.25, 0.5)
        (order,) = nao.obey()
        assert order.servos.size == 2
        assert nao.board.measured[5] == pytest.approx(-1.25)
        for session in sessions:
            session.close()


def test_services_come_when_the_robot_is_ready_and_end_with_it() -> None:
    needs_qi()
    one = Served("nao", "naoqi:127.0.0.1:0")
    session = session_with(one.port)
    said = "".join(one.stop())
    assert "Traceback" not in said
    assert "leaked" not in said
    wait_for(lambda: not session.isConnected())
