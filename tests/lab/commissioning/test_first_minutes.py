"""`tci check --hardware` on wrong robots finds the fault before any joint has moved by 2 degrees."""

from __future__ import annotations

import re
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from helpers.crossed import Crossed, Witness, world_of
from helpers.served import needs_qi
from tci.cli.hardware import Simulation
from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.registry import connect, open_server
from tci.errors import UnknownNameError
from tci.lab.commissioning.first_minutes import first_minutes, wanted
from tci.lab.commissioning.hardware import MOST
from tci.robot.catalogue import load_robot
from tci.runtime.serve import serve

ROBOT = load_robot("nao")
UNIT = 180.0 / np.pi
PATIENCE = 10
STRAIGHT = {"left_arm": [90.0, 0.0, 90.0, 60.0, 0.0]}
"""Posture [degrees] in which shoulder pitch and elbow yaw are both at servo angle 0. These two joints have
equal limits."""


def minutes(driver: Driver, crossed: Crossed, *names: str, taxels: int = 0) -> dict[str, Finding]:
    servos, patches = wanted(ROBOT, names)
    found, _ = first_minutes(
        driver, Witness(crossed, driver), servos=servos, patches=patches if taxels else (), taxels=taxels
    )
    assert np.rad2deg(crossed.far.max()) <= np.rad2deg(MOST)
    return {finding.subject: finding for finding in found}


def simulated(*names: str, taxels: int = 0, posture: Any = None, **wrong: Any) -> dict[str, Finding]:
    crossed = Crossed(ROBOT, world=world_of(ROBOT, **(posture or {})), **wrong)
    return minutes(crossed, crossed, *names, taxels=taxels)


def test_a_sound_robot_passes_joint_by_joint_and_taxel_by_taxel() -> None:
    found = simulated(taxels=3)
    wrong = [finding for finding in found.values() if finding.level in (Level.FAULT, Level.WARNING)]
    # The time of a reading depends on this machine.
    assert all("read_p99_ms" in finding.figures for finding in wrong)
    moved = [servo.name for servo in ROBOT.servos if servo.limits.lower is not None]
    assert len(moved) == 14
    for name in moved:
        assert found[name].level is Level.OK
        assert found[name].figures["measured_deg"] == pytest.approx(1.8, abs=0.05)
    pressed = [finding for name, finding in found.items() if "taxel" in name and finding.level is Level.OK]
    assert len(pressed) >= 8
    assert max(float(finding.figures["away_mm"]) for finding in pressed) < 10.0


@pytest.mark.parametrize("name", ["LWristYaw", "HeadYaw"])
def test_a_reversed_sign_that_the_encoder_shares_is_seen(name: str) -> None:
    found = simulated(name, scale={name: -1.0})
    assert found[name].level is Level.FAULT
    assert "the other way" in found[name].advice


def test_a_reversed_sign_away_from_zero_shows_in_the_posture_and_nothing_is_moved() -> None:
    found = simulated("LElbowYaw", "LShoulderPitch", scale={"LElbowYaw": -1.0})
    assert found["left_arm"].level is Level.FAULT
    assert "not moved" in found["LElbowYaw"].what
    assert "not moved" in found["LShoulderPitch"].what


@pytest.mark.parametrize(("name", "posture"), [("LShoulderRoll", None), ("LShoulderPitch", STRAIGHT)])
def test_a_command_reversed_under_a_sound_encoder_is_stopped_at_once(name: str, posture: Any) -> None:
    found = simulated(name, scale={name: -1.0}, sound_encoders=True, posture=posture)
    assert found[name].level is Level.FAULT
    assert "wrong way" in found[name].what or "too far" in found[name].what


def test_a_swapped_pair_is_seen() -> None:
    found = simulated("LShoulderPitch", swap=("LShoulderPitch", "LElbowYaw"), posture=STRAIGHT)
    assert found["LShoulderPitch"].level is Level.FAULT
    assert "another joint" in found["LShoulderPitch"].advice


def test_a_swapped_pair_of_commands_is_stopped_when_the_other_one_moves() -> None:
    found = simulated(
        "LShoulderPitch", swap=("LShoulderPitch", "LElbowYaw"), sound_encoders=True, posture=STRAIGHT
    )
    assert found["LShoulderPitch"].level is Level.FAULT
    assert "LElbowYaw moved instead" in found["LShoulderPitch"].what


def test_degrees_where_radians_belong_are_found_before_anything_moves() -> None:
    found = simulated("left_arm", scale=dict.fromkeys([s.name for s in ROBOT.servos], UNIT))
    faults = {name for name, finding in found.items() if finding.level is Level.FAULT}
    assert {"LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw"} <= faults
    assert "degrees" in found["LElbowYaw"].advice or "not moved" in found["LElbowYaw"].what


