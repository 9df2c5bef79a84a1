"""The driver of a NAO: skin, touch, autonomous life, and a robot that disconnects and connects again."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.living_nao import cut
from helpers.naoqi_wait import PATIENCE, ROBOT, wait_for
from helpers.served import Served
from helpers.still_nao import StillNao
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities import SoftHands
from tci.drivers.diagnosis import Level
from tci.drivers.registry import connect
from tci.errors import DriverError
from tci.gate.gate import GateState
from tci.messages import Mode, Reading
from tci.messages.clock import ManualClock
from tci.robot.catalogue import load_robot
from tci.robot.description import Address, Robot
from tci.runtime.loop import Tick, run
from tci.wires.naoqi.words import current_key

ELBOW = next(servo.index for servo in ROBOT.servos if servo.name == "LElbowRoll")


def with_binding(robot: Robot, **changes: Any) -> Robot:
    bindings = [b.model_copy(update=changes) if b.middleware == "naoqi" else b for b in robot.bindings]
    return robot.model_copy(update={"bindings": tuple(bindings)})


OFTEN = with_binding(ROBOT, rate=200.0)
"""Asked more often than its skin sends, so that it pays to wait for a frame."""


def frame(reading: Reading, patch: str) -> Any:
    return next(frame for frame in reading.skin if frame.patch == patch)


@pytest.mark.parametrize("packed", [True, False], ids=["text", "vectors"])
def test_skin_comes_as_text_or_as_plain_vectors_and_only_new_frames_count(packed: bool) -> None:
    with StillNao() as nao:
        if not packed:
            memory = nao.services["ALMemory"]
            for key in [key for key in memory._live if key.endswith("/Packed")]:
                del memory._live[key]
        with connect(ROBOT, nao.via) as driver:
            first = frame(driver.read(), "left_forearm")
            values = np.full(240, 240, np.uint8)
            values[7] = 31
            nao.touch("left_forearm", 1, values)
            wait_for(lambda: frame(driver.read(), "left_forearm").sequence == 1)
            later = frame(driver.read(), "left_forearm")
            np.testing.assert_array_equal(later.values, values)
            assert first.stamp < later.stamp <= driver.clock.now()
            again = frame(driver.read(), "left_forearm")
            assert (again.sequence, again.stamp) == (later.sequence, later.stamp)


def test_a_vector_of_another_publisher_without_numbers_counts_when_it_changes() -> None:
    with StillNao() as nao:
        memory = nao.services["ALMemory"]
        memory._live.clear()
        memory.insertData("My/Skin", [0.5] * 240)
        robot = with_binding(ROBOT, addresses=(Address(of="left_forearm", to="My/Skin"),))
        with connect(robot, nao.via) as driver:
            assert [(f.patch, f.sequence) for f in driver.read().skin] == [("left_forearm", 0)]
            memory.insertData("My/Skin", [0.75] * 240)
            wait_for(lambda: frame(driver.read(), "left_forearm").sequence == 1)
            for rubbish in ("text", [[1.0], [2.0, 3.0]], ["a"] * 240, {"a": 1}, 3.0):
                memory.insertData("My/Skin", rubbish)
                polls = driver._poller.counts["polls"]
                wait_for(lambda polls=polls: driver._poller.counts["polls"] > polls + 3, driver)
            assert frame(driver.read(), "left_forearm").values[0] == 0.75
            assert driver._poller.counts["bad"] > 0


def test_a_frame_that_is_due_goes_before_joints_only_while_these_are_young() -> None:
    with StillNao() as nao, connect(OFTEN, nao.via) as driver:
        poller: Any = driver._poller
        poller.close()
        poller.clock, poller._until = ManualClock(100.0), 100.004
        for due, age, first in ((0.002, 0.005, True), (0.002, 0.02, False), (0.008, 0.005, False)):
            poller._seen = {"left_forearm": 100.0 + due - 0.01}
            poller._before = replace(poller.latest.reading.joints, stamp=100.0 - age)
            assert poller._skin_first() is first, (due, age)


def test_a_frame_that_was_there_at_once_is_asked_for_earlier_the_next_time() -> None:
    with StillNao() as nao, connect(OFTEN, nao.via) as driver:
        poller: Any = driver._poller
        poller._end.set()
        poller._thread.join(PATIENCE)
        poller.clock = ManualClock(100.0)
        poller._ask()
        poller.clock.advance(0.0004)
        nao.touch("left_forearm", 1, np.full(240, 240, np.uint8))
        poller._ask()
        assert poller._seen["left_forearm"] == pytest.approx(100.0002)  # between the two requests
        poller.clock.advance(0.01)
        nao.touch("left_forearm", 2, np.full(240, 240, np.uint8))
        poller._ask()
        assert poller._seen["left_forearm"] == pytest.approx(100.0094)  # no request shortly before


def test_head_and_hands_are_patches_of_switches() -> None:
    with StillNao() as nao, connect(ROBOT, nao.via) as driver:
        assert frame(driver.read(), "head").values.tolist() == [0.0, 0.0, 0.0]
        nao.services["ALMemory"].raiseEvent("FrontTactilTouched", 1.0)
        nao.services["ALMemory"].raiseEvent("HandLeftRightTouched", 1.0)
        wait_for(lambda: frame(driver.read(), "left_hand").values[2] == 1.0)
        assert frame(driver.read(), "head").values.tolist() == [1.0, 0.0, 0.0]
        assert frame(driver.read(), "right_hand").values.tolist() == [0.0, 0.0, 0.0]
        before = frame(driver.read(), "head").sequence
        wait_for(lambda: frame(driver.read(), "head").sequence > before + 2)
        contacts = Perceiver(GenericBody(ROBOT)).step(driver.read(), driver.clock.now()).contacts
        assert {(contact.patch, *contact.taxels.tolist()) for contact in contacts} == {
            ("head", 0), ("left_hand", 2),
        }  # fmt: skip


def test_bumpers_of_the_feet_are_patches_of_switches() -> None:
    robot, key = load_robot("nao-whole"), "Device/SubDeviceList/{}/Bumper/{}/Sensor/Value"
    with StillNao(robot) as nao, connect(robot, nao.via) as driver:
        memory = nao.services["ALMemory"]
        assert frame(driver.read(), "left_bumper").values.tolist() == [0.0, 0.0]
        memory.insertData(key.format("LFoot", "Left"), 1.0)
        memory.insertData(key.format("RFoot", "Right"), 1.0)
        wait_for(lambda: frame(driver.read(), "right_bumper").values[1] == 1.0)
        wait_for(lambda: frame(driver.read(), "left_bumper").values[0] == 1.0)
        contacts = Perceiver(GenericBody(robot)).step(driver.read(), driver.clock.now()).contacts
        assert {(contact.patch, contact.part, *contact.taxels.tolist()) for contact in contacts} == {
            ("left_bumper", "left_leg", 0), ("right_bumper", "right_leg", 1),
        }  # fmt: skip


def test_a_memory_that_refuses_a_list_for_one_key_is_asked_only_for_what_it_has() -> None:
    with StillNao() as nao:
        memory = nao.services["ALMemory"]
        for key in [key for key in memory._live if key.startswith("HandLeft") or "/" in key]:
            if key.startswith("HandLeft") or "Packed" in key or "Sequence" in key:
                del memory._live[key]

        def strict(key: str) -> Any:
            found = key in memory._own or key in memory._live
            if not found:
                raise KeyError(key)
            return True, memory._live[key]()

        memory._value = strict
        with connect(ROBOT, nao.via) as driver:
            patches = {frame.patch for frame in driver.read().skin}
            assert patches == {patch.name for patch in ROBOT.patches} - {"left_hand"}
            nao.touch("left_forearm", 1, np.full(240, 7, np.uint8))
            wait_for(lambda: frame(driver.read(), "left_forearm").values[0] == 7)
            assert driver._poller.counts["failures"] == 0


def test_currents_are_torques_of_joints_whose_motors_constant_is_known(tmp_path: Path) -> None:
    (tmp_path / "nao.joints.json").write_text('{"robot": "nao", "amperes": {"LElbowRoll": 2.0}}')
    robot = ROBOT.model_copy(update={"source": str(tmp_path / "nao.xml")})
    elbow = next(servo.index for servo in robot.servos if servo.name == "LElbowRoll")
    with StillNao(robot) as nao, connect(robot, nao.via) as driver:

        def torque() -> float:
            found = driver.read().joints.torque
            assert found is not None
            assert np.isnan(np.delete(found, elbow)).all()
            return float(found[elbow])

        nao.board.torque[elbow] = -0.6
        nao.board.commanded[elbow] -= 0.05
        wait_for(lambda: torque() == pytest.approx(-0.6))
        nao.services["ALMemory"].insertData(current_key("LElbowRoll"), 0.25)  # a key that genuine robots have
        wait_for(lambda: torque() == pytest.approx(-0.5))
        nao.board.commanded[elbow] += 0.1  # the motor has a torque towards its commanded angle
        wait_for(lambda: torque() == pytest.approx(0.5))
        nao.services["ALMemory"].insertData(current_key("LElbowRoll"), "none")
        wait_for(lambda: bool(np.isnan(torque())))
    with StillNao() as nao, connect(ROBOT, nao.via) as driver:
        assert driver.read().joints.torque is None


def test_a_robot_without_hands_has_no_frames_of_them() -> None:
    with StillNao() as nao:
        memory = nao.services["ALMemory"]
        for key in [key for key in memory._live if key.startswith("HandLeft")]:
            del memory._live[key]
        with connect(ROBOT, nao.via) as driver:
            patches = {frame.patch for frame in driver.read().skin}
            assert patches == {patch.name for patch in ROBOT.patches} - {"left_hand"}
            assert any("HandLeftBackTouched" in found.what for found in driver.diagnose())


def test_a_robot_without_the_descriptions_joints_is_named() -> None:
    h21 = load_robot("nao-h21")
    assert {servo.name for servo in ROBOT.servos} - {servo.name for servo in h21.servos} == {
        "LWristYaw", "LHand", "RWristYaw", "RHand",
    }  # fmt: skip
    with StillNao(h21) as nao:
        with pytest.raises(DriverError, match=r"LWristYaw|ALMotion.getAngles"):
            connect(ROBOT, nao.via)
        with connect(h21, nao.via, arm=True) as driver:
            assert {frame.patch for frame in driver.read().skin} == {patch.name for patch in h21.patches}
            elbow = driver.native("LArm").command({"LElbowRoll": -0.8})
            driver.write(driver.gate.step([elbow], driver.read().joints, driver.clock.now()))


def test_stiffness_shares_and_power() -> None:
    with StillNao() as nao:
        nao.board.stiffness = [0.0] * 14
        with connect(ROBOT, nao.via, arm=True) as driver:
            assert not driver.read().joints.powered.any()
            share = driver.native("LArm").command({"LElbowRoll": 0.8}, mode=Mode.STIFFNESS)
            driver.write(driver.gate.step([share], driver.read().joints, driver.clock.now()))
            (order,) = nao.obey()
            assert (order.servos.tolist(), order.values.tolist()) == ([ELBOW], pytest.approx([0.8]))
            assert driver.read().joints.powered[ELBOW]
            wait_for(lambda: bool(driver._poller.latest.stiffness[ELBOW] > 0.7), driver)


def test_what_robot_and_description_disagree_about_is_found() -> None:
    def narrow(servo: Any) -> Any:
        if servo.name != "LElbowYaw":
            return servo
        return servo.model_copy(
            update={"limits": servo.limits.model_copy(update={"upper": 1.0, "velocity": 2.0})}
        )

    other = ROBOT.model_copy(update={"servos": tuple(map(narrow, ROBOT.servos))})
    with StillNao(other) as nao, connect(ROBOT, nao.via) as driver:
        findings = [finding for finding in driver.diagnose() if finding.subject == "LElbowYaw"]
        assert [finding.level for finding in findings] == [Level.WARNING, Level.WARNING]
        assert "57.3 in the robot" in findings[0].what
        assert "352 degrees/s in the description, at most 115" in findings[1].what
        subjects = {finding.subject for finding in driver.diagnose()}
        assert {"NAOqi", "questions", "clock", "autonomy"} <= subjects


def test_answers_that_are_none_do_not_reach_the_gate() -> None:
    with StillNao() as nao, connect(ROBOT, nao.via) as driver:
        before = driver.read()
        motion = nao.services["ALMotion"]
        for rubbish in ([], [0.1] * 13, [float("nan")] * 14):
            nao.board.measured = rubbish + [0.0] * (14 - len(rubbish)) if len(rubbish) == 14 else rubbish
            time.sleep(0.05)
            joints = driver.read().joints
            assert joints.position.shape == (14,)
        nao.board.measured = before.joints.position.tolist()
        assert motion.getAngles("Body", True)
        wait_for(
            lambda: bool(np.isfinite(driver.read().joints.position).all() and not driver._poller.trouble)
        )


def test_without_a_stream_nothing_goes_further_than_the_last_target() -> None:
    with StillNao() as nao, connect(ROBOT, nao.via, arm=True) as driver:
        command = [driver.native("LArm").command({"LElbowRoll": -0.2}, speed=1.0)]
        for tick, now in enumerate(driver.ticks(duration=10.0)):
            safe = driver.write(driver.gate.step(command, driver.read().joints, now))
            command = []
            nao.obey()
            if tick > 30 and abs(safe.velocity[safe.servos.tolist().index(ELBOW)]) > 0.5:
                break
        reference = safe.position[safe.servos.tolist().index(ELBOW)]
        time.sleep(0.2)  # the commander is silent
        nao.obey()
        assert abs(nao.board.measured[ELBOW] - reference) < np.deg2rad(4.0)
        assert nao.obey() == []


COMMANDER = """
import sys, tci
with tci.connect(tci.load_robot("nao"), sys.argv[1], arm=True) as driver:
    command = driver.native("LArm").command({"LElbowRoll": -0.1}, speed=0.1)
    for tick, now in enumerate(driver.ticks()):
        orders = [] if tick % 50 else [command]
        safe = driver.write(driver.gate.step(orders, driver.read().joints, now))
        if safe.state.name == "STOP" and not safe.velocity.any():
            driver.gate.reset()  # a machine that is too busy for real time
