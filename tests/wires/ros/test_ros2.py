"""ROS 2: TCI with cyclonedds against the genuine rclpy of Kilted (Fast DDS)."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tci
from helpers import HELPERS
from helpers.peers import peer_python
from helpers.ros_robots import (
    Programs,
    Start,
    anywhere,
    complete,
    drive,
    go,
    is_killed_and_comes_back,
    nao_in_ros,
)
from tci.drivers.registry import connect, open_server
from tci.errors import DriverError
from tci.exports.facts import query, read_facts
from tci.recording.rosmsg.cdr import MessageType
from tci.recording.schemas import CLOUD, JOINTS
from tci.robot.description import Address, Robot
from tci.robot.joint_map import initial_position
from tci.shared.ros2_dds import DdsNode, _settings, type_hash
from tci.wires.ros.messages import BYTES, TEXT, TRAJECTORY, VALUES
from tci.wires.ros.native import QUEUE

SERVE = (sys.executable, "-m", "tci.cli.main", "serve", "nao", "--duration", "120", "--via")


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, worker_id: str) -> int:
    """Returns a ROS domain for this test, restricted to this machine."""
    number = 40 + int(worker_id.removeprefix("gw") or 0) if worker_id != "master" else 40
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return number


@pytest.fixture
def start(domain: int) -> Iterator[Start]:
    """Yields a function that starts programs of this test."""
    programs = Programs()
    yield programs.start
    programs.kill()


@pytest.fixture
def namespace() -> str:
    """Returns a namespace for this test, because other tests on this machine may use the same domain."""
    return anywhere()


def ros_robot(start: Start, namespace: str, **more: Any) -> subprocess.Popen[str]:
    """Starts a NAO in genuine ROS 2 without TCI."""
    about = json.dumps(nao_in_ros(namespace=namespace, **more))
    return start(peer_python("ros2"), str(HELPERS / "ros2_robot.py"), about)


def with_address(robot: Robot, of: str, to: str) -> Robot:
    binding = robot.binding("ros2").model_copy(update={"addresses": (Address(of=of, to=to),)})
    return robot.model_copy(update={"bindings": (binding,)})


def test_a_robot_in_ros_sends_joints_and_skin_and_takes_trajectories(start: Start, namespace: str) -> None:
    process = ros_robot(start, namespace, imu="Torso")
    robot = with_address(tci.load_robot("nao"), "imu", "imu/data")
    with connect(robot, f"ros2:{namespace}", arm=True, wait=60.0) as driver:
        first = complete(driver)
        names = [servo.joint or servo.name for servo in driver.robot.servos]
        sent = 0.01 * np.array([[*nao_in_ros()["position"]].index(name) for name in names])
        np.testing.assert_allclose(np.asarray(first.joints.torque), sent)
        gravity = first.joints.gravity
        assert gravity is not None
        np.testing.assert_allclose(gravity, (-1.0, 0.0, -9.5))
        for frame in first.skin:
            assert frame.values.dtype == np.uint16
            np.testing.assert_array_equal(frame.values, np.arange(len(frame.values)))
        go(driver, "LElbowRoll", -1.2)
        drive(driver, seconds=1.0)
        last = driver.read()
        assert last.joints.sequence > first.joints.sequence + 50
        assert last.skin[0].sequence > first.skin[0].sequence + 50
    process.kill()
    heard = [json.loads(line) for line in process.stdout or ()]
    assert {command["part"] for command in heard} == {"LArm"}, "no other part was ever sent anything"
    names = [servo.joint or servo.name for servo in driver.robot.servos_of("LArm")]
    assert all(command["names"] == names for command in heard), "a controller wants all its joints"
    assert {command["seconds"] for command in heard} == {0.01}


def test_plain_values_where_the_binding_says_so(start: Start, namespace: str) -> None:
    process = ros_robot(start, namespace)
    robot = with_address(tci.load_robot("nao"), "LArm", "LArm_controller/commands")
    with connect(robot, f"ros2:{namespace}", arm=True, wait=60.0) as driver:
        go(driver, "LElbowRoll", -1.2)
        drive(driver, seconds=0.2)
    process.kill()
    heard = [json.loads(line) for line in process.stdout or ()]
    assert heard[-1]["values"] == pytest.approx(
        [
            -1.2 if s.name == "LElbowRoll" else initial_position(robot)[s.index]
            for s in robot.servos_of("LArm")
        ],
        abs=1e-3,
    )


def test_28_a_robot_that_dies_is_held_within_100_ms_and_34_nothing_is_replayed(
    start: Start, namespace: str
) -> None:
    is_killed_and_comes_back(f"ros2:{namespace}", lambda: ros_robot(start, namespace))


@pytest.mark.timeout(60)  # the driver waits for a robot, but does not wait after a topic of a wrong type
def test_35_topics_of_a_wrong_type_are_refused_by_name(start: Start, namespace: str) -> None:
    ros_robot(start, namespace, wrong_type=True)
    with pytest.raises(
        DriverError, match=r"/joint_states is std_msgs/msg/String; valid: sensor_msgs/msg/JointState"
    ):
        connect(tci.load_robot("nao"), f"ros2:{namespace}", wait=600.0)


def test_nobody_there_a_bad_namespace_and_bad_settings_are_told(
    domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = tci.load_robot("nao")
    with pytest.raises(DriverError, match="no node publishes /left/nao/joint_states"):
        connect(robot, "ros2:/left/nao", wait=0.2)
    with pytest.raises(DriverError, match="no ROS namespace"):
        connect(robot, "ros2:10.0.0.1")
    monkeypatch.setenv("ROS_DOMAIN_ID", "999")
    with pytest.raises(DriverError, match="0 to 232"):
        connect(robot, "ros2", wait=0.2)
    monkeypatch.setenv("ROS_DOMAIN_ID", "3")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "EVERYWHERE")
    with pytest.raises(DriverError, match="LOCALHOST"):
        connect(robot, "ros2", wait=0.2)


def test_another_served_robot_hides_no_foreign_one_and_unfit_topics_are_told(
    domain: int, namespace: str
) -> None:
    """Another `tci serve` in the same namespace, and a foreign NAO whose forearm is an array."""
    robot = tci.load_robot("nao")
    names = [servo.joint or servo.name for servo in robot.servos]
    array = MessageType("std_msgs/msg/Float32MultiArray", (VALUES.fields[0], ("float32[]", "data")),
                        needs=VALUES.needs, headed=False)  # fmt: skip
    foreign = DdsNode("foreign", namespace)
    ended = threading.Event()

    def publish() -> None:
        joints = foreign.advertise(f"{namespace}/joint_states", JOINTS)
        skin = foreign.advertise(f"{namespace}/skin/left_forearm", array)
        while not ended.wait(0.01):
            stamp = time.time()
            joints((int(stamp), int(stamp % 1.0 * 1e9), "", names, initial_position(robot), (), ()))
            skin((((), 0), np.zeros(240)))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        with tci.connect("nao-h21") as other, open_server(other, f"ros2:{namespace}"):
            with connect(robot, f"ros2:{namespace}", wait=10.0) as driver:
                np.testing.assert_allclose(driver.read().joints.position, initial_position(robot))
                told = {one.subject: one for one in driver.diagnose()}
            assert "a robot's own topics" in told["dialect"].what
            assert (
                f"{namespace}/skin/left_forearm is std_msgs/msg/Float32MultiArray"
                in told["left_forearm"].what
            )
            assert (
                f"array:ros2://{namespace}/skin/left_forearm,patch=left_forearm"
                in told["left_forearm"].advice
            )
            assert f"{namespace}/joint_states (sensor_msgs/msg/JointState)" in told["left_hand"].what
            with pytest.raises(DriverError, match=f"seen: .*{namespace}/joint_states"):
                connect(robot, "ros2:/elsewhere", wait=0.5)
    finally:
        ended.set()
        thread.join()
        foreign.close()


@pytest.mark.parametrize("peer", ["no such host", "256.1.1.1", "::1", "127.0.0.1:99999", "127.0.0.1:x", ":1"])
def test_a_peer_that_cyclone_would_end_the_process_for_is_told(
    domain: int, monkeypatch: pytest.MonkeyPatch, peer: str
) -> None:
    monkeypatch.setenv("ROS_STATIC_PEERS", f"127.0.0.1;{peer}")
    with pytest.raises(DriverError, match=f"'{peer}' of ROS_STATIC_PEERS is no address; valid: HOST or"):
        connect(tci.load_robot("nao"), "ros2", wait=0.2)


def test_cyclone_gets_addresses_and_no_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without /etc/hosts can't resolve the name `localhost`."""
    monkeypatch.setenv("ROS_STATIC_PEERS", "localhost:7410;10.0.0.1")
    peers = re.findall('<Peer address="(.*?)"/>', _settings("LOCALHOST"))
    assert peers == ["127.0.0.1:7410", "10.0.0.1", "127.0.0.1"]


