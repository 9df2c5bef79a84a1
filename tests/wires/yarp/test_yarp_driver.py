"""The driver of a robot on YARP: refusals, joints that the driver does not command, and the reflex over
YARP."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.patient import patient
from helpers.wire_peers import free_port
from helpers.yarp_show import Show, until
from tci.body.places import Place, find_place
from tci.body.posture import home, to_platform
from tci.capabilities.fields import default_fields
from tci.drivers.diagnosis import Level
from tci.errors import DriverError, UnknownNameError
from tci.gate.gate import GateState, SafeCommand
from tci.lab.commissioning.doctor import judge
from tci.lab.commissioning.streams import observe
from tci.messages import Mode, Order, PlatformCommand, PlatformOrder, PlatformSwitch, SwitchMode
from tci.messages.frames import Array
from tci.robot.description import GenericPart, Limits, Robot
from tci.robot.joint_map import initial_position
from tci.runtime.loop import Tick
from tci.skin.skin import Skin
from tci.wires.yarp import driver as yarp_driver
from tci.wires.yarp.board_driver import BoardDriver
from tci.wires.yarp.driver import YarpDriver
from yarpwire.board import Stream
from yarpwire.dialect import DIALECTS, V3, V4
from yarpwire.errors import CallError
from yarpwire.name_server import NameServer
from yarpwire.names import Names

PATIENCE = 5
"""Number of pokes until the reflex responds to one. On a busy machine the gate sometimes holds the robot."""


@pytest.fixture(scope="module", params=["nao 3", "icub 4"])
def show(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Show]:
    robot, dialect = request.param.split()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YARP_CONFIG_HOME", str(tmp_path_factory.mktemp("yarp")))
        running = Show(DIALECTS[dialect], robot)
        yield running
        running.close()


def where(show: Show) -> str:
    return "{}:{}".format(*show.names.address)


def driver_to(show: Show, robot: Robot | None = None, options: str = "", *, arm: bool = True) -> YarpDriver:
    return YarpDriver(robot or patient(show.driver.robot.name), where(show) + options, arm=arm)


def test_the_dialect_is_probed_and_the_wrong_one_is_refused(show: Show) -> None:
    other = V4 if show.dialect is V3 else V3
    with driver_to(show) as driver:
        assert driver.dialect is show.dialect
        assert driver.read().joints.torque is not None
    with pytest.raises(DriverError, match=f"of YARP {other.name}"):
        driver_to(show, options=f",dialect={other.name}")


def bring_home(driver: YarpDriver, part: GenericPart) -> None:
    """Moves a part to its initial posture. Repeats the order if a busy machine stops the motion."""
    servos = [servo.servo for servo in part.servos if servo.servo is not None]
    wanted = initial_position(driver.robot)[servos]
    for _ in range(4 * PATIENCE):
        orders = [to_platform(driver.robot, command) for command in home(part)]
        for now in driver.ticks(duration=2.0):
            joints = driver.read().joints
            sent = driver.write(driver.gate.step(orders, joints, now))
            if sent.state is GateState.RUN and np.abs(joints.position[servos] - wanted).max() < 0.02:
                return
            orders = []
        if driver.gate.state is GateState.STOP:
            driver.gate.reset()
    raise AssertionError(f"{part.name} does not reach its initial posture")


def test_the_reflex_withdraws_the_arm_over_yarp_and_touches_nothing_else(show: Show) -> None:
    """The setting of the paper: robot and reflex run in two loops that are connected only by YARP."""
    robot = show.driver.robot
    world = show.driver.world
    arm = next(part for part in robot.parts if part.name == "left_arm")
    mapped = {servo.servo for servo in arm.servos if servo.servo is not None}
    ordered: set[int] = set()
    take = show.server.orders

    def orders() -> object:
        found = take()
        for order in found:
            assert isinstance(order, PlatformCommand) or hasattr(order, "servos")
            ordered.update(order.servos.tolist())
        return found

    show.server.orders = orders
    reflex, site = tci.WithdrawalReflex(), default_fields()[0]
    told: list[object] = []
    for _ in range(PATIENCE):
        seen: list[Tick] = []
        world.finger.retire()  # a finger that still presses would be included in the rest values of the skin
        with driver_to(show) as driver:
            bring_home(driver, arm)  # an arm that has withdrawn has no room for another withdrawal
            joints = world.joints()
            place = find_place(Skin(robot), "left_arm", site.segment, site.u, site.theta, joints)

            def observe(tick: Tick, place: Place = place, seen: list[Tick] = seen) -> None:
                if len(seen) == 50:
                    world.finger.poke(place.patch, place.p_L, place.n_L, speed=0.25, depth=0.01, gap=0.05)
                seen.append(tick)

            tci.run(driver, reflex, duration=2.0, observe=observe)
        begun = seen[0].reading.joints.position
        path = np.array([tick.reading.joints.position - begun for tick in seen])
        away = np.rad2deg(np.abs(path).max(axis=0))
        told.append((away[list(mapped)].max(), {str(tick.sent.reason) for tick in seen}))
        if away[list(mapped)].max() > 5.0 and driver.gate.state is not GateState.STOP:
            break
    else:
        raise AssertionError(f"the arm does not withdraw: {told}")
    assert max(len(tick.perception.contacts) for tick in seen) > 0
    both = {s.servo for part in robot.parts if part.kind == "arm" for s in part.servos if s.servo is not None}
    assert ordered
    assert ordered <= both
    show.server.orders = take


def test_modes_are_switched_by_order_and_reported(show: Show) -> None:
    part = show.driver.robot.parts[0].name
    servos = [servo.servo for servo in show.driver.robot.part(part).servos if servo.servo is not None]
    if not all(Mode.VELOCITY in show.driver.robot.servos[servo].modes for servo in servos):
        pytest.skip("did not run: this robot has no velocity mode")
    with driver_to(show) as driver:
        for mode in (Mode.VELOCITY, Mode.POSITION):
            body = tci.GenericBody(driver.robot)
            pending, _ = body.to_platform((SwitchMode(part, mode),), driver.read().joints)
            end = time.monotonic() + 20
            reported: set[object] = set()
            for now in driver.ticks():
                joints = driver.read().joints
                sent = driver.write(driver.gate.step(pending, joints, now))
                pending = pending if sent.refusals else []
                assert joints.modes is not None
                reported = {joints.modes[servo] for servo in servos}
                if reported == {mode} or time.monotonic() > end:
                    break
            assert reported == {mode}


def test_set_points_are_ahead_on_the_way_that_the_gate_planned_and_end_where_it_ends(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[float] = []
    stream_on = BoardDriver._stream

    def note(board: BoardDriver, stream: Stream, joints: Sequence[int], values: Array) -> None:
        sent.append(float(np.deg2rad(values[0])))
        stream_on(board, stream, joints, values)

    monkeypatch.setattr(BoardDriver, "_stream", note)
    with driver_to(show) as driver:
        elbow = next(servo for servo in driver.robot.servos if "elbow" in servo.name.lower())
        start = float(driver.read().joints.position[elbow.index])
        way = 0.1 * np.sign(np.mean([elbow.limits.lower, elbow.limits.upper]) - start)
        order = PlatformCommand(
            Mode.POSITION, np.array([elbow.index]), np.array([start + way]), np.array([np.inf])
        )
        planned, sent[:] = [start], [start]
        for now in driver.ticks(duration=60.0):
            first = [order] if len(planned) == 1 else []
            safe = driver.write(driver.gate.step(first, driver.read().joints, now))
            if safe.reason:  # the gate holds, and the robot starts again
                planned, sent[:] = [start], [start]
            elif len(sent) > len(planned):
                planned.append(float(safe.position[0]))
            if abs(planned[-1] - start - way) < 1e-9:
                break
    done, told = (np.array(planned) - start) / way, (np.array(sent) - start)[: len(planned)] / way
    moving = (done > 0.01) & (done < 0.9)
    assert moving.any()
    assert np.all(told[moving] > done[moving])
    assert np.all(np.diff(told) > -1e-9)
    assert told.max() <= 1.0 + 1e-9
    assert told[-1] == pytest.approx(1.0)


def test_a_board_that_refuses_a_mode_for_a_moment_means_hold_and_one_that_goes_on_is_an_error(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    servo = show.driver.robot.servos[show.driver.robot.part("left_arm").servos[0].servo]
    board = show.server.boards[servo.robot_part]
    left, take = [5], board.set_modes

    def refuse(joints: Sequence[int] | None, words: Sequence[int]) -> None:
        left[0] -= 1
        if left[0] >= 0:
            raise CallError("the gate holds")
        take(joints, words)

    monkeypatch.setattr(board, "set_modes", refuse)
    with driver_to(show) as driver:
        here = float(driver.read().joints.position[servo.index])
        orders = [driver.native(servo.robot_part).command({servo.name: here})]
        told: list[str] = []

        def step() -> GateState:
            sent = driver.write(driver.gate.step(orders, driver.read().joints, driver.clock.now()))
            told.append(str(sent.reason))
            time.sleep(driver.period)
            return sent.state

        assert until(lambda: step() is GateState.HOLD and "refuses" in told[-1])
        assert until(lambda: step() is GateState.RUN and left[0] < 0)
    monkeypatch.setattr(yarp_driver, "REFUSED", 0.1)
    left[0] = 1_000_000
    with driver_to(show) as driver, pytest.raises(DriverError, match=r"refuses.*tci doctor"):
        until(lambda: step() is None)


def test_28_a_board_that_goes_away_means_hold_and_the_arm_goes_on_when_it_is_back(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    servo = show.driver.robot.servos[show.driver.robot.part("left_arm").servos[-1].servo]
    work: list[Callable[[str], None]] = []
    take = show.server.orders

    def orders() -> Sequence[Order]:
        while work:
            work.pop()(servo.robot_part)
        return take()

    monkeypatch.setattr(show.server, "orders", orders)
    with driver_to(show) as driver:
        arm = driver.native(servo.robot_part)
        here = float(driver.read().joints.position[servo.index])

        def step(angle: float) -> GateState:
            order = arm.command({servo.name: angle})
            sent = driver.write(driver.gate.step([order], driver.read().joints, driver.clock.now()))
            time.sleep(driver.period)
            return sent.state

        def is_at(angle: float) -> bool:
            step(angle)
            return abs(float(driver.read().joints.position[servo.index]) - angle) < 0.01

        low, high = servo.limits.lower or 0.0, servo.limits.upper or 0.0
        there = here + np.copysign(0.1, (low + high) / 2 - here)
        assert until(lambda: is_at(there))
        work.append(show.server.close_board)
        assert until(lambda: step(there) is GateState.HOLD)
        work.append(show.server.open_board)
        assert until(lambda: step(there) is GateState.RUN)
        assert until(lambda: is_at(here))


def test_what_the_description_says_otherwise_is_told(show: Show) -> None:
    robot = patient(show.driver.robot.name)
    servo = next(s for s in robot.servos if s.limits.upper is not None)
    wider = Limits(**{**servo.limits.model_dump(), "upper": servo.limits.upper + 0.3})
    renamed = servo.model_copy(update={"limits": wider, "name": "somebody_else"})
    robot = robot.model_copy(update={"servos": tuple(renamed if s is servo else s for s in robot.servos)})
    with driver_to(show, robot, arm=False) as driver:
        found = {finding.subject: finding for finding in driver.diagnose() if finding.level is not Level.OK}
    assert found["somebody_else"].level is Level.WARNING
    assert "the board allows" in found["somebody_else"].what
    good = YarpDriver.probe(show.driver.robot, where(show))
    assert {finding.level for finding in good} == {Level.OK}
    assert YarpDriver.probe(show.driver.robot, "127.0.0.1:9")[-1].level is Level.FAULT


def test_swapped_names_are_followed_by_name(show: Show) -> None:
    """The names of two servos are kept and their ids are swapped. The driver uses the board's names, not the
    ids."""
    robot = patient(show.driver.robot.name)
    part = robot.servos[-1].robot_part
    first, second = robot.servos_of(part)[:2]
    ids = {first.index: second.id, second.index: first.id}
    swapped = tuple(s.model_copy(update={"id": ids.get(s.index, s.id)}) for s in robot.servos)
    with (
        driver_to(show, robot, arm=False) as right,
        driver_to(show, robot.model_copy(update={"servos": swapped}), arm=False) as driver,
    ):
        np.testing.assert_allclose(
            driver.read().joints.position, right.read().joints.position, atol=0.02, equal_nan=True
        )


def test_a_patch_of_another_length_is_refused_at_once_and_can_be_left_out(show: Show) -> None:
    robot = patient(show.driver.robot.name)
    patch = next(patch for patch in robot.patches if patch.name == "left_forearm")
    longer = patch.model_copy(update={"channels": patch.channels + 12})
    robot = robot.model_copy(
        update={"patches": tuple(longer if one is patch else one for one in robot.patches)}
    )
    with pytest.raises(DriverError, match=rf"{patch.channels} values.*without="):
        driver_to(show, robot)
    with driver_to(show, robot, f",without={patch.name}") as driver:
        assert patch.name not in {frame.patch for frame in driver.read().skin}
        found = judge(driver, observe(driver, 0.3))
    assert [one.level for one in found if one.subject == patch.name] == [Level.NOTE]
    assert Level.FAULT not in {one.level for one in found}, "run works, so doctor ends well"


def test_a_board_whose_names_are_all_foreign_is_a_warning(show: Show) -> None:
    robot = patient(show.driver.robot.name)
    part = robot.servos[-1].robot_part
    servos = tuple(
        one.model_copy(update={"name": f"foreign_{one.name}"}) if one.robot_part == part else one
        for one in robot.servos
    )
    with driver_to(show, robot.model_copy(update={"servos": servos}), arm=False) as driver:
        (told,) = [one for one in driver.diagnose() if "none of its" in one.what]
    assert (told.subject, told.level) == (part, Level.WARNING)


def test_compensated_skin_reads_like_raw_skin(show: Show) -> None:
    with driver_to(show, options=",skin=comp", arm=False) as comp, driver_to(show, arm=False) as raw:

        def same() -> bool:
            frames = zip(comp.read().skin, raw.read().skin, strict=True)
            return all(np.abs(one.values - other.values).max() <= 3.0 for one, other in frames)

        assert until(same)


def test_skin_events_are_read(show: Show) -> None:
    with driver_to(show, arm=False) as driver:
        assert isinstance(driver.skin_events(), tuple)


def test_a_robot_that_is_not_there_is_a_clear_error(show: Show) -> None:
    with pytest.raises(DriverError, match="nobody"):
        driver_to(show, options=",robot=nobody")
    with pytest.raises(UnknownNameError, match=r"LArm|left_arm"):
        show.driver.native("Tail")


def test_29_the_name_server_restarts_and_data_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    address = ("127.0.0.1", free_port())
    first = NameServer(*address)
    show = Show(V3, where="{}:{}".format(*address))
    try:
        with driver_to(show, arm=False) as driver:
            first.close()
            before = driver.read().joints.sequence
            assert until(lambda: driver.read().joints.sequence > before + 20)
            assert abs(driver.clock.now() - driver.read().joints.stamp) < 1.0
            with NameServer(*address):
                assert until(lambda: any(c.name.startswith("/tci/") for c in Names(address).list()))
                assert until(lambda: any(c.name.startswith("/nao/") for c in Names(address).list()))
    finally:
        show.close()


def test_28_34_a_robot_that_starts_again_is_found_again_and_nothing_jumps(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    address = f"127.0.0.1:{free_port()}"
    show = Show(V3, where=address)
    again: Show | None = None
    try:
        with driver_to(show) as driver:
            arm = driver.native("LArm")
            elbow = next(servo.index for servo in arm.servos if servo.name == "LElbowRoll")

            def step(*orders: PlatformCommand) -> GateState:
                sent = driver.write(driver.gate.step(orders, driver.read().joints, driver.clock.now()))
                time.sleep(driver.period)
                return sent.state

            assert until(lambda: step(arm.command({"LElbowRoll": -0.4})) is GateState.RUN)
            assert until(lambda: step() is GateState.RUN and driver.read().joints.position[elbow] > -0.7)
            show.close()
            assert until(lambda: step() is GateState.HOLD)
            again = Show(V3, where=address)
            assert until(lambda: step() is GateState.RUN)
            there = again.driver.world.joints().position[elbow]
            for _ in range(100):
                step()
            assert again.driver.world.joints().position[elbow] == pytest.approx(there, abs=0.02)
            assert until(lambda: step(arm.command({"LElbowRoll": -1.3})) is GateState.RUN)
            assert until(lambda: step() is GateState.RUN and driver.read().joints.position[elbow] < -1.2)
    finally:
        for one in (show, again):
            if one is not None:
                one.close()


def test_28_a_board_whose_state_stays_away_is_sent_torques_until_they_have_ended(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The board may still receive commands. A joint in torque mode keeps its last torque."""
    elbow = next(servo for servo in show.driver.robot.servos if "elbow" in servo.name.lower())
    if Mode.TORQUE not in elbow.modes:
        pytest.skip("did not run: this robot has no torque mode")
    torques: list[float] = []
    stream_on, state_of = BoardDriver._stream, BoardDriver.state

    def note(board: BoardDriver, stream: Stream, joints: Sequence[int], values: Array) -> None:
        if stream is Stream.TORQUE:
            torques.append(float(values[0]))
        stream_on(board, stream, joints, values)

    monkeypatch.setattr(BoardDriver, "_stream", note)
    with driver_to(show) as driver:
        index = np.array([elbow.index])

        def step(*orders: PlatformOrder) -> SafeCommand:
            safe = driver.write(driver.gate.step(orders, driver.read().joints, driver.clock.now()))
            time.sleep(driver.period)
            return safe

        def pushes() -> bool:
            step(PlatformCommand(Mode.TORQUE, index, np.array([1.0]), np.ones(1)))
            return bool(torques) and torques[-1] > 0.5

        assert until(lambda: step(PlatformSwitch(index, Mode.TORQUE)).modes == (Mode.TORQUE,))
        assert until(pushes)
        board = driver.boards[elbow.robot_part]
        last = state_of(board)
        monkeypatch.setattr(BoardDriver, "state", lambda b, at=None: last if b is board else state_of(b, at))
        assert until(lambda: step().state is GateState.HOLD)
        for _ in range(5):
            step()
        assert torques[-1] == 0.0
        monkeypatch.undo()
        assert until(lambda: step(PlatformSwitch(index, Mode.POSITION)).modes == (Mode.POSITION,))
