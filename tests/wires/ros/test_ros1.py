"""ROS 1: TCI against Debian's roscore and rospy."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import tci
from helpers import HELPERS
from helpers.peers import DEBIAN_PYTHON, needs_debian_module
from helpers.ros_robots import (
    Programs,
    Start,
    anywhere,
    complete,
    drive,
    go,
    is_killed_and_comes_back,
    nao_in_ros,
    roscore,
)
from tci.drivers.registry import connect
from tci.errors import DriverError
from tci.exports.facts import query, read_facts
from tci.shared.ros1_node import NAMES, Ros1Node
from tci.wires.ros.messages import TEXT

SERVE = (sys.executable, "-m", "tci.cli.main", "serve", "nao", "--duration", "120", "--via")
pytestmark = pytest.mark.xdist_group("driver-ros1")
"""All these tests run in one process: rospy permits one node per process, and a node has one master."""


@pytest.fixture
def start() -> Iterator[Start]:
    """Yields a function that starts programs of this test with the same ROS master."""
    roscore()
    programs = Programs()
    yield programs.start
    programs.kill()


def ros_robot(start: Start, namespace: str, **more: Any) -> subprocess.Popen[str]:
    """Starts a NAO in genuine ROS 1 without TCI."""
    about = json.dumps(nao_in_ros(**more))
    return start(DEBIAN_PYTHON, str(HELPERS / "ros1_robot.py"), about, f"__ns:={namespace or '/'}")


@pytest.mark.parametrize("make", [str, anywhere], ids=["at the root", "in a namespace"])
def test_a_robot_in_ros_sends_joints_and_skin_and_takes_trajectories(
    start: Start, make: Callable[[], str]
) -> None:
    namespace = make()
    process = ros_robot(start, namespace)
    with connect(tci.load_robot("nao"), f"ros1:{namespace}", arm=True, wait=60.0) as driver:
        first = complete(driver)
        for frame in first.skin:
            np.testing.assert_array_equal(frame.values, np.arange(len(frame.values), dtype=np.uint16))
        go(driver, "LElbowRoll", -1.2)
        drive(driver, seconds=1.0)
        assert driver.read().joints.sequence > first.joints.sequence + 50
    process.kill()
    heard = [json.loads(line) for line in process.stdout or ()]
    names = [servo.joint or servo.name for servo in driver.robot.servos_of("LArm")]
    assert heard[-1]["names"] == names
    assert {(command["part"], command["seconds"]) for command in heard} == {("LArm", 0.01)}


def test_robot_of_this_machine_needs_no_netifaces(start: Start) -> None:
    """Only the system's version of Python can import Debian's `netifaces`."""
    via = f"ros1:{anywhere()}"
    start(*SERVE, via)
    program = (
        "import sys; sys.modules['netifaces'] = None; import tci\n"
        f"with tci.connect('nao', '{via}', wait=60.0) as robot: print(robot.read().joints.sequence)"
    )
    usual = {name: value for name, value in os.environ.items() if name not in NAMES}
    subprocess.run([sys.executable, "-c", program], env=usual, timeout=80, check=True)


def test_what_a_killed_process_left_in_the_master_is_no_robot(start: Start) -> None:
    via = f"ros1:{anywhere()}"
    shown = start(*SERVE, via)
    with connect(tci.load_robot("nao"), via, wait=60.0) as driver:
        assert not driver.is_native
    shown.kill()
    shown.wait()
    with pytest.raises(DriverError, match=r"no node publishes .*/tci_nao_\w+ \(http:.*\) is registered"):
        connect(tci.load_robot("nao"), via, wait=0.5)
    process = ros_robot(start, via.removeprefix("ros1:"))
    with connect(tci.load_robot("nao"), via, wait=60.0) as driver:
        assert driver.is_native
        assert any(finding.subject == "node" for finding in driver.diagnose())
        process.kill()


def test_28_a_robot_that_dies_is_held_and_34_nothing_is_replayed(start: Start) -> None:
    namespace = anywhere()
    is_killed_and_comes_back(f"ros1:{namespace}", lambda: ros_robot(start, namespace))


def test_what_is_said_just_before_leaving_is_heard(start: Start) -> None:
    topic, heard = f"{anywhere()}/farewell", queue.Queue[str]()
    hears = Ros1Node("hears")
    hears.subscribe(topic, TEXT, lambda message: heard.put(message["data"]))
    for number in range(20):
        leaves = Ros1Node("leaves")
        send = leaves.advertise(topic, TEXT)
        end = time.monotonic() + 60.0
        while not leaves._topics[-1].get_num_connections():
            assert time.monotonic() < end
            time.sleep(0.01)
        send([str(number)])
        leaves.close()
        assert heard.get(timeout=60.0) == str(number)
    hears.close()


@pytest.mark.timeout(60)  # the driver waits for a robot, but does not wait after a topic of a wrong type
def test_35_topics_of_a_wrong_type_are_refused_by_name(start: Start) -> None:
    namespace = anywhere()
    ros_robot(start, namespace, wrong_type=True)
    with pytest.raises(
        DriverError, match=r"/joint_states is std_msgs/msg/String; valid: sensor_msgs/msg/JointS"
    ):
        connect(tci.load_robot("nao"), f"ros1:{namespace}", wait=600.0)


def test_33_a_flood_does_not_age_what_is_read(start: Start) -> None:
    namespace = anywhere()
    ros_robot(start, namespace, flood=100)
    with connect(tci.load_robot("nao"), f"ros1:{namespace}", wait=60.0) as driver:
        time.sleep(2.0)
        end = time.monotonic() + 30.0
        while driver.clock.now() - driver.read().joints.stamp > driver.gate.stale_after:
            assert time.monotonic() < end


def test_a_robot_that_tci_shows_is_an_ordinary_robot_to_ros(start: Start) -> None:
    start(*SERVE, "ros1:/left")
    robot = tci.load_robot("nao")
    with connect(robot, "ros1:/left", arm=True, wait=60.0) as driver:
        assert driver.read().joints.modes is not None, "a TCI process tells more than a JointState can"
        go(driver, "LElbowRoll", -1.2)
    asked = subprocess.run(
        [DEBIAN_PYTHON, "-c", LOOK], capture_output=True, text=True, timeout=120, check=True
    )
    found = json.loads(asked.stdout.splitlines()[-1])
    assert set(found["position"]) == {servo.joint or servo.name for servo in robot.servos}
    assert found["position"]["LElbowRoll"] == pytest.approx(-1.2, abs=0.01)
    assert found["cloud"] == [240, "LForeArm", ["x", "y", "z", "pressure", "raw"]]
    assert read_facts(found["facts"]) == query(robot)
    assert found["urdf"].startswith("<?xml")
    assert found["type"] == "tci_msgs/SkinFrame"
    assert found["after"]["RElbowRoll"] == pytest.approx(0.8, abs=0.01)


LOOK = """
import json, rospy, rostopic
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
rospy.init_node("client")
def one(topic, kind):
    return rospy.wait_for_message("/left/" + topic, kind, timeout=20.0)
