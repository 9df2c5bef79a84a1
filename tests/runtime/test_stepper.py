"""`Stepper`: equal to `run` where time waits, and safe beside any caller where it does not."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.wire_peers import Lcm, Peer
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import CommandError, DriverError, FrameError, TciError
from tci.gate.gate import GateState
from tci.messages import GenericCommand, Mode, Perception, Reading, SwitchMode
from tci.messages.clock import MonotonicClock
from tci.reasons import Code
from tci.recording.recorder import Recorder
from tci.robot.joint_map import generic_posture
from tci.runtime.loop import Tick, run
from tci.runtime.stepper import KEPT, Stepper
from tci.testing import FakeDriver

POKED = 0.8
"""Length [s] of a run with a touch, a withdrawal and the end of the touch."""
LATE = 0.2
"""Time [s] for which the callers of these tests stay away."""
TESTS = Path(__file__).parents[1]


def poked() -> SimulatedDriver:
    driver = SimulatedDriver(tci.load_robot("nao"))
    driver.world.finger.poke("left_forearm", 60)
    return driver


def ran() -> list[Tick]:
    ticks: list[Tick] = []
    with poked() as driver:
        run(driver, tci.WithdrawalReflex(), duration=POKED, observe=ticks.append)
    return ticks


@pytest.fixture(scope="module")
def as_run() -> list[Tick]:
    ticks = ran()
    assert any(len(tick.perception.contacts) for tick in ticks)
    assert any(tick.perception.ended for tick in ticks)
    assert any(tick.commands for tick in ticks)
    return ticks


def bits(seen: Perception) -> tuple[object, ...]:
    """Everything that a capability sees, as bytes."""
    contacts, skin = seen.contacts, seen.skin
    assert skin is not None
    return (
        seen.stamp,
        [array.tobytes() for array in seen.posture.values()],
        contacts.identity.tobytes(), contacts.force.tobytes(), contacts.area.tobytes(),
        seen.ended,
        skin.sequence.tobytes(), skin.active.tobytes(), skin.pressure.tobytes(),
    )  # fmt: skip


def followed(driver: Driver) -> tuple[list[Perception], list[bytes]]:
    """Steps a robot with the reflex for `POKED`, by hand; what it saw, and the positions that were sent."""
    reflex, seen, sent = tci.WithdrawalReflex(), list[Perception](), list[bytes]()
    with Stepper(driver) as stepper:
        memory = reflex.init(stepper.body)
        for count in range(round(POKED / driver.period)):
            perception = stepper.observe()
            orders, memory = reflex.step(memory, perception, stepper.body)
            if count % 100 == 0:
                time.sleep(0.02)  # a slow caller
            sent.append(stepper.act(orders).position.tobytes())
            seen.append(perception)
    return seen, sent


def test_what_a_stepper_sees_and_sends_is_what_a_run_does(as_run: list[Tick]) -> None:
    with poked() as driver:
        seen, sent = followed(driver)
    assert [bits(one) for one in seen] == [bits(tick.perception) for tick in as_run]
    assert sent == [tick.sent.position.tobytes() for tick in as_run]


def test_a_recording_is_stepped_as_it_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "poke.mcap"
    with poked() as driver, Recorder(path, driver.robot, period=driver.period) as recorder:
        run(
            driver, tci.WithdrawalReflex(), duration=POKED,
            observe=lambda tick: recorder.tick(tick.now, tick.reading, tick.commands, tick.sent),
        )  # fmt: skip
    with tci.connect("nao", f"replay:{path}") as replay:
        followed(replay)
        assert replay.compared > 100
        assert replay.different == []
    over = pytest.raises(DriverError, match="the recording of nao is over")
    with tci.connect("nao", f"replay:{path}") as replay, over, Stepper(replay) as stepper:
        while True:
            stepper.observe()


def test_skin_frames_between_two_steps_can_be_read(as_run: list[Tick]) -> None:
    seen: list[Perception] = []
    with poked() as driver, Stepper(driver, period=0.05) as stepper:
        count = round(0.05 / driver.period)
        for _ in range(round(POKED / 0.05)):
            seen += [stepper.observe(), *stepper.missed]
            stepper.act()
        assert (len(stepper.missed), stepper.lost) == (count - 1, 0)
    stamps = sorted(one.stamp for one in seen)
    assert stamps == [tick.now for tick in as_run][: len(stamps)]
    assert len(stamps) == 1 + (round(POKED / 0.05) - 1) * count


def test_what_a_caller_missed_is_kept_for_a_second_and_then_counted() -> None:
    with (
        SimulatedDriver(tci.load_robot("nao")) as driver,
        Stepper(driver, period=3.0) as stepper,
    ):
        stepper.observe()
        stepper.act()
        newest = stepper.observe()
        kept = [one.stamp for one in stepper.missed]
        assert kept == pytest.approx(np.arange(newest.stamp - KEPT, newest.stamp - 1e-9, driver.period))
        assert len(kept) + stepper.lost + 1 == round(3.0 / driver.period)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_robot_has_one_commander(elsewhere: bool) -> None:
    refused: list[str] = []

    def intrude(driver: Driver) -> None:
        for way in (
            lambda: Stepper(driver),
            lambda: run(driver, tci.WithdrawalReflex(), duration=0.1),
            lambda: driver.write(driver.gate.step((), driver.read().joints, driver.clock.now())),
            lambda: DriverWrapper(driver).write(driver.gate.step((), driver.read().joints, 0.0)),
        ):
            with pytest.raises(DriverError) as raised:
                way()
            refused.append(str(raised.value))

    with SimulatedDriver(tci.load_robot("nao")) as driver:
        with Stepper(driver) as stepper:
            stepper.observe()
            if elsewhere:
                thread = threading.Thread(target=intrude, args=[driver])
                thread.start()
                thread.join()
            else:
                intrude(driver)
            stepper.observe()
            stepper.act()
        assert len(refused) == 4
        assert all("nao is commanded by a Stepper (thread MainThread) already" in one for one in refused)
        run(driver, tci.WithdrawalReflex(), duration=0.1)
        driver.write(driver.gate.step((), driver.read().joints, driver.clock.now()))


def test_a_write_beside_a_run_is_refused_with_the_name_of_its_capability() -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver:
        joints = driver.read().joints

        def intrude(tick: Tick) -> None:
            driver.write(driver.gate.step((), joints, tick.now))

        with pytest.raises(DriverError, match=r"by the run of WithdrawalReflex \(thread MainThread\)"):
            run(driver, tci.WithdrawalReflex(), duration=0.1, observe=intrude)


def bend(angle: float) -> GenericCommand:
    return GenericCommand("left_arm", Mode.POSITION, np.array([0.0, 0.0, 0.0, angle, 0.0]))


def test_a_caller_who_only_looks_is_silent_after_its_patience() -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver:
        ticks: list[Tick] = []
        with Stepper(driver, patience=0.1, see=ticks.append) as stepper:
            stepper.observe()
            stepper.act(bend(1.0))
            for _ in range(round(0.5 / driver.period)):
                stepper.observe()
            held = [tick for tick in ticks if tick.sent.state is GateState.HOLD]
            assert {tick.sent.reason.code for tick in held if tick.sent.reason} == {Code.CALLER_SILENT}
            assert str(held[0].sent.reason).startswith("caller silent for 0.1")
            assert held[0].now == pytest.approx(0.1 + driver.period, abs=driver.period)
            assert not ticks[-1].sent.velocity.any()
            back = stepper.act(bend(1.0))
            assert (back.state, back.refusals) == (GateState.RUN, ())


def test_a_velocity_expires_although_the_patience_lasts_longer() -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver:
        ticks: list[Tick] = []
        with Stepper(driver, patience=2.0, see=ticks.append) as stepper:
            stepper.observe()
            stepper.act(SwitchMode("head", Mode.VELOCITY))
            stepper.observe()
            count = len(driver.robot.part("head").servos)
            stepper.act(GenericCommand("head", Mode.VELOCITY, np.full(count, 0.3)))
            given = ticks[-1].now
            for _ in range(round(0.5 / driver.period)):
                stepper.observe()
        fast = [tick.now - given for tick in ticks if np.abs(tick.sent.velocity).max(initial=0.0) > 0.25]
        assert 0.05 < max(fast) < 0.15
        assert not ticks[-1].sent.velocity.any()


@pytest.fixture
def usual_signals() -> Iterator[None]:
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("usual_signals")
def test_another_thread_may_close_a_stepper() -> None:
    with poked() as driver:
        stepper = Stepper(driver)
        give(stepper, bend(0.1))
        closing = threading.Thread(target=stepper.close)
        closing.start()
        closing.join()
        assert stepper.result().ended == "done"
        with driver.commanding():
            pass


@pytest.mark.usefixtures("usual_signals")
def test_sigterm_ends_the_program_at_once_only_when_no_stepper_is_open() -> None:
    with poked() as one, poked() as two:
        first, second = Stepper(one), Stepper(two)
        first.close()
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        second.close()
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.parametrize("failing", [False, True])
def test_a_loop_that_hangs_is_told_at_the_end(monkeypatch: pytest.MonkeyPatch, failing: bool) -> None:
    free, hangs, inside = threading.Event(), threading.Event(), threading.Event()

    class Hanging(FakeDriver):
        def _receive(self) -> Reading:
            if hangs.is_set():
                inside.set()
                free.wait(20.0)
            return super()._receive()

    for name in ("REST", "STUCK"):
        monkeypatch.setattr(f"tci.runtime.stepper.{name}", 0.1)
    driver = Hanging("nao", clock=MonotonicClock(), rate=100.0)
    stepper = Stepper(driver)
    try:
        stepper.observe()
        hangs.set()
        assert inside.wait(5.0)
        told = ""
        try:
            if failing:
                with stepper:
                    raise ValueError("of the caller")
            stepper.close()
        except ValueError as error:
            told = "".join(error.__notes__)
        except DriverError as error:
            told = str(error)
        assert "may not be at rest" in told
        assert "valid: the robot's own stop" in told
    finally:
        free.set()


def test_what_does_not_fit_is_told() -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver:
        with pytest.raises(TciError, match="period 0 s; valid: above 0"):
            Stepper(driver, period=0)
        with pytest.raises(TciError, match=r"patience 0.1 s; valid: at least the period"):
            Stepper(driver, period=0.2, patience=0.1)
        with pytest.raises(TciError, match="Stepper: the word 'nao' in place of the connection"):
            Stepper("nao")
        stepper = Stepper(driver)
        with pytest.raises(CommandError, match="act returned the word 'left'"):
            stepper.act(["left"])
        stepper.close()
        for call in (stepper.observe, stepper.act):
            with pytest.raises(DriverError, match="this Stepper is closed"):
                call()


def test_frames_that_never_fit_are_an_error_and_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver, Stepper(driver) as stepper:
        stepper.observe()
        receive = driver._receive

        def damaged() -> Reading:
            reading = receive()
            return replace(reading, skin=tuple(replace(one, values=one.values[:3]) for one in reading.skin))

        monkeypatch.setattr(driver, "_receive", damaged)
        with pytest.raises(FrameError):  # noqa: PT012 - between two frames, nothing is wrong
            for _ in range(1000):
                stepper.observe()
        assert driver.gate.state is GateState.STOP


def failing(stepper: Stepper) -> None:
    for _ in range(20):
        stepper.observe()
        moving = stepper.act(bend(1.0))
    assert moving.velocity.any()
    raise ZeroDivisionError("in the caller")


def test_an_error_of_the_caller_leaves_the_robot_at_rest() -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver:
        with pytest.raises(ZeroDivisionError), Stepper(driver) as stepper:
            failing(stepper)
        assert "ZeroDivisionError: in the caller" in str(driver.gate.reason)
        assert driver.clock.now() < 20 * driver.period + 0.5
        driver.world.advance(driver.clock.now() + 0.3)  # the servos reach the last set-point
        assert np.abs(driver.world.joints().velocity).max() < 0.01


# Over a wire: the clock runs by itself.


@pytest.fixture(scope="module")
def peer() -> Iterator[Peer]:
    peer = Lcm()
    peer.start()
    yield peer
    peer.stop()


@pytest.fixture
def distant(peer: Peer) -> Iterator[Driver]:
    with peer.open(arm=True) as driver:
        yield driver


def asleep() -> None:
    time.sleep(LATE)


def busy() -> None:
    end = time.monotonic() + LATE
    while time.monotonic() < end:
        sum(range(100))


def locked() -> None:
    """Calls C and keeps the interpreter's lock."""
    ctypes.PyDLL(None).usleep(round(1e6 * LATE))


