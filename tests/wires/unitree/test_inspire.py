"""Inspire hands over Unitree's topics, against a stand-in with cyclonedds' own encoder and nothing of TCI.

Joint ranges are those of Unitree's URDF (unitree_ros d6f13aad), 1000 is open: xr_teleoperate d1510db.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import tci
from helpers import HELPERS
from helpers.dds_domains import DOMAINS
from helpers.puppets import Puppet
from helpers.served import Served
from helpers.touch_devices import InspireHand
from tci.cli.main import app
from tci.drivers.driver import Driver
from tci.drivers.sourced import SourcedDriver
from tci.errors import DriverError
from tci.gate.safe_command import GateState
from tci.reasons import Code
from tci.shared.inspire_dds import CTRL, SETS, decode, topic
from tci.shared.interface_node import InterfaceNode
from tci.wires.unitree.inspire_fingers import InspireFingers

pytestmark = [pytest.mark.timeout(90), pytest.mark.xdist_group("unitree-inspire")]
JOINTS = (  # in the order of the messages, with the range [rad] that Unitree's URDF gives
    ("little_1", 1.4381), ("ring_1", 1.4381), ("middle_1", 1.4381), ("index_1", 1.4381),
    ("thumb_2", 0.5864), ("thumb_1", 1.1641),
)  # fmt: skip
PADS = (
    *(f"{finger}_{pad}" for finger in ("little", "ring", "middle", "index") for pad in ("tip", "top", "pad")),
    "thumb_tip", "thumb_top", "thumb_middle", "thumb_pad", "palm",
)  # fmt: skip
ANGLES = {"l": [900, 800, 700, 600, 500, 400], "r": [1000, 950, 880, 777, 333, 222]}
SIDES = {"l": "left", "r": "right"}
RATE = 15.0
"""Rate [Hz] of the stand-in: slow enough that each state would be a jump for the gate."""


class Program:
    """The stand-in in a process of its own."""

    def __init__(self, domain: int, *role: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(HELPERS / "inspire_bridge.py"), str(domain), *role],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.heard: list[Any] = []
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.heard.append(json.loads(line))

    def tell(self, what: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()

    def answer(self, what: Any) -> Any:
        count = len(self.heard)
        self.tell(what)
        until(lambda: len(self.heard) > count, 30.0)
        return self.heard[-1]

    def close(self) -> None:
        self.process.kill()
        self.process.wait()


def until(there: Callable[[], bool], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


@contextmanager
def robot(*, arm: bool = False) -> Iterator[tuple[Program, Driver, int]]:
    """A G1 without physics whose hands are the stand-in's, and a driver of it."""
    domain = next(DOMAINS)
    bridge = Program(domain, "hands", str(RATE))
    try:
        bridge.tell({letter: {"angle_act": angles} for letter, angles in ANGLES.items()})
        with (
            Puppet(domain) as puppet,
            tci.connect(
                tci.load_robot("g1-inspire").with_stale_after(0.3), f"unitree:lo/{domain}", arm=arm
            ) as driver,
        ):
            puppet.obeys = True
            yield bridge, driver, domain
    finally:
        bridge.close()


def angles(driver: Driver, letter: str) -> list[float]:
    side = SIDES[letter]
    found = driver.native(f"{side}_arm").positions(driver.read().joints)
    return [found[f"{side}_{name}_joint"] for name, _ in JOINTS]


def rad(counts: list[int]) -> list[float]:
    return [(1000 - count) / 1000 * most for count, (_, most) in zip(counts, JOINTS, strict=True)]


def drive(driver: Driver, seconds: float, until: GateState | None = None, **goal: float) -> Any:
    """Commands joints of the left hand, by their names behind the side, in each period: on a busy machine a
    hold ends an order. Ends in the state `until`."""
    arm = driver.native("left_arm")
    orders = [arm.command({f"left_{name}_joint": angle for name, angle in goal.items()})] if goal else []
    for now in driver.ticks(duration=seconds):
        sent = driver.write(driver.gate.step(orders, driver.read().joints, now))
        if sent.state is until:
            break
    return sent


def drive_there(driver: Driver, arrived: Callable[[], bool], **goal: float) -> None:
    """Commands joints of the left hand until they have arrived: a busy machine is slower."""
    for _ in range(10):
        drive(driver, 1.6, **goal)
        if arrived():
            break


