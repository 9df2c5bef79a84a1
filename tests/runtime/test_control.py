"""`Control`: one period cut in two, its watchdogs and its end."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.body import GenericBody
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, DriverError, FrameError
from tci.gate.gate import GateState
from tci.gate.safe_command import SafeCommand
from tci.messages import GenericCommand, Mode, PlatformCommand
from tci.reasons import Code, Reason
from tci.runtime.control import Control
from tci.runtime.moment import Moment
from tci.testing import FakeDriver


def nod(driver: SimulatedDriver) -> PlatformCommand:
    return driver.native("Head").command({"HeadPitch": 0.3})


def sent_by(driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch) -> list[SafeCommand]:
    """Everything that the driver sends from now on."""
    sent: list[SafeCommand] = []
    send = driver._send

    def noted(safe: SafeCommand) -> None:
        sent.append(safe)
        send(safe)

    monkeypatch.setattr(driver, "_send", noted)
    return sent


def test_without_a_body_orders_are_in_the_robots_own_joints(driver: SimulatedDriver) -> None:
    with Control(driver) as control:
        moment = control.observe()
        assert moment is not None
        assert moment.perception is None
        order = nod(driver)
        assert control.act([order]).orders == (order,)
        control.observe()
        (refusal,) = control.act([GenericCommand("head", Mode.POSITION, np.zeros(2))]).refusals
        assert "not in the robot's own joints" in str(refusal)
        for _ in control.periods(duration=1.0):
            control.act()
        positions = driver.native("Head").positions(driver.read().joints)
        assert positions["HeadPitch"] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("fails", [False, True])
def test_the_end_brings_the_robot_to_rest(driver: SimulatedDriver, fails: bool) -> None:
    def loop() -> None:
        with Control(driver) as control:
            for moment in control.periods(duration=0.1):
                sent = control.act([nod(driver)] if moment.now == 0.0 else [])
            assert sent.velocity.any()
            if fails:
                raise ZeroDivisionError("in a loop")

    if not fails:
        loop()
        assert driver.gate.state is GateState.RUN
    else:
        with pytest.raises(ZeroDivisionError):
            loop()
        assert driver.gate.reason == Reason(Code.PROGRAM_FAILED, "ZeroDivisionError: in a loop")
    assert not driver.gate.step((), driver.read().joints, driver.clock.now()).velocity.any()
    driver.write(driver.gate.step((), driver.read().joints, driver.clock.now() + driver.period))  # it let go


def test_after_the_robots_own_stop_nothing_is_sent(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Control(driver) as control:
        control.observe()
        control.act([nod(driver)])
        for _ in range(20):
            control.observe()
            control.act()
        sent = sent_by(driver, monkeypatch)
        control.halt()
    assert sent == []


def test_the_last_watchdog_with_a_reason_is_told(driver: SimulatedDriver) -> None:
    asked: list[Moment] = []

    def first(moment: Moment) -> Reason | None:
        asked.append(moment)
        return Reason(Code.OTHER, "the first")

    def second(moment: Moment) -> Reason | None:
        return Reason(Code.OTHER, "the second") if len(asked) == 2 else None

    reasons = []
    with Control(driver, watchdogs=[first, second, lambda moment: None]) as control:
        for _ in range(3):
            moment = control.observe()
            reasons.append(str(control.act([nod(driver)]).reason))
            assert asked[-1] is moment
    assert reasons == ["the first", "the second", "the first"]


def test_what_only_reads_sends_nothing_and_is_no_commander(
    driver: SimulatedDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = sent_by(driver, monkeypatch)
    with Control(driver, write=False) as reading, Control(driver, who="the other") as control:
        for moment in reading.periods(duration=0.02):
            assert moment.took > 0.0
            reading.act()
        assert sent == []
        control.observe()
        control.act()
        with pytest.raises(DriverError, match=r"nao is commanded by the other \(thread MainThread\) already"):
            Control(driver).__enter__()
    assert len(sent) == 1


def test_what_is_not_there_yet_is_told(driver: SimulatedDriver) -> None:
    control = Control(driver)
    with pytest.raises(CommandError, match="act before the robot was read"):
        control.act()
    moment = control.observe()
    assert moment is not None
    with pytest.raises(FrameError, match=r"valid: Control\(driver, body\)"):
        moment.perceived()
    moment = Control(driver, tci.GenericBody(driver.robot)).observe()
    assert moment is not None
    assert moment.perceived().stamp == moment.now


@pytest.mark.parametrize(("side", "back"), [(slice(60, 120), True), (slice(0, 60), False)])
def test_who_is_met_at_the_end_is_freed_too(side: slice, back: bool) -> None:
    """Skin begins to press after the last period of the loop: where the arm leads, or where it leaves."""
    driver = FakeDriver("nao")
    pressed = driver.skin["left_forearm"].copy()
    pressed[side] -= 60.0
    elbow = driver.robot.servos[driver.robot.part("left_arm").servos[3].servo or 0].index
    bend = GenericCommand("left_arm", Mode.POSITION, np.array([0.4, 0.2, 0.0, 1.2, 0.0]), speed=0.5)
    with Control(driver, GenericBody(driver.robot)) as control:
        for moment in control.periods(duration=0.5):
            control.act([bend] if moment.now == 0.0 else [])
        begun, loops = driver.position[elbow], len(driver.sent)
        driver.set_skin("left_forearm", pressed)
    told = [clamp.code for sent in driver.sent[loops:] for clamp in sent.clamped]
    assert Code.CONTACT in told
    gone = np.array([sent.position[sent.servos.tolist().index(elbow)] for sent in driver.sent])
    went_back = abs(begun - gone[0]) - abs(gone[-1] - gone[0])
    assert went_back > np.deg2rad(1.5) if back else went_back < np.deg2rad(0.1)
