"""Contract that every driver must fulfil. A new middleware adds the program for the other end of its
connection to `PEERS` in `helpers/wire_peers.py`."""

from __future__ import annotations

import random
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from typing import Any

import numpy as np
import psutil
import pytest

from helpers.held import left_behind
from helpers.patient import PATIENCE as SILENCE
from helpers.wire_peers import BINDINGS, PEERS, Peer
from tci.body.generic_body import GenericBody
from tci.body.posture import home, to_platform
from tci.capabilities.capability import Capability
from tci.drivers.driver import Driver
from tci.errors import CommandError, DriverError, UnknownNameError
from tci.gate.gate import Gate
from tci.gate.safe_command import GateState, SafeCommand
from tci.messages import Perception, PlatformOrder
from tci.robot.joint_map import initial_position
from tci.runtime.loop import run

PATIENCE = 20
"""Number of times that a motion is ordered again, because a busy machine may stop the motion early."""
LATE = re.compile("missed [0-9]+ periods|no message from|stood still")
"""Pattern of the gate's reasons to hold on a machine that is too busy for real time."""
AFTER_THAW = 0.02
"""Distance [rad] that a robot frozen at 0.1 rad/s may travel beyond its last measured and commanded
position."""

pytestmark = pytest.mark.timeout(120)  # a peer that sends nothing must not block the test run
PEERS = PEERS | BINDINGS


def group(*names: str) -> list[Any]:
    """Returns the test parameters for these drivers. In one run, all tests of a driver use the same process
    and the same peer (the program at the other end)."""
    return [pytest.param(name, marks=pytest.mark.xdist_group(f"driver-{name}")) for name in names]


ELSEWHERE = group(*(name for name, peer in PEERS.items() if peer.other_process))
HERE = group(*(name for name, peer in PEERS.items() if not peer.other_process))
elsewhere = pytest.mark.parametrize("peer", ELSEWHERE, indirect=True)


@pytest.fixture(scope="module", params=[*ELSEWHERE, *HERE])
def peer(request: pytest.FixtureRequest) -> Iterator[Peer]:
    """Yields the peer that all tests of one driver share. The peer ends before the peer of the next driver
    starts."""
    made = PEERS[request.param]()
    try:
        made.start()
        yield made
    finally:
        made.stop()


@pytest.fixture(scope="module")
def shared(peer: Peer) -> Iterator[list[Driver]]:
    """Yields the driver that tests share. The first of these tests opens the driver."""
    opened: list[Driver] = []
    yield opened
    for driver in opened:
        driver.close()


@pytest.fixture
def driver(peer: Peer, shared: list[Driver]) -> Driver:
    """Yields an armed driver for tests that neither close it nor open another one. These tests run first."""
    if not shared:
        shared.append(peer.open(arm=True))
    return shared[0]


@pytest.fixture
def open_driver(peer: Peer, shared: list[Driver]) -> Iterator[Callable[..., Driver]]:
    opened = [*shared]
    for driver in opened:
        driver.close()
    shared.clear()

    def make(*, arm: bool = True) -> Driver:
        opened.append(peer.open(arm=arm))
        return opened[-1]

    yield make
    for driver in opened:
        driver.close()


def drive(
    driver: Driver,
    *orders: PlatformOrder,
    duration: float = 1.0,
    until: Callable[[SafeCommand], bool] = lambda sent: False,
) -> SafeCommand:
    """Runs a loop for `duration` [s], or until a command fulfils `until`. Returns the last command."""
    pending = list(orders)
    for now in driver.ticks(duration=duration):
        sent = driver.write(driver.gate.step(pending, driver.read().joints, now))
        pending = []
        if until(sent):
            break
    return sent


