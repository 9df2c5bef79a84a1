"""Skin over YARP, from the served port to the driver: Vectors with the sizes of iCub's ports, and skin
patches of YARP 4."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
import pytest

import tci
from helpers.yarp_show import until
from tci.errors import DriverError
from tci.messages import SkinFrame
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot
from tci.wires.yarp import diagnose
from tci.wires.yarp.address import patch_port
from tci.wires.yarp.axes import find_axes
from tci.wires.yarp.driver import YarpDriver
from tci.wires.yarp.facts import facts_port
from tci.wires.yarp.skin_layout import SkinLayout
from tci.wires.yarp.skin_ports import SkinPorts, read_skin
from yarpwire.board import OK, find_board
from yarpwire.dialect import DIALECTS, V3, V4, Dialect
from yarpwire.errors import PortError
from yarpwire.feed import Feed
from yarpwire.incoming import Answer, Delivery
from yarpwire.message import Stamp
from yarpwire.name_server import NameServer
from yarpwire.names import Contact
from yarpwire.network import NamedPort
from yarpwire.sensors import Measure, encode_measures
from yarpwire.values import Vocab
from yarpwire.wire import Wire

ICUB = tci.load_robot("icub")
UPPER_ARM, FOREARM = ICUB.patch("left_upper_arm"), ICUB.patch("left_forearm")
WIDTHS = {"left_upper_arm": 768, "left_forearm": 384, "right_upper_arm": 768, "right_forearm": 384}
"""Number of values per patch that skinGui's position files of an iCub use as indices."""