def test_33_a_flood_costs_bounded_time_and_memory(start: Start, namespace: str) -> None:
    ros_robot(start, namespace, flood=100)
    with connect(tci.load_robot("nao"), f"ros2:{namespace}", wait=60.0) as driver:
        for _ in driver.ticks(duration=1.0):
            before = driver.read().joints.sequence
            assert driver.read().joints.sequence - before <= QUEUE
        time.sleep(1.0)
        before = driver.read().joints.sequence
        assert driver.read().joints.sequence - before <= QUEUE, (
            "what came meanwhile was dropped, but the newest"
        )
        end = time.monotonic() + 30.0
        while driver.clock.now() - driver.read().joints.stamp > driver.gate.stale_after:
            assert time.monotonic() < end


def test_a_robot_that_tci_shows_is_an_ordinary_robot_to_ros(start: Start, namespace: str) -> None:
    python = peer_python("ros2")
    start(*SERVE, f"ros2:{namespace}")
    robot = tci.load_robot("nao")
    left = [servo.joint or servo.name for servo in robot.servos_of("LArm")]
    here = dict(
        zip(left, [float(initial_position(robot)[s.index]) for s in robot.servos_of("LArm")], strict=True)
    )
    right = [float(initial_position(robot)[servo.index]) for servo in robot.servos_of("RArm")]
    names = [servo.name for servo in robot.servos_of("RArm")]
    right[names.index("RElbowRoll")] = 1.0
    about = {
        "namespace": namespace,
        "cloud": "skin/left_forearm/points",
        "trajectory": {
            "topic": "LArm_controller/joint_trajectory",
            "names": ["LElbowRoll", "LShoulderPitch"],
            "points": [[0.3, [-0.6, here["LShoulderPitch"]]], [0.9, [-1.0, here["LShoulderPitch"] - 0.3]]],
            "goal": {"LElbowRoll": -1.0, "LShoulderPitch": here["LShoulderPitch"] - 0.3},
        },
        "values": {"topic": "RArm_controller/commands", "data": right, "goal": {"RElbowRoll": 1.0}},
    }
    client = start(python, str(HELPERS / "ros2_client.py"), json.dumps(about))
    told, _ = client.communicate(timeout=100)
    found = json.loads(told.splitlines()[-1])
    assert "tci_nao" in found["nodes"]
    assert found["types"][f"{namespace}/joint_states"] == [JOINTS.name]
    assert found["types"][f"{namespace}/skin/left_forearm/points"] == [CLOUD.name]
    assert found["types"][f"{namespace}/skin/left_forearm"] == ["tci_msgs/msg/SkinFrame"]
    assert found["hashes_agree"]
    assert found["cloud"] == [240, "LForeArm", ["x", "y", "z", "pressure", "raw"]]
    assert found["urdf"].startswith("<?xml")
    assert read_facts(found["facts"]) == query(robot)
    assert set(found["position"]) == {servo.joint or servo.name for servo in robot.servos}
    assert abs(found["age"]) < 5.0, "seconds since 1970"
    assert found["after_trajectory"]["LElbowRoll"] == pytest.approx(-1.0, abs=0.01)
    assert found["after_trajectory"]["LShoulderPitch"] == pytest.approx(
        here["LShoulderPitch"] - 0.3, abs=0.01
    )
    assert found["after_values"]["RElbowRoll"] == pytest.approx(1.0, abs=0.01)
    assert found["after_values"]["LElbowRoll"] == pytest.approx(-1.0, abs=0.01)
    assert any("no joint 'Nonsense'" in reason for reason in found["refusals"])