def drive_until(driver: Driver, arrived: Callable[[], bool], *orders: PlatformOrder) -> bool:
    """Returns True if the robot reaches its target. In a simulation one order is enough. On a busy machine
    the gate may stop the motion; then the order is repeated."""
    for _ in range(PATIENCE):
        drive(driver, *orders, until=lambda sent: arrived())
        if arrived():
            return True
        if driver.gate.state is GateState.STOP:
            with suppress(CommandError):  # not at rest yet
                driver.gate.reset()
    return False


def judged(driver: Driver, values: dict[str, float]) -> SafeCommand:
    """Returns the gate's decision on a command, as soon as the gate is in state RUN on a busy machine."""
    end = time.monotonic() + 30.0
    while True:
        joints = driver.read().joints
        safe = driver.gate.step([driver.native("LArm").command(values)], joints, driver.clock.now())
        if safe.state is GateState.RUN:
            return safe
        assert time.monotonic() < end
        time.sleep(driver.period)


def elbow(driver: Driver) -> float:
    return driver.native("LArm").positions(driver.read().joints)["LElbowRoll"]


def bend(driver: Driver, angle: float, speed: float = np.inf) -> PlatformOrder:
    return driver.native("LArm").command({"LElbowRoll": angle}, speed=speed)


def test_readings_are_complete_fresh_and_in_order(driver: Driver) -> None:
    sequences, ages = [], []
    for now in driver.ticks(duration=0.1):
        reading = driver.read()
        assert reading.joints.position.shape == (len(driver.robot.servos),)
        ages.append(now - reading.joints.stamp)
        assert {frame.patch for frame in reading.skin} == {patch.name for patch in driver.robot.patches}
        for frame in reading.skin:
            assert frame.values.shape == (driver.robot.patch(frame.patch).channels,)
            assert abs(now - frame.stamp) <= driver.gate.stale_after
        sequences.append(reading.joints.sequence)
    assert sequences == sorted(sequences)
    # A reading is newer than the start of its period. A busy machine may delay some readings, but not all.
    assert min(np.abs(ages)) <= driver.gate.stale_after


def test_write_returns_what_was_sent_and_the_robot_goes_there(driver: Driver) -> None:
    bent = {"LElbowRoll": -1.2}
    safe = judged(driver, bent)
    assert driver.write(safe) is safe
    assert drive_until(driver, lambda: abs(elbow(driver) + 1.2) < 0.01, driver.native("LArm").command(bent))


def test_home_is_commands_like_any_other(driver: Driver) -> None:
    part, arm = driver.robot.part("right_arm"), driver.native("RArm")
    away = arm.command({"RElbowRoll": 0.3})
    drive_until(driver, lambda: abs(arm.positions(driver.read().joints)["RElbowRoll"] - 0.3) < 0.01, away)
    servos = [servo.servo for servo in part.servos]
    wanted = initial_position(driver.robot)[servos]
    orders = [to_platform(driver.robot, command) for command in home(part)]
    assert drive_until(
        driver, lambda: np.abs(driver.read().joints.position[servos] - wanted).max() < 0.01, *orders
    )


def test_only_this_drivers_gate_can_write(driver: Driver) -> None:
    other = Gate(driver.robot, period=driver.period, stale_after=1.0)
    safe = other.step([], driver.read().joints, driver.clock.now())
    with pytest.raises(DriverError, match="gate"):
        driver.write(safe)


def test_native_names_are_checked(driver: Driver) -> None:
    with pytest.raises(UnknownNameError, match="LArm"):
        driver.native("Tail")
    with pytest.raises(UnknownNameError, match="LWristYaw"):
        driver.native("LArm").command({"LWrist": 0.0})
    with pytest.raises(CommandError, match="no values"):
        driver.native("LArm").command({})


def test_a_native_command_obeys_the_same_limits(driver: Driver) -> None:
    assert "LHand is nan" in judged(driver, {"LElbowRoll": 2.0, "LHand": np.nan}).refusals[0].text
    assert judged(driver, {"LElbowRoll": 2.0}).clamped[0].names == ("LElbowRoll",)


