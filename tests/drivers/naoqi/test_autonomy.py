"""A NAO that moves by itself, and comes back doing so after a restart or a gap in the network."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.naoqi.living_nao import LivingNao, cut
from drivers.naoqi.still_nao import StillNao
from drivers.naoqi.test_naoqi_link import ROBOT, wait_for
from tci.drivers.driver import Link
from tci.drivers.registry import connect
from tci.errors import LinkError
from tci.gate.gate import GateState, SafeCommand


def is_back(link: Any, generation: int = 1) -> None:
    wait_for(lambda: link._poller.generation == generation and link.read() is not None, link)


def step(link: Link) -> SafeCommand:
    command = link.native("LArm").command({"LElbowRoll": -0.2}, speed=0.3)
    return link.write(link.gate.step([command], link.read().joints, link.clock.now()))


def watch(link: Link) -> SafeCommand:
    """A step without a command: this NAO stands still, which the gate would see."""
    return link.write(link.gate.step([], link.read().joints, link.clock.now()))


def moves(link: Link) -> bool:
    return step(link).state is GateState.RUN


def test_a_robot_that_moves_by_itself_is_not_armed_unless_that_is_switched_off_and_on_again() -> None:
    with StillNao() as nao:
        life, motion = nao.services["ALAutonomousLife"], nao.services["ALMotion"]
        life.setState("solitary")
        motion.setBreathEnabled("LArm", True)
        with connect(ROBOT, nao.via) as link:
            found = {finding.what for finding in link.diagnose() if finding.subject == "autonomy"}
            assert any("autonomous life (solitary)" in what for what in found)
        with pytest.raises(LinkError, match=r"autonomous life \(solitary\), Breath of LArm.*life=off"):
            connect(ROBOT, nao.via, arm=True)
        assert life.getState() == "solitary"
        with connect(ROBOT, f"{nao.via}?life=off", arm=True):
            assert life.getState() == "disabled"
            assert not motion.getBreathEnabled("LArm")
        assert life.getState() == "solitary"
        assert motion.getBreathEnabled("LArm")


def test_a_robot_that_restarts_with_life_on_stops_the_gate_until_it_is_connected_anew() -> None:
    with LivingNao("disabled") as nao, connect(ROBOT, nao.via, arm=True) as link:
        wait_for(lambda: moves(link))
        nao.kill()
        with LivingNao("solitary", nao.port) as again:
            is_back(link)
            sent = step(link)
            assert (sent.state, sent.servos.size) == (GateState.STOP, 0)
            assert "autonomous life (solitary); valid: end that and connect again" in sent.reason
            link.gate.reset()
            assert step(link).state is GateState.STOP  # nothing has changed
            assert again.life() == "solitary"


def test_a_robot_that_restarts_with_life_on_is_quietened_again_and_restored_at_the_end() -> None:
    with LivingNao("solitary") as nao, connect(ROBOT, f"{nao.via}?life=off", arm=True) as link:
        assert nao.life() == "disabled"
        nao.kill()
        with LivingNao("interactive", nao.port) as again:
            is_back(link)
            assert again.life() == "disabled"
            wait_for(lambda: moves(link))
            link.close()
            assert again.life() == "solitary"  # as before the link, whatever it was in between


def test_a_robot_that_restarts_is_not_back_before_its_life_can_be_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with LivingNao("disabled") as nao, connect(ROBOT, nao.via, arm=True) as link:
        monkeypatch.setattr("tci.drivers.naoqi.session.TIMEOUT", 1.0)
        nao.kill()
        with LivingNao("solitary", nao.port, late=True) as again:
            wait_for(lambda: "no service ALAutonomousLife" in link._poller.trouble, link)
            assert step(link).state is GateState.HOLD
            again.go_on()
            is_back(link)
            assert step(link).state is GateState.STOP


@pytest.mark.parametrize("waits", [True, False], ids=["after it", "in it"])
def test_a_gap_in_the_network_does_not_leave_life_off(waits: bool) -> None:
    with LivingNao("solitary") as nao, connect(ROBOT, f"{nao.via}?life=off", arm=True) as link:
        cut(nao.port)
        if waits:
            is_back(link)
            assert nao.life() == "disabled"
        else:
            poller: Any = link._poller  # type: ignore[attr-defined]
            wait_for(lambda: poller.generation == 1 or not poller.services.session.isConnected())
        link.close()
        assert nao.life() == "solitary"


def test_what_stays_off_is_told_with_what_to_do() -> None:
    with LivingNao("solitary") as nao, connect(ROBOT, f"{nao.via}?life=off", arm=True) as link:
        nao.kill()
        wait_for(lambda: bool(link._poller.trouble), link)
        with pytest.warns(RuntimeWarning, match=r"autonomous life \(solitary\).*by hand") as told:
            link.close()
        assert [one.category for one in told].count(RuntimeWarning) == 1


def test_what_can_not_be_switched_off_after_a_gap_stops_the_gate() -> None:
    from tci.drivers.naoqi.services import ALAutonomousLife

    class Stubborn(ALAutonomousLife):
        def setState(self, state: str) -> None:
            raise RuntimeError("not now")

    with StillNao(without=("ALAutonomousLife",)) as nao:
        life = Stubborn()
        nao.session.registerService("ALAutonomousLife", life)
        with connect(ROBOT, f"{nao.via}?life=off", arm=True) as link:
            life._state = "interactive"
            cut(nao.port)
            is_back(link)
            sent = step(link)
            assert sent.state is GateState.STOP
            assert "autonomous life (interactive) can't be switched off" in sent.reason
            assert "not now" in sent.reason


def test_life_that_somebody_switches_on_meanwhile_stops_the_gate() -> None:
    with StillNao() as nao, connect(ROBOT, nao.via, arm=True) as link:
        lookout: Any = link._lookout  # type: ignore[attr-defined]
        wait_for(lambda: watch(link).state is GateState.RUN and lookout._was_off)
        nao.services["ALAutonomousLife"].setState("interactive")
        wait_for(lambda: watch(link).state is GateState.STOP)
        sent = watch(link)
        assert "autonomous life has been switched on (interactive); valid: end that" in sent.reason


def test_life_that_comes_after_the_link_and_is_on_stops_the_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    """While a robot boots its services come one by one."""
    from tci.drivers.naoqi.services import ALAutonomousLife

    monkeypatch.setattr("tci.drivers.naoqi.autonomy.EVERY", 0.01)
    with StillNao(without=("ALAutonomousLife",)) as nao, connect(ROBOT, nao.via, arm=True) as link:
        wait_for(lambda: watch(link).state is GateState.RUN)
        life = ALAutonomousLife()
        life._state = "solitary"
        nao.session.registerService("ALAutonomousLife", life)
        wait_for(lambda: watch(link).state is GateState.STOP)
        assert "autonomous life has been switched on (solitary)" in watch(link).reason


def test_life_that_is_still_ending_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    from tci.drivers.naoqi.services import ALAutonomousLife

    monkeypatch.setattr("tci.drivers.naoqi.autonomy.EVERY", 0.01)
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
        with connect(ROBOT, f"{nao.via}?life=off", arm=True) as link:
            wait_for(lambda: watch(link).state is GateState.RUN and len(asked) > 5)
            assert link.gate.counts.stops == 0
            life._state = "disabled"
            wait_for(lambda: watch(link).state is GateState.RUN and asked[-3:] == ["disabled"] * 3)
            life._state = "solitary"
            wait_for(lambda: watch(link).state is GateState.STOP)


def test_a_link_that_only_reads_leaves_a_robot_that_comes_back_alone() -> None:
    with StillNao() as nao, connect(ROBOT, f"{nao.via}?life=off") as link:
        nao.services["ALAutonomousLife"].setState("solitary")
        cut(nao.port)
        is_back(link)
        joints = link.read().joints
        assert link.gate.step([], joints, joints.stamp).state is GateState.RUN
        assert nao.services["ALAutonomousLife"].getState() == "solitary"
