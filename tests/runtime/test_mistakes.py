"""Mistakes of beginners: TCI either accepts each of them, or raises an error that lists the valid choices."""

from __future__ import annotations

import runpy
import time
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tci
from helpers import ROOT
from tci.body.generic_body import GenericBody
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.contact_stop import ContactStop
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, TciError, UnknownNameError
from tci.messages import Order
from tci.runtime.arguments import load_capability
from tci.simulation.world import World
from tci.testing import TouchedRobot

EXAMPLES = ROOT / "examples"


class Ask(tci.Capability[int]):
    """A capability that returns a fixed value in each period."""

    def __init__(self, answer: Any = ()) -> None:
        self.answer = answer

    def init(self, body: tci.GenericBody) -> int:
        return 0

    def step(self, memory: int, perception: tci.Perception, body: tci.GenericBody) -> Any:
        return self.answer, memory + 1


class Settings(Ask):
    """A capability whose constructor has a required argument."""

    def __init__(self, answer: Any) -> None:
        super().__init__(answer)


def refusals(driver: SimulatedDriver, answer: Any) -> str:
    """Returns the refusal texts of a result whose every command was refused."""
    result = tci.run(driver, Ask(answer), duration=0.01)
    assert not result
    return str(result)


def head(*values: float, mode: Any = tci.Mode.POSITION) -> tci.GenericCommand:
    return tci.GenericCommand("head", mode, np.array(values))


def test_1_a_number_that_is_none(driver: SimulatedDriver) -> None:
    assert "position of head: pitch = nan; valid: finite numbers" in refusals(
        driver, (head(np.nan, 0.0, 0.0),)
    )


def test_2_the_wrong_number_of_values(driver: SimulatedDriver) -> None:
    assert "position of head: values of shape (2,); valid: (3,)" in refusals(driver, (head(0.1, 0.0),))


def test_3_a_mode_that_the_servo_is_not_in(driver: SimulatedDriver) -> None:
    words = refusals(driver, (head(0.1, 0.0, 0.0, mode=tci.Mode.TORQUE),))
    assert "is in position mode, the command is in torque mode; valid: switch the mode first" in words


def test_4_a_robot_that_is_stopped(driver: SimulatedDriver) -> None:
    driver.gate.stop("on purpose")
    words = refusals(driver, (head(0.1, 0.0, 0.0),))
    assert "stop: on purpose" in words
    assert words.endswith("STOP at the end: on purpose")


@pytest.mark.parametrize(
    ("part", "degrees"),
    [("head", (30.0, 0.0, 0.0)), ("left_arm", (25.0, 25.0, 0.0, 60.0, 0.0)), ("left_arm", (0, 0, 0, -90, 0))],
)
def test_5_degrees_in_place_of_radians(
    driver: SimulatedDriver, part: str, degrees: tuple[float, ...]
) -> None:
    words = refusals(driver, (tci.GenericCommand(part, tci.Mode.POSITION, np.array(degrees, dtype=float)),))
    assert "is more than a full turn; degrees? valid: radians, as from np.deg2rad" in words


def test_5_one_wrong_angle_of_three_is_no_wrong_unit(driver: SimulatedDriver) -> None:
    values = np.array([0.1, 0.2, 0.1, 7.0, 0.1])
    words = refusals(driver, (tci.GenericCommand("left_arm", tci.Mode.POSITION, values),))
    assert "at 7 rad is more than a full turn; valid: at most a full turn" in words
    assert "degrees?" not in words


def test_5_degrees_in_the_robots_own_joints(driver: SimulatedDriver) -> None:
    own = driver.native("Head")
    for degrees in (
        {"HeadPitch": 20.0},
        {"HeadYaw": 5.0, "HeadPitch": 4.0},
        {"HeadYaw": -9.0, "HeadPitch": 0.1},
    ):
        words = refusals(driver, (own.command(degrees),))
        assert "degrees? valid: radians" in words
        assert "limits -2.09 .. 2.09 rad" in words or "limits -0.67 .. 0.51 rad" in words


def test_5_what_is_a_little_too_far_is_clamped_as_ever(driver: SimulatedDriver) -> None:
    own = driver.native("Head")
    for far in ({"HeadPitch": 5.0}, {"HeadYaw": 5.0, "HeadPitch": 0.1}, {"HeadYaw": 3.0, "HeadPitch": 1.4}):
        result = tci.run(driver, Ask((own.command(far),)), duration=0.01)
        assert result
        assert not result.refusals
        assert result.clamps
    assert tci.run(driver, Ask((own.command({"HeadYaw": 40.0}, mode="stiffness"),)), duration=0.01)


def test_6_a_robot_or_a_name_in_place_of_a_connection(world: World) -> None:
    for given, words in (
        (world.robot, "a Robot"),
        ("nao", "the word 'nao'"),
        (SimulatedDriver, "the class Sim"),
    ):
        with pytest.raises(TciError, match=f"run: {words}.* valid: driver, from `with tci.connect"):
            tci.run(given, Ask(), duration=0.01)


