"""Faults of joints from end to end, in the modes in which a joint may yield: impedance and torque.

There the measured motion need not be the commanded one. What readings say of themselves still counts.
"""

from __future__ import annotations

import numpy as np
import pytest

from faults.rehearsal import AT, Rehearsal
from tci.interface.gate.gate import GateState
from tci.messages import Mode
from tci.middleware.simulated import SimulatedLink
from tci.model.catalogue import load_robot
from tci.simulation.world import World

END = 0.05
"""Time [s] from the last reading that can be believed within which torques end."""


@pytest.fixture(scope="module")
def world() -> World:
    return World(load_robot("icub"))


@pytest.fixture(params=[Mode.IMPEDANCE, Mode.TORQUE], ids=lambda mode: mode.value)
def mode(request: pytest.FixtureRequest) -> Mode:
    given: Mode = request.param
    return given


@pytest.fixture
def link(world: World) -> SimulatedLink:
    world.reset()
    world.set_power(np.arange(len(world.robot.servos)), on=True)
    return SimulatedLink(world.robot, world=world)


def pushes_after(done: Rehearsal, time: float) -> float:
    """Largest torque [N m] that was sent from `time` [s] on."""
    late = [np.abs(tick.sent.torque).max(initial=0.0) for tick in done.ticks if tick.now >= time - 1e-9]
    assert late
    return float(max(late))


def stops(link: SimulatedLink, name: str, mode: Mode, *, between: tuple[float, float]) -> None:
    done = Rehearsal(link, name, mode=mode)
    low, high = between
    after = done.stopped_after()
    assert low <= after < high
    assert {tick.sent.modes[0] for tick in done.ticks[1:]} == {mode}
    assert pushes_after(done, AT + after + END) == 0.0
    pushed = max(np.abs(tick.sent.torque).max() for tick in done.ticks)
    assert (pushed > 1.0) == (mode is Mode.TORQUE)


def test_04_nan_angle(link: SimulatedLink, mode: Mode) -> None:
    done = Rehearsal(link, "nan-angle", lasts=0.1, mode=mode)
    assert done.states == {GateState.RUN, GateState.HOLD}
    assert done.ticks[-1].sent.state is GateState.RUN
    blind = [tick for tick in done.ticks if AT + END - 1e-9 <= tick.now < AT + 0.1 - 1e-9]
    assert blind
    assert not any(tick.sent.torque.any() for tick in blind)


def test_10_dropped_frames(link: SimulatedLink, mode: Mode) -> None:
    done = Rehearsal(link, "dropped-frames", lasts=0.2, mode=mode)
    assert done.states == {GateState.RUN, GateState.HOLD}
    blind = [tick for tick in done.ticks if AT + END - 1e-9 <= tick.now < AT + 0.2 - 1e-9]
    assert blind
    assert not any(tick.sent.torque.any() for tick in blind)


def test_14_frozen_source(link: SimulatedLink, mode: Mode) -> None:
    stops(link, "frozen-source", mode, between=(0.1, 0.15))


def test_15_wrong_taxel_count(link: SimulatedLink, mode: Mode) -> None:
    done = Rehearsal(link, "wrong-taxel-count", mode=mode)
    assert 0.09 < done.stopped_after() < 0.15
    assert done.report.rejected == sum(tick.now >= AT - 1e-9 for tick in done.ticks)


def test_19_wrong_direction(link: SimulatedLink, mode: Mode) -> None:
    stops(link, "wrong-direction", mode, between=(0.02, 0.3))


def test_20_stale_encoder(link: SimulatedLink, mode: Mode) -> None:
    stops(link, "stale-encoder", mode, between=(0.05, 0.4))


def test_21_a_joint_that_is_blocked_is_none_that_fails(link: SimulatedLink, mode: Mode) -> None:
    """It may be held: whoever asks for a torque or an equilibrium gets no more than that."""
    done = Rehearsal(link, "stall", mode=mode)
    assert done.states == {GateState.RUN}
    assert pushes_after(done, AT) <= 3.0


def test_22_servo_off(link: SimulatedLink, mode: Mode) -> None:
    stops(link, "servo-off", mode, between=(0.0, 0.01))


def test_23_mode_mismatch(link: SimulatedLink, mode: Mode) -> None:
    stops(link, "mode-mismatch", mode, between=(0.45, 0.55))


def test_25_encoder_step(link: SimulatedLink, mode: Mode) -> None:
    stops(link, "encoder-step", mode, between=(0.0, 0.01))