class Once(Capability[bool]):
    """Sends a single order."""

    def __init__(self, order: PlatformOrder) -> None:
        self.order = order

    def init(self, body: GenericBody) -> bool:
        return False

    def step(
        self, memory: bool, perception: Perception, body: GenericBody
    ) -> tuple[tuple[PlatformOrder, ...], bool]:
        return () if memory else (self.order,), True


def test_a_run_after_one_that_ended_in_motion_is_obeyed(driver: Driver) -> None:
    """A hold at the end of the first run is no longer in force, neither in this process nor in the process of
    the robot."""
    refused: list[str] = []
    undisturbed = 0
    for _ in range(2 * PATIENCE):
        # starts in the middle and returns, so that no limit interferes
        away = -1.0 if elbow(driver) < -0.8 else 1.0
        first = run(
            driver, Once(bend(driver, np.clip(elbow(driver) + 0.5 * away, -1.5, -0.1), 0.6)), duration=0.3
        )
        goal = elbow(driver) - 0.3 * away
        refused.clear()
        second = run(
            driver,
            Once(bend(driver, goal, 0.6)),
            duration=0.9,
            observe=lambda tick: refused.extend(map(str, tick.sent.refusals)),
        )
        if not refused and abs(elbow(driver) - goal) < 0.05:
            return
        # A busy machine may cause any number of holds.
        late = first.report.missed or second.report.missed or LATE.search(" ".join(refused))
        undisturbed += not late
        assert undisturbed < PATIENCE / 4, refused
        driver.gate.reset()
    raise AssertionError(f"this machine is too busy: {refused}")


def test_32_a_reader_that_was_away_gets_the_latest_and_no_backlog(driver: Driver) -> None:
    before = driver.read().joints.sequence
    driver.clock.sleep_until(driver.clock.now() + 1.5)
    reading, now = driver.read(), driver.clock.now()
    assert abs(now - reading.joints.stamp) <= driver.gate.stale_after
    assert reading.joints.sequence > before + 10
    assert driver.read().joints.sequence - reading.joints.sequence <= 100


@elsewhere
def test_28_34_a_peer_that_falls_silent_means_hold_and_comes_back_without_replay(
    peer: Peer, driver: Driver
) -> None:
    assert drive_until(driver, lambda: abs(elbow(driver) + 0.3) < 0.01, bend(driver, -0.3))
    away = bend(driver, -1.4, 0.1)

    def under_way(sent: SafeCommand) -> bool:
        return away.servos[0] in sent.servos and elbow(driver) < -0.35

    for _ in range(PATIENCE):  # a busy machine may stop it on the way
        last = drive(driver, away, until=under_way)
        if under_way(last):
            break
    led = dict(zip(last.servos.tolist(), last.position.tolist(), strict=True))[away.servos[0]]
    peer.freeze()
    try:
        held = drive(driver, duration=5.0, until=lambda sent: sent.state is GateState.HOLD)
        assert held.state is GateState.HOLD
        assert re.search("joint data is .* old|no new joint data", str(held.reason))
        refused = driver.gate.step([bend(driver, -1.0)], driver.read().joints, driver.clock.now())
        assert "hold" in refused.refusals[0].text
        driver.write(refused)
        drive(driver, duration=0.2)
        frozen = elbow(driver)
    finally:
        peer.thaw()
    passed: list[float] = []

    def seen(sent: SafeCommand) -> bool:
        passed.append(elbow(driver))
        return sent.state is GateState.RUN

    assert drive(driver, duration=10.0, until=seen).state is GateState.RUN
    # Before the freeze, the robot was moving to its commanded position (with a delay on a busy machine).
    # After the thaw it holds from its first period on, so it stops between these two positions. Commands that
    # were sent from then until this driver's hold (0.05 rad further) are not executed.
    drive(driver, duration=3.0 * AFTER_THAW / 0.1)
    passed.append(elbow(driver))
    assert min(passed) > min(frozen, led) - AFTER_THAW
    assert max(passed) < max(frozen, led) + AFTER_THAW
    assert drive_until(driver, lambda: abs(elbow(driver) + 0.3) < 0.03, bend(driver, -0.3))