def test_radians_where_degrees_belong_are_found_before_anything_moves() -> None:
    found = simulated("left_arm", scale=dict.fromkeys([s.name for s in ROBOT.servos], 1.0 / UNIT))
    faults = {name for name, finding in found.items() if finding.level is Level.FAULT}
    assert {"LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw"} <= faults


@pytest.mark.parametrize("factor", [1.0 / UNIT, UNIT])
def test_one_joint_at_zero_in_a_wrong_unit_is_seen_in_its_smallest_step(factor: float) -> None:
    found = simulated("HeadYaw", scale={"HeadYaw": factor})
    assert found["HeadYaw"].level is Level.FAULT


@pytest.mark.parametrize("factor", [1.0 / UNIT, UNIT])
def test_one_joint_at_zero_whose_commands_are_in_a_wrong_unit(factor: float) -> None:
    found = simulated("HeadYaw", scale={"HeadYaw": factor}, sound_encoders=True)
    assert found["HeadYaw"].level is Level.FAULT
    assert "unit" in found["HeadYaw"].advice or "degrees" in found["HeadYaw"].advice


def test_what_the_operator_does_not_permit_is_not_done() -> None:
    class Cautious(Witness):
        def may(self, what: str) -> bool:
            self.asked.append(what)
            return "HeadPitch" in what

        def press(self, patch: str, taxel: int, where: str) -> bool:
            return False

    crossed = Crossed(ROBOT)
    operator = Cautious(crossed, crossed)
    servos, patches = wanted(ROBOT, ["Head", "left_forearm"])
    found, largest = first_minutes(crossed, operator, servos=servos, patches=patches, taxels=2)
    named = {finding.subject: finding for finding in found}
    assert named["HeadYaw"].what == "not moved: the operator did not permit it"
    assert named["HeadPitch"].level is Level.OK
    assert named["left_forearm taxel 0"].what == "not pressed"
    assert crossed.far[0] < 1e-4 < crossed.far[1]
    assert largest == pytest.approx(np.deg2rad(1.8), abs=1e-3)
    assert "its top goes" in operator.asked[1]


def test_servos_that_are_off_are_switched_on_only_with_permission() -> None:
    class Off(Crossed):
        on = False

        def _receive(self) -> Any:
            reading = super()._receive()
            powered = np.full(len(self.robot.servos), self.on)
            return replace(reading, joints=replace(reading.joints, powered=powered))

        def _send(self, safe: Any) -> None:
            self.on |= bool(safe.stiffness)
            super()._send(safe)

    driver = Off(ROBOT)
    servos, _ = wanted(ROBOT, ["HeadYaw"])
    operator = Witness(driver, driver)
    found, _ = first_minutes(driver, operator, servos=servos, patches=())
    assert operator.asked[0] == "switch on HeadYaw"
    assert {finding.subject: finding.level for finding in found}["HeadYaw"] is Level.OK