class Ports:
    """A name server, and the ports that a test opens there."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.server = NameServer("127.0.0.1", 0)
        self.network = Wire(self.server.address)
        self.opened: dict[str, NamedPort] = {}
        self.feeds: list[Feed[Array]] = []

    def open(self, name: str, receive: Callable[[Delivery], Answer] | None = None) -> NamedPort:
        found = self.opened[name] = self.network.port(name, self.dialect, receive)
        return found

    def serve(self, robot: Robot, patch: Patch) -> SkinPorts:
        if facts_port("icub") not in self.opened:
            self.open(facts_port("icub"))
        return SkinPorts(robot, patch, "icub", self.dialect, self.open)

    def read(self, robot: Robot, patch: Patch, *, compensated: bool = False) -> Feed[Array]:
        feed = read_skin(
            robot, patch, "icub", self.network, self.dialect,
            own="/test", carrier="fast_tcp", compensated=compensated,
        )  # fmt: skip
        self.feeds.append(feed)
        return feed

    def close(self) -> None:
        for one in (*self.feeds, *self.opened.values(), self.server):
            one.close()


@pytest.fixture(params=["3", "4"])
def ports(request: pytest.FixtureRequest) -> Iterator[Ports]:
    found = Ports(DIALECTS[request.param])
    yield found
    found.close()


def frame(patch: Patch) -> SkinFrame:
    values = np.arange(patch.channels, dtype=float) % 200.0
    return SkinFrame(patch.name, 1.0, 1, values)


@pytest.mark.parametrize("patch", [UPPER_ARM, FOREARM], ids=lambda patch: patch.name)
def test_a_frame_arrives_as_it_was_sent_in_a_port_of_the_width_of_an_icub(ports: Ports, patch: Patch) -> None:
    served = ports.serve(ICUB, patch)
    name = patch_port(ICUB, "icub", patch.name)
    seen: list[Array] = []
    listener = ports.network.port("/listener", ports.dialect, lambda d: seen.append(d.vector(ports.dialect)))
    listener.listen_to(name)
    feed, sent = ports.read(ICUB, patch), frame(patch)
    assert feed.source == (f"{name}/measures:o" if ports.dialect is V4 else name)
    assert until(lambda: (served.publish(sent, Stamp(1, 5.0)), feed.latest is not None and bool(seen))[1])
    assert feed.latest is not None
    np.testing.assert_array_equal(feed.latest.value, sent.values)
    assert len(seen[0]) == WIDTHS[patch.name]
    assert np.count_nonzero(seen[0] != patch.sensor.rest) >= patch.channels - 2
    listener.close()


def test_the_values_of_an_upper_arm_are_those_that_skin_gui_indexes() -> None:
    """The test uses the rows of icub-main's left_arm.txt and right_arm.txt that contain a taxel. A module has
    either all its taxels or none."""
    for side, first, count in (("left", 2, 35), ("right", 2, 35)):
        layout = SkinLayout.of(ICUB, ICUB.patch(f"{side}_upper_arm"))
        assert layout.places is not None
        modules, places = layout.places // 12, layout.places % 12
        assert (modules.min(), modules.max(), len({*modules.tolist()})) == (first, 63, count)
        assert {*places.tolist()} == {*range(12)} - {6, 10}
    left, right = (SkinLayout.of(ICUB, ICUB.patch(f"{side}_upper_arm")).places for side in ("left", "right"))
    assert left is not None
    assert right is not None
    assert len({*left.tolist()} & {*right.tolist()}) == 250


def test_modules_that_do_not_hold_the_channels_are_an_error() -> None:
    longer = UPPER_ARM.model_copy(update={"channels": UPPER_ARM.channels + 10})
    with pytest.raises(DriverError, match="modules of 350 taxels for left_upper_arm; valid: 360"):
        SkinLayout.of(ICUB, longer)


def test_compensated_values_become_counts_around_rest(ports: Ports) -> None:
    served = ports.serve(ICUB, UPPER_ARM)
    feed, values = ports.read(ICUB, UPPER_ARM, compensated=True), np.full(UPPER_ARM.channels, 240.0)
    values[7] = 200.0
    sent = SkinFrame(UPPER_ARM.name, 1.0, 1, values)
    assert until(lambda: (served.publish(sent, Stamp(1, 5.0)), feed.latest is not None)[1])
    assert feed.latest is not None
    np.testing.assert_array_equal(feed.latest.value, values)


def test_the_upper_arm_of_a_real_icub_needs_its_own_skin_file(
    ports: Ports, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No port answers the run-time query, so TCI does not serve this robot, and the positions of its taxels
    are unknown."""
    for patch in ICUB.patches:
        ports.open(patch_port(ICUB, "icub", patch.name))
    with pytest.raises(DriverError, match=r"left_upper_arm are only in the robot's own skin file.*without="):
        ports.read(ICUB, UPPER_ARM)
    assert ports.read(ICUB, FOREARM).source == "/icub/skin/left_forearm"
    where = "{}:{}".format(*ports.server.address)
    monkeypatch.setattr(diagnose, "board_ports", lambda robot, prefix: {})
    faults = {finding.subject for finding in YarpDriver.probe(ICUB, where)[2:]}
    assert faults == {"left_upper_arm", "right_upper_arm"}
    assert len(YarpDriver.probe(ICUB, f"{where},without=left_upper_arm+right_upper_arm")) == 2


def test_several_sensors_of_one_device_are_one_patch_and_a_wrong_number_of_values_is_told() -> None:
    ports = Ports(V4)
    try:
        port = ports.open("/icub/skin/left_forearm/measures:o")
        feed = ports.read(ICUB, FOREARM)

        def send(*sizes: int) -> None:
            measures = [Measure(np.full(size, float(number)), 5.0) for number, size in enumerate(sizes)]
            port.write(encode_measures(measures), Stamp(1, 5.0))

        assert until(lambda: (send(192, 192), feed.latest is not None)[1])
        assert feed.latest is not None
        assert feed.latest.value.tolist() == [0.0] * 192 + [1.0] * 192
        assert until(lambda: (send(192), "sends 192 values; valid: 384" in str(feed.last_error))[1])
        assert until(lambda: (send(), "sends 0 values" in str(feed.last_error))[1])
    finally:
        ports.close()