def test_angles_and_pads_are_those_of_the_stand_in_and_fingers_obey_within_their_range() -> None:
    with robot(arm=True) as (bridge, driver, _):
        for letter in ANGLES:
            until(lambda letter=letter: np.allclose(angles(driver, letter), rad(ANGLES[letter]), atol=1e-9))  # type: ignore[misc]
        until(lambda: len(driver.read().skin) == 34)
        felt = {frame.patch: frame.values.tolist() for frame in driver.read().skin}
        for side in SIDES.values():
            flat = [value for pad in PADS for value in felt[f"{side}_{pad}"]]
            assert flat == list(range(1062)), "the order of the registers"
        assert not bridge.heard, "nothing is sent before a command"
        goal = [900, 800, 700, round(1000 * (1 - 1.2 / 1.4381)), 500, round(1000 * (1 - 0.2 / 1.1641))]
        drive_there(driver, lambda: list(bridge.heard[-1][1]) == goal, index_1=1.2, thumb_1=0.2)
        heard = [one for one in bridge.heard if one[0] == "l"]
        assert not [one for one in bridge.heard if one[0] == "r"], "the other hand is left alone"
        assert {mode for _, _, mode, _ in heard} == {1}, "angles only"
        assert not any(any(others) for *_, others in heard)
        sent = np.array([counts for _, counts, _, _ in heard])
        assert np.abs(sent[0] - ANGLES["l"]).max() <= 30, "it begins where the hand is"
        assert np.abs(np.diff(sent, axis=0)).max() <= 100, "and goes on without a step"
        assert sent[-1].tolist() == goal
        until(lambda: np.allclose(angles(driver, "l"), rad(goal), atol=1e-9))  # the next state tells
        drive_there(driver, lambda: bridge.heard[-1][1][0::3] == [1000, 0], index_1=2.5, little_1=-1.0)
        assert bridge.heard[-1][1][0::3] == [1000, 0], "as far as they go"
        assert not driver.gate.counts.stops
        assert not [one for one in driver.diagnose() if "hand" in one.subject and one.level.name != "OK"]


def test_a_hand_that_is_silent_or_sends_zeros_holds_and_comes_back_and_an_error_stops() -> None:
    with robot(arm=True) as (bridge, driver, domain):
        for fault, angle in (("silent", 0.9), ("zeros", 0.4)):
            drive(driver, 0.3, index_1=angle)
            bridge.tell({"l": {fault: True}})
            sent = drive(driver, 3.0, GateState.HOLD)
            assert sent.reason.code is Code.JOINTS_STALE
            assert "no state of the left hand" in sent.reason.text
            assert drive(driver, 0.5).state is GateState.HOLD
            assert any("no state of the left hand" in one.what for one in driver.diagnose())
            bridge.tell({"l": {fault: False}})
            assert drive(driver, 0.6).state is GateState.RUN
        bridge.tell({"l": {"err": [0, 0, 0, 1, 0, 0]}})
        sent = drive(driver, 0.5)
        assert sent.state is GateState.STOP
        assert "left index of the Inspire hand reports stall" in sent.reason.text
        count = len(bridge.heard)
        drive(driver, 0.3)
        assert len(bridge.heard) <= count + 1, "nothing more is sent"
        with pytest.raises(DriverError, match="reports stall"):
            tci.connect("g1-inspire", f"unitree:lo/{domain}", arm=True)


def test_a_halt_sends_no_old_angles_and_nothing_to_a_hand_that_nobody_moved() -> None:
    sent: list[bytes] = []
    node: Any = SimpleNamespace(fault_of_writers=lambda _: "", out=lambda *_: sent.append)
    state = np.array([1004, 800, 700, 600, 500, -3])
    hand: Any = SimpleNamespace(
        commands="", servos=np.arange(6), places=np.arange(6), state=state, late=False
    )
    fingers = InspireFingers(node, hand)

    def targets(now: float) -> list[int]:
        fingers.repeat(now)
        return [int(one) for one in decode(sent[-1], SETS, {})[0]["angle_set"]]

    fingers.hold()
    fingers.repeat(0.0)
    assert not sent, "it stands still by itself"
    fingers.obey(moving(1, 1.4381 * 0.4))
    assert targets(1.0) == [1000, 600, 700, 600, 500, -1]
    hand.late = True
    fingers.hold()
    assert targets(2.0)[1] == 600, "not back to where it was"
    hand.late, state[1] = False, 650
    fingers.hold()
    assert targets(3.0)[1] == 650


def moving(servo: int, angle: float) -> Any:
    return SimpleNamespace(servos=np.array([servo]), position=np.array([angle]))


def test_another_program_that_commands_a_hand_keeps_the_robot_unarmed() -> None:
    with robot() as (_, driver, domain):
        other = InterfaceNode("lo", domain)
        kept = other.out(topic("ctrl", "right"), CTRL)
        time.sleep(0.5)
        with pytest.raises(DriverError, match="another program writes rt/inspire_hand/ctrl/r"):
            tci.connect(driver.robot, f"unitree:lo/{domain}", arm=True)
        assert "1 other programs write rt/inspire_hand/ctrl/r" in [one.what for one in driver.diagnose()]
        del kept
        other.close()


def test_a_program_that_commands_a_hand_later_stops_the_robot() -> None:
    with robot(arm=True) as (bridge, driver, domain):
        assert drive(driver, 0.5, index_1=0.9).state is GateState.RUN
        other = InterfaceNode("lo", domain)
        kept = other.out(topic("ctrl", "left"), CTRL)
        sent = drive(driver, 3.0, GateState.STOP)
        assert "another program writes rt/inspire_hand/ctrl/l; valid: only one" in sent.reason.text
        count = len(bridge.heard)
        drive(driver, 0.3)
        assert len(bridge.heard) <= count + 1, "nothing more is sent"
        del kept
        other.close()