@elsewhere
def test_33_garbage_floods_and_wrong_types_change_nothing(peer: Peer, driver: Driver) -> None:
    garbage = [bytes(random.Random(n).randbytes(n % 700)) for n in range(200)]
    ended = threading.Event()

    def flood() -> Iterator[bytes]:
        for turn in range(20):
            if turn and ended.is_set():
                return
            yield from garbage

    driver.read()
    sender = threading.Thread(target=peer.disturb, args=(flood(),))
    memory = psutil.Process().memory_info().rss
    sender.start()
    sent = drive(driver, bend(driver, -0.3), duration=1.0)
    ended.set()
    sender.join()
    for _ in driver.ticks(duration=40.0):  # the transport may be delayed by the flood
        reading, now = driver.read(), driver.clock.now()
        if abs(now - reading.joints.stamp) <= driver.gate.stale_after:
            break
    assert abs(now - reading.joints.stamp) <= driver.gate.stale_after
    assert sent.state is not GateState.STOP
    assert reading.joints.position.shape == (len(driver.robot.servos),)
    assert np.isfinite(reading.joints.position).all()
    for frame in reading.skin:
        assert frame.values.shape == (driver.robot.patch(frame.patch).channels,)
    assert psutil.Process().memory_info().rss - memory < 50e6


def test_an_unarmed_driver_reads_and_refuses_to_write(open_driver: Callable[..., Driver]) -> None:
    driver = open_driver(arm=False)
    joints = driver.read().joints
    with pytest.raises(DriverError, match="arm=True"):
        driver.write(driver.gate.step([], joints, driver.clock.now()))


def test_a_closed_driver_says_so_and_closes_twice(open_driver: Callable[..., Driver]) -> None:
    with open_driver(arm=False) as driver:
        pass
    driver.close()
    with pytest.raises(DriverError, match="closed"):
        driver.read()


def test_closing_leaves_nothing_behind(open_driver: Callable[..., Driver]) -> None:
    def use(driver: Driver) -> None:
        drive(driver, duration=0.1)

    # the first driver also opens objects that its library keeps for all drivers
    left_behind(open_driver, use, patience=0.0)
    assert not left_behind(open_driver, use)


@elsewhere
def test_43_a_commander_that_is_killed_leaves_a_robot_at_rest(
    peer: Peer, open_driver: Callable[..., Driver]
) -> None:
    with open_driver() as driver:
        assert drive_until(driver, lambda: abs(elbow(driver) + 1.2) < 0.03, bend(driver, -1.2))
    commander = peer.commander()
    try:
        assert commander.stdout is not None
        assert commander.stdout.readline() == "moving\n"
    finally:
        commander.kill()
        commander.communicate()
    with open_driver(arm=False) as driver:
        driver.clock.sleep_until(driver.clock.now() + 1.5 * SILENCE)
        there = elbow(driver)
        assert there < -0.5  # in motion for 11 s
        driver.clock.sleep_until(driver.clock.now() + 0.5)
        assert elbow(driver) == pytest.approx(there, abs=0.02)
    end = time.monotonic() + 10.0
    while True:  # a G1's motors are handed back gradually, and until then nobody else may command them
        with suppress(DriverError) if time.monotonic() < end else nullcontext(), open_driver():
            break


@elsewhere
def test_a_peer_that_is_killed_means_hold_and_closing_works(
    peer: Peer, open_driver: Callable[..., Driver]
) -> None:
    """This test must be the last one for each driver, because the other tests need the peer."""
    with open_driver() as driver:
        drive(driver, bend(driver, -0.3), duration=0.3)
        peer.kill()
        held = drive(driver, duration=10.0, until=lambda sent: sent.state is not GateState.RUN)
        assert held.state is not GateState.RUN
        drive(driver, duration=0.3)
