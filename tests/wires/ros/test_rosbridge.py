"""rosbridge: TCI's client against recorded messages of a genuine server (0.11.17, on Debian's rospy)."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from concurrent.futures import Future

import numpy as np
import pytest

import tci
from helpers.rosbridge_exchange import RecordedServer, exchange, narrow, plain
from helpers.wire_peers import free_port
from tci.errors import DriverError
from tci.gate.safe_command import GateState
from tci.recording.schemas import CLOUD, JOINTS, cloud_fields, header
from tci.shared.ros_trees import Trees
from tci.wires.ros.messages import BYTES, NO_LAYOUT, TRAJECTORY
from tci.wires.ros.rosbridge import MOST_WAITING, RosbridgeNode, _get, _new, parse

pytestmark = pytest.mark.xdist_group("rosbridge")


@pytest.fixture
def server() -> Iterator[RecordedServer]:
    one = RecordedServer()
    yield one
    one.close()


def test_the_client_says_what_the_genuine_server_understood(server: RecordedServer) -> None:
    with tci.connect(narrow(), f"rosbridge:127.0.0.1:{server.port}", arm=True) as driver:
        end = time.monotonic() + 60.0
        while len((first := driver.read()).skin) < 2:
            assert time.monotonic() < end
            time.sleep(0.01)
        assert {frame.patch: len(frame.values) for frame in first.skin} == {
            "left_forearm": 240,
            "right_forearm": 240,
        }
        for frame in first.skin:
            np.testing.assert_array_equal(frame.values, np.arange(240, dtype=np.uint16))
        assert first.joints.position.shape == (len(driver.robot.servos),)
        pending = [driver.native("LArm").command({"LElbowRoll": -1.1})]
        for now in driver.ticks(duration=60.0):
            joints = driver.read().joints
            driver.write(driver.gate.step(pending, joints, now))
            pending = []
            said = any(message["op"] == "publish" for message in server.heard)
            if said and joints.sequence > first.joints.sequence + 20:
                break
        assert driver.read().joints.sequence > first.joints.sequence + 20
    recorded = {json.dumps(plain(m), sort_keys=True) for _, who, m in exchange() if who == "client"}
    said = [json.dumps(plain(message), sort_keys=True) for message in server.heard]
    assert set(said) <= recorded
    ops = {message["op"] for message in server.heard}
    assert {"call_service", "subscribe", "advertise", "publish", "unsubscribe", "unadvertise"} <= ops
    assert {m["topic"] for m in server.heard if m["op"] == "publish"} == {"/LArm_controller/joint_trajectory"}


def test_28_a_server_that_dies_means_hold_and_closing_leaves_nothing(server: RecordedServer) -> None:
    driver = tci.connect(narrow(), f"rosbridge:127.0.0.1:{server.port}", arm=True)
    server.close()
    for now in driver.ticks(duration=60.0):
        held = driver.write(driver.gate.step([], driver.read().joints, now))
        if held.state is GateState.HOLD:
            break
    assert held.state is GateState.HOLD
    driver.close()
    driver.close()
    with pytest.raises(DriverError, match="closed"):
        driver.read()


def test_one_who_gave_up_does_not_stay_when_the_server_is_there_later() -> None:
    port = free_port()
    with pytest.raises(DriverError, match="no rosbridge server"):
        RosbridgeNode("127.0.0.1", port)
    late = RecordedServer(port)
    try:
        assert late.left.wait(40.0)  # an attempt to connect that is in progress may still reach the server
    finally:
        late.close()


def test_32_a_server_that_reads_nothing_keeps_little_waiting(server: RecordedServer) -> None:
    node = RosbridgeNode("127.0.0.1", server.port)
    send = node.advertise("/flood", BYTES)
    server._loop.call_soon_threadsafe(server.protocol.transport.pause_reading)
    data = np.random.default_rng(0).integers(0, 256, MOST_WAITING, np.uint8)
    for _ in range(40):
        send((NO_LAYOUT, data))
    waiting: Future[int] = Future()
    factory = node._ros.factory
    factory.manager.loop.call_soon_threadsafe(
        lambda: waiting.set_result(factory._proto.transport.get_write_buffer_size())
    )
    assert waiting.result(40.0) < 4 * MOST_WAITING
    server._loop.call_soon_threadsafe(server.protocol.transport.resume_reading)
    node.close()
    node.close()


def test_35_messages_that_are_none_are_counted_and_the_driver_goes_on(server: RecordedServer) -> None:
    with tci.connect(narrow(), f"rosbridge:127.0.0.1:{server.port}") as driver:
        before = driver.read().joints.sequence
        damaged = [
            {"name": ["a"]}, {"header": 3}, {"header": {"stamp": {}, "frame_id": ""}}, [], "text", 7, None,
            {"header": {"stamp": {"secs": 1, "nsecs": "x"}, "frame_id": ""}, "name": 3},
            {"header": {"stamp": {"secs": 1, "nsecs": 2}, "frame_id": ""}, "name": ["HeadYaw"],
             "position": ["x"], "velocity": [], "effort": []},
            {"header": {"stamp": {"secs": 1, "nsecs": 2}, "frame_id": ""}, "name": ["HeadYaw"],
             "position": [1.0, 2.0], "velocity": [], "effort": []},
        ]  # fmt: skip
        for message in damaged:
            said = {"op": "publish", "topic": "/joint_states", "msg": message}
            server._loop.call_soon_threadsafe(server.protocol.say, said)
        server._loop.call_soon_threadsafe(server.protocol.sendMessage, b"{no json")
        end = time.monotonic() + 60.0
        while sum(driver._node.rejected.values()) < len(damaged) - 1 and time.monotonic() < end:
            time.sleep(0.05)
        assert sum(driver._node.rejected.values()) >= len(damaged) - 1
        while driver.read().joints.sequence == before and time.monotonic() < end:
            time.sleep(0.05)
        assert driver.read().joints.sequence > before
        assert any(finding.subject == "messages" for finding in driver.diagnose())


def test_nobody_there_and_bad_addresses_are_told() -> None:
    assert parse("") == ("127.0.0.1", 9090, "")
    assert parse("10.0.0.5:9091/left/nao") == ("10.0.0.5", 9091, "/left/nao")
    assert parse("robot.local/left") == ("robot.local", 9090, "/left")
    for address in ("a b", "host:99999", "host:x", "ws://host:9090"):
        with pytest.raises(DriverError, match="valid: "):
            parse(address)
    with pytest.raises(DriverError, match=r"no rosbridge server at ws://127.0.0.1:9"):
        tci.connect(tci.load_robot("nao"), "rosbridge:127.0.0.1:9")


@pytest.mark.parametrize("names", [("secs", "nsecs"), ("sec", "nanosec")], ids=["ROS 1", "ROS 2"])
def test_messages_of_both_kinds_of_ros_come_back_from_their_json(names: tuple[str, str]) -> None:
    trees = Trees(_new, _get, names)
    points = np.arange(8, dtype=np.float32).reshape(2, 4)
    point = ([1.0, 2.0], [], [], [], (1, 500))
    for kind, values in (
        (JOINTS, (*header(3.5, "torso"), ["a", "b"], [0.1, 0.2], [], [])),
        (CLOUD, (*header(3.5, "torso"), *cloud_fields(points))),
        (TRAJECTORY, (*header(0.0), ["a", "b"], [point])),
    ):
        grown = json.loads(json.dumps(trees.grow(kind, values)))
        assert set(grown["header"]["stamp"]) == set(names)
        flat = trees.flatten(kind, grown)
        again = trees.grow(kind, _values(kind, flat))
        assert json.loads(json.dumps(again)) == grown
        assert (flat["sec"], flat["frame_id"]) == (int(values[0]), values[2])


def _values(kind: object, flat: dict[str, object]) -> list[object]:
    """Returns the values of nested fields as a flat list, in their order."""

    def bare(found: object) -> object:
        if isinstance(found, dict):
            return tuple(bare(value) for value in found.values())
        return [bare(item) for item in found] if isinstance(found, list) else found

    return [bare(value) for value in flat.values()]
