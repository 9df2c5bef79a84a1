"""A policy runs at its own rate on every robot, leaves touches, and is held when it is late."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tci
from tci.capabilities.fields import default_fields
from tci.capabilities.policy import Observation, PolicySpec
from tci.errors import TciError
from tci.reasons import Code, Reason
from tci.robot.limb import generic_limb_distance
from tci.testing import FakeDriver, TouchedRobot


def still(seen: np.ndarray) -> np.ndarray:
    return np.zeros(5)


class Fields:
    """Hand-written, of what it sees alone: the field nearest to the first contact says where to go."""

    def __call__(self, seen: np.ndarray) -> np.ndarray:
        rows = seen.reshape(20, -1)
        for row in rows:
            forearm, u, sin, cos, force, *_ = row[5:12]
            if 10.0 * force > 1.0:
                near = [
                    (generic_limb_distance(u, np.arctan2(sin, cos), field.u, field.theta), field.motion)
                    for field in default_fields()
                    if (field.segment == "forearm") == (forearm > 0.5)
                ]
                return np.array(min(near)[1])
        return np.zeros(5)


AWAY = PolicySpec(observations=("offset", "contacts"), rate=20.0, history=20)


def left(robot: str, capability: tci.Capability[Any], touches: int) -> tuple[int, int]:
    """How many touches a capability leaves within 1 s of the first contact, and how often the gate refused
    it."""
    gone = refused = 0
    for seed in range(touches):
        driver = tci.connect(robot, seed=seed)
        fields, body, ticks = (
            default_fields(),
            tci.GenericBody(driver.robot),
            list[tuple[float, float, int]](),
        )
        part = ("left_arm", "right_arm")[seed % 2]
        place = body.place(part, fields[seed % len(fields)].place, driver.read().joints)
        driver.world.finger.poke(place.patch, place.p_L, place.n_L)

        def see(tick: tci.Tick, world: tci.World = driver.world, ticks: list[Any] = ticks) -> None:
            ticks.append((tick.now, world.finger.force, len(tick.sent.refusals)))

        tci.run(driver, capability, duration=1.2, observe=see)
        now, force, refusals = np.array(ticks).T
        begin = now[force > 0.5][0]
        gone += bool((force[(now > begin) & (now <= begin + 1.0)] == 0.0).any())
        refused += int(refusals.sum())
    return gone, refused


@pytest.mark.parametrize("robot", ["nao", "icub", "g1"])
def test_touches_are_left_on_every_robot_and_nothing_is_refused(robot: str) -> None:
    gone, refused = left(robot, tci.PolicyCapability(Fields(), AWAY), 3)
    assert gone == 3
    assert refused == 0


def test_a_policy_that_does_nothing_leaves_no_touch() -> None:
    assert left("nao", tci.PolicyCapability(still, AWAY), 2) == (0, 0)


def orders(
    capability: tci.Capability[Any], periods: int, touch: Callable[[int], str | None] = lambda n: None
) -> list[tuple[float, float]]:
    """Time [s] and elbow angle [rad] relative to the initial one of each order of the left arm, at 50
    perceptions per second."""
    robot, found = TouchedRobot("nao"), []
    home = robot.perceive().posture["left_arm"][3]
    start, memory = robot.now, capability.init(robot.body)
    for n in range(periods):
        seen = robot.perceive(touch(n))
        given, memory = capability.step(memory, seen, robot.body)
        for order in given:
            assert isinstance(order, tci.GenericCommand)
            if order.part == "left_arm":
                found.append((round(seen.stamp - start - 0.02, 6), round(float(order.values[3] - home), 6)))
    return found


def test_it_is_asked_at_its_own_rate_sees_the_past_and_carries_out_chunks() -> None:
    seen = []

    def policy(now: np.ndarray) -> np.ndarray:
        seen.append(now.copy())
        return np.outer([0.1, 0.2], [0, 0, 0, len(seen), 0])

    number = Observation(lambda view: view.perception.stamp, scale=2.0)
    spec = PolicySpec(("time",), rate=10.0, history=3, chunk=2, action_scale=[1, 1, 1, 0.1, 1], limit=9.0)
    found = orders(tci.PolicyCapability(policy, spec, ("left_arm",), {"time": number}), 25)
    # asked at 0.0, 0.2, 0.4 s; two actions each, 0.1 s apart; that of 0.2 s is the one before
    assert found == [(0.0, 0.01), (0.1, 0.02), (0.3, 0.04), (0.4, 0.03)]
    ages = [np.ptp(one).round(6) for one in seen]
    assert ages == [0.0, 0.1, 0.1]  # halved by the scale; at first, the first counts for all
    assert (np.diff(seen[2]) > 0.0).all(), "the oldest first"


def test_its_actions_come_after_its_latency() -> None:
    spec = PolicySpec(rate=10.0, latency=0.06)
    found = orders(tci.PolicyCapability(lambda seen: [0, 0, 0, 0.5, 0], spec, ("left_arm",)), 10)
    assert found == [(0.06, 0.5)]  # a target that stays is not ordered again


def test_a_late_policy_holds_its_part_and_says_so_until_it_is_in_time_again() -> None:
    go, robot = threading.Event(), TouchedRobot("nao")
    asked = []

    def policy(seen: np.ndarray) -> np.ndarray:
        asked.append(seen)
        if len(asked) == 2:
            go.wait(20.0)
        return np.array([0, 0, 0, 0.3 + 0.1 * len(asked), 0])

    capability = tci.PolicyCapability(policy, PolicySpec(rate=50.0), parts=("left_arm",))
    memory = capability.init(robot.body)
    told, given = [], []
    for n in range(8):
        if n == 4:
            go.set()
            (job,) = capability._worker._jobs.values()
            assert job.done.wait(20.0)
        seen = robot.perceive()
        found, memory = capability.step(memory, seen, robot.body)
        told.append(capability.notes(memory))
        given.append([round(float((one.values - seen.posture["left_arm"])[3]), 6) for one in found])
    late = ("left_arm holds: policy late: no action within 20 ms",)
    assert told[0] == ()
    assert told[1:5] == [late] * 4
    assert told[-1] == ()
    assert given[:4] == [[0.4], [0.0], [], []], "it is held once, where it is"
    assert len(asked) > 2
    assert [0.5] not in given, "what it says of long ago is not carried out"
    assert [0.6] in given


def test_a_number_that_is_not_finite_holds_too() -> None:
    capability = tci.PolicyCapability(lambda seen: [np.nan] * 5)
    with tci.connect("nao") as driver:
        result = tci.run(driver, capability, duration=0.1)
    assert not result.refusals
    assert not result.moved
    assert "left_arm holds: policy gave a number that is not finite" in capability.notes(result.memory)


def test_it_gives_way_to_the_gate_where_it_pushes() -> None:
    """Refusals would otherwise come at the policy's rate."""
    push = tci.PolicyCapability(lambda seen: [0, 0, 0, 0.9 * (seen[14] > 0.01 or seen[3] > 0.05), 0])
    parts = set[str]()
    with tci.connect("g1") as driver:
        driver.world.finger.poke("left_forearm", 100)
        see = lambda tick: parts.update(one.part for one in tick.sent.met)  # noqa: E731
        result = tci.run(driver, push, duration=0.6, observe=see)
    assert result.went_back, "it pushes"
    assert parts == {"left_arm", "left_hand"}, "they move together, and each is named"
    assert sum(notice.count for notice in result.refusals) <= 1, "that of the instant"


