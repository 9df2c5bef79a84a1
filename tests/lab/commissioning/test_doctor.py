"""`tci doctor` reports findings about faulty robots, and no findings about healthy robots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError
from tci.gate.settings import over_a_wire
from tci.lab.commissioning.doctor import judge
from tci.lab.commissioning.machine import _delays, examine_machine
from tci.lab.commissioning.streams import observe
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.simulation.world import World
from tci.testing import FakeDriver


class Spoilt(SimulatedDriver):
    """A simulated robot whose readings are changed before the driver returns them."""

    change: Callable[[Reading], Reading | None] = staticmethod(lambda reading: reading)

    def _receive(self) -> Reading:
        self._kept = self.change(super()._receive()) or self._kept
        return self._kept


@pytest.fixture(scope="module")
def world() -> World:
    return World(load_robot("nao"))


def examine(driver: Driver, duration: float = 1.0) -> dict[tuple[str, Level], Finding]:
    findings = judge(driver, observe(driver, duration))
    # The time of a reading depends on this machine.
    return {(f.subject, f.level): f for f in findings if "read_p99_ms" not in f.figures}


def spoilt(world: World, change: Callable[[Reading], Reading | None]) -> dict[tuple[str, Level], Finding]:
    world.reset()
    driver = Spoilt(world.robot, world=world)
    driver.change = change
    return examine(driver)


def with_joints(change: Callable[[JointReading], JointReading]) -> Callable[[Reading], Reading]:
    return lambda reading: replace(reading, joints=change(reading.joints))


def with_forearm(change: Callable[[SkinFrame], SkinFrame]) -> Callable[[Reading], Reading]:
    def frame(frame: SkinFrame) -> SkinFrame:
        return change(frame) if frame.patch == "left_forearm" else frame

    return lambda reading: replace(reading, skin=tuple(map(frame, reading.skin)))


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_a_sound_robot_gets_no_complaint_and_its_rates_are_measured(name: str) -> None:
    driver = SimulatedDriver(load_robot(name))
    found = examine(driver)
    assert {level for subject, level in found if subject != "limits"} == {Level.OK}
    for patch in driver.robot.patches:
        finding = found[patch.name, Level.OK]
        assert finding.figures["rate_hz"] == pytest.approx(patch.rate, rel=0.03)
        assert finding.figures["lost"] == 0.0


def test_old_joint_data_is_a_fault_that_names_the_age(world: World) -> None:
    found = spoilt(world, with_joints(lambda joints: replace(joints, stamp=joints.stamp - 0.3)))
    finding = found["joints", Level.FAULT]
    assert finding.figures["age_ms"] == pytest.approx(300.0, abs=1.0)
    assert "the gate holds at 50 ms" in finding.what
    ahead = spoilt(world, with_joints(lambda joints: replace(joints, stamp=joints.stamp + 0.3)))
    assert "clock" in ahead["joints", Level.FAULT].advice


def test_frames_that_nobody_saw_are_counted(world: World) -> None:
    def drop(reading: Reading) -> Reading | None:
        return None if reading.skin[0].sequence % 4 == 3 else reading

    found = spoilt(world, drop)
    finding = found["left_forearm", Level.WARNING]
    assert finding.figures["lost"] == pytest.approx(25, abs=2)


def test_a_slow_skin_is_told_from_its_description() -> None:
    robot = load_robot("nao")
    slow = robot.model_copy(
        update={"patches": tuple(patch.model_copy(update={"rate": 40.0}) for patch in robot.patches)}
    )
    found = examine(SimulatedDriver(robot, world=World(slow)))
    assert found["right_forearm", Level.WARNING].figures["rate_hz"] == pytest.approx(40.0, rel=0.05)


def test_a_skin_that_stands_still_and_one_that_is_not_there(world: World) -> None:
    still = spoilt(world, with_forearm(lambda frame: replace(frame, stamp=0.0, sequence=0)))
    assert "restart it" in still["left_forearm", Level.FAULT].advice
    gone = spoilt(world, lambda reading: replace(reading, skin=reading.skin[1:]))
    assert gone["left_forearm", Level.FAULT].what == "no frame at all"


def test_degrees_in_place_of_radians_are_recognised(world: World) -> None:
    found = spoilt(
        world, with_joints(lambda joints: replace(joints, position=read_only(np.rad2deg(joints.position))))
    )
    assert "degrees" in found["LShoulderPitch", Level.FAULT].advice


def test_a_joint_outside_its_limits_and_one_without_an_angle(world: World) -> None:
    def move(joints: JointReading) -> JointReading:
        position = joints.position.copy()
        position[[2, 3]] = np.nan, 1.5
        return replace(joints, position=read_only(position))

    found = spoilt(world, with_joints(move))
    assert "nan" in found["LShoulderPitch", Level.FAULT].what
    assert "85.9 degrees" in found["LShoulderRoll", Level.WARNING].what


def test_servos_that_are_off_and_another_number_of_servos(world: World) -> None:
    powered = np.ones(len(world.robot.servos), dtype=bool)
    powered[4] = False
    off = spoilt(world, with_joints(lambda joints: replace(joints, powered=read_only(powered, np.bool_))))
    assert "LElbowYaw" in off["joints", Level.NOTE].what
    fewer = spoilt(
        world, with_joints(lambda joints: replace(joints, position=read_only(joints.position[:-1])))
    )
    assert "13 angles; the description has 14" in fewer["joints", Level.FAULT].what


def test_a_skin_of_another_length_polarity_or_range(world: World) -> None:
    short = spoilt(world, with_forearm(lambda frame: replace(frame, values=frame.values[:-12])))
    assert "228 values; the description has 240" in short["left_forearm", Level.FAULT].what
    inverted = spoilt(world, with_forearm(lambda frame: replace(frame, values=255 - frame.values)))
    assert "inverted" in inverted["left_forearm", Level.WARNING].advice
    wide = spoilt(world, with_forearm(lambda frame: replace(frame, values=frame.values * 20.0)))
    assert "0 .. 255" in wide["left_forearm", Level.FAULT].what


def test_what_the_driver_itself_knows_comes_first() -> None:
    class Knowing(FakeDriver):
        def diagnose(self) -> tuple[Finding, ...]:
            return (Finding(Level.NOTE, "dialect", "4.0"),)

    driver = Knowing("nao")
    assert judge(driver, observe(driver, 0.1))[0].subject == "dialect"


def test_observing_commands_nothing_and_a_lost_robot_is_an_error() -> None:
    class Leaving(FakeDriver):
        def joints(self) -> JointReading:
            if self.clock.now() > 0.5:
                raise DriverError("gone")
            return super().joints()

    driver = Leaving("nao")
    with pytest.raises(DriverError, match="gone"):
        observe(driver, 1.0)
    assert not driver.sent


def test_this_machine_names_drivers_robots_and_its_clock() -> None:
    found = {finding.subject: finding for finding in examine_machine(duration=0.1)}
    assert found["driver sim"].level is Level.OK
    assert found["robot nao"].level is Level.OK
    assert found["clock"].figures["late_p99_us"] >= found["clock"].figures["late_p50_us"] >= 0.0
    assert "allowed: 1 ms" in found["clock"].what
    assert found["driver sim"].what == "ready; it needs no extra"
    assert found["driver zenoh"].what.startswith("ready; its library: eclipse-zenoh 1.")


def test_another_package_in_the_same_folder_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The distribution `tci` on PyPI installs a package and a command with the name `tci`. MuJoCo 3 and
    mujoco-core 4 also install files in the same folder."""
    there = [("tci", "0.1.4", "tci"), ("tactile-capabilities", "0.2.0", "tci"),
             ("mujoco", "3.17.0", "mujoco"), ("mujoco-core", "4.0.1", "mujoco")]  # fmt: skip
    for name, version, module in there:
        folder = tmp_path / f"{name.replace('-', '_')}-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        (folder / "top_level.txt").write_text(f"{module}\n")
    monkeypatch.syspath_prepend(tmp_path)
    found = {finding.subject: finding for finding in examine_machine(duration=0.1)}
    assert found["package tci"].level is Level.WARNING
    assert "tactile-capabilities 0.2.0 and tci 0.1.4 write into the same folder" in found["package tci"].what
    assert "mujoco 3.17.0 and mujoco-core 4.0.1" in found["package mujoco"].what
    assert found["package tci"].advice.startswith("pip uninstall tactile-capabilities tci, then")
    assert "'mujoco>=3.11,<4' serves TCI" in found["package mujoco"].advice


