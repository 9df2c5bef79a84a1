"""Joint faults in the complete pipeline, in the modes in which a joint may yield: impedance and torque.

In these modes the measured motion may differ from the commanded motion. Fault flags in the readings are still
used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from helpers.rehearsal import AT, Rehearsal
from tci.capabilities.soft_reaction import SoftReaction
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import GateState
from tci.lab.faults.injectors import INJECTORS
from tci.lab.faults.injectors.injector import Injector
from tci.messages import Mode, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.simulation.world import World
from tci.skin.skin import Skin

END = 0.05
"""Time [s] after the last credible reading within which torques end."""


@pytest.fixture(scope="module")
def world() -> World:
    return World(load_robot("icub"))


@pytest.fixture(params=[Mode.IMPEDANCE, Mode.TORQUE], ids=lambda mode: mode.value)
def mode(request: pytest.FixtureRequest) -> Mode:
    given: Mode = request.param
    return given


@pytest.fixture
def driver(world: World) -> SimulatedDriver:
    world.reset()
    world.set_power(np.arange(len(world.robot.servos)), on=True)
    return SimulatedDriver(world.robot, world=world)


def pushes_after(done: Rehearsal, time: float) -> float:
    """Returns the largest torque [N m] that was sent from `time` [s] on."""
    late = [np.abs(tick.sent.torque).max(initial=0.0) for tick in done.ticks if tick.now >= time - 1e-9]
    assert late
    return float(max(late))


def stops(
    driver: SimulatedDriver, name: str, mode: Mode, *, between: tuple[float, float], believed: bool = False
) -> Rehearsal:
    """Checks that torques end or, if angles and velocities can be `believed`, that torques only brake."""
    done = Rehearsal(driver, name, mode=mode)
    low, high = between
    after = done.stopped_after()
    assert low <= after < high
    assert {tick.sent.modes[0] for tick in done.ticks[1:]} == {mode}
    if believed:
        for tick in done.ticks:
            if tick.sent.state is GateState.STOP:
                speeds = tick.reading.joints.velocity[tick.sent.servos]
                assert (tick.sent.torque * speeds <= 0.0).all()
    else:
        assert pushes_after(done, AT + after + END) == 0.0
    pushed = max(np.abs(tick.sent.torque).max() for tick in done.ticks)
    assert (pushed > 1.0) == (mode is Mode.TORQUE)
    return done


def test_04_nan_angle(driver: SimulatedDriver, mode: Mode) -> None:
    done = Rehearsal(driver, "nan-angle", lasts=0.1, mode=mode)
    assert done.states == {GateState.RUN, GateState.HOLD}
    assert done.ticks[-1].sent.state is GateState.RUN
    blind = [tick for tick in done.ticks if AT + END - 1e-9 <= tick.now < AT + 0.1 - 1e-9]
    assert blind
    assert not any(tick.sent.torque.any() for tick in blind)


def test_10_dropped_frames(driver: SimulatedDriver, mode: Mode) -> None:
    done = Rehearsal(driver, "dropped-frames", lasts=0.2, mode=mode)
    assert done.states == {GateState.RUN, GateState.HOLD}
    blind = [tick for tick in done.ticks if AT + END - 1e-9 <= tick.now < AT + 0.2 - 1e-9]
    assert blind
    assert not any(tick.sent.torque.any() for tick in blind)


def test_14_frozen_source(driver: SimulatedDriver, mode: Mode) -> None:
    stops(driver, "frozen-source", mode, between=(0.1, 0.15))


def test_15_wrong_taxel_count(driver: SimulatedDriver, mode: Mode) -> None:
    done = Rehearsal(driver, "wrong-taxel-count", mode=mode)
    assert 0.09 < done.stopped_after() < 0.15
    assert done.report.rejected == sum(tick.now >= AT - 1e-9 for tick in done.ticks)


class AnotherRobot(Injector):
    """Replaces the robot's readings by the readings of another NAO."""

    number = 16
    description = "joints and skin are another robot's"

    def begin(self) -> None:
        self.nao = SimulatedDriver(load_robot("nao"))

    def read(self, reading: Reading) -> Reading:
        theirs = self.nao.read()
        joints = replace(theirs.joints, stamp=reading.joints.stamp, sequence=reading.joints.sequence)
        return Reading(joints, theirs.skin)

    def end(self) -> None:
        self.nao.close()