class Ahead(tci.CapabilityWrapper[Any]):
    """Lives three times faster than the robot, as beside a simulation on a busy machine."""

    def step(self, memory: Any, perception: tci.Perception, body: tci.GenericBody) -> Any:
        return super().step(memory, replace(perception, stamp=3.0 * perception.stamp), body)


def test_the_robots_clock_says_when_it_may_go_on() -> None:
    """The gate obeys again half a second after a contact, of the robot's time."""
    push = tci.PolicyCapability(lambda seen: [0, 0, 0, 0.9 * (seen[14] > 0.01 or abs(seen[3]) > 0.05), 0])
    ordered, away = list[float](), list[float]()

    with tci.connect("g1") as driver:
        finger = driver.world.finger
        finger.poke("left_forearm", 100)

        def see(tick: tci.Tick) -> None:
            ordered.extend(tick.now for order in tick.sent.orders)
            away.extend(tick.now for one in tick.sent.met if one.answer == "retreat")
            if away and tick.now > away[0] + 0.1 and finger.pose is not None:
                finger.retire()

        result = tci.run(driver, Ahead(push), duration=1.5, observe=see)
    assert away, "it pushes"
    assert sum(notice.count for notice in result.refusals) <= 1, "that of the instant"
    assert max(ordered) > away[0] + 0.5, "it goes on"