def no_jumps(driver: Driver, ticks: list[Tick]) -> None:
    """Asserts that the set-points of one motion keep the speed limits from each command to the next, and the
    measured joints over all of it.

    A hold of this process sends no set-point: it asks the robot's process, whose gate brakes, and the next
    motion begins where that gate is. Only the measured joints tell whether the robot jumped there.
    """
    fastest = np.array([servo.limits.velocity or np.inf for servo in driver.robot.servos])
    for before, after in pairwise(ticks):
        held = before.sent.state is not GateState.RUN
        if not held and before.sent.servos.tolist() == after.sent.servos.tolist():
            way = np.abs(after.sent.position - before.sent.position)
            assert (way <= 1.001 * fastest[after.sent.servos] * driver.period + 1e-9).all()
        joints = [tick.reading.joints for tick in (before, after)]
        way = np.abs(joints[1].position - joints[0].position)
        # stamps are known to a fraction of a period
        longest = max(0.0, joints[1].stamp - joints[0].stamp) + 0.4 * driver.period
        assert (way <= 1.02 * fastest * longest + 1e-9).all()


def late_calls(driver: Driver, call: Callable[[], None]) -> tuple[list[Tick], list[int]]:
    """Steps a robot with a caller who makes `call` after each step. Returns the periods, and how many of them
    began in each call."""
    ticks: list[Tick] = []
    during: list[int] = []
    read: list[Perception] = []
    with Stepper(driver, see=ticks.append) as stepper:
        for number in range(6):
            read += [stepper.observe(), *stepper.missed]
            stepper.act(bend((0.3, 1.0)[number % 2]))
            begin, before = time.monotonic(), len(ticks)
            call()
            end = time.monotonic()
            during.append(sum(begin < tick.now < end for tick in ticks[before:]))
        newest = stepper.observe()
        read += [newest, *stepper.missed]
        assert stepper.lost == 0
    assert {one.stamp for one in read} == {tick.now for tick in ticks if tick.now <= newest.stamp}
    return ticks, during