def test_16_readings_of_another_robot(
    driver: SimulatedDriver, mode: Mode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(INJECTORS, "another-robot", AnotherRobot)
    done = Rehearsal(driver, "another-robot", mode=mode)
    assert 0.09 < done.stopped_after() < 0.15
    assert done.report.rejected == sum(tick.now >= AT - 1e-9 for tick in done.ticks)
    assert pushes_after(done, AT + END) == 0.0


class Scattered(Injector):
    """Single taxels and their neighbours, pressed by an object of which TCI has no data."""

    number = 17
    description = "thirty places are touched at once"

    def begin(self) -> None:
        skin, left = Skin(self.driver.robot), 30
        self.pressed: dict[str, NDArray[np.intp]] = {}
        for patch in self.driver.robot.patches:
            surface = skin.surfaces[patch.name]
            count = len(surface.channels)
            near = np.eye(count, dtype=bool)
            one, other = surface.neighbours.T
            near[one, other] = near[other, one] = True
            free, chosen = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
            while left and free.any():
                middle = near[np.flatnonzero(free)[0]]
                chosen |= middle
                around = near[middle].any(axis=0)
                free &= ~near[around].any(axis=0)
                left -= 1
            self.pressed[patch.name] = surface.channels[chosen]

    def frame(self, frame: SkinFrame) -> SkinFrame:
        sensor = self.driver.robot.patch(frame.patch).sensor
        values = frame.values.astype(float)
        values[self.pressed[frame.patch]] += 100.0 * np.sign(sensor.pascal_per_count)
        return replace(frame, values=read_only(np.clip(values, sensor.lowest, sensor.highest)))


def test_17_thirty_contacts_at_once(
    driver: SimulatedDriver, mode: Mode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commands of reflex and soft reaction stay bounded, and each arm has one response."""
    monkeypatch.setitem(INJECTORS, "scattered", Scattered)
    behaviour = SoftReaction(mode=mode) if mode is Mode.TORQUE else WithdrawalReflex(mode=mode)
    done = Rehearsal(driver, "scattered", mode=mode, behaviour=behaviour)
    assert max(len(tick.perception.contacts) for tick in done.ticks) >= 30
    assert done.states == {GateState.RUN}
    assert all(len(tick.commands) <= 2 for tick in done.ticks[1:])
    torques = [servo.limits.torque or 0.0 for servo in driver.robot.servos]
    for tick in done.ticks:
        assert np.isfinite(tick.sent.torque).all()
        assert (np.abs(tick.sent.torque) <= np.take(torques, tick.sent.servos)).all()


def test_19_wrong_direction(driver: SimulatedDriver, mode: Mode) -> None:
    stops(driver, "wrong-direction", mode, between=(0.02, 0.3))


def test_20_stale_encoder(driver: SimulatedDriver, mode: Mode) -> None:
    stops(driver, "stale-encoder", mode, between=(0.05, 0.4))


def test_21_a_joint_that_is_blocked_is_none_that_fails(driver: SimulatedDriver, mode: Mode) -> None:
    """A person may hold the joint. Then the joint gets no more torque than the command (torque or
    equilibrium) says, and no fault is reported."""
    done = Rehearsal(driver, "stall", mode=mode)
    assert done.states == {GateState.RUN}
    assert pushes_after(done, AT) <= 3.0


def test_22_servo_off(driver: SimulatedDriver, mode: Mode) -> None:
    done = stops(driver, "servo-off", mode, between=(0.0, 0.01), believed=True)
    for tick in done.ticks:
        on = tick.reading.joints.powered
        assert on is not None
        assert not tick.sent.torque[~on[tick.sent.servos]].any()
    assert not on[tick.sent.servos].all()


def test_23_mode_mismatch(driver: SimulatedDriver, mode: Mode) -> None:
    done = stops(driver, "mode-mismatch", mode, between=(0.45, 0.55), believed=True)
    last = done.ticks[-1]  # Data are correct until 0.1 s later, so moving joints are braked until then.
    assert AT + done.stopped_after() + 2 * END - 0.005 < last.now
    assert np.abs(last.reading.joints.velocity).max() < 0.002, "it rests"
    assert pushes_after(done, last.now) < 0.01, "and is left alone"


def test_25_encoder_step(driver: SimulatedDriver, mode: Mode) -> None:
    stops(driver, "encoder-step", mode, between=(0.0, 0.01))