def test_while_the_robot_is_held_it_waits_and_then_goes_on() -> None:
    """A velocity is ordered again and again, so the hold would refuse several."""
    driver, spec = FakeDriver("icub"), PolicySpec(mode="velocity", action_scale=[0.5] * 5)
    drive = tci.PolicyCapability(lambda seen: [0, 0, 0, 1, 0], spec)
    held, going = range(5, 45), list[bool]()  # periods of 2 ms; it acts in every tenth

    def guard() -> Reason | None:
        return Reason(Code.OWNER_HOLDS, "the loop missed 3 periods") if len(going) in held else None

    see = lambda tick: going.append(len(tick.commands) > 0)  # noqa: E731
    result = tci.run(driver, drive, duration=0.5, guard=guard, observe=see)
    assert not result.refusals
    assert [notice.count for notice in result.holds] == [len(held)]
    assert not any(going[n] for n in held)
    assert sum(going[45:75]) >= 2


def test_in_velocity_mode_it_drives_and_rests() -> None:
    driver = FakeDriver("icub")
    spec = PolicySpec(mode="velocity", action_scale=[0.5] * 5)
    result = tci.run(driver, tci.PolicyCapability(lambda seen: [0, 0, 0, 1, 0], spec), duration=0.5)
    assert not result.refusals
    body = tci.GenericBody(driver.robot)
    went = body.posture(driver.joints())["left_arm"][3] - body.robot.part("left_arm").initial_posture[3]
    assert 0.15 < went < 0.3


def test_it_can_be_sent_to_another_process_and_read_back() -> None:
    spec = PolicySpec(("offset",), rate=20.0, scale=[1.0] * 5)
    again = pickle.loads(pickle.dumps(tci.PolicyCapability(still, spec)))
    assert again.spec == spec == PolicySpec.from_json(spec.to_json())
    assert orders(again, 3) == []


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rate": 0.0}, "rate"), ({"rate": 5.0, "mode": "velocity"}, "at least 20"),
        ({"mode": "torque"}, "mode"), ({"history": 0}, "history"), ({"latency": -1.0}, "latency"),
        ({"action_scale": [1.0]}, "action_scale"),
        ({"scale": [0.0]}, "scale"), ({"observations": "offset"}, "a tuple"),
    ],
)  # fmt: skip
def test_what_a_policy_can_not_be_is_one_error(options: dict[str, Any], says: str) -> None:
    with pytest.raises(TciError, match=says):
        PolicySpec(**options)


@pytest.mark.parametrize(
    ("spec", "parts", "robot", "says"),
    [
        (PolicySpec(("offset",), joints=("yaw",)), (), "nao", "no arm with the joints yaw"),
        (PolicySpec(("offset",)), ("head",), "nao", "can't move head; valid: left_arm, right_arm"),
        (PolicySpec(("smell",)), (), "nao", "smell"),
        (PolicySpec(("offset",), scale=[1.0]), (), "nao", "offset 5"),
        (PolicySpec(("offset",), chunk=2), (), "nao", "2 actions of 5 joints"),
        (PolicySpec(), (), "nao-plain-h21", "no skin on an arm of this robot"),
    ],
)  # fmt: skip
def test_what_does_not_fit_a_robot_is_told(
    spec: PolicySpec, parts: tuple[str, ...], robot: str, says: str
) -> None:
    capability = tci.PolicyCapability(still, spec, parts)
    if robot != "nao":
        assert says in tci.capabilities.lacks(capability, robot)[0]
        return
    with tci.connect(robot) as driver, pytest.raises(TciError, match=says):
        tci.run(driver, capability, duration=0.1)


def test_what_is_no_policy_is_told() -> None:
    with pytest.raises(TciError, match="valid: the path of an ONNX file, or a function"):
        tci.PolicyCapability(3)  # type: ignore[arg-type]
    with pytest.raises(TciError, match=r"nowhere\.onnx"):
        tci.PolicyCapability("nowhere.onnx")