def test_6_a_name_in_place_of_a_robot() -> None:
    with tci.connect("nao", "sim", skin=False) as driver:
        assert driver.robot.name == "nao"
    with pytest.raises(TciError, match=r"the class Robot in place of a robot; valid: tci\.load_robot"):
        tci.connect(tci.Robot)
    with pytest.raises(TciError, match=r"connect: a SimulatedDriver as the name of a driver; valid: .*sim"):
        tci.connect("nao", driver)


def test_7_a_class_in_place_of_an_instance(driver: SimulatedDriver) -> None:
    assert tci.run(driver, Ask, duration=0.01).memory == 5
    with pytest.raises(
        TciError, match=r"the class Settings needs settings: .*'answer'; valid: Settings\(\.\.\.\)"
    ):
        tci.run(driver, Settings, duration=0.01)
    with pytest.raises(TciError, match="the class Capability lacks init and step; valid: a subclass"):
        tci.run(driver, tci.Capability, duration=0.01)
    for given, words in (("withdrawal", "the word 'withdrawal'"), (World, "the class World"), (None, "None")):
        with pytest.raises(TciError, match=f"run: {words} in place of a capability; valid: tci.Withdr"):
            tci.run(driver, given, duration=0.01)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"init": lambda self: 0}, r"Old.init\(self\) .* valid: def init\(self, body\)"),
        (
            {"step": lambda self, memory, perception: ((), memory)},
            r"Old.step\(self, memory, perception\) .* valid: def step\(self, memory, perception, body\)",
        ),
    ],
    ids=["init", "step"],
)
def test_7_a_method_without_the_body(own: dict[str, Any], words: str) -> None:
    """Capabilities had this form before `body` became an argument."""
    old = type("Old", (Ask,), own)
    with pytest.raises(TciError, match=words):
        old()


@pytest.mark.parametrize("mode", ["position", "Position"])
def test_8_a_mode_by_its_name(driver: SimulatedDriver, mode: str) -> None:
    assert tci.run(driver, Ask((head(0.1, 0.0, 0.0, mode=mode),)), duration=0.01)
    assert tci.SwitchMode("head", mode).mode is tci.Mode.POSITION
    assert driver.native("Head").command({"HeadYaw": 0.1}, mode=mode).mode is tci.Mode.POSITION
    assert tci.WithdrawalReflex(mode=mode).mode is tci.Mode.POSITION


def test_8_a_mode_that_there_is_not() -> None:
    with pytest.raises(
        UnknownNameError, match="no mode named 'positon' \\(did you mean 'position'\\?\\); valid: pos"
    ):
        head(0.1, 0.0, 0.0, mode="positon")
    with pytest.raises(UnknownNameError, match="no mode named '3'; valid: position, velocity"):
        head(0.1, 0.0, 0.0, mode=3)


def test_8_a_list_in_place_of_an_array(driver: SimulatedDriver) -> None:
    command = tci.GenericCommand("head", "position", [0.1, 0.0, 0.0])
    assert command.values.tolist() == [0.1, 0.0, 0.0]
    assert tci.run(driver, Ask((command,)), duration=0.01)
    with pytest.raises(CommandError, match=r"position of head: could not convert .*'far'; valid: numbers"):
        tci.GenericCommand("head", "position", ["far", 0.0, 0.0])


def test_9_one_command_in_place_of_a_tuple(driver: SimulatedDriver) -> None:
    class Begins(Ask):
        def begin(self, perception: tci.Perception, body: tci.GenericBody) -> Any:
            return tci.SwitchMode("head", tci.Mode.POSITION)

    command = head(0.1, 0.0, 0.0)
    for answer in (command, [command], (one for one in [command])):
        ticks: list[tci.Tick] = []
        assert tci.run(driver, Begins(answer), duration=0.004, observe=ticks.append).accepted == 1
        assert ticks[1].commands == (command,)
    joints = driver.read().joints
    ((own,), _) = GenericBody(driver.robot).to_platform(command, joints)
    assert driver.gate.step(own, joints, driver.clock.now()).orders == (own,)


@pytest.mark.parametrize(
    ("answer", "words"), [(None, "None"), (("head",), "the word 'head'"), (3.0, "a float")]
)
def test_9_what_is_no_command(driver: SimulatedDriver, answer: Any, words: str) -> None:
    with pytest.raises(CommandError, match=f"Ask: step returned {words} as a command; valid: a tuple"):
        tci.run(driver, Ask(answer), duration=0.01)
    driver.gate.reset()