"""


@pytest.mark.timeout(300)
def test_43_killed_with_minus_9_the_commander_leaves_a_robot_that_stands() -> None:
    served = Served("nao", "naoqi:127.0.0.1:0")
    via = f"naoqi://127.0.0.1:{served.port}"
    commander = subprocess.Popen([sys.executable, "-c", COMMANDER, via])
    try:
        with connect(ROBOT, via) as driver:
            start = driver.read().joints.position[ELBOW]
            # The motion would last eight seconds; the process is killed during the motion.
            wait_for(lambda: driver.read().joints.position[ELBOW] > start + 0.05)
            commander.kill()
            here = [driver.read().joints.position[ELBOW]]
            wait_for(lambda: here.append(driver.read().joints.position[ELBOW]) or np.ptp(here[-40:]) < 1e-4)
            assert here[-1] - here[0] < np.deg2rad(3.0)
            assert here[-1] < -0.3
    finally:
        commander.kill()
        commander.wait()
        served.kill()


@pytest.mark.timeout(300)
def test_34_a_robot_killed_in_motion_holds_the_gate_and_comes_back_without_a_replay() -> None:
    served = Served("nao", "naoqi:127.0.0.1:0")
    port = served.port
    with connect(ROBOT, f"naoqi://127.0.0.1:{port}", arm=True) as driver:
        command = [driver.native("LArm").command({"LElbowRoll": -0.2}, speed=0.3)]
        states = set()
        killed = None
        for tick, now in enumerate(driver.ticks(duration=PATIENCE)):
            safe = driver.write(driver.gate.step(command, driver.read().joints, now))
            command = []
            states.add(safe.state)
            if tick == 40:
                served.kill()
                killed = driver.clock.now()
            if killed is not None and safe.state is not GateState.RUN and not safe.velocity.any():
                break
        assert killed is not None
        assert GateState.HOLD in states or GateState.STOP in states
        assert driver._poller.trouble
        driver.gate.reset()
        served = Served("nao", f"naoqi:127.0.0.1:{port}")
        try:
            wait_for(lambda: driver._poller.generation == 1, driver)
            start = driver.read().joints.position[ELBOW]
            for now in driver.ticks(duration=0.5):
                safe = driver.write(driver.gate.step([], driver.read().joints, now))
                assert safe.servos.size == 0, "an old target came back"
            assert driver.read().joints.position[ELBOW] == pytest.approx(start, abs=1e-3)
            again = driver.native("LArm").command({"LElbowRoll": float(start) + 0.1})
            for now in driver.ticks(duration=1.0):
                safe = driver.write(driver.gate.step([again] if again else [], driver.read().joints, now))
                again = None
            assert safe.servos.size > 0
        finally:
            served.kill()


def test_36_a_port_that_is_taken_is_one_clear_error() -> None:
    with (
        StillNao() as nao,
        pytest.raises(AssertionError, match="the port is taken; valid: --via naoqi:HOST:PORT"),
    ):
        Served("nao", f"naoqi:127.0.0.1:{nao.port}")


def test_two_drivers_of_one_process_share_no_robot_twice() -> None:
    with StillNao() as nao, connect(ROBOT, nao.via) as one:
        by_name = nao.via.replace("127.0.0.1", "127.1")
        assert by_name != nao.via
        with connect(ROBOT, by_name) as two:
            assert one.info.lease_name == two.info.lease_name
        assert str(os.getpid()) not in one.info.lease_name


@pytest.mark.parametrize("strict", [True, False], ids=["refuses unknown keys", "answers nothing"])
def test_skin_that_is_published_again_after_a_restart_is_read_as_before(strict: bool) -> None:
    with StillNao() as nao:
        memory = nao.services["ALMemory"]
        key = "TCI/Skin/left_forearm"
        own = {name: memory._live.pop(name) for name in list(memory._live) if name.startswith(key)}
        lenient = memory._value

        def value(name: str) -> Any:
            if strict and not lenient(name)[0]:
                raise KeyError(name)
            return lenient(name)

        memory._value = value
        memory._live |= own
        with connect(ROBOT, nao.via) as driver:
            for name in own:  # a NAOqi that has restarted lacks data that clients inserted
                del memory._live[name]
            cut(nao.port)
            wait_for(lambda: driver._poller.generation == 1, driver)
            memory._live |= own
            nao.touch("left_forearm", 7, np.full(240, 7, np.uint8))
            wait_for(lambda: frame(driver.read(), "left_forearm").sequence == 7)
            wait_for(lambda: driver._poller._asks["left_forearm"] == [f"{key}/Packed"], driver)
            assert driver._poller.counts["reconnections"] == 1


def test_skin_that_is_published_in_another_way_after_a_restart_is_not_looked_for_for_ever() -> None:
    with StillNao() as nao:
        memory = nao.services["ALMemory"]
        del memory._live["TCI/Skin/left_forearm/Packed"]
        with connect(ROBOT, nao.via) as driver:
            poller: Any = driver._poller
            del memory._live["TCI/Skin/left_forearm/Sequence"]
            cut(nao.port)
            wait_for(lambda: poller.generation == 1, driver)
            assert poller._asks != poller._known
            for number in range(2):
                nao.touch("left_forearm", number, np.full(240, 50 + number, np.uint8))
                wait_for(lambda n=number: frame(driver.read(), "left_forearm").values[0] == 50 + n)
            wait_for(lambda: poller._asks == poller._known, driver)
            assert poller._asks["left_forearm"] == ["TCI/Skin/left_forearm"]


def test_a_nao_as_sold_is_soft_while_its_hand_is_held() -> None:
    robot = load_robot("nao-plain")
    softest, stiff = {"LElbowRoll": 1.0, "RElbowRoll": 1.0}, {}
    with StillNao(robot) as nao, connect(robot, nao.via, arm=True) as driver:
        memory, names = nao.services["ALMemory"], [servo.name for servo in robot.servos]
        begin = driver.clock.now()

        def see(tick: Tick) -> None:
            nao.obey()
            since = tick.now - begin
            memory.insertData("HandLeftBackTouched", float(0.3 < since < 0.8))
            for name in softest:
                stiff[name] = float(nao.board.stiffness[names.index(name)])
                softest[name] = min(softest[name], stiff[name])

        result = run(driver, SoftHands(), duration=2.0, observe=see)
    assert result.touched.keys() == {"left_hand"}
    assert softest == {"LElbowRoll": 0.2, "RElbowRoll": 1.0}
    assert stiff == {"LElbowRoll": 1.0, "RElbowRoll": 1.0}
