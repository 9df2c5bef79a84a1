"""A robot served as YARP control boards and skin ports, commanded through real sockets."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tci
from helpers.wire_peers import free_port
from helpers.yarp_show import Show, until
from tci.body.places import find_place
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError
from tci.exports.facts import query
from tci.lab.authoring.dense_skin import with_skin_rate
from tci.messages import Mode, PlatformCommand, PlatformSwitch
from tci.reasons import Code, Reason
from tci.runtime.serve import serve
from tci.skin.skin import Skin
from tci.wires.yarp import served_board, server
from tci.wires.yarp.facts import read_robot_facts
from tci.wires.yarp.served_board import ServedBoard
from tci.wires.yarp.server import YarpServer
from tci.wires.yarp.skin_events import decode_events
from yarpwire import names
from yarpwire.board import COMPLIANT, DIRECT, POSITION, VELOCITY, Stream, find_board
from yarpwire.carrier import TEXT
from yarpwire.dialect import DIALECTS, V3, V4
from yarpwire.errors import CallError, PortError
from yarpwire.incoming import Delivery
from yarpwire.name_server import NameServer
from yarpwire.names import Names
from yarpwire.port import Port
from yarpwire.rpc import Rpc
from yarpwire.state import decode_state
from yarpwire.values import Vocab

ELBOW = 3


@pytest.fixture(scope="module", params=list(DIALECTS))
def show(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Show]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YARP_CONFIG_HOME", str(tmp_path_factory.mktemp("yarp")))
        running = Show(DIALECTS[request.param])
        yield running
        running.close()


def insist(act: Callable[[], object]) -> None:
    """Repeats an action while the gate holds because a busy machine missed periods."""
    for _ in range(40):
        try:
            act()
            return
        except PortError:
            time.sleep(0.25)
    act()


def elbow(show: Show) -> float:
    return float(show.server.boards["LArm"].state.position[ELBOW])


def speed(show: Show) -> float:
    velocity = show.server.boards["LArm"].state.velocity
    assert velocity is not None
    return abs(float(velocity[ELBOW]))


def test_every_part_is_a_board_with_its_joints_names_and_limits(show: Show) -> None:
    robot = show.driver.robot
    for part in ("LArm", "RArm", "Head"):
        board = find_board(show.network, f"/nao/{part}", "/test/calls")
        assert board.dialect is show.dialect
        servos = robot.servos_of(part)
        assert board.axes() == len(servos)
        assert [board.name(number) for number in range(len(servos))] == [servo.name for servo in servos]
        for number, servo in enumerate(servos):
            if servo.limits.lower is not None:
                found = board.limits(number)
                assert found.lower == pytest.approx(np.rad2deg(servo.limits.lower))
        with pytest.raises(PortError, match="refuses"):
            board.limits(99)
        board.close()


def _words(*items: object) -> list[object]:
    return [Vocab(item) if isinstance(item, str) else item for item in items]


def test_positions_by_call(show: Show) -> None:
    port = find_board(show.network, "/nao/LArm", "/x").port
    rpc = Rpc(show.names.query(f"/nao/LArm{port}"), "/test/pos", show.dialect)
    calls, done = {
        V3: ([_words("set", "vel", ELBOW, 100.0), _words("set", "pos", ELBOW, -50.0)], _words("get", "dons")),
        V4: (
            [["setTrajSpeedOneRPC", ELBOW, 100.0], ["positionMoveOneRPC", ELBOW, -50.0]],
            ["checkMotionDoneAllRPC"],
        ),
    }[show.dialect]
    for call in calls:
        assert until(lambda call=call: rpc.call(*call) == [Vocab("ok")])
    assert until(lambda: abs(elbow(show) + 50.0) < 0.5)
    assert until(lambda: rpc.call(*done)[2 if show.dialect is V3 else 1] in (1, Vocab("ok")))
    refused = rpc.call("nonsense") if show.dialect is V4 else rpc.call(Vocab("set"), Vocab("pos"), 99, 0.0)
    assert refused == [Vocab("fail")]
    rpc.close()


def test_a_mode_that_was_just_set_is_read_back(show: Show) -> None:
    board = find_board(show.network, "/nao/LArm", "/test/read_back")
    for mode in (DIRECT, POSITION) * 5:
        insist(lambda mode=mode: board.set_modes([ELBOW], mode))
        modes = show.server.boards["LArm"].state.modes
        assert modes is not None
        assert modes[ELBOW] == mode
    board.close()


def test_streamed_groups_move_their_joints_and_no_other(show: Show) -> None:
    board = find_board(show.network, "/nao/LArm", "/test/modes")
    insist(lambda: board.set_modes([ELBOW], DIRECT))
    writer = Port("/test/command:o", show.names, show.dialect)
    writer.connect("/nao/LArm/command:i")
    before = show.server.boards["LArm"].state.position.copy()

    def there() -> bool:
        writer.write(board.command(Stream.POSITION, [ELBOW], np.array([-70.0])))
        return abs(elbow(show) + 70.0) < 0.5

    assert until(there)
    moved = np.abs(show.server.boards["LArm"].state.position - before) > 0.5
    assert moved.nonzero()[0].tolist() == [ELBOW]
    refused = show.server.refused
    writer.write(board.command(Stream.VELOCITY, [ELBOW], np.array([10.0])))
    assert until(lambda: show.server.refused == refused + 1)
    assert "needs [vel]" in show.server.last_error
    insist(lambda: board.set_modes([ELBOW], POSITION))
    writer.close()
    board.close()


def test_a_commander_of_velocities_that_falls_silent_leaves_the_arm_at_rest(show: Show) -> None:
    board = find_board(show.network, "/nao/LArm", "/test/velocity")
    assert until(lambda: speed(show) < 0.01)
    insist(lambda: board.set_modes([ELBOW], VELOCITY))
    writer = Port("/test/velocity:o", show.names, show.dialect)
    writer.connect("/nao/LArm/command:i")
    begun = elbow(show)

    def moves() -> bool:
        writer.write(board.command(Stream.VELOCITY, [ELBOW], np.array([30.0])))
        return elbow(show) > begun + 5.0

    assert until(moves)
    assert until(lambda: speed(show) < 0.01)
    rest = elbow(show)
    time.sleep(0.3)
    assert elbow(show) == pytest.approx(rest, abs=0.5)
    insist(lambda: board.set_modes([ELBOW], POSITION))
    writer.close()
    board.close()


def test_a_mode_that_the_gate_refuses_is_refused_on_the_wire(show: Show) -> None:
    board = find_board(show.network, "/nao/LArm", "/test/refused")
    with pytest.raises(PortError, match="refuses"):
        board.set_modes([ELBOW], Vocab("ipwm"))
    with pytest.raises(PortError, match="refuses"):
        board.set_interaction(ELBOW, Vocab("soft"))
    board.close()


def test_a_board_whose_change_of_mode_was_refused_is_in_the_mode_from_before() -> None:
    board = ServedBoard("LArm", tci.load_robot("nao").servos_of("LArm"))
    board.set_modes(None, [DIRECT] * board.count)
    board.book.take()
    board.book.judge([], [Reason(Code.GATE_CLOSED, "hold: joint data is old")])
    with pytest.raises(CallError, match=r"is in \[pos\]"):
        board.stream(Stream.POSITION, [ELBOW], [10.0])
    board.set_modes([ELBOW], [DIRECT])
    board.book.judge(board.book.take(), [])
    board.stream(Stream.POSITION, [ELBOW], [10.0])
    board.armed = False
    with pytest.raises(CallError, match="read-only"):
        board.set_modes([ELBOW], [POSITION])
    board.armed = True
    board.stream(Stream.POSITION, [ELBOW], [10.0])


def test_a_move_is_cut_to_the_range_and_done_when_it_is_there() -> None:
    board = ServedBoard("LArm", tci.load_robot("nao").servos_of("LArm"))
    board.move([ELBOW], [1000.0])
    (order,) = board.book.take()
    limits = board.servos[ELBOW].limits
    assert isinstance(order, PlatformCommand)
    assert order.values.tolist() == [limits.upper]
    count = max(servo.index for servo in board.servos) + 1
    target, reference, still = np.zeros((3, count))
    target[order.servos] = order.values
    board.follow(target, reference, still)
    assert not board.is_done([ELBOW])
    assert board.is_done([0])
    board.follow(target, target, still)
    assert board.is_done(None)
    assert board.set_points[Stream.POSITION][ELBOW] == pytest.approx(np.rad2deg(limits.upper))
    board.move([ELBOW], [0.0])
    board.book.take()
    board.book.judge([], [Reason(Code.GATE_CLOSED, "hold: joint data is old")])
    assert board.is_done(None), "a refused move leaves nothing behind"


def test_a_joint_without_speed_keeps_its_place_and_the_others_of_its_group_move() -> None:
    """A program may choose speeds so that all joints arrive at the same time. A joint that is at its target
    then has speed 0."""
    board = ServedBoard("LArm", tci.load_robot("nao").servos_of("LArm"))
    board.set_speeds([0, ELBOW], [5e-16, 30.0])
    board.move([0, ELBOW], [80.0, -40.0])
    (order,) = board.book.take()
    assert order.servos.tolist() == [board.servos[ELBOW].index]
    board.set_speeds(None, [0.0] * board.count)
    board.move(None, [0.0] * board.count)
    assert board.book.take() == []


@pytest.mark.parametrize(
    ("waits", "kinds"), [(60.0, [PlatformSwitch, PlatformCommand]), (0.0, [PlatformSwitch])]
)
def test_set_points_that_overtake_their_change_of_mode_wait_for_it(
    waits: float, kinds: list[type], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served_board, "OVERTAKES", waits)
    board = ServedBoard("LArm", tci.load_robot("nao").servos_of("LArm"))
    with pytest.raises(CallError, match="this command needs"):
        board.stream(Stream.POSITION, [ELBOW], [-10.0])
    board.set_modes([ELBOW], [DIRECT])
    assert [type(order) for order in board.book.take()] == kinds
    board.set_modes([ELBOW], [DIRECT])
    assert [type(order) for order in board.book.take()] == [PlatformSwitch], "once"


def test_compliance_and_impedance(show: Show) -> None:
    board = find_board(show.network, "/nao/LArm", "/test/impedance")
    if Mode.IMPEDANCE in show.driver.robot.servos_of("LArm")[ELBOW].modes:
        insist(lambda: board.set_interaction(ELBOW, COMPLIANT))
        assert until(lambda: show.server.boards["LArm"].state.interactions[ELBOW] == COMPLIANT)
        insist(lambda: board.set_interaction(ELBOW, Vocab("stif")))
    else:
        with pytest.raises(PortError, match="refuses"):
            board.set_interaction(ELBOW, COMPLIANT)
    insist(lambda: board.set_impedance(ELBOW, 0.5, 0.02))
    assert board.impedance(ELBOW) == (0.5, 0.02)
    board.close()


def test_state_and_skin_flow_with_their_stamps(show: Show) -> None:
    states: queue.Queue[Delivery] = queue.Queue()
    skins: queue.Queue[Delivery] = queue.Queue()
    ports = [
        show.listen("/nao/LArm/stateExt:o", states.put),
        show.listen("/nao/skin/left_forearm", skins.put),
    ]
    state = decode_state(states.get(timeout=40).items(show.dialect), show.dialect)
    assert state.position.shape == (6,)
    assert state.modes is not None
    first, second = skins.get(timeout=40), skins.get(timeout=40)
    assert first.stamp is not None
    assert second.stamp is not None
    assert second.stamp.count == first.stamp.count + 1
    assert second.stamp.time > first.stamp.time
    assert abs(second.stamp.time - time.time()) < 60.0
    assert second.vector(show.dialect).tolist() == [240.0] * 240
    for port in ports:
        port.close()


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_states_keep_apart_from_skin_and_go_out_beside_one_that_never_rests(
    rate: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    driver = SimulatedDriver(with_skin_rate(tci.load_robot("nao"), rate))
    clock = SimpleNamespace(monotonic=driver.clock.now, time=driver.clock.now)
    monkeypatch.setattr(server, "time", clock)
    felt: list[float] = []
    states: list[float] = []

    def write(name: str, *rest: object) -> None:
        if name == "/nao/LArm/state:o":
            states.append(driver.clock.now())

    with YarpServer(driver, "127.0.0.1:0,dialect=3") as shown:
        shown._write = write
        shown._publish_skin = lambda frame, offset: felt.append(driver.clock.now())
        serve(shown, duration=0.5)
    assert len(states) >= 49
    if rate == 100.0:
        assert all(min((s - f for f in felt if f <= s), default=1.0) >= 0.003 for s in states[1:])


def test_the_run_time_query_gives_dh_limits_and_skin_to_a_person_and_to_a_program(show: Show) -> None:
    robot = show.driver.robot
    facts = query(robot)
    host, port = show.network.address
    assert read_robot_facts("nao", f"{host}:{port},dialect={show.dialect.name}") == facts
    table = next(t for t in facts.denavit_hartenberg if (t.part, t.convention) == ("left_arm", "classic"))
    where = show.names.query("/nao/facts/rpc:i")
    rpc = Rpc(where, "/test/typed", show.dialect, carrier=TEXT)
    np.testing.assert_allclose(
        rpc.call("dh", "left_arm"), [[r.servo, r.a, r.alpha, r.d, r.theta] for r in table.rows], atol=1e-12
    )
    limits = {name: numbers for name, *numbers in rpc.call("limits")}
    assert limits.keys() == {servo.name for servo in robot.servos}
    assert [row[0] for row in rpc.call("skins")] == [patch.name for patch in robot.patches]
    assert rpc.call("points")[0] == ["left_arm", "palm", "torso", 0.5]
    assert len(rpc.call("taxels", "left_forearm")) == len(facts.patches[0].taxels)
    assert rpc.call("help")[0] == Vocab("many")
    for wrong in (("dh", "tail"), ("dh",), ("taxels", "tail"), ("colour",)):
        refused, why = rpc.call(*wrong)
        assert refused == Vocab("fail")
        assert "valid: " in why
    rpc.close()


def test_contacts_are_published_as_skin_events(show: Show) -> None:
    came: queue.Queue[Delivery] = queue.Queue()
    skin: queue.Queue[Delivery] = queue.Queue()
    events = show.listen("/skinManager/skin_events:o", came.put)
    compensated = show.listen("/nao/skin/left_forearm_comp", skin.put)
    world = show.driver.world
    place = find_place(Skin(show.driver.robot), "left_arm", "forearm", 0.5, 0.0, show.driver.world.joints())
    world.finger.poke(place.patch, place.p_L, place.n_L, speed=0.25, depth=0.01, gap=0.05)
    found = []
    end = time.monotonic() + 40
    while not found and time.monotonic() < end:
        found = list(decode_events(came.get(timeout=40).items(show.dialect)))
    assert found[0].body_part == 3
    assert (found[0].link, found[0].skin_part) == (4, 2)
    assert np.linalg.norm(found[0].force) > 0.1
    assert until(lambda: skin.get(timeout=40).vector(show.dialect).max() > 0.0)
    events.close()
    compensated.close()


def test_55_a_driver_that_is_not_armed_is_read_only(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    driver = SimulatedDriver(tci.load_robot("nao"), arm=False)
    with YarpServer(driver, "127.0.0.1:0") as server:
        np.testing.assert_allclose(  # readable before the loop starts
            np.deg2rad(server.boards["LArm"].state.position),
            driver.read().joints.position[[servo.index for servo in driver.robot.servos_of("LArm")]],
        )
        board = find_board(server.network, "/nao/LArm", "/test/unarmed")
        with pytest.raises(PortError, match="refuses"):
            board.set_modes([ELBOW], DIRECT)
        assert server.orders() == []
        assert board.axes() == 6


def test_a_stranger_who_answers_for_the_name_server_is_not_told_of_any_port(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Without yarp.conf the server starts its own name server, and does not search the network for a name
    server."""
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    here = ("127.0.0.1", free_port())
    monkeypatch.setattr(server, "DEFAULT", here)
    with NameServer() as stranger:
        monkeypatch.setattr(names, "detect", lambda space: stranger.address)
        with YarpServer(SimulatedDriver(tci.load_robot("nao"))) as shown:
            assert shown.network.address == here
            assert len(Names(stranger.address).list()) == 1  # the name server itself


def test_29_a_name_server_that_restarts_hears_of_every_port_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    first = NameServer()
    with YarpServer(SimulatedDriver(tci.load_robot("nao")), "{}:{}".format(*first.address)) as server:
        ports = {contact.name for contact in server.network.list()}
        first.close()
        with NameServer(*first.address) as second:
            assert until(lambda: {c.name for c in Names(second.address).list()} == ports)


def test_an_address_that_is_none_names_what_is_valid() -> None:
    driver = SimulatedDriver(tci.load_robot("nao"))
    for address in ("host:99999999", "127.0.0.1,dialect=5", "127.0.0.1,colour=red", "127.0.0.1,nonsense"):
        with pytest.raises(DriverError, match="valid: "):
            YarpServer(driver, address)
