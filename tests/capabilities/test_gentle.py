"""An arm on its way gives way to whoever it meets (judge: `helpers.gentled`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tci
from helpers.gentled import Go, meet
from tci.body import PEOPLE, Struck, first_peak
from tci.capabilities import Sway, SwayMemory
from tci.capabilities.gentle.capability import GentleMemory
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, TciError, UnknownNameError
from tci.gate import GateState
from tci.messages import ExpectContact, GenericCommand, Mode, SwitchMode
from tci.messages.frames import read_only
from tci.simulation.world import World
from tci.testing import TouchedRobot


@pytest.mark.parametrize(
    ("name", "seed", "cap", "stiffness"),
    [("g1", 2, 10.0, 10e3), ("icub", 1, 5.0, 75e3), ("nao", 1, 15.0, 25e3)],
)
def test_it_presses_with_no_more_than_its_cap_and_then_goes_on(
    name: str, seed: int, cap: float, stiffness: float
) -> None:
    met = meet(name, seed, cap=cap, stiffness=stiffness)
    assert met is not None
    assert met.felt
    assert met.peak > 3.0
    assert met.late <= cap + max(0.1 * cap, met.step)
    assert met.left < 2.0
    assert met.state == "RUN"


@pytest.mark.parametrize("seed", [1, 6])
def test_an_arm_gives_way_to_whom_the_skin_of_its_hand_feels(seed: int) -> None:
    """The arm itself has no skin."""
    met = meet("g1-inspire", seed, cap=10.0, stiffness=20e3, lasts=1.8)
    assert met is not None
    assert met.felt
    assert 3.0 < met.peak <= 11.0
    assert met.kept >= 0.9
    assert met.state == "RUN"


@pytest.mark.parametrize("seed", [1, 6])
def test_a_hand_that_comes_and_goes_is_not_taken_for_a_stiff_one(seed: int) -> None:
    """It comes by 13 cm with up to 0.2 m/s, and the bar of the 95th percentile is 20 N. The second one comes
    so slowly at first that it seems to stand."""
    met = meet("g1", seed, cap=10.0, stiffness=1.5e3, speed=0.2)
    assert met is not None
    assert met.felt
    assert met.peak > 10.0
    assert met.late <= 11.0
    assert met.high <= 20.0
    assert met.left < 2.0


@pytest.mark.parametrize(
    ("name", "seed", "stiffness", "speed"), [("g1", 6, 1.5e3, 0.2), ("icub", 177, 1.7e3, 0.15)]
)
def test_a_hand_on_a_persons_arm_that_comes_and_goes_is_given_way_to(
    name: str, seed: int, stiffness: float, speed: float
) -> None:
    """0.6 kg behind a pad, on an arm of 300 N/m."""
    met = meet(name, seed, cap=10.0, stiffness=stiffness, speed=speed, free=True, lasts=2.4)
    assert met is not None
    assert met.felt
    assert met.peak > 10.0
    assert met.high <= 20.0
    assert met.kept >= 0.9
    assert met.state == "RUN"


@pytest.mark.parametrize(
    ("name", "seed", "speed", "delay"), [("alex", 111, 0.11, 0.05), ("g1", 102, 0.17, 0.1)]
)
def test_a_hand_that_comes_is_neither_lost_nor_struck(
    name: str, seed: int, speed: float, delay: float
) -> None:
    """Loops of 10 ms. A hand that followed the arm was taken for so soft a one that the arm fled from it;
    with a delay of 0.1 s the arm never knew whom it met, and pressed the hand with 116 N."""
    met = meet(name, seed, cap=10.0, stiffness=1.5e3, speed=speed, delay=delay, lasts=1.2)
    assert met is not None
    assert met.felt
    assert met.kept >= 0.9
    assert 10.0 < met.peak <= 25.0
    assert met.state == "RUN"


def test_the_first_peak_that_is_told_is_hardly_ever_too_low() -> None:
    """At small size; `make reliability ROWS=gentles` has the bar, 3 of 4 within 25 %. These are the trials
    241 to 248 that skin felt."""
    ratios = []
    for name, seed, stiffness in (
        ("icub", 241, 25e3), ("icub", 243, 50e3), ("nao", 244, 40e3), ("alex", 248, 20e3),
    ):  # fmt: skip
        met = meet(name, seed, cap=10.0, stiffness=stiffness, lasts=0.4)
        assert met is not None
        assert met.felt
        person = Struck(name="partner", stiffness=stiffness, mass=1e6, force=np.inf)
        told = first_peak(
            tci.GenericBody(name), met.joints, met.patch, met.taxel, speed=met.closing, person=person,
            period=met.period,
        )  # fmt: skip
        ratios.append(told / met.first)
    assert min(ratios) >= 0.75, ratios
    assert max(ratios) <= 2.0, ratios
    assert sum(abs(one - 1.0) <= 0.25 for one in ratios) >= 0.5 * len(ratios), ratios


def test_what_a_first_peak_does_not_take_is_told() -> None:
    body, joints = tci.GenericBody("nao"), TouchedRobot("nao").perceive().joints
    assert joints is not None
    hand = PEOPLE[-1]
    for taxel, speed, period, valid in (
        (10**6, 0.1, 0.01, r"taxel 1000000 of left_forearm; valid: 0 to \d+"),
        (0, -0.1, 0.01, "valid: 0 or more"),
        (0, 0.1, 0.0, "a period of 0.0 s; valid: above 0"),
    ):
        with pytest.raises(CommandError, match=valid):
            first_peak(body, joints, "left_forearm", taxel, speed=speed, person=hand, period=period)


def test_speeds_give_way_to_two_people_at_once() -> None:
    """Whatever is wanted, no contact is pressed further than it may be; where both can't be, the larger
    excess is made small."""
    robot, second, random = TouchedRobot("icub"), TouchedRobot("icub"), np.random.default_rng(0)
    for _ in range(40):
        seen = robot.perceive("left_forearm", taxel=int(random.integers(100)), force=6.0)
        other = second.perceive("left_upper_arm", taxel=int(random.integers(100)), force=6.0)
        contacts = [*seen.contacts, *other.contacts]
        if len(contacts) < 2:
            continue
        wanted, most = random.uniform(-1.0, 1.0, 5), random.uniform(-0.02, 0.05, len(contacts))
        rates = robot.body.yield_to(seen, contacts, wanted, most)
        into = np.array([robot.body.jacobian(seen, one).T @ one.n_T for one in contacts])
        before, after = into @ wanted - most, into @ rates - most
        assert after.max() <= max(before.max(), 0.0) + 1e-9
        if np.linalg.matrix_rank(into, tol=0.05) == len(contacts):
            assert after.max() <= 0.01
        if before.max() <= 0.0:
            np.testing.assert_array_equal(rates, wanted)


def test_it_declares_the_contact_that_it_handles_and_tells_it() -> None:
    robot = TouchedRobot("nao")
    goal = robot.body.robot.part("left_arm").initial_posture + 0.4
    gentle = tci.Gentle(Go("left_arm", goal), cap=5.0)
    first = gentle.begin(robot.perceive(), robot.body)
    assert [(one.part, one.mode) for one in first if isinstance(one, SwitchMode)] == [
        ("left_arm", Mode.VELOCITY), ("right_arm", Mode.VELOCITY),
    ]  # fmt: skip
    memory = gentle.init(robot.body)
    for touch in (None, None, "left_forearm", "left_forearm", "left_forearm"):
        seen = robot.perceive(touch, force=12.0)
        orders, memory = gentle.step(memory, seen, robot.body)
        move, expects = orders
        assert isinstance(move, GenericCommand)
        assert isinstance(expects, ExpectContact)
        pushes = [robot.body.jacobian(seen, one).T @ one.n_T @ move.values for one in seen.contacts]
        assert all(push < 0.0 for push in pushes), "12 N are above the cap"
    assert gentle.claims(memory) == {"left_arm"}
    assert "left_arm gives way" in gentle.notes(memory)[0]
    with pytest.raises(TciError, match=r"gentle: cap 40.0; valid: 1 to 30"):
        tci.Gentle(Go("left_arm", goal), cap=40.0)
    with pytest.raises(UnknownNameError, match="left_wing"):
        tci.Gentle(Go("left_arm", goal), parts=("left_wing",)).init(robot.body)


def test_it_goes_no_faster_than_it_is_told_but_gives_way_as_fast_as_it_can() -> None:
    """A NAO that swayed slowly was pushed 16 degrees off, and stopped."""
    robot, fastest = tci.load_robot("nao"), [0.0, 0.0]
    world = World(robot, people=1)
    world.touch("push 'left forearm'")

    def watch(tick: tci.Tick) -> None:
        pressed = bool(tick.perception and tick.perception.contacts)
        for one in tick.commands:
            if isinstance(one, GenericCommand) and one.part == "left_arm":
                fastest[pressed] = max(fastest[pressed], float(np.abs(one.values).max()))

    result = tci.run(SimulatedDriver(robot, world=world), tci.Gentle(Sway()), duration=1.5, observe=watch)
    assert result.state is GateState.RUN
    slowly = 2.0 * Sway().angle / Sway().turn
    assert fastest[0] <= slowly + 1e-9
    assert fastest[1] > 2.0 * slowly


@pytest.mark.parametrize(("retreats", "words"), [(0.0, "can't give way there"), (0.3, "gives way")])
def test_an_arm_that_is_kept_from_giving_way_tells_it(retreats: float, words: str) -> None:
    robot = TouchedRobot("icub")
    joints = robot.body.joint_maps["left_arm"]
    gentle = tci.Gentle(Go("left_arm", robot.body.robot.part("left_arm").initial_posture + 0.4))
    memory = gentle.init(robot.body)
    for _ in range(30):
        seen = robot.perceive("left_forearm", force=40.0)
        assert seen.joints is not None
        away = sum(-(robot.body.jacobian(seen, one).T @ one.n_T) for one in seen.contacts)
        velocity = np.zeros(len(seen.joints.position))
        velocity[joints.servos] = joints.slope(seen.joints.position).T @ (retreats * np.asarray(away))
        moving = replace(seen, joints=replace(seen.joints, velocity=read_only(velocity)))
        _, memory = gentle.step(memory, moving, robot.body)
    assert words in gentle.notes(memory)[0]


def test_it_gives_way_to_what_only_its_joints_bear() -> None:
    """Somebody presses a link without skin ever harder: the arm goes away, with positive power for them."""
    robot = TouchedRobot("g1")
    pushed, power = np.array([3.0, -6.0, 0.0, 4.0, 0.0]), list[float]()
    part, joints = robot.body.robot.part("left_arm"), robot.body.joint_maps["left_arm"]
    gentle = tci.Gentle(Go(part.name, part.initial_posture + 0.05 * pushed))
    memory = gentle.init(robot.body)
    for step in range(80):
        seen = robot.perceive()
        assert seen.joints is not None
        torque = np.full(len(seen.joints.position), 0.3)
        torque[joints.servos] += (
            max(0.0, 0.04 * (step - 40)) * joints.slope(seen.joints.position).T @ pushed[joints.ids]
        )
        orders, memory = gentle.step(
            memory, replace(seen, joints=replace(seen.joints, torque=read_only(torque))), robot.body
        )
        move = orders[0]
        assert isinstance(move, GenericCommand)
        power.append(float(pushed @ move.values))
    assert max(power[:40]) > 0.0, "it goes on while nobody pushes, whatever its weight"
    assert power[-1] < -0.1
    assert not seen.contacts


def test_a_heavy_arm_takes_its_own_acceleration_for_nobody() -> None:
    gentle, told = tci.Gentle(Sway()), list[str]()

    def hear(memory: GentleMemory[SwayMemory]) -> bool:
        told.extend(gentle.notes(memory))
        return False

    with tci.connect("franka", "sim") as driver:
        start = driver.read().joints.position
        tci.run(driver, gentle, duration=0.6, until=hear)
        assert np.abs(driver.read().joints.position - start).max() > 0.01
    assert not told


def test_a_push_that_only_joints_told_ends_with_it_also_where_speeds_are_noisy() -> None:
    robot, chance, power = TouchedRobot("g1"), np.random.default_rng(0), list[float]()
    pushed, joints = np.array([3.0, -6.0, 0.0, 4.0, 0.0]), robot.body.joint_maps["left_arm"]
    start = robot.body.robot.part("left_arm").initial_posture
    gentle = tci.Gentle(Go("left_arm", start + 0.05 * pushed))
    memory = gentle.init(robot.body)
    for step in range(230):
        seen = robot.perceive()
        assert seen.joints is not None
        count = len(seen.joints.position)
        torque, noise = np.zeros(count), chance.normal(0.0, 0.1 * (step > 60), count)
        if 40 < step < 80:
            torque[joints.servos] = joints.slope(seen.joints.position).T @ pushed[joints.ids]
        own = replace(seen.joints, torque=read_only(torque), velocity=read_only(noise))
        orders, memory = gentle.step(memory, replace(seen, joints=own), robot.body)
        assert isinstance(orders[0], GenericCommand)
        power.append(float(pushed @ orders[0].values))
    assert power[75] < -0.1
    assert min(power[-20:]) > 0.0, "it goes on"
    assert not gentle.notes(memory)


def test_it_takes_positions_only() -> None:
    robot = TouchedRobot("nao")
    gentle = tci.Gentle(tci.SoftReaction())
    with pytest.raises(CommandError, match="another way than by positions"):
        gentle.step(gentle.init(robot.body), robot.perceive(), robot.body)