def test_9_two_commands_and_no_memory(driver: SimulatedDriver) -> None:
    class Forgets(Ask):
        def step(self, memory: int, perception: tci.Perception, body: tci.GenericBody) -> Any:
            return head(0.1, 0.0, 0.0), head(0.2, 0.0, 0.0)

    with pytest.raises(CommandError, match="Forgets: step returned two commands; valid: the pair"):
        tci.run(driver, Forgets(), duration=0.01)


def test_9_a_generic_command_for_the_gate(driver: SimulatedDriver) -> None:
    sent = driver.gate.step([head(0.1, 0.0, 0.0)], driver.read().joints, driver.clock.now())
    words = "a GenericCommand is not in the robot's own joints; valid: the result of GenericBody.to_platform"
    assert [*map(str, sent.refusals)] == [words]


@pytest.mark.parametrize("duration", [-1.0, float("nan"), float("inf")])
def test_10_a_duration_that_is_none(driver: SimulatedDriver, duration: float) -> None:
    with pytest.raises(
        TciError, match=f"duration {duration} s; valid: 0 or more and finite, or None for ever"
    ):
        tci.run(driver, Ask(), duration=duration)


def test_10_a_duration_in_words(driver: SimulatedDriver) -> None:
    with pytest.raises(TciError, match="duration '1'; valid: a number of seconds, or None for ever"):
        tci.run(driver, Ask(), duration="1")  # type: ignore[arg-type]


class Counts(Ask):
    """Keeps its state in itself, and takes longer than a period of 2 ms."""

    def __init__(self) -> None:
        self.count, self.seen = 0, [0.0]

    def step(
        self, memory: Any, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], Any]:
        self.count += 1
        self.seen.append(perception.stamp)
        time.sleep(0.004)
        return (), memory


def test_habits_that_nobody_notices_in_simulation_are_told(driver: SimulatedDriver) -> None:
    result = tci.run(driver, Counts(), duration=0.02)
    assert "Counts keeps state in itself (count, seen)" in str(result)
    assert "longer than a period of 2 ms" in str(result)
    assert tci.run(driver, tci.WithdrawalReflex(), duration=0.02).advice == ()


def test_11_names_that_are_nearly_right() -> None:
    with pytest.raises(
        UnknownNameError, match=r"no robot named 'noa' \(did you mean 'nao'\?\); valid: .*icub"
    ):
        tci.load_robot("noa")
    with pytest.raises(UnknownNameError, match="no robot named 'ICUB' \\(did you mean 'icub'\\?\\)"):
        tci.connect("ICUB")
    with pytest.raises(UnknownNameError, match="no robot named 'zzz'; valid: "):
        tci.load_robot("zzz")
    with pytest.raises(
        UnknownNameError, match="no generic part named 'leftarm' \\(did you mean 'left_arm'\\?\\)"
    ):
        tci.load_robot("nao").part("leftarm")
    with pytest.raises(UnknownNameError, match="no generic part named 3; valid: left_arm"):
        tci.load_robot("nao").part(3)


@pytest.mark.parametrize("name", ["nao", "nao-whole"])
def test_12_a_touch_of_a_part_that_a_capability_does_not_know(name: str) -> None:
    shrug = runpy.run_path(str(EXAMPLES / "07_own_capability.py"))["Shrug"]
    capabilities = [load_capability(point.name) for point in entry_points(group="tci.capabilities")]
    robot = TouchedRobot(name)
    touches = {patch: robot.perceive(patch, force=5.0) for patch in (one.name for one in robot.robot.patches)}
    assert {contact.part for seen in touches.values() for contact in seen.contacts} >= {"head", "left_arm"}
    capabilities = [one for one in capabilities if not isinstance(one, tci.LightGrasp)]  # it needs palms
    # one needs fingers with skin, the other moves nothing
    apart = tci.FingerReflex, tci.capabilities.TouchWords
    capabilities = [one for one in capabilities if not isinstance(one, apart)]
    # it looks when a withdrawal would be over, wherever the touch was
    capabilities = [one for one in capabilities if not isinstance(one, tci.Attend)]
    assert len(capabilities) > 2
    for capability in [*capabilities, ContactStop(tci.WithdrawalReflex()), shrug()]:
        answers = {
            patch: capability.step(capability.init(robot.body), seen, robot.body)[0]
            for patch, seen in touches.items()
        }
        special = {BodyWithdrawal: "head_skin", tci.capabilities.SoftHands: "left_hand"}
        known = special.get(type(capability), "left_forearm")
        assert known not in answers or answers[known]


def test_a_file_in_place_of_a_capability_lists_its_classes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text("import tci\n\nclass Settings: pass\n\nclass Shrug(tci.Capability): pass\n")
    Path("broken.py").write_text("class Shrug(")
    with pytest.raises(UnknownNameError) as raised:
        load_capability("mine")
    assert "mine:Shrug" in raised.value.valid
    assert "mine:Settings" not in raised.value.valid
    with pytest.raises(UnknownNameError):
        load_capability("broken")