def test_a_patch_that_is_dead_swapped_inverted_or_in_another_order_is_found() -> None:
    def spoil(change: Any) -> dict[str, Finding]:
        class Spoilt(Crossed):
            def _receive(self) -> Any:
                reading = super()._receive()
                skin = [change(frame) if "forearm" in frame.patch else frame for frame in reading.skin]
                return replace(reading, skin=tuple(skin))

        driver = Spoilt(ROBOT)
        _, patches = wanted(ROBOT, ["left_forearm"])
        found, _ = first_minutes(driver, Witness(driver, driver), servos=(), patches=patches, taxels=3)
        return {f.subject: f for f in found if f.level is Level.FAULT and "taxel" in f.subject}

    other = {"left_forearm": "right_forearm", "right_forearm": "left_forearm"}
    swapped = spoil(lambda frame: replace(frame, patch=other.get(frame.patch, frame.patch)))
    assert swapped
    assert all("right_forearm instead" in finding.what for finding in swapped.values())
    turned = spoil(lambda frame: replace(frame, values=np.roll(frame.values, len(frame.values) // 3)))
    assert turned
    assert all("strongest at taxel" in finding.what for finding in turned.values())
    inverted = spoil(lambda frame: replace(frame, values=480 - frame.values.astype(int)))
    assert inverted
    assert all("wrong way" in finding.what for finding in inverted.values())
    dead = spoil(lambda frame: replace(frame, values=np.full(len(frame.values), 240, np.uint8)))
    assert all("no response" in finding.what for finding in dead.values())
    assert dead


def test_names_of_what_is_to_be_checked() -> None:
    servos, patches = wanted(ROBOT, ["left_arm"])
    assert [servo.name for servo in servos][:2] == ["LShoulderPitch", "LShoulderRoll"]
    assert [patch.name for patch in patches] == ["left_forearm", "left_upper_arm", "left_hand"]
    with pytest.raises(UnknownNameError, match="left_arm"):
        wanted(ROBOT, ["left_wing"])


def wide(robot: Any, **limits: tuple[float, float]) -> Any:
    """Returns the robot with other limits [degrees] for some servos."""
    servos = []
    for servo in robot.servos:
        if servo.name in limits:
            lower, upper = np.deg2rad(limits[servo.name]).tolist()
            servo = servo.model_copy(
                update={"limits": servo.limits.model_copy(update={"lower": lower, "upper": upper})}
            )
        servos.append(servo)
    return robot.model_copy(update={"servos": tuple(servos)})


def served(crossed: Crossed, via: str, *names: str) -> dict[str, Finding]:
    """Runs the check over a server in front of the wrong robot, and returns the findings by subject."""
    if via == "naoqi":
        needs_qi()
    end = threading.Event()

    def run() -> None:
        def see(tick: Any) -> None:
            if end.is_set():
                raise KeyboardInterrupt

        with server:
            try:
                serve(server, observe=see)
            except KeyboardInterrupt:
                return

    options = "" if via == "naoqi" else f",dialect={via[-1]}"
    name = via.partition(" ")[0]
    server = open_server(crossed, f"{name}:127.0.0.1:0{options}")
    found_port = re.search(r"127\.0\.0\.1:(\d+)", server.where())
    assert found_port is not None
    address = f"{name}:127.0.0.1:{found_port[1]}{options}"
    thread = threading.Thread(target=run)
    thread.start()
    try:
        for _ in range(PATIENCE):
            with connect(ROBOT, address, arm=True) as driver:
                found = minutes(driver, crossed, *names)
            # If the machine is too busy for real time, the robot seems too slow; then the check is repeated.
            if "motion" not in found and not any("the gate" in finding.what for finding in found.values()):
                break
        return found
    finally:
        end.set()
        thread.join()


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("via", "wrong", "posture", "names", "faulty"),
    [
        ("yarp 4", {"scale": {"LWristYaw": -1.0}}, None, ["LWristYaw", "LShoulderPitch"], "LWristYaw"),
        ("naoqi", {"swap": ("LShoulderPitch", "LElbowYaw")}, STRAIGHT, ["LShoulderPitch"], "LShoulderPitch"),
        ("yarp 3", {"scale": {"HeadYaw": 1.0 / UNIT}}, None, ["HeadYaw"], "HeadYaw"),
    ],
    ids=["reversed", "swapped", "unit"],
)
def test_the_same_is_found_through_a_middleware(
    via: str, wrong: Any, posture: Any, names: list[str], faulty: str
) -> None:
    crossed = Crossed(ROBOT, world=world_of(ROBOT, **(posture or {})), paced=True, **wrong)
    found = served(crossed, via, *names)
    assert found[faulty].level is Level.FAULT
    sound = [name for name in names if name != faulty]
    assert all(found[name].level is Level.OK for name in sound)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("via", ["naoqi", "yarp 3", "yarp 4"])
def test_a_limit_that_the_description_has_wrong_is_found_before_anything_moves(via: str) -> None:
    crossed = Crossed(wide(ROBOT, LShoulderRoll=(-18.0, 40.0)), paced=True)
    found = served(crossed, via, "LShoulderRoll")
    assert "not moved" in found["LShoulderRoll"].what
    assert crossed.far.max() < np.deg2rad(0.01)


def test_a_servo_that_is_named_twice_is_moved_once_and_an_error_lists_only_what_can_be_tested() -> None:
    servos, patches = wanted(ROBOT, ["LElbowRoll", "left_arm", "left_forearm"])
    assert len(servos) == len({servo.name for servo in servos})
    assert len(patches) == len({patch.name for patch in patches})
    with pytest.raises(UnknownNameError) as raised:
        wanted(ROBOT, ["left_leg"])
    assert "torso" not in raised.value.valid
    for name in raised.value.valid:
        assert any(wanted(ROBOT, [name]))


def test_a_joint_that_rests_on_its_stop_is_moved() -> None:
    robot = load_robot("icub")
    with connect(robot, "sim") as driver:
        servos, _ = wanted(robot, ["l_hand_finger", "l_thumb_oppose"])
        found, _ = first_minutes(
            driver, Simulation(driver, Console(stderr=True)), servos=servos, patches=(), taxels=0
        )
    assert [one.level for one in found if one.subject in {servo.name for servo in servos}] == [Level.OK] * 2
