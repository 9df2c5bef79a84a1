"""While a part leaves somebody, the waist and parts that near the same person wait, whoever commands them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from helpers.gate_checks import position_command, reading
from tci.gate.contact.group import make_groups
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.waiting import Waiting
from tci.gate.gate import Gate, GateSettings, GateState
from tci.gate.joint_group import groups_of
from tci.gate.joint_monitor import Reference
from tci.messages import Contacts, Mode, PlatformOrder
from tci.messages.contacts import CONTACT, TAXEL, Site
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain

ROBOT = load_robot("icub")
PLACE = {servo.name: servo.index for servo in ROBOT.servos}
PERIOD = 0.01
HOME = np.array(initial_position(ROBOT))
HAND = KinematicChain(ROBOT).poses(HOME, ["l_hand"])["l_hand"][:3, 3]


def felt(force: float, place: Array, *, right: float = 0.0) -> Contacts:
    """Forces [N] on the left and the right arm."""
    count = 2 if right else 1
    rows = np.zeros(count, CONTACT)
    rows["identity"], rows["force"] = [7, 8][:count], [force, right][:count]
    rows["n_T"], rows["p_T"] = [1.0, 0.0, 0.0], place
    sites = (Site("skin", "left_arm", "forearm"), Site("skin", "right_arm", "forearm"))[:count]
    begin = np.zeros(count + 1, np.int64)
    return Contacts(sites, np.zeros(1), np.arange(count), rows, begin, np.zeros(0, TAXEL))


class Robot:
    """Joints that follow at once."""

    def __init__(self) -> None:
        settings = GateSettings(contact=ContactSettings(), self_collision=None)
        self.gate = Gate(ROBOT, period=PERIOD, stale_after=0.1, settings=settings, streams=True)
        self.angles, self.now = HOME.copy(), 0.0
        self.told: list[str] = []
        self.refused: list[Code] = []

    def order(self, **degrees: float) -> PlatformOrder:
        """To so many degrees from the start."""
        servos = [PLACE[name] for name in degrees]
        return position_command(servos, HOME[servos] + np.deg2rad([*degrees.values()]))

    def step(self, *orders: PlatformOrder, contacts: Contacts | None = None) -> None:
        safe = self.gate.step(orders, reading(self.angles, self.now), self.now, contacts=contacts)
        self.angles[safe.servos] = safe.position
        self.told += [one.text for one in safe.clamped if one.code is Code.CONTACT]
        self.refused += [one.code for one in safe.refusals]
        self.now += PERIOD

    def moved(self, name: str) -> float:
        """Degrees from the start."""
        return float(np.rad2deg(self.angles - HOME)[PLACE[name]])


def meets(other: Mapping[str, float], *, force: float = 20.0) -> Robot:
    """The left arm meets somebody at its hand while another client moves another part."""
    robot, nobody = Robot(), felt(0.0, HAND)
    robot.step(robot.order(l_elbow=25.0), robot.order(**other), contacts=nobody)
    for _ in range(15):
        robot.step(contacts=nobody)
    for _ in range(100):
        robot.step(contacts=felt(force, HAND))
    return robot


@pytest.mark.parametrize(
    ("joint", "asked"), [("torso_yaw", 40.0), ("r_shoulder_yaw", 60.0)], ids=["waist", "other arm"]
)
def test_a_part_that_could_press_the_same_person_waits(joint: str, asked: float) -> None:
    robot = meets({joint: asked})
    there = robot.moved(joint)
    assert 0.0 < there < asked - 5.0
    assert any("waits, since left_arm met somebody" in one for one in robot.told)
    robot.step(robot.order(**{joint: asked}), contacts=felt(20.0, HAND))
    assert robot.refused == [Code.CONTACT]
    for _ in range(100):
        robot.step(contacts=felt(0.0, HAND))
    robot.step(robot.order(**{joint: asked}), contacts=felt(0.0, HAND))
    for _ in range(300):
        robot.step(contacts=felt(0.0, HAND))
    assert robot.moved(joint) == pytest.approx(asked, abs=0.1), "afterwards it obeys"
    assert robot.gate.state is GateState.RUN


def test_a_part_that_goes_away_goes_on() -> None:
    robot = meets({"r_shoulder_yaw": -30.0})
    assert robot.moved("r_shoulder_yaw") == pytest.approx(-30.0, abs=0.1)
    assert not any("waits" in one for one in robot.told)


def test_nobody_waits_for_a_touch_that_is_only_told() -> None:
    robot = meets({"torso_yaw": 40.0}, force=10.0)
    assert robot.moved("torso_yaw") == pytest.approx(40.0, abs=0.1)


def test_a_part_that_waits_gives_way_to_whoever_presses_it() -> None:
    robot = meets({"r_shoulder_yaw": 60.0})
    there, place = robot.moved("r_shoulder_yaw"), PLACE["r_shoulder_yaw"]
    for _ in range(60):
        robot.angles[place] = min(robot.angles[place], np.deg2rad(there - 2.0) + HOME[place])
        robot.step(contacts=felt(20.0, HAND, right=25.0))
    robot.step(contacts=felt(20.0, HAND, right=25.0))
    assert robot.moved("r_shoulder_yaw") < there - 1.0


def test_nobody_waits_for_an_arm_that_lies_on_a_thing() -> None:
    groups, _ = make_groups(ROBOT, groups_of(ROBOT), {}, stands=False)
    left, right, waist = (
        next(one for one in groups.values() if part in one.parts)
        for part in ("left_arm", "right_arm", "torso")
    )
    waiting, yaw = Waiting(ROBOT, groups), np.array([PLACE["torso_yaw"]])
    turns = Reference(yaw, (Mode.POSITION,), HOME[yaw], np.array([0.5]), np.zeros(1))
    right.thing, right.goal, left.goal = "the table", HOME[right.servos], HOME[left.servos]
    waiting.look({}, HOME, turns)
    assert waiting.servos == waist.own
    left.goal = None
    waiting.look({}, HOME, turns)
    assert not waiting.servos


def test_whoever_obeys_nobody_is_told_until_it_obeys_again() -> None:
    """Clients can't count the half second after a contact themselves: a simulated robot may be slow."""
    robot = meets({"r_elbow": 25.0})
    for n in range(120):
        told = {one.part for one in robot.gate.met if one.answer in ("retreat", "waits")}
        robot.refused.clear()
        # far apart in time, so that no stream is refused; the contact ends in period 20
        robot.step(
            *([robot.order(l_elbow=24.0)] if n % 30 == 29 else []),
            contacts=felt(20.0 if n < 20 else 0.0, HAND),
        )
        if n % 30 == 29:
            assert robot.refused == ([Code.CONTACT] if "left_arm" in told else [])
        assert "left_arm" in told or n > 60
    assert "left_arm" not in told


def test_an_order_at_the_instant_of_a_contact_is_told_and_no_refusal() -> None:
    """Nobody could know; it ends as the motion does that it would have changed."""
    robot, nobody = Robot(), felt(0.0, HAND)
    robot.step(robot.order(l_elbow=25.0), contacts=nobody)
    for _ in range(15):
        robot.step(contacts=nobody)
    order = robot.order(l_elbow=40.0)
    for _ in range(10):
        safe = robot.gate.step(
            [order], reading(robot.angles, robot.now), robot.now, contacts=felt(20.0, HAND)
        )
        robot.angles[safe.servos] = safe.position
        robot.now += PERIOD
        if any(one.code is Code.CONTACT for one in safe.clamped):
            break
        assert safe.orders == (order,)
    assert not safe.orders
    assert not safe.refusals
    ((refused, why),) = safe.refused
    assert (refused is order, why.code) == (True, Code.OVERTAKEN)
    assert why in safe.clamped
    robot.step(robot.order(l_elbow=40.0), contacts=felt(20.0, HAND))
    assert robot.refused == [Code.CONTACT], "now everybody knows"