def test_a_gripper_tells_and_takes_metres_as_its_own_driver_does(start: Start, namespace: str) -> None:
    """Of `franka_gripper`: a finger's place is its way, 0 to 0.04 m."""
    python, finger = peer_python("ros2"), "panda_finger_joint1"
    start(*(word.replace("nao", "franka-hand") for word in SERVE), f"ros2:{namespace}")
    about = {
        "namespace": namespace,
        "cloud": "skin/left_palm/points",
        "near": 5e-4,
        "trajectory": {
            "topic": "left_gripper_controller/joint_trajectory", "names": [finger],
            "points": [[0.5, [0.03]]], "goal": {finger: 0.03},
        },
        "values": {"topic": "left_gripper_controller/commands", "data": [0.01], "goal": {finger: 0.01}},
    }  # fmt: skip
    client = start(python, str(HELPERS / "ros2_client.py"), json.dumps(about))
    found = json.loads(client.communicate(timeout=100)[0].splitlines()[-1])
    assert found["after_trajectory"][finger] == pytest.approx(0.03, abs=5e-4)
    assert found["after_values"][finger] == pytest.approx(0.01, abs=5e-4)


def test_a_behaviour_elsewhere_commands_a_robot_that_tci_shows(start: Start, namespace: str) -> None:
    start(*SERVE, f"ros2:{namespace}")
    with connect(tci.load_robot("nao"), f"ros2:{namespace}", arm=True, wait=60.0) as driver:
        go(driver, "LElbowRoll", -1.2)
        reading = complete(driver)
        assert reading.joints.modes is not None, "a TCI process tells more than a JointState can"


