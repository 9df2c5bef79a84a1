"""Tests `tci serve`: its output about a robot that other programs command, and its bounded memory."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable

import pytest

import tci
from helpers.desk import Desk, turn_head
from tci.capabilities.capability import lacks
from tci.cli.serve import serve
from tci.drivers import registry
from tci.drivers.simulated import SimulatedDriver
from tci.gate.safe_command import SafeCommand
from tci.lab.faults.fault_injector import FaultInjector, parse_fault
from tci.messages import MonotonicClock, Perception, Reading
from tci.reasons import MOST
from tci.runtime.arguments import load_capability

AWAY = 400
"""Number of periods without joint data. In each period the age of the data is different."""


def served(monkeypatch: pytest.MonkeyPatch, orders: Iterable[tci.GenericCommand], *, as_json: bool) -> None:
    """Serves a robot whose joint data stop. An order arrives in each period."""
    driver = FaultInjector(
        SimulatedDriver(tci.load_robot("nao")), [parse_fault(f"dropped-frames@0.1:{AWAY * 0.002}")]
    )
    plan = dict(enumerate([one] for one in orders))
    monkeypatch.setattr(registry, "connect", lambda *_, **__: driver)
    monkeypatch.setattr(registry, "open_server", lambda driver, via: Desk(driver, plan))
    serve("nao", via="desk", source="sim", arm=True, duration=0.2 + AWAY * 0.002, as_json=as_json)


def test_a_robot_that_is_away_is_told_of_once_and_refusals_are_counted_by_their_kind(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served(monkeypatch, [turn_head(0.1)] * 600, as_json=False)
    lines = [line for line in capsys.readouterr().out.splitlines() if " s  " in line]
    assert sum("HOLD" in line for line in lines) == 1
    assert len(lines) < 10
    served(monkeypatch, [turn_head(0.1)] * 600, as_json=True)
    told = json.loads(capsys.readouterr().out)
    old = [reason for reason in told["refusals"] if "ms old" in reason]
    assert len(old) == 1
    assert told["refusals"][old[0]] > AWAY / 2
    assert len(told["refusals"]) < 5


def test_who_serves_is_told_what_a_part_met(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only clients were, and who could type `free` did not know that there was somebody to free."""
    driver = FaultInjector(SimulatedDriver(tci.load_robot("nao")), [parse_fault("stall@0.2")])
    monkeypatch.setattr(registry, "connect", lambda *_, **__: driver)
    monkeypatch.setattr(registry, "open_server", lambda driver, via: Desk(driver, {50: [turn_head(0.8)]}))
    serve("nao", via="desk", source="sim", duration=1.0)
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("CONTACT: head met something: HeadPitch is held") == 1


def test_a_server_that_is_ended_by_sigterm_reports_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def serve_robot(*_: object, **__: object) -> None:
        raise SystemExit(143)

    monkeypatch.setattr("tci.runtime.serve.serve", serve_robot)
    with pytest.raises(SystemExit) as end:
        served(monkeypatch, [], as_json=True)
    assert end.value.code == 143
    assert json.loads(capsys.readouterr().out)["robot"] == "nao"


def test_of_many_kinds_of_refusals_most_are_counted_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def strange(number: int) -> tci.GenericCommand:
        name = "".join(chr(ord("a") + int(digit)) for digit in str(number))
        return tci.GenericCommand(f"tail_{name}", tci.Mode.POSITION, turn_head(0.1).values)

    served(monkeypatch, map(strange, range(500)), as_json=True)
    refusals = json.loads(capsys.readouterr().out)["refusals"]
    assert sum(refusals.values()) == 500
    assert len(refusals) == MOST + 1
    assert refusals["other reasons"] >= 500 - MOST - 1


def test_a_served_robot_is_touched_again_and_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In simulated time: nobody waits for the clock here."""
    driver = SimulatedDriver(tci.load_robot("nao"), people=1)
    onsets: set[float] = set()

    class Felt(Desk):
        def publish(self, reading: Reading, perception: Perception, sent: SafeCommand) -> None:
            super().publish(reading, perception, sent)
            onsets.update(contact.onset for contact in perception.contacts)

    monkeypatch.setattr(registry, "connect", lambda *_, **__: driver)
    monkeypatch.setattr(registry, "open_server", lambda driver, via: Felt(driver, {}))
    serve("nao", via="desk", touch=["press 'left forearm' 3N 0.3s"], duration=4.0, as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told["touches"][0]["kind"] == "press"
    assert told["missed_touches"] == []
    assert len(onsets) == 2


def test_a_served_simulation_says_that_it_is_late_and_how_to_reach_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A machine that needs five seconds for one of the simulation."""
    driver = SimulatedDriver(tci.load_robot("nao"), paced=True, people=1)

    class Slow(MonotonicClock):
        def now(self) -> float:
            return 5.0 * driver.world.time

        def sleep_until(self, stamp: float) -> None:
            pass

    monkeypatch.setattr(driver.clock, "_pace", Slow())
    monkeypatch.setattr(driver.clock, "_ahead", 0.0)
    monkeypatch.setattr(registry, "connect", lambda *_, **__: driver)
    monkeypatch.setattr(registry, "open_server", lambda driver, via: Desk(driver, {}))
    serve("nao", via="desk", duration=3.0)
    said = " ".join(capsys.readouterr().out.split())
    assert "tci run withdrawal nao --via 'a desk' --arm" in said
    assert 2 <= said.count("the simulation is late") <= 3
    assert said.count("0.20 of real time") >= said.count("the simulation is late")
    assert "it ran at 0.2" in said


def test_what_it_proposes_fits_the_robot(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A NAO as it is sold has no skin on its arms, so the reflex does nothing there."""
    monkeypatch.setattr(registry, "open_server", lambda driver, via: Desk(driver, {}))
    serve("nao-plain", via="desk", duration=0.02)
    (proposed,) = re.findall(r"tci run (\S+) nao-plain", capsys.readouterr().out)
    assert not lacks(load_capability(proposed), tci.load_robot("nao-plain"))