@pytest.mark.parametrize("call", [asleep, busy])
def test_the_robot_goes_on_beside_a_caller_who_is(call: Callable[[], None], distant: Driver) -> None:
    ticks, during = late_calls(distant, call)
    no_jumps(distant, ticks)
    assert np.median(during) > 0.15 * LATE / distant.period
    assert not any(tick.sent.reason and tick.sent.reason.code is Code.CALLER_SILENT for tick in ticks)
    assert np.ptp([tick.reading.joints.position for tick in ticks], axis=0).max() > 0.1


def test_a_caller_who_keeps_the_interpreters_lock_holds_the_robot(distant: Driver) -> None:
    ticks, during = late_calls(distant, locked)
    assert max(during) <= 3
    no_jumps(distant, ticks)
    gaps = np.flatnonzero(np.diff([tick.now for tick in ticks]) > 0.9 * LATE)
    assert len(gaps) >= 5
    for gap in gaps:
        after = ticks[gap + 1].sent
        assert after.state is GateState.HOLD
        assert after.reason is not None
        assert after.reason.code in (Code.PERIODS_MISSED, Code.JOINTS_STALE)


def give(stepper: Stepper, order: GenericCommand) -> None:
    """Repeats an order until no hold refuses it: on a busy machine periods are missed."""
    wait_until(lambda: not stepper.act(order).refusals)


