"""The loop, the clock and the registry of drivers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import tci
from helpers.served import needs_qi
from tci.body.generic_body import GenericBody
from tci.drivers import driver_names
from tci.drivers.registry import open_server, server_names
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError, UnknownNameError
from tci.messages import GenericCommand, Mode, Perception
from tci.messages.clock import Every, ManualClock, ticks
from tci.runtime.loop import Tick
from tci.simulation.world import World


class Nod(tci.Capability[int]):
    """Moves the head down and up once, then only counts its steps."""

    def init(self, body: GenericBody) -> int:
        return 0

    def step(
        self, memory: int, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], int]:
        posture = perception.posture["head"].copy()
        posture[0] += 0.2
        commands = () if memory else (GenericCommand("head", Mode.POSITION, posture),)
        return commands, memory + 1


def test_the_loop_runs_a_capability_of_ones_own() -> None:
    with tci.connect(tci.load_robot("nao"), "sim") as driver:
        seen: list[Tick] = []
        assert tci.run(driver, Nod(), duration=0.5, observe=seen.append).memory == 250
        start, end = seen[0].perception.posture["head"], seen[-1].perception.posture["head"]
        assert end[0] - start[0] == pytest.approx(0.2, abs=0.002)
        assert set(seen[-1].sent.servos) == {1, 0}  # a NAO has the servos HeadPitch and HeadYaw, and no roll


def test_after_a_tick_that_came_a_period_late_there_is_none_in_the_same_period() -> None:
    class Late(ManualClock):
        def sleep_until(self, stamp: float) -> None:
            super().sleep_until(stamp + (0.12 if stamp == pytest.approx(0.3) else 0.0))

    assert list(ticks(Late(), 0.1, duration=0.8)) == pytest.approx([0.0, 0.1, 0.2, 0.42, 0.5, 0.6, 0.7])


def test_ticks_are_skipped_never_caught_up() -> None:
    clock = ManualClock()
    stamps = []
    for now in ticks(clock, 0.1, duration=1.0):
        stamps.append(round(now, 6))
        if now == pytest.approx(0.2):
            clock.advance(0.35)
    assert stamps == [0.0, 0.1, 0.2, 0.55, 0.6, 0.7, 0.8, 0.9]


def test_a_clock_that_has_run_for_days_serves_each_period_once() -> None:
    for start in np.random.default_rng(0).integers(10**12, 10**15, 50) * 1e-9:
        clock = ManualClock(float(start))  # a clock that wakes exactly at the given time, which is rounded
        served = [now - start for now in itertools.islice(ticks(clock, 0.001), 300)]
        assert served == pytest.approx(np.arange(300) * 0.001)


def test_what_is_due_once_in_a_period_is_not_caught_up() -> None:
    every = Every(1.0)
    told = [now for now in np.arange(5.0, 8.0, 0.25) if every.due(now)]
    assert told == [5.0, 5.5, 6.5, 7.5]
    assert [now for now in np.arange(12.0, 14.0, 0.25) if every.due(now)] == [12.0, 12.5, 13.5]


def test_connect_lists_what_there_is() -> None:
    robot = tci.load_robot("nao")
    assert "sim" in driver_names()
    with pytest.raises(UnknownNameError, match="sim"):
        tci.connect(robot, "telepathy://nao")
    with pytest.raises(DriverError, match="no address"):
        tci.connect(robot, "sim:10.0.0.5")
    with pytest.raises(
        UnknownNameError,
        match="no option of the driver 'sim' named 'armed' \\(did you mean 'arm'\\?\\); valid: arm",
    ):
        tci.connect(robot, "sim", armed=True)
    with tci.connect(robot, "sim", skin=False) as driver:
        assert not driver.read().skin
    with pytest.raises(DriverError, match="seed for a world that exists already; valid: World"):
        SimulatedDriver(robot, world=World(robot), seed=3)
    with pytest.raises(UnknownNameError, match="no option of the driver 'replay' named 'rate'; valid: arm"):
        tci.connect(robot, "replay:touch.mcap", rate=100.0)
    unbound = robot.model_copy(update={"bindings": ()})
    tci.connect(unbound, "sim").close()
    with pytest.raises(UnknownNameError, match="binding"):
        tci.connect(unbound, "naoqi:127.0.0.1:9")


@pytest.mark.parametrize("name", driver_names())
def test_every_driver_and_server_refuses_an_option_that_it_lacks(name: str) -> None:
    if name == "naoqi":
        needs_qi()
    robot = tci.load_robot("nao")
    with pytest.raises(
        UnknownNameError,
        match=f"no option of the driver '{name}' named 'amr' \\(did you mean 'arm'\\?\\); valid: .*arm",
    ):
        tci.connect(robot, name, amr=True)
    if name in server_names():
        with (
            tci.connect(robot, "sim") as driver,
            pytest.raises(UnknownNameError, match="option of the server"),
        ):
            open_server(driver, name, amr=True)
