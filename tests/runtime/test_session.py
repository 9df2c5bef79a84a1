"""A session of `tci run` with a driver that only reads perceives touches, and sends nothing."""

from __future__ import annotations

import tci
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import GateState
from tci.runtime.run_log import Event
from tci.runtime.session import Session


def test_a_robot_that_is_only_read_shows_touches_and_does_not_move() -> None:
    events: list[Event] = []
    with SimulatedDriver(tci.load_robot("nao"), arm=False) as driver:
        driver.world.finger.poke("left_forearm", 150)
        session = Session(driver, tci.WithdrawalReflex(), listen=events.append)
        session.run(0.5)
        assert driver.gate.state is GateState.HOLD
    assert session.error is None
    assert session.result is not None
    assert "left_forearm" in session.result.touched
    assert not session.result.moved
    assert not session.failed
    assert any("read-only" in event.words for event in events)