def forever(stepper: Stepper) -> None:
    while True:
        stepper.observe()
        stepper.act()


def said(words: str, ticks: list[Tick]) -> bool:
    return any(words in str(tick.sent.reason) for tick in [*ticks])


def resting(ticks: list[Tick]) -> bool:
    return len(ticks) > 0 and not ticks[-1].sent.velocity.any()


def wait_until(done: Callable[[], bool], longest: float = 10.0) -> None:
    end = time.monotonic() + longest
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_caller_who_never_comes_back_leaves_the_robot_at_rest(distant: Driver) -> None:
    ticks: list[Tick] = []
    with Stepper(distant, see=ticks.append, patience=0.1) as stepper:
        give(stepper, bend(0.1))
        wait_until(lambda: said("caller silent for 0.1", ticks) and resting(ticks))
        assert any(np.abs(tick.sent.velocity).max(initial=0.0) > 0.05 for tick in ticks)
        no_jumps(distant, ticks)
        give(stepper, bend(1.4))  # it came back
        stepper.act()
        assert ticks[-1].sent.velocity.any()
        no_jumps(distant, ticks)


def test_a_thread_that_ends_leaves_the_robot_at_rest(distant: Driver) -> None:
    ticks: list[Tick] = []
    stepper = Stepper(distant, see=ticks.append, patience=60.0)

    def call() -> None:
        for _ in range(20):
            stepper.observe()
            stepper.act(bend(1.4))

    with stepper:
        thread = threading.Thread(target=call, name="short-lived")
        thread.start()
        thread.join()
        said_so = partial(said, "caller silent: its thread short-lived has ended", ticks)
        wait_until(lambda: said_so() and resting(ticks))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_fails_ends_the_stepper(distant: Driver) -> None:
    ticks: list[Tick] = []
    stepper = Stepper(distant, see=ticks.append)

    def call() -> None:
        stepper.observe()
        stepper.act(bend(1.4))
        time.sleep(0.1)
        raise ZeroDivisionError("in the caller")

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    with pytest.raises(ZeroDivisionError):
        forever(stepper)
    with pytest.raises(DriverError, match="has ended; valid: a new one"):
        stepper.act()
    stepper.close()
    assert distant.gate.state is GateState.STOP
    assert not distant.gate.step((), distant.read().joints, distant.clock.now()).velocity.any()