def test_measures_that_are_sent_again_are_no_new_frame() -> None:
    """A server writes a new time stamp into each message, even while one of its sensors has no new values."""
    ports = Ports(V4)
    try:
        port = ports.open("/icub/skin/left_forearm/measures:o")
        feed = ports.read(ICUB, FOREARM)
        numbers = itertools.count(1)

        def send(first: float, second: float) -> None:
            number = next(numbers)
            measures = [Measure(np.full(192, 0.02 * number), time) for time in (first, second)]
            port.write(encode_measures(measures), Stamp(number, 5.0 + 0.02 * number))

        assert until(lambda: (send(5.0, 5.0), feed.latest is not None)[1])
        frozen, heard = feed.latest, feed.silent(0.0)
        assert frozen is not None
        for number in range(1, 6):
            send(5.0 + 0.02 * number, 5.0)
        assert until(lambda: feed.silent(0.0) != heard)
        assert feed.latest is frozen
        assert until(lambda: (send(6.0, 6.0), feed.latest is not frozen)[1])
        assert (feed.wrong, feed.lost) == (0, 0)
        for time in (0.0, float("nan")):  # no time at all
            came = feed.recent[-1].sequence + 2
            assert until(lambda: (send(time, time), feed.recent[-1].sequence > came)[1])  # noqa: B023 - called in this turn only
    finally:
        ports.close()


def test_the_names_of_the_sensors_are_answered_in_yarp_4_only(ports: Ports) -> None:
    ports.serve(ICUB, FOREARM)
    name = "/icub/skin/left_forearm/rpc:o"
    assert (name in ports.opened) is (ports.dialect is V4)
    if ports.dialect is V3:
        return
    caller = ports.network.caller(ports.network.query(name), "/asks", V4)
    answer = caller.call("getMetadata")
    caller.close()
    assert [[one[0] for one in kind] for kind in answer if kind] == [["left_forearm"]]


def test_a_client_of_analog_sensors_finds_its_port_in_yarp_3_only(ports: Ports) -> None:
    """`analogsensorclient`, and so iCub's skinManager, only starts with this port. Nothing is calibrated."""
    ports.serve(ICUB, FOREARM)
    name = "/icub/skin/left_forearm/rpc:i"
    assert (name in ports.opened) is (ports.dialect is V3)
    if ports.dialect is V4:
        return
    caller = ports.network.caller(ports.network.query(name), "/asks", V3)
    with closing(caller):
        assert caller.call(Vocab("iana"), Vocab("cal")) == [1]  # IAnalogSensor: AS_ERROR
        assert caller.call(Vocab("help")) == [Vocab("fail")]


def test_names_that_a_crashed_program_left_are_no_ports(ports: Ports) -> None:
    """No program listens at port 1. Facts of a robot that was served earlier are not used for its
    successor."""
    vector = patch_port(ICUB, "icub", FOREARM.name)
    for name in (facts_port("icub"), f"{vector}/measures:o"):
        ports.network.names.register(Contact(name, "127.0.0.1", 1))
    for patch in ICUB.patches:
        ports.open(patch_port(ICUB, "icub", patch.name))
    assert ports.read(ICUB, FOREARM).source == vector
    with pytest.raises(DriverError, match="left_upper_arm are only in the robot's own skin file"):
        ports.read(ICUB, UPPER_ARM)


def test_a_board_of_another_dialect_that_crashed_is_not_called() -> None:
    ports = Ports(V4)
    try:
        ports.network.names.register(Contact("/icub/torso/rpc:i", "127.0.0.1", 1))
        with closing(find_board(ports.network, "/icub/torso", "/asks")) as board, pytest.raises(PortError):
            board.axes()
        ports.open("/icub/torso/nws/rpc:i", lambda delivery: [OK, 3])
        with closing(find_board(ports.network, "/icub/torso", "/asks")) as board:
            assert (board.dialect, board.axes()) == (V4, 3)
    finally:
        ports.close()


@pytest.mark.parametrize("count", [0, -1, 257, 1 << 31, float("inf"), "three"])
def test_a_number_of_axes_that_no_board_has_is_refused_before_their_names_are_asked_for(
    count: object,
) -> None:
    ports = Ports(V4)
    try:
        ports.open("/icub/torso/nws/rpc:i", lambda delivery: [OK, count])
        with (
            closing(find_board(ports.network, "/icub/torso", "/asks")) as board,
            pytest.raises(DriverError, match="to getAxesRPC; valid: 1 to 256 axes"),
        ):
            find_axes(board, ICUB.servos_of("torso"))
    finally:
        ports.close()
