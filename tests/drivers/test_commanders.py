"""The processes that command a served robot, with a manual clock."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.drivers.remote.commanders import LEASE, Commanders
from tci.drivers.remote.protocol import MOST_COMMANDERS, Orders
from tci.gate.gate import Gate, SafeCommand
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.clock import ManualClock
from tci.reasons import Code, Reason
from tci.robot.joint_map import initial_position

SESSION, SILENCE = 7, 0.08


class Robot:
    """A NAO with its gate, and the messages of two processes that command the NAO."""

    def __init__(self, silence: float = SILENCE) -> None:
        self.robot = tci.load_robot("nao")
        self.clock = ManualClock(100.0)
        self.commanders = Commanders(self.robot, SESSION, silence, self.clock.now)
        self.gate = Gate(self.robot, period=0.002, stale_after=1.0)
        self.readings = 0
        self.numbers: dict[int, int] = {}

    def say(self, client: int, *orders: PlatformOrder, first: int = 1, **changes: object) -> None:
        self.numbers[client] = self.numbers.get(client, 0) + 1
        message: dict[str, object] = {
            "session": SESSION, "seen": self.clock.now(), "client": client, "name": f"behaviour {client}",
            "sequence": self.numbers[client], "halt": None, "leaving": False, "first": first,
            "orders": orders,
        }  # fmt: skip
        self.commanders.receive(Orders(**{**message, **changes}))

    def tick(self, speed: float = 0.0) -> SafeCommand:
        """One period, in which joint 2 measures `speed` [rad/s]."""
        if fault := self.commanders.fault():
            self.gate.hold(fault)
        count = len(self.robot.servos)
        self.readings += 1
        velocity = np.zeros(count)
        velocity[2] = speed
        joints = JointReading(
            self.clock.now(), self.readings, np.array(initial_position(self.robot)), velocity
        )
        sent = self.gate.step(self.commanders.take(), joints, self.clock.now())
        self.commanders.decided(sent)
        return sent


@pytest.fixture
def robot() -> Robot:
    return Robot()


def aim(*servos: int, value: float = 0.1) -> PlatformCommand:
    many = len(servos)
    return PlatformCommand(
        Mode.POSITION, np.array(servos, np.intp), np.full(many, value), np.full(many, np.inf)
    )


def test_each_order_counts_once_however_often_it_is_repeated(robot: Robot) -> None:
    first, second = aim(2), aim(3)
    robot.say(1, first)
    assert robot.tick().orders == (first,)
    robot.say(1, first, second)
    assert robot.tick().orders == (second,)
    robot.say(1)
    assert robot.tick().orders == ()
    assert robot.commanders.states()[0].acknowledged == 2


@pytest.mark.parametrize(
    "changes",
    [
        {"seen": 99.9},  # delayed, or recorded
        {"seen": 100.5},
        {"seen": float("nan")},
        {"session": 6},
        {"sequence": 0},
    ],
)
def test_34_what_is_late_repeated_or_of_another_session_moves_nothing(
    robot: Robot, changes: dict[str, object]
) -> None:
    robot.say(1)
    robot.say(1, aim(2), **changes)
    assert robot.tick().orders == ()
    assert robot.commanders.rejected == 1


def test_34_what_is_played_again_right_after_its_sender_left_moves_nothing(robot: Robot) -> None:
    robot.say(1, aim(2))
    robot.tick()
    begun = robot.clock.now()
    robot.clock.advance(0.01)
    robot.say(1, leaving=True)
    robot.tick()
    robot.say(1, aim(2), seen=begun)
    assert robot.tick().orders == ()
    assert robot.commanders.rejected == 1
    robot.clock.advance(0.01)
    robot.say(1, aim(2))  # a controller that has restarted
    assert len(robot.tick().orders) == 1


def test_26_a_joint_has_one_commander_and_the_second_is_told_who_it_is(robot: Robot) -> None:
    robot.say(1, aim(2, 3))
    robot.say(2, aim(3), aim(5))
    assert [order.servos.tolist() for order in robot.tick().orders] == [[2, 3], [5]]
    first, second = robot.commanders.states()
    assert (first.refused, second.refused) == (0, 1)
    assert "commanded by behaviour 1" in str(second.reason)
    assert robot.robot.servos[3].name in str(second.reason)


def test_28_43_a_commander_that_falls_silent_means_hold_and_later_its_joints_are_free(robot: Robot) -> None:
    robot.say(1, aim(2))
    assert not robot.tick().reason
    robot.clock.advance(SILENCE + 0.001)
    assert "no message from behaviour 1" in str(robot.tick().reason)
    robot.say(2, aim(2))
    robot.tick()
    assert robot.commanders.states()[1].refused == 1
    robot.clock.advance(LEASE)
    robot.tick()
    robot.say(2, aim(2, value=0.2), first=2)
    assert [order.servos.tolist() for order in robot.tick().orders] == [[2]]


def test_43_silence_means_hold_also_where_it_may_be_long() -> None:
    robot = Robot(silence=3.0)
    robot.say(1, aim(2))
    robot.tick()
    robot.clock.advance(2.9)
    assert not robot.tick().reason
    assert [member.client for member in robot.commanders.states()] == [1]
    robot.clock.advance(0.2)
    assert "no message from behaviour 1" in str(robot.tick().reason)
    robot.clock.advance(LEASE)
    robot.tick()
    assert not robot.commanders.states()


def test_a_commander_that_comes_back_ends_the_hold(robot: Robot) -> None:
    robot.say(1, aim(2))
    robot.tick()
    robot.clock.advance(SILENCE + 0.001)
    assert robot.tick().reason
    robot.say(1)
    assert not robot.tick().reason


def test_one_who_commands_nothing_may_leave_unnoticed(robot: Robot) -> None:
    robot.say(1)
    robot.clock.advance(SILENCE + 0.001)
    assert not robot.tick().reason
    robot.say(2, leaving=True)
    assert not robot.tick().reason


def test_one_who_leaves_stops_what_moves_and_frees_the_joints(robot: Robot) -> None:
    robot.say(1, aim(2))
    robot.tick()
    robot.say(1, leaving=True)
    assert "has disconnected" in str(robot.tick().reason)
    robot.say(2, aim(2))
    assert len(robot.tick().orders) == 1


def test_while_a_commanders_own_gate_holds_the_robot_holds(robot: Robot) -> None:
    robot.say(1, aim(2))
    robot.tick()
    robot.say(1, halt=Reason(Code.PERIODS_MISSED, "its loop missed 9 periods"))
    assert "missed 9" in str(robot.tick().reason)
    robot.say(1)
    assert not robot.tick().reason


def test_orders_that_a_commanders_hold_overtakes_are_gone_and_not_refused(robot: Robot) -> None:
    """It has dropped them itself: refused, they would make its gate hold once more."""
    robot.say(1, aim(2))
    robot.say(2, aim(4))
    robot.tick()
    robot.say(1, aim(2, value=0.2), first=2)
    robot.say(2, aim(4, value=0.2), first=2)
    robot.say(1, first=3, halt=Reason(Code.PERIODS_MISSED, "its loop missed 3 periods"))
    sent = robot.tick()
    assert "missed 3" in str(sent.reason)
    assert [order.servos.tolist() for order, _ in sent.refused] == [[4]], "the other's order is"
    robot.say(1, first=3)
    robot.say(1, aim(2, value=0.2), first=3)
    assert [order.servos.tolist() for order in robot.tick().orders] == [[2]]
    assert [one.refused for one in robot.commanders.states()] == [0, 2]


def test_what_the_gate_refuses_is_told_to_its_sender_alone(robot: Robot) -> None:
    robot.say(1, aim(2), aim(3, value=float("nan")), aim(4))
    robot.say(2, PlatformSwitch(np.array([999]), Mode.TORQUE), aim(6))
    assert [order.servos.tolist() for order in robot.tick().orders] == [[2], [4], [6]]
    first, second = robot.commanders.states()
    assert (first.refused, second.refused) == (2, 1)
    assert "nan" in str(first.reason)
    assert "999" in str(second.reason)


def test_what_the_gate_refuses_late_is_told_to_the_commander_of_the_joint(robot: Robot) -> None:
    """The refusal of a switch that waited for rest comes before those of new orders."""
    robot.say(1, PlatformSwitch(np.array([2]), Mode.VELOCITY))
    assert robot.tick(speed=0.5).clamped[0].code is Code.SWITCHES_AT_REST
    for _ in range(60):
        robot.clock.advance(0.01)
        robot.say(1)
        robot.say(2, *[aim(3, value=float("nan"))] * robot.readings)
        robot.tick(speed=0.5)
        first, second = robot.commanders.states()
        assert "nan" in str(second.reason)
        assert second.refused == robot.readings - 1
    assert first.reason is not None
    assert (first.refused, first.reason.code) == (1, Code.IN_MOTION)


def test_33_a_crowd_is_bounded(robot: Robot) -> None:
    for client in range(1, 100):
        robot.say(client, aim(2))
    robot.tick()
    assert len(robot.commanders.states()) == MOST_COMMANDERS


def test_an_order_that_was_on_its_way_while_its_part_met_something_is_no_refusal_of_the_gate(
    robot: Robot,
) -> None:
    """Its sender is told, and one that saw the contact is refused by the gate."""
    seen = robot.clock.now()
    robot.clock.advance(0.005)
    sent = robot.tick()
    robot.commanders.decided(sent, {2})
    robot.say(1, aim(2), seen=seen)
    robot.say(2, aim(6), seen=seen)
    assert [order.servos.tolist() for order in robot.tick().orders] == [[6]]
    (first, second), told = robot.commanders.states(), robot.commanders.overtaken
    assert (first.refused, second.refused, told) == (1, 0, 1)
    assert first.reason is not None
    assert first.reason.code is Code.OVERTAKEN
    robot.commanders.decided(sent, {2})
    robot.clock.advance(0.005)
    robot.say(1, aim(2), first=2)
    assert [order.servos.tolist() for order in robot.tick().orders] == [[2]], "it is for the gate to say"