def joints():
    state = one("joint_states", JointState)
    return dict(zip(state.name, state.position))
cloud = one("skin/left_forearm/points", PointCloud2)
found = {
    "position": joints(),
    "cloud": [cloud.width, cloud.header.frame_id, [field.name for field in cloud.fields]],
    "facts": one("tci/facts", String).data,
    "urdf": one("robot_description", String).data,
    "type": rostopic.get_topic_type("/left/skin/left_forearm")[0],
}
move = rospy.Publisher("/left/RArm_controller/joint_trajectory", JointTrajectory, queue_size=1)
while move.get_num_connections() == 0:
    rospy.sleep(0.05)
point = JointTrajectoryPoint(positions=[0.8], time_from_start=rospy.Duration(0.4))
found["after"] = joints()
for _ in range(20):  # refused while the robot still holds after a commander whose farewell was lost
    move.publish(JointTrajectory(joint_names=["RElbowRoll"], points=[point]))
    for _ in range(100):
        if abs(found["after"]["RElbowRoll"] - 0.8) < 0.01:
            break
        found["after"] = joints()
print(json.dumps(found))
"""


def test_without_a_master_and_in_a_bad_namespace_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    needs_debian_module("rospy", "ros-core")
    with pytest.raises(DriverError, match="no ROS namespace"):
        connect(tci.load_robot("nao"), "ros1:a b")
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    with pytest.raises(DriverError, match=r"no ROS master at http://127.0.0.1:9.*roscore"):
        connect(tci.load_robot("nao"), "ros1")
