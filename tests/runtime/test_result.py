"""The report of a run: the result object, and the log."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import tci
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import GateState
from tci.gate.settings import over_a_wire
from tci.reasons import MOST, OTHERS, Code, Notice, Reason, ReasonCounter
from tci.runtime.loop_report import LoopReport


class Ask(tci.Capability[int]):
    """A capability that sends fixed commands in each period."""

    def __init__(self, command: Callable[[int], tci.GenericCommand]) -> None:
        self.command = command

    def init(self, body: tci.GenericBody) -> int:
        return 0

    def step(
        self, memory: int, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[tci.GenericCommand, ...], int]:
        return (self.command(memory),), memory + 1


def head(*values: float, mode: tci.Mode = tci.Mode.POSITION) -> tci.GenericCommand:
    return tci.GenericCommand("head", mode, np.array(values))


def warnings(log: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in log.records if record.name == "tci.run"]


def test_a_run_tells_in_one_line_what_was_touched_and_what_moved() -> None:
    with tci.connect(tci.load_robot("nao"), "sim") as driver:
        assert isinstance(driver, SimulatedDriver)
        driver.world.finger.poke("left_forearm", 150)
        result = tci.run(driver, tci.WithdrawalReflex(), duration=0.4)
        assert result
        assert result.touched["left_forearm"] == pytest.approx(driver.world.finger.peak_force, rel=0.5)
    assert [*result.touched] == ["left_forearm"]
    assert "left_arm" in result.memory
    ways = [*result.moved.values()]
    assert ways == sorted(ways, reverse=True)
    assert next(iter(result.moved)) in ("LElbowRoll", "LShoulderRoll", "LShoulderPitch", "LElbowYaw")
    assert ways[0] > np.deg2rad(5.0)
    assert not any(name.startswith("R") for name in result.moved)
    text = str(result)
    assert text.startswith("nao: touched left_forearm (")
    assert f"{next(iter(result.moved))} {np.rad2deg(ways[0]):.0f}" in text
    assert text.count("\n") == 0
    assert result.accepted > 0
    assert (result.refusals, result.clamps, result.holds) == ((), (), ())


def test_nothing_that_happened_is_said_too() -> None:
    with tci.connect(tci.load_robot("nao"), "sim") as driver:
        assert (
            str(tci.run(driver, tci.WithdrawalReflex(), duration=0.01))
            == "nao: touched nowhere; nothing moved"
        )


def test_over_a_wire_it_says_for_how_long_joint_torques_told_who_was_met() -> None:
    def swing(count: int) -> tci.GenericCommand:
        return head(0.5 if count % 400 < 200 else -0.5, 0.0, 0.0)

    driver = SimulatedDriver("nao")
    driver.gate.set_contact(over_a_wire(softens=False).contact)
    driver.info = replace(driver.info, lease_name="yarp:nao")
    with driver:
        first = tci.run(driver, Ask(swing), duration=2.0)
        assert first.by_torques is not None
        assert 0.1 < first.by_torques < 0.9
        assert f"torques told who was met for {first.by_torques:.0%} of the run" in str(first)
        later = tci.run(driver, Ask(swing), duration=1.0)
        assert later.by_torques == 1.0
        assert "torques" not in str(later)


def test_refusals_are_counted_by_kind_and_the_first_is_logged(
    driver: SimulatedDriver, caplog: pytest.LogCaptureFixture
) -> None:
    begin = driver.clock.now()
    odd = head(np.nan, 0.0, 0.0), head(0.0, 0.0), head(0.1, 0.0, 0.0, mode=tci.Mode.VELOCITY)
    result = tci.run(driver, Ask(lambda count: odd[count % 3]), duration=0.06)
    assert [notice.count for notice in result.refusals] == [10, 10, 10]
    for index, words in enumerate(("pitch = nan", "values of shape (2,)", "HeadPitch is in position mode")):
        assert words in result.refusals[index].words
        assert result.refusals[index].time == pytest.approx(begin + index * driver.period)
        assert words in warnings(caplog)[index]
        assert words in str(result)
    assert len(warnings(caplog)) == 3
    assert {record.levelno for record in caplog.records} == {logging.WARNING}
    assert not result, "every command was refused"
    assert result.refused_all
    assert result.state is GateState.RUN


def test_what_is_refused_among_what_is_not_leaves_the_result_true(driver: SimulatedDriver) -> None:
    result = tci.run(driver, Ask(lambda count: head(np.nan if count else 0.1, 0.0, 0.0)), duration=0.02)
    assert result
    assert (result.accepted, result.refusals[0].count) == (1, 9)


def test_the_first_orders_of_a_run_do_not_count_as_accepted(driver: SimulatedDriver) -> None:
    class Begins(Ask):
        def begin(self, perception: tci.Perception, body: tci.GenericBody) -> tuple[tci.GenericCommand, ...]:
            return (self.command(0),)

    result = tci.run(driver, Begins(lambda _: head(0.1, 0.0, 0.0)), duration=0.02)
    assert (result.report.ticks, result.accepted) == (10, 9)


def test_clamps_are_counted_and_the_first_is_logged(
    driver: SimulatedDriver, caplog: pytest.LogCaptureFixture
) -> None:
    result = tci.run(driver, Ask(lambda count: head(1.5 + 0.01 * (count % 7), 0.0, 0.0)), duration=0.1)
    (clamp,) = result.clamps
    assert clamp.count == 50
    assert "HeadPitch: 1.50 rad (85.94 degrees) asked, clamped to" in clamp.words
    (said,) = warnings(caplog)
    assert clamp.words in said
    assert f"clamped 50 x, first at {clamp.time:.3f} s: {clamp.words}" in str(result)
    assert result


def test_a_run_that_ends_stopped_is_false_and_says_why(
    driver: SimulatedDriver, caplog: pytest.LogCaptureFixture
) -> None:
    driver.gate.stop("somebody pressed the button")
    result = tci.run(driver, Ask(lambda count: head(0.1, 0.0, 0.0)), duration=0.1)
    assert not result
    assert (result.state, str(result.reason)) == (GateState.STOP, "somebody pressed the button")
    assert result.ended == "done"
    assert result.memory == 50
    stops = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert len(stops) == 1
    assert "somebody pressed the button" in stops[0].getMessage()
    assert str(result).endswith("STOP at the end: somebody pressed the button")


def test_a_stop_after_the_last_period_is_said_too(
    driver: SimulatedDriver, caplog: pytest.LogCaptureFixture
) -> None:
    """The robot is brought to rest at the end of the run. Errors during this time are reported too."""
    periods = iter(range(50))

    def until(memory: int) -> bool:
        if next(periods) == 49:
            driver.gate.stop("too late")
            return True
        return False

    result = tci.run(driver, Ask(lambda count: head(0.4, 0.0, 0.0)), duration=1.0, until=until)
    assert (result.state, result.reason) == (GateState.STOP, Reason(Code.OTHER, "too late"))
    assert not result
    assert "too late" in warnings(caplog)[-1]


def test_a_hold_is_counted_by_its_periods(driver: SimulatedDriver, caplog: pytest.LogCaptureFixture) -> None:
    reasons = iter([Reason(Code.HEARTBEAT_MISSING, "no heartbeat of viewer")] * 20 + [None] * 30)
    quiet = Ask(lambda count: head(0.1, 0.0, 0.0))
    result = tci.run(driver, quiet, duration=0.1, guard=lambda: next(reasons))
    (hold,) = result.holds
    assert (hold.words, hold.count, hold.code) == ("no heartbeat of viewer", 20, Code.HEARTBEAT_MISSING)
    assert result.refusals[0].count == 20
    assert len([words for words in warnings(caplog) if "held" in words]) == 1
    assert result


def test_a_result_in_plain_values_is_json(driver: SimulatedDriver) -> None:
    plain = tci.run(driver, Ask(lambda count: head(np.nan, 0.0, 0.0)), duration=0.02).to_json()
    assert json.loads(json.dumps(plain)) == plain
    assert (plain["robot"], plain["ok"], plain["accepted"]) == ("nao", False, 0)
    assert plain["refusals"][0]["code"] == "COMMAND_INVALID"
    assert plain["refusals"][0]["count"] == plain["loop"]["ticks"] == 10


def test_further_kinds_than_anybody_reads_are_counted_together() -> None:
    reasons = ReasonCounter()
    assert all(
        reasons.add(Reason(Code.UNKNOWN_NAME, f"no part named part{number}"), 0.5 * number)
        for number in range(MOST)
    )
    assert not reasons.add(Reason.of("one more"), 70.0)
    assert not reasons.add(Reason.of("and another"), 80.0)
    last = reasons.notices()[-1]
    assert (last.words, last.time, last.count) == (OTHERS, 70.0, 2)
    assert len(reasons.notices()) == MOST + 1


def test_more_than_anybody_reads_is_only_counted() -> None:
    notices = tuple(Notice(f"no part named {name}", 0.1, 2) for name in "abcdefgh")
    moved = {f"joint_{name}": 0.5 for name in "abcdefgh"}
    result = tci.RunResult(
        memory=None, report=LoopReport(ended="done"), robot="nao", state=GateState.HOLD,
        reason=Reason.of("no data"),
        touched={"left_forearm": 1.25, "head": 1.0}, moved=moved, accepted=1, refusals=notices, clamps=(),
        holds=notices[:1],
    )  # fmt: skip
    first, *others = str(result).splitlines()
    assert first == (
        "nao: touched left_forearm (1.2 N), head (1.0 N); moved joint_a 29, joint_b 29, joint_c 29, "
        "joint_d 29, joint_e 29, joint_f 29 degrees and 2 more"
    )
    assert others[0] == "refused 2 x, first at 0.100 s: no part named a"
    assert others[5:] == [
        "refused 2 x, first at 0.100 s: no part named f",
        "refused 4 x for 2 further reasons",
        "held 2 x, first at 0.100 s: no part named a",
        "HOLD at the end: no data",
    ]
    assert result, "a robot that holds is not stopped"
