"""Another process requests kinematic chains from a served robot over a middleware, and builds them in OROCOS
KDL.

That process has no TCI. It is Debian's Python with rospy, genuine rclpy, Zenoh alone, LCM alone, or a short
implementation of Player's protocol.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers import ROOT
from helpers.moving import random_postures, robot_and_kinematics
from helpers.peers import DEBIAN_PYTHON, debian_python, needs_debian_module, peer_python
from helpers.ros_robots import Programs, here_only, roscore
from helpers.wire_peers import free_port, lcm_url
from tci.exports.facts import query

PAGE = ROOT / "docs" / "kinematics.md"
PART = "left_arm"
BY_ROS1 = """
import rospy
from std_msgs.msg import String
rospy.init_node("asker")
print(rospy.wait_for_message("/tci/facts", String, timeout=60.0).data)
"""
BY_ROS2 = """
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
rclpy.init()
node, found = rclpy.create_node("asker"), []
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(String, "/tci/facts", lambda message: found.append(message.data), latched)
while not found:
    rclpy.spin_once(node, timeout_sec=0.1)
print(found[0], flush=True)
import os
os._exit(0)
"""
BY_PLAYER = """
import socket, struct, sys
with socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=60.0) as player:
    stream = player.makefile("rb")
    stream.read(32)
    player.sendall(struct.pack(">IIIIIIdII", 0, 0, 51, 99, 3, 1, 0.0, 0, 0))
    while True:
        *_, kind, subtype, stamp, sequence, size = struct.unpack(">IIIIIIdII", stream.read(40))
        body = stream.read(size)
        if kind == 4:
            break
    count = struct.unpack(">I", body[:4])[0]
    print(body[8 : 8 + count].decode())
"""
BY_ZENOH = """
import sys, time, zenoh
config = zenoh.Config.from_json5('{mode: "client", connect: {endpoints: ["tcp/127.0.0.1:%s"]}}' % sys.argv[1])
with zenoh.open(config) as session:
    found = [reply.ok for reply in session.get("tci/nao/facts", timeout=10.0)]
print(found[0].payload.to_string())
"""
BY_LCM = """
import struct, sys, zlib, lcm
found, bus = [], lcm.LCM(sys.argv[1])
bus.subscribe("tci/nao/facts", lambda channel, data: found.append(data))
while not found:
    bus.handle_timeout(60000)
(size,) = struct.unpack(">i", found[0][16:20])
print(zlib.decompress(found[0][20 : 20 + size]).decode())
"""
KDL = """
import json, sys
import PyKDL as kdl
request = json.load(sys.stdin)
exec(request["documented"])
forward, poses = kdl.ChainFkSolverPos_recursive(chain), []
for values in request["postures"]:
    q, pose = kdl.JntArray(len(values)), kdl.Frame()
    for i, value in enumerate(values):
        q[i] = value
    forward.JntToCart(q, pose)
    poses.append([[pose.M[i, j] for j in range(3)] + [pose.p[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]])
json.dump(poses, sys.stdout)
"""


@pytest.fixture
def programs() -> Iterator[Programs]:
    started = Programs()
    yield started
    started.kill()


def ros1(programs: Programs) -> str:
    roscore()
    programs.start(*SERVE, "ros1")
    return asked(DEBIAN_PYTHON, BY_ROS1)


def ros2(programs: Programs) -> str:
    here_only()
    python = peer_python("ros2")
    programs.start(*SERVE, "ros2")
    return asked(python, BY_ROS2)


def player(programs: Programs) -> str:
    port = free_port()
    programs.start(*SERVE, f"player:127.0.0.1:{port}")
    return patiently(DEBIAN_PYTHON, BY_PLAYER, str(port))


def zenoh(programs: Programs) -> str:
    port = free_port()
    programs.start(*SERVE, f"zenoh:tcp/127.0.0.1:{port}")
    return patiently(sys.executable, BY_ZENOH, str(port))


def over_lcm(programs: Programs) -> str:
    url = lcm_url()
    programs.start(*SERVE, f"lcm:{url}")
    return asked(sys.executable, BY_LCM, url)


def patiently(*command: str) -> str:
    """Returns the output of a client, and repeats the request while the robot is starting."""
    end = time.monotonic() + 60.0
    while True:
        try:
            return asked(*command)
        except subprocess.CalledProcessError:
            assert time.monotonic() < end
            time.sleep(0.5)


SERVE = (sys.executable, "-m", "tci.cli.main", "serve", "nao", "--duration", "120", "--via")


def asked(*command: str) -> str:
    """Returns the output of another program that requests the facts of the robot."""
    python, script, *rest = command
    done = subprocess.run(
        [python, "-c", script, *rest], capture_output=True, text=True, timeout=90, check=True
    )
    return done.stdout


@pytest.mark.parametrize("ask", [ros1, ros2, player, zenoh, over_lcm], ids=lambda ask: ask.__name__)
def test_kdl_builds_the_chain_that_came_over_the_driver(
    ask: Callable[[Programs], str], programs: Programs, tmp_path: Path
) -> None:
    needs_debian_module("PyKDL", "python3-pykdl")
    facts = json.loads(ask(programs))
    robot, kinematics = robot_and_kinematics("nao")
    assert facts["digest"] == tci.load_robot("nao").digest == query(robot).digest
    file = tmp_path / "chains.json"
    file.write_text(json.dumps(facts["chains"]))
    lines = PAGE.read_text().split("```python\n")[1].split("```")[0]
    servos = [segment["servo"] for segment in facts["chains"][PART] if segment["servo"] is not None]
    tip = facts["chains"][PART][-1]["name"]
    postures = random_postures(robot, 50, seed=3)
    request = {
        "documented": lines.replace('"nao.json"', repr(str(file))),
        "postures": postures[:, servos].tolist(),
    }
    for posture, pose in zip(postures, json.loads(debian_python(KDL, json.dumps(request))), strict=True):
        assert np.abs(kinematics.poses(posture, [tip])[tip] - pose).max() <= 1e-9
