"""What every link promises. A new middleware adds itself to `LINKS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from middleware.served import needs_qi, served
from tci.errors import CommandError, LinkError, UnknownNameError
from tci.interface.gate import Gate
from tci.interface.part import home, to_platform
from tci.middleware.link import Link
from tci.middleware.simulated import SimulatedLink
from tci.model.catalogue import load_robot
from tci.model.description import Robot
from tci.runtime.registry import connect

NAOQI = "naoqi:127.0.0.1:0"
PATIENCE = 20
"""Seconds that a robot may take to get where it goes."""
LINKS: dict[str, Callable[[Robot, bool], Link]] = {
    "sim": lambda robot, arm: SimulatedLink(robot, arm=arm),
    "naoqi": lambda robot, arm: connect(robot, f"naoqi://127.0.0.1:{served('nao', NAOQI).port}", arm=arm),
}


@pytest.fixture(params=[pytest.param(name, marks=pytest.mark.xdist_group(f"link {name}")) for name in LINKS])
def open_link(request: pytest.FixtureRequest) -> Iterator[Callable[..., Link]]:
    opened: list[Link] = []
    if request.param == "naoqi":
        needs_qi()

    def make(*, arm: bool = True) -> Link:
        opened.append(LINKS[request.param](load_robot("nao"), arm))
        return opened[-1]

    yield make
    for link in opened:
        link.close()


def drive(link: Link, *commands: object, duration: float = 1.0) -> None:
    pending = list(commands)
    for now in link.ticks(duration=duration):
        link.write(link.gate.step(pending, link.read().joints, now))  # type: ignore[arg-type]
        pending = []


def drive_until(link: Link, arrived: Callable[[], bool], *commands: object) -> bool:
    """Whether the robot gets there: at once in a simulation. Where a busy machine keeps it from being real
    time, the gate stops it on the way."""
    for _ in range(PATIENCE):
        drive(link, *commands)
        if arrived():
            return True
        link.gate.reset()
    return False


def test_readings_are_complete_fresh_and_in_order(open_link: Callable[..., Link]) -> None:
    link = open_link()
    sequences, ages = [], []
    for now in link.ticks(duration=0.1):
        reading = link.read()
        assert reading.joints.position.shape == (len(link.robot.servos),)
        ages.append(now - reading.joints.stamp)
        assert {frame.patch for frame in reading.skin} == {patch.name for patch in link.robot.patches}
        for frame in reading.skin:
            assert frame.values.shape == (link.robot.patch(frame.patch).channels,)
        sequences.append(reading.joints.sequence)
    assert sequences == sorted(sequences)
    # A reading is taken after its tick began; a busy machine may be late, but not always.
    assert min(np.abs(ages)) <= link.gate.stale_after


def test_write_returns_what_was_sent_and_the_robot_goes_there(open_link: Callable[..., Link]) -> None:
    link = open_link()
    arm = link.native("LArm")
    command = arm.command({"LElbowRoll": -1.2})
    safe = link.gate.step([command], link.read().joints, link.clock.now())
    assert link.write(safe) is safe
    assert drive_until(link, lambda: abs(arm.positions(link.read().joints)["LElbowRoll"] + 1.2) < 0.01)


def test_home_is_commands_like_any_other(open_link: Callable[..., Link]) -> None:
    link = open_link()
    part = link.robot.part("right_arm")
    drive(link, link.native("RArm").command({"RElbowRoll": 0.3}))
    servos = [servo.servo for servo in part.servos]
    wanted = link.robot.initial_position[servos]
    orders = [to_platform(link.robot, command) for command in home(part)]
    assert drive_until(
        link, lambda: np.abs(link.read().joints.position[servos] - wanted).max() < 0.01, *orders
    )


def test_an_unarmed_link_reads_and_refuses_to_write(open_link: Callable[..., Link]) -> None:
    link = open_link(arm=False)
    joints = link.read().joints
    with pytest.raises(LinkError, match="arm=True"):
        link.write(link.gate.step([], joints, link.clock.now()))


def test_only_this_links_gate_can_write(open_link: Callable[..., Link]) -> None:
    link = open_link()
    other = Gate(link.robot, period=link.period, stale_after=1.0)
    safe = other.step([], link.read().joints, link.clock.now())
    with pytest.raises(LinkError, match="gate"):
        link.write(safe)


def test_a_closed_link_says_so_and_closes_twice(open_link: Callable[..., Link]) -> None:
    with open_link() as link:
        pass
    link.close()
    with pytest.raises(LinkError, match="closed"):
        link.read()


def test_native_names_are_checked(open_link: Callable[..., Link]) -> None:
    link = open_link()
    with pytest.raises(UnknownNameError, match="LArm"):
        link.native("Tail")
    with pytest.raises(UnknownNameError, match="LWristYaw"):
        link.native("LArm").command({"LWrist": 0.0})
    with pytest.raises(CommandError, match="no values"):
        link.native("LArm").command({})


def test_a_native_command_obeys_the_same_limits(open_link: Callable[..., Link]) -> None:
    link = open_link()
    safe = link.gate.step(
        [link.native("LArm").command({"LElbowRoll": 2.0, "LHand": 0.5})],
        link.read().joints,
        link.clock.now(),
    )
    assert "LHand can't be moved" in safe.refusals[0]
    command = link.native("LArm").command({"LElbowRoll": 2.0})
    safe = link.gate.step([command], link.read().joints, link.clock.now())
    assert "LElbowRoll" in safe.clamped[0]
