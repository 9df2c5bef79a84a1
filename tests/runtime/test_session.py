"""A session of `tci run` with a driver that only reads perceives touches, and sends nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import tci
from tci.cli.run_log import Event
from tci.cli.session import Session
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import GateState


@pytest.mark.parametrize(
    "reflex", [tci.WithdrawalReflex(), tci.SoftReaction(), tci.WithdrawalReflex(mode="velocity")]
)
def test_a_robot_that_is_only_read_shows_touches_and_does_not_move(
    reflex: tci.Capability[Any], tmp_path: Path
) -> None:
    events: list[Event] = []
    robot, file = tci.load_robot("nao"), tmp_path / "read.mcap"
    with SimulatedDriver(robot, arm=False) as driver, tci.Recorder(file, robot) as recorder:
        driver.world.finger.poke("left_forearm", 150)
        session = Session(driver, reflex, listen=events.append, recorder=recorder)
        session.run(0.5)
        assert driver.gate.state is GateState.HOLD
    assert session.error is None
    assert session.result is not None
    assert "left_forearm" in session.result.touched
    assert not session.result.moved
    assert not session.failed
    assert any("read-only" in event.words for event in events)
    assert not any("at rest" in event.kind for event in events)
    ticks = list(tci.Recording(file).ticks())
    assert ticks
    assert all(tick.decision is None for tick in ticks)
