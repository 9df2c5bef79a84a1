"""Code that the tests of ROS 1, ROS 2 and rosbridge share."""

from __future__ import annotations

import ctypes
import os
import secrets
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

import numpy as np

import tci
from helpers.peers import needs_debian_module
from tci.drivers.driver import Driver
from tci.drivers.registry import connect
from tci.gate.safe_command import GateState
from tci.messages import Reading
from tci.recording.schemas import JOINTS
from tci.robot.joint_map import initial_position
from tci.shared.ros_node import RosNode
from tci.wires.ros.messages import BYTES, NO_LAYOUT

PATCHES = {patch.name: patch.channels for patch in tci.load_robot("nao").patches}
Start = Callable[..., "subprocess.Popen[str]"]


class Programs:
    """Programs that a test started. All are killed at the end of the test, since some ignore SIGTERM."""

    def __init__(self) -> None:
        self.running: list[subprocess.Popen[str]] = []

    def start(self, *command: str) -> subprocess.Popen[str]:
        environment = dict(os.environ)
        self.running.append(
            subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, env=environment
            )
        )
        return self.running[-1]

    def kill(self) -> None:
        for process in self.running:
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def nao_in_ros(**more: Any) -> dict[str, Any]:
    """Returns the settings with which a ROS robot is used as a NAO."""
    robot = tci.load_robot("nao")
    names = {servo.index: servo.joint or servo.name for servo in robot.servos}
    joints: dict[str, list[str]] = {}
    for servo in robot.servos:
        joints.setdefault(servo.robot_part, []).append(names[servo.index])
    position = {names[servo.index]: float(initial_position(robot)[servo.index]) for servo in robot.servos}
    return {"joints": joints, "position": position, "skin": PATCHES, **more}


def drive(driver: Driver, *orders: Any, seconds: float) -> list[Any]:
    """Runs the loop and returns the commands that were sent."""
    pending, sent = list(orders), []
    for now in driver.ticks(duration=seconds):
        sent.append(driver.write(driver.gate.step(pending, driver.read().joints, now)))
        pending = []
    return sent


def complete(driver: Driver) -> Reading:
    """Returns the first reading that has a frame of every patch, all of the right size."""
    end = time.monotonic() + 60.0
    while True:
        reading = driver.read()
        if {frame.patch: len(frame.values) for frame in reading.skin} == PATCHES:
            return reading
        assert time.monotonic() < end
        time.sleep(0.01)


def go(driver: Driver, joint: str, angle: float) -> None:
    """Moves a joint. Repeats the order if the robot held because the machine paused."""
    arm = driver.native("LArm")
    end = time.monotonic() + 60.0
    while abs(arm.positions(driver.read().joints)[joint] - angle) > 0.01:
        assert driver.gate.state is not GateState.STOP
        assert time.monotonic() < end
        drive(driver, arm.command({joint: angle}), seconds=0.5)


def is_killed_and_comes_back(via: str, begin: Callable[[], subprocess.Popen[str]]) -> None:
    """Checks that the gate holds when a robot process dies, and that a restarted robot receives nothing
    before a new command."""
    process = begin()
    with connect(tci.load_robot("nao"), via, arm=True, wait=60.0) as driver:
        drive(driver, seconds=0.3)
        process.kill()
        pending = [driver.native("LArm").command({"LElbowRoll": -0.1})]
        for now in driver.ticks(duration=30.0):
            joints = driver.read().joints
            safe = driver.write(driver.gate.step(pending, joints, now))
            pending = []
            if safe.state is GateState.HOLD:
                break
            # The gate holds in the first period in which the data are too old, even if a busy machine runs
            # this period late.
            assert now - joints.stamp <= driver.gate.stale_after <= 0.1
        assert safe.state is GateState.HOLD
        while np.any(safe.velocity):  # until the robot rests
            (safe,) = drive(driver, seconds=driver.period)
        process = begin()
        end, before = time.monotonic() + 90.0, driver.read().joints.sequence
        while driver.read().joints.sequence < before + 50 or driver.gate.state is not GateState.RUN:
            drive(driver, seconds=0.1)
            assert time.monotonic() < end
        process.kill()
    assert not list(process.stdout or ())


@cache
def roscore() -> str:
    """Returns the address of a ROS master on the loopback interface. All tests of a run share this master,
    because rospy permits one node per process, and a node has one master."""
    for module, package in (("rospy", "ros-core"), ("sensor_msgs", "python3-sensor-msgs")):
        needs_debian_module(module, package)
    needs_debian_module("trajectory_msgs", "python3-trajectory-msgs")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    os.environ |= {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    subprocess.Popen(
        ["roscore", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=_end_with_its_parent,
    )
    end = time.monotonic() + 60.0
    while True:
        with socket.socket() as asked:
            if asked.connect_ex(("127.0.0.1", port)) == 0:
                return os.environ["ROS_MASTER_URI"]
        assert time.monotonic() < end
        time.sleep(0.1)


def _end_with_its_parent() -> None:
    """Makes the process end when its parent process ends, because a worker of pytest-xdist ends without
    running atexit functions."""
    set_parent_death_signal = 1  # prctl's PR_SET_PDEATHSIG
    ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGTERM)


def here_only() -> None:
    """Restricts ROS 2 to nodes on this machine, in a domain that only these tests use."""
    os.environ |= {"ROS_DOMAIN_ID": "90", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def anywhere() -> str:
    """Returns a namespace that no other test uses."""
    return f"/n{secrets.token_hex(4)}"


def garbage_on(node: RosNode, namespace: str, messages: Iterable[bytes]) -> None:
    """Sends random bytes as states and frames of a TCI process, and joint messages of wrong lengths."""
    topics = [f"{namespace}/tci/nao/state", f"{namespace}/tci/nao/frames/left_forearm"]
    senders = [node.advertise(topic, BYTES) for topic in topics]
    joints = node.advertise(f"{namespace}/joint_states", JOINTS)
    for message in messages:
        for send in senders:
            send((NO_LAYOUT, np.frombuffer(message, dtype=np.uint8)))
        joints((0, 0, "", ["a"] * (len(message) % 3), [0.0], [], [1.0] * (len(message) % 2)))
    node.close()