def test_an_error_of_the_loop_comes_to_the_caller(distant: Driver) -> None:
    count = 0

    def see(tick: Tick) -> None:
        nonlocal count
        count += 1
        if count == 20:
            raise ZeroDivisionError("in see")

    with pytest.raises(ZeroDivisionError, match="in see"), Stepper(distant, see=see) as stepper:
        forever(stepper)
    count = 10
    stepper = Stepper(distant, see=see)
    wait_until(lambda: count == 20)
    with pytest.raises(ZeroDivisionError, match="in see"):
        stepper.close()


PROGRAM = """
import sys, time
import numpy as np, tci
from helpers.patient import patient

def send(safe):
    sys.stdout.write(f"{np.abs(safe.velocity).max(initial=0.0)}\\n")
    sys.stdout.flush()
    sent(safe)

driver = tci.connect(patient("nao", 0.5), sys.argv[1], arm=True)
sent, driver._send = driver._send, send
stepper = tci.Stepper(driver, patience=60.0)
stepper.observe()
order = tci.GenericCommand("left_arm", "position", np.array([0, 0, 0, float(sys.argv[2]), 0]))
while stepper.act(order).refusals:
    pass
time.sleep(0.2)
sys.stdout.write("now\\n")
sys.stdout.flush()
"""


@pytest.mark.parametrize(
    ("last", "status"), [("", 0), ("sys.exit(3)", 3), ("with stepper: time.sleep(60)", 128 + signal.SIGTERM)]
)
def test_a_program_that_ends_leaves_the_robot_at_rest(
    peer: Peer, distant: Driver, last: str, status: int
) -> None:
    assert isinstance(peer, Lcm)
    bent = generic_posture(distant.robot, distant.read().joints)["left_arm"][3]
    distant.close()
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM + last, peer.driver_via, "1.4" if bent < 0.7 else "0.1"],
        stdout=subprocess.PIPE, text=True, cwd=TESTS,
    )  # fmt: skip
    assert program.stdout is not None
    speeds: list[float] = []
    for line in program.stdout:
        if line != "now\n":
            speeds.append(float(line))
        elif "sleep" in last:
            program.terminate()
    assert program.wait(30) == status
    assert max(speeds) > 0.05
    assert speeds[-1] == 0.0