def test_a_robot_without_the_bridge_says_what_to_start() -> None:
    domain = next(DOMAINS)
    with Puppet(domain), pytest.raises(DriverError, match=r"left hand; start the maker's bridge.*state/l"):
        tci.connect("g1-inspire", f"unitree:lo/{domain}", wait=1.0)


def test_a_served_g1_tells_and_takes_what_the_bridge_does() -> None:
    domain = next(DOMAINS)
    served, client = Served("g1-inspire", f"unitree:lo/{domain}"), Program(domain, "client")
    try:
        before, touch = client.answer(["l", [], 0])
        assert len(touch) == 1062
        assert client.answer(["l", [-1, -1, -1, 400, -1, -1], 2])[0] == before, "no angles are meant"
        assert client.answer(["l", [-1, -1, -1, 1200, -1, -1], 1])[0] == before, "beyond the range"
        client.answer(["l", [-1, -1, -1, 400, -1, -1], 1])
        until(lambda: abs(client.answer(["l", [], 0])[0][3] - 400) <= 5)
        after = client.answer(["l", [], 0])[0]
        assert np.abs(np.delete(after, 3) - np.delete(before, 3)).max() <= 5, "-1 leaves a joint alone"
        with tci.connect("g1-inspire", f"unitree:lo/{domain}") as driver:
            counts = client.answer(["l", [], 0])[0]
            until(lambda: np.allclose(angles(driver, "l"), rad(counts), atol=2e-3))
    finally:
        client.close()
        said = "".join(served.stop())
    assert "Traceback" not in said


def test_the_bridges_topics_as_a_source_give_angles_too() -> None:
    domain = next(DOMAINS)
    bridge = Program(domain, "hands", "50")
    try:
        bridge.tell({"r": {"angle_act": ANGLES["r"]}})
        with tci.connect("g1-inspire", f"sim + inspire:dds://lo/{domain},side=right") as driver:
            until(lambda: np.allclose(angles(driver, "r"), rad(ANGLES["r"])))
            assert not np.allclose(angles(driver, "l"), rad(ANGLES["l"])), "the other hand is simulated"
            assert isinstance(driver, SourcedDriver)
            bridge.tell({"r": {"zeros": True}})
            (reader,) = driver.readers
            until(lambda: reader.rejected.total() > 0)
            frames = reader.pads["palm"].sequence
            until(lambda: reader.rejected.total() > 30)
            assert reader.pads["palm"].sequence > frames + 15, "without angles there is touch all the same"
    finally:
        bridge.close()


def test_hands_that_sources_read_need_no_bridge_and_the_doctor_examines_every_part() -> None:
    """Beside the robot's own driver, over the hands' own sockets: angles and pads arrive, arms are moved, and
    fingers are not."""
    domain, hands = next(DOMAINS), {letter: InspireHand() for letter in ANGLES}
    via = f"unitree:lo/{domain}"
    for letter, hand in hands.items():
        hand.angles = lambda letter=letter: ANGLES[letter]  # type: ignore[misc]
        hand.number()
        hand.plug()
        via += f" + {hand.via},side={SIDES[letter]}"
    try:
        with Puppet(domain) as puppet:
            puppet.obeys = True
            with tci.connect(tci.load_robot("g1-inspire").with_stale_after(0.3), via, arm=True) as driver:
                for letter, hand in hands.items():
                    until(lambda letter=letter: np.allclose(angles(driver, letter), rad(ANGLES[letter])))  # type: ignore[misc]
                    felt = {frame.patch: frame.values.tolist() for frame in driver.read().skin}
                    assert {pad: felt[f"{SIDES[letter]}_{pad}"] for pad in PADS} == hand.values
                arm, name = driver.native("left_arm"), "left_shoulder_roll_joint"
                before = arm.positions(driver.read().joints)[name]
                order = arm.command({"left_index_1_joint": 0.1})
                (refusal,) = driver.gate.step([order], driver.read().joints, driver.clock.now()).refusals
                assert refusal.text.startswith("left_index_1_joint can't be moved: no state of the left hand")
                near = pytest.approx(before + 0.2, abs=0.02)
                drive_there(
                    driver,
                    lambda: arm.positions(driver.read().joints)[name] == near,
                    shoulder_roll=before + 0.2,
                )
                assert arm.positions(driver.read().joints)[name] == near
            report = doctor(via)
            assert report["healthy"]
            said = {one["subject"]: one["what"] for one in report["findings"]}
            assert "29 motors" in said["variant"]
            assert "can't be moved" in said["left hand"]
            hands["r"].unplug()
            report = doctor(via)
            assert not report["healthy"]
            found = [(one["subject"], one["what"]) for one in report["findings"]]
            assert any(subject == "states" for subject, _ in found), "the robot's own driver"
            assert any("17 of 17 pads send" in what for _, what in found), "the hand that is there"
            assert any(hands["r"].via in what and "side=right" in what for _, what in found)
    finally:
        for hand in hands.values():
            hand.unplug()


def doctor(via: str) -> Any:
    said = CliRunner().invoke(app, ["doctor", "g1-inspire", "--via", via, "--duration", "0.5", "--json"])
    return json.loads(said.stdout)
