"""A robot in a separate thread: pokes, orders, faults, pauses, recordings and a restart."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tci
from tci.body.places import find_place
from tci.drivers.replay import ReplayDriver
from tci.errors import CommandError
from tci.gate.gate import GateState
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.session import Session
from tci.reasons import Code, Reason
from tci.runtime.moment import Tick
from tci.skin.skin import Skin

PATIENCE = 60.0


def wait_for(what: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def session() -> Iterator[Session]:
    driver = tci.connect(tci.load_robot("nao"), "sim", step=0.002, people=1, self_touch=False)
    session = Session(driver, tci.WithdrawalReflex(), about={"middleware": "sim", "capability": "withdrawal"})
    session.start()
    wait_for(lambda: session.view)
    yield session
    session.close()


def poke(session: Session) -> None:
    view = session.view
    assert view is not None
    site = tci.WithdrawalReflex().fields[0]
    place = find_place(Skin(session.robot), "left_arm", site.segment, site.u, site.theta, view.joints)
    session.poke(place, force=5.0, speed=0.25)


def words(session: Session) -> str:
    return " | ".join(said for _, said in list(session.events))


def test_a_poke_is_felt_answered_and_ends(session: Session) -> None:
    poke(session)
    wait_for(lambda: session.view.finger is not None)
    wait_for(lambda: "touched: left forearm" in words(session))
    wait_for(lambda: "left arm goes to" in words(session))
    wait_for(lambda: session.view.finger is None)
    time_, force, response, angles = session.history.series("left_arm")
    assert force.max() > 0.1
    assert response.max() > 0.1
    assert np.ptp(angles, axis=1).max() > np.deg2rad(3.0)
    assert np.all(np.diff(time_) > 0.0)


def test_which_layer_holds_a_part_is_told_once() -> None:
    layers = tci.Arbiter([tci.WithdrawalReflex(), tci.BodyWithdrawal()])
    session = Session(tci.connect("nao", step=0.002), layers, about={})
    session.start()
    try:
        wait_for(lambda: session.view)
        poke(session)
        wait_for(lambda: "WithdrawalReflex holds left_arm" in words(session))
        wait_for(lambda: session.view.finger is None)
        assert words(session).count("holds left_arm") == 1
    finally:
        session.close()


def test_another_capability_runs_also_in_another_control_mode(session: Session) -> None:
    session.run("teach", tci.Teach())
    wait_for(lambda: "runs teach" in words(session) and session.memory is not None)
    session.run("withdrawal", tci.WithdrawalReflex(), home=True)
    wait_for(lambda: "runs withdrawal" in words(session) and session.fields)
    session.people_do(["poke 'left forearm' 10N @0.5s"])
    wait_for(lambda: "left arm goes to" in words(session) or session.ended)
    assert session.ended == ""
    assert "refused" not in words(session)
    assert session.runs == "withdrawal"


def test_a_poke_without_room_is_told(session: Session) -> None:
    place = find_place(Skin(session.robot), "left_arm", "forearm", 0.5, 0.0, session.view.joints)
    inward = type(place)(place.patch, place.p_L, -place.n_L)
    session.poke(inward, force=5.0, speed=0.25)
    wait_for(lambda: "no room for the finger" in words(session))


def test_orders_of_a_person_pass_the_gate(session: Session) -> None:
    target = session.view.posture["left_arm"] + np.array([0.0, 3.0, 0.0, 0.0, 0.0])
    session.move("left_arm", target)
    upper = session.robot.servos[session.robot.part("left_arm").servos[1].servo].limits.upper
    wait_for(lambda: session.view.posture["left_arm"][1] > np.deg2rad(60.0))
    assert upper is not None
    assert session.driver.gate.counts.clamps
    session.home()
    wait_for(lambda: abs(session.view.posture["left_arm"][1] - np.deg2rad(25.0)) < 0.02)


def test_a_pause_stops_time_and_pokes_still_arrive(session: Session) -> None:
    session.pace = 0.0
    world = session.world
    assert world is not None
    before = -1.0
    while world.time != before:
        before = world.time
        time.sleep(0.2)
    poke(session)
    wait_for(lambda: session.pokes == 1)
    assert world.time == before
    session.pace = 0.5
    wait_for(lambda: world.time > before)


def test_a_fault_ends_the_loop_and_a_reset_begins_it_again(session: Session) -> None:
    session.inject("link-lost", lasts=0.2)
    wait_for(lambda: "DriverError" in session.ended)
    world = session.world
    assert world is not None
    over = world.time + 0.3
    wait_for(lambda: world.time > over)  # time continues until the fault ends
    session.reset()
    wait_for(lambda: not session.ended)
    before = session.report.ticks
    wait_for(lambda: session.report.ticks > before + 10)
    assert session.view is not None
    assert session.view.state is GateState.RUN


def test_what_is_ordered_while_the_loop_has_ended_is_forgotten(session: Session) -> None:
    session.inject("link-lost", lasts=0.2)
    wait_for(lambda: "DriverError" in session.ended)
    view, world = session.view, session.world
    assert view is not None
    assert world is not None
    session.move("left_arm", view.posture["left_arm"] + np.array([0.0, 0.5, 0.0, 0.0, 0.0]))
    over = world.time + 0.3
    wait_for(lambda: world.time > over)
    session.reset()
    wait_for(lambda: not session.ended)
    before = session.report.ticks
    wait_for(lambda: session.report.ticks > before + 50)
    assert "goes to" not in words(session)
    assert session.view is not None
    assert session.view.posture["left_arm"] == pytest.approx(view.posture["left_arm"], abs=0.02)


def test_what_was_recorded_is_replayed_bit_for_bit(session: Session, tmp_path: Path) -> None:
    session.record(tmp_path / "poke.mcap")
    poke(session)
    wait_for(lambda: "left arm goes to" in words(session))
    recorder = session.stop_recording()
    assert recorder is not None
    assert not recorder.failed
    assert recorder.ticks > 10
    with ReplayDriver(session.robot, str(tmp_path / "poke.mcap")) as driver:
        assert driver.recording.about["recorded_by"] == "tci view"
        assert sum(1 for _ in driver.ticks()) == recorder.ticks


def test_a_robot_that_is_not_armed_is_only_shown() -> None:
    driver = tci.connect(tci.load_robot("nao"), "sim", arm=False)
    session = Session(driver, tci.WithdrawalReflex(), about={})
    session.start()
    wait_for(lambda: session.view)
    assert session.view is not None
    assert session.view.state is None
    session.close()


def test_one_that_is_only_shown_begins_again(tmp_path: Path) -> None:
    driver = tci.connect(tci.load_robot("nao"), "sim", arm=False)
    viewer = Viewer([Session(driver, tci.WithdrawalReflex(), about={})], port=0, folder=tmp_path)
    (session,) = viewer.sessions.values()
    assert viewer.controls["nao"].buttons.options == ("Reset",)
    assert not viewer.controls["nao"].buttons.disabled
    session.start()
    wait_for(lambda: session.view)
    session.inject("wrong-taxel-count", lasts=0.1)
    wait_for(lambda: "FrameError" in session.ended)
    world = session.world
    assert world is not None
    over = world.time + 0.3
    wait_for(lambda: world.time > over)  # the fault ends
    session.reset()
    wait_for(lambda: session.view and session.view.time > over)
    viewer.close()


def test_a_finger_needs_a_simulation() -> None:
    driver = tci.connect(tci.load_robot("nao"), "sim")
    session = Session(driver, tci.WithdrawalReflex(), about={})
    session.world = None
    place = find_place(Skin(session.robot), "left_arm", "forearm", 0.5, 0.0, driver.read().joints)
    with pytest.raises(CommandError, match="not simulated"):
        session.poke(place, force=1.0, speed=0.1)
    session.close()


def test_the_page_says_that_a_part_met_something() -> None:
    ticks = list[Tick]()
    with tci.connect("nao", "sim") as driver:
        tci.run(driver, tci.WithdrawalReflex(), duration=0.01, observe=ticks.append)
        session = Session(driver, tci.WithdrawalReflex(), about={})
        met = Reason(Code.CONTACT, "left_arm met something: 40 N on its skin; it goes back")
        session._see(replace(ticks[-1], sent=replace(ticks[-1].sent, clamped=(met,))))
        assert f"{met}; see what is in its way" in words(session)
        session.close()


def test_what_an_operator_asks_for_is_not_told_as_done_if_it_is_refused(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> None:
        raise CommandError("still in contact: left_arm")

    monkeypatch.setattr(session.driver.gate, "reset", refuse)
    session.reset()
    session.free()
    wait_for(lambda: "free is refused: nothing is in contact" in words(session))
    assert "reset is refused: still in contact: left_arm" in words(session)
    assert "by the operator" not in words(session)
    session.inject("link-lost", lasts=0.2)
    wait_for(lambda: "DriverError" in session.ended)
    session.reset()
    assert session.ended
    assert words(session).count("reset is refused") == 2