def test_a_robot_without_patches_has_only_joints() -> None:
    robot: Robot = load_robot("nao").model_copy(update={"patches": ()})
    found = {subject for subject, _ in examine(SimulatedDriver(robot))}
    assert found == {"joints", "way back", "contact", "limits"}


def test_a_wake_up_that_misses_periods_is_late_by_all_of_them() -> None:
    times = np.array([0.0, 0.0021, 0.0039999, 0.0111, 0.0125])
    np.testing.assert_allclose(_delays(times), [0.0, 0.0001, 0.0, 0.0051, 0.0005], atol=1e-9)


class OverAWire(Spoilt):
    """A robot behind a wire: torques count once motion has shown that they are what they seem."""

    def _receive(self) -> Reading:
        self.gate.set_contact(over_a_wire(softens=False).contact)
        return super()._receive()


def test_it_says_how_a_link_without_skin_notices_whom_it_meets(world: World) -> None:
    def contact(change: Callable[[Reading], Reading | None] = lambda reading: reading) -> Finding:
        world.reset()
        driver = OverAWire(world.robot, world=world)
        driver.change = change
        (found,) = (one for (subject, _), one in examine(driver).items() if subject == "contact")
        return found

    assert contact().level is Level.OK
    assert "6 degrees" in contact().what
    without = contact(with_joints(lambda joints: replace(joints, torque=None)))
    assert without.level is Level.NOTE
    assert without.what.startswith("no joint torques")
    gaps = contact(lambda reading: None if reading.joints.sequence % 250 >= 150 else reading)
    assert gaps.level is Level.WARNING
    assert gaps.figures["gaps"] in (3.0, 4.0)


@pytest.mark.parametrize(("kind", "words"), [(Spoilt, "softly"), (OverAWire, "stiffly: this connection")])
def test_it_says_how_parts_go_back_from_whom_they_meet(world: World, kind: type[Spoilt], words: str) -> None:
    world.reset()
    driver = kind(world.robot, world=world)
    (found,) = (one for (subject, _), one in examine(driver).items() if subject == "way back")
    assert words in found.what
