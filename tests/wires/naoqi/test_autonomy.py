"""The driver detects that a NAO moves by itself, also after a restart or a gap in the network."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.living_nao import LivingNao, cut
from helpers.naoqi_wait import ROBOT, wait_for
from helpers.still_nao import StillNao
from tci.drivers.driver import Driver
from tci.drivers.registry import connect
from tci.errors import DriverError
from tci.gate.gate import GateState, SafeCommand


def is_back(driver: Any, generation: int = 1) -> None:
    wait_for(lambda: driver._poller.generation == generation and driver.read() is not None, driver)


def step(driver: Driver) -> SafeCommand:
    command = driver.native("LArm").command({"LElbowRoll": -0.2}, speed=0.3)
    return driver.write(driver.gate.step([command], driver.read().joints, driver.clock.now()))


def watch(driver: Driver) -> SafeCommand:
    """Runs one period without a command. This NAO does not move, so the gate has no reason to hold."""
    return driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))


def moves(driver: Driver) -> bool:
    return step(driver).state is GateState.RUN


def test_a_robot_that_moves_by_itself_is_not_armed_unless_that_is_switched_off_and_on_again() -> None:
    with StillNao() as nao:
        life, motion = nao.services["ALAutonomousLife"], nao.services["ALMotion"]
        life.setState("solitary")
        motion.setBreathEnabled("LArm", True)
        with connect(ROBOT, nao.via) as driver:
            found = {finding.what for finding in driver.diagnose() if finding.subject == "autonomy"}
            assert any("autonomous life (solitary)" in what for what in found)
        with pytest.raises(DriverError, match=r"autonomous life \(solitary\), Breath of LArm.*life=off"):
            connect(ROBOT, nao.via, arm=True)
        assert life.getState() == "solitary"
        with connect(ROBOT, f"{nao.via}?life=off", arm=True):
            assert life.getState() == "disabled"
            assert not motion.getBreathEnabled("LArm")
        assert life.getState() == "solitary"
        assert motion.getBreathEnabled("LArm")


def test_a_robot_that_restarts_with_life_on_stops_the_gate_until_it_is_connected_anew() -> None:
    with LivingNao("disabled") as nao, connect(ROBOT, nao.via, arm=True) as driver:
        wait_for(lambda: moves(driver))
        nao.kill()
        with LivingNao("solitary", nao.port) as again:
            is_back(driver)
            sent = step(driver)
            assert (sent.state, sent.servos.size) == (GateState.STOP, 0)
            assert "autonomous life (solitary); valid: end that and connect again" in str(sent.reason)
            driver.gate.reset()
            assert step(driver).state is GateState.STOP  # nothing has changed
            assert again.life() == "solitary"


def test_a_robot_that_restarts_with_life_on_is_quietened_again_and_restored_at_the_end() -> None:
    with LivingNao("solitary") as nao, connect(ROBOT, f"{nao.via}?life=off", arm=True) as driver:
        assert nao.life() == "disabled"
        nao.kill()
        with LivingNao("interactive", nao.port) as again:
            is_back(driver)
            assert again.life() == "disabled"
            wait_for(lambda: moves(driver))
            driver.close()
            assert again.life() == "solitary"  # the state before the driver, regardless of later states


def test_a_robot_that_restarts_is_not_back_before_its_life_can_be_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with LivingNao("disabled") as nao, connect(ROBOT, nao.via, arm=True) as driver:
        monkeypatch.setattr("tci.wires.naoqi.session.TIMEOUT", 1.0)
        nao.kill()
        with LivingNao("solitary", nao.port, late=True) as again:
            wait_for(lambda: "no service ALAutonomousLife" in driver._poller.trouble, driver)
            assert step(driver).state is GateState.HOLD
            again.go_on()
            is_back(driver)
            assert step(driver).state is GateState.STOP


@pytest.mark.parametrize("waits", [True, False], ids=["after it", "in it"])
def test_a_gap_in_the_network_does_not_leave_life_off(waits: bool) -> None:
    with LivingNao("solitary") as nao, connect(ROBOT, f"{nao.via}?life=off", arm=True) as driver:
        cut(nao.port)
        if waits:
            is_back(driver)
            assert nao.life() == "disabled"
        else:
            poller: Any = driver._poller
            wait_for(lambda: poller.generation == 1 or not poller.services.session.isConnected())
        driver.close()
        assert nao.life() == "solitary"


def test_what_stays_off_is_told_with_what_to_do() -> None:
    with LivingNao("solitary") as nao, connect(ROBOT, f"{nao.via}?life=off", arm=True) as driver:
        nao.kill()
        wait_for(lambda: bool(driver._poller.trouble), driver)
        with pytest.warns(RuntimeWarning, match=r"autonomous life \(solitary\).*by hand") as told:
            driver.close()
        assert [one.category for one in told].count(RuntimeWarning) == 1


def test_what_can_not_be_switched_off_after_a_gap_stops_the_gate() -> None:
    from tci.wires.naoqi.services import ALAutonomousLife

    class Stubborn(ALAutonomousLife):
        def setState(self, state: str) -> None:
            raise RuntimeError("not now")

    with StillNao(without=("ALAutonomousLife",)) as nao:
        life = Stubborn()
        nao.session.registerService("ALAutonomousLife", life)
        with connect(ROBOT, f"{nao.via}?life=off", arm=True) as driver:
            life._state = "interactive"
            cut(nao.port)
            is_back(driver)
            sent = step(driver)
            assert sent.state is GateState.STOP
            assert "autonomous life (interactive) can't be switched off" in str(sent.reason)
            assert "not now" in str(sent.reason)


def test_life_that_somebody_switches_on_meanwhile_stops_the_gate() -> None:
    with StillNao() as nao, connect(ROBOT, nao.via, arm=True) as driver:
        lookout: Any = driver._lookout
        wait_for(lambda: watch(driver).state is GateState.RUN and lookout._was_off)
        nao.services["ALAutonomousLife"].setState("interactive")
        wait_for(lambda: watch(driver).state is GateState.STOP)
        sent = watch(driver)
        assert "autonomous life has been switched on (interactive); valid: end that" in str(sent.reason)


def test_life_that_comes_after_the_driver_and_is_on_stops_the_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    """While a robot boots, its services become available one after the other."""
    from tci.wires.naoqi.services import ALAutonomousLife

    monkeypatch.setattr("tci.wires.naoqi.autonomy.EVERY", 0.01)
    with StillNao(without=("ALAutonomousLife",)) as nao, connect(ROBOT, nao.via, arm=True) as driver:
        wait_for(lambda: watch(driver).state is GateState.RUN)
        life = ALAutonomousLife()
        life._state = "solitary"
        nao.session.registerService("ALAutonomousLife", life)
        wait_for(lambda: watch(driver).state is GateState.STOP)
        assert "autonomous life has been switched on (solitary)" in str(watch(driver).reason)


def test_life_that_is_still_ending_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    from tci.wires.naoqi.services import ALAutonomousLife

    monkeypatch.setattr("tci.wires.naoqi.autonomy.EVERY", 0.01)
    asked = []

    class Slow(ALAutonomousLife):
        def getState(self) -> str:
            asked.append(self._state)
            return self._state

        def setState(self, state: str) -> None:
            return

    with StillNao(without=("ALAutonomousLife",)) as nao:
        life = Slow()
        life._state = "solitary"
        nao.session.registerService("ALAutonomousLife", life)
        with connect(ROBOT, f"{nao.via}?life=off", arm=True) as driver:
            wait_for(lambda: watch(driver).state is GateState.RUN and len(asked) > 5)
            assert driver.gate.counts.stops == 0
            life._state = "disabled"
            wait_for(lambda: watch(driver).state is GateState.RUN and asked[-3:] == ["disabled"] * 3)
            life._state = "solitary"
            wait_for(lambda: watch(driver).state is GateState.STOP)


def test_a_driver_that_only_reads_leaves_a_robot_that_comes_back_alone() -> None:
    with StillNao() as nao, connect(ROBOT, f"{nao.via}?life=off") as driver:
        nao.services["ALAutonomousLife"].setState("solitary")
        cut(nao.port)
        is_back(driver)
        joints = driver.read().joints
        assert driver.gate.step([], joints, joints.stamp).state is GateState.RUN
        assert nao.services["ALAutonomousLife"].getState() == "solitary"