def test_by_genuine_rclpy_it_is_the_same(
    start: Start, namespace: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If ROS 2 is installed, TCI uses rclpy. Here a process with rclpy serves the robot, and a process
    without ROS 2 commands it."""
    python = peer_python("ros2")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(tci.__file__).parents[1]), *_site_packages()]))
    serve = "import sys; from tci.cli.main import main; sys.argv = ['tci', *sys.argv[1:]]; main()"
    start(python, "-c", serve, "serve", "nao", "--via", f"ros2:{namespace}", "--duration", "120")
    with connect(tci.load_robot("nao"), f"ros2:{namespace}", arm=True, wait=60.0) as driver:
        go(driver, "LElbowRoll", -1.2)
        complete(driver)
    told = subprocess.run(
        [python, "-c", BY_RCLPY, f"ros2:{namespace}"], capture_output=True, text=True, timeout=120, check=True
    )
    assert json.loads(told.stdout.splitlines()[-1]) == ["RclpyNode", False, pytest.approx(-1.2, abs=0.01)]


def _site_packages() -> list[str]:
    return [path for path in sys.path if path.endswith("site-packages")]


BY_RCLPY = """
import json, sys, tci
with tci.connect(tci.load_robot("nao"), sys.argv[1], wait=60.0) as driver:
    elbow = driver.native("LArm").positions(driver.read().joints)["LElbowRoll"]
    print(json.dumps([type(driver._node).__name__, driver.is_native, elbow]))
"""


def test_closing_leaves_nothing_behind(domain: int) -> None:
    threads = len(os.listdir("/proc/self/task"))
    for _ in range(3):
        one, two = DdsNode("one"), DdsNode("two")
        heard: list[Any] = []
        two.subscribe("/values", VALUES, heard.append)
        send = one.advertise("/values", VALUES)
        end = time.monotonic() + 10.0
        while not heard and time.monotonic() < end:
            send((((), 0), np.arange(3.0)))
            two.poll()
        np.testing.assert_array_equal(heard[0]["data"], np.arange(3.0))
        one.close()
        one.close()
        two.close()
        with pytest.raises(DriverError, match="closed"):
            send((((), 0), np.arange(3.0)))
    assert len(os.listdir("/proc/self/task")) <= threads, "Cyclone's own threads are gone with it"


@pytest.mark.parametrize("kind", [JOINTS, CLOUD, TRAJECTORY, VALUES, BYTES, TEXT], ids=lambda kind: kind.name)
def test_type_hashes_are_those_of_the_definitions_that_genuine_ros_installs(kind: Any) -> None:
    package, _, name = kind.name.split("/")
    path = Path(peer_python("ros2")).parents[1] / "share" / package / "msg" / f"{name}.json"
    hashes = {
        entry["type_name"]: entry["hash_string"] for entry in json.loads(path.read_text())["type_hashes"]
    }
    assert type_hash(kind) == hashes[kind.name]
