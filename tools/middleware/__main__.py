"""Tests each middleware: the contract suite, a genuine program as the other end, a round trip, and the sudden
death of the other process.

make middleware

runs the tests, measures the times, and writes docs/tables/middleware.md.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tools")]

import numpy as np
from report import TABLES, markdown
from rich.progress import track
from round_trip import in_turn

from helpers.ros_robots import here_only, roscore
from helpers.wire_peers import PEERS, Peer, free_port, lcm_url
from tci.gate.safe_command import GateState
from yarpwire.name_server import NameServer

TABLE = TABLES / "middleware.md"
CONTRACT = "tests/drivers/test_driver.py"
HEAD = (
    "middleware", "tests passed", "program at the other end", "tests with this program",
    "round trip of 768 doubles [ms]", "this round trip over plain TCP [ms]",
    "hold after the other process is killed [ms]", "when this process runs again",
)  # fmt: skip
AGAIN = "connect again; earlier commands are lost"
ITSELF = "reconnects automatically, waits for a new command"


@dataclass(frozen=True)
class Row:
    """One middleware, which is one row of the table."""

    peer: Callable[[], str]
    """Function that returns the name and version of the genuine program at the other end of the
    connection."""
    tests: str
    """Files and folders of tests/wires whose tests use this genuine program."""
    back: str
    """Behaviour after the robot's process has died and started again."""
    where: Callable[[], str] = lambda: str(free_port())
    """Function that returns an address for the round-trip measurement."""


def debian(package: str) -> str:
    """Returns the version of an installed Debian package."""
    asked = ["dpkg-query", "-W", "-f", "${Version}", package]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout


def rclpy() -> str:
    script = (
        "from importlib.metadata import version; print(version('ros-rclpy'), version('ros-rmw-fastrtps-cpp'))"
    )
    asked = [str(ROOT / ".peers/ros2/bin/python"), "-c", script]
    found = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()
    return f"rclpy {found[0]} (rmw_fastrtps {found[1]})"


def sdks() -> str:
    script = (
        "from importlib.metadata import version as v; print(v('far-unitree-sdk'), v('unitree-sdk2py-dimos'))"
    )
    asked = [str(ROOT / ".peers/unitree/bin/python"), "-c", script]
    cpp, python = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()
    return f"Unitree's SDKs: C++ (far-unitree-sdk {cpp}), Python (unitree-sdk2py-dimos {python})"


def zenoh_where() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


ROBOT = f"a robot with ROS: {ITSELF}; a robot served by TCI: {AGAIN}"
SAID = "recorded messages"
ROWS = {
    "zenoh": Row(
        lambda: f"Zenoh {version('eclipse-zenoh')}: sessions, a router",
        "zenoh",
        AGAIN,
        zenoh_where,
    ),
    "lcm": Row(
        lambda: f"lcm-logger, lcm-logplayer {debian('liblcm-bin')}, LCM {version('lcm')}",
        "lcm",
        AGAIN,
        lcm_url,
    ),
    "naoqi": Row(lambda: f"libqi {version('qi')}: sessions, services", "naoqi", ITSELF),
    "yarp": Row(lambda: f"YARP 3.12.3, {SAID}", "yarp", ITSELF),
    "yarp4": Row(lambda: f"YARP 4.0, {SAID}", "yarp", ITSELF),
    "ros2": Row(rclpy, "ros/test_ros2.py", ROBOT),
    "ros1": Row(lambda: f"roscore, rospy {debian('python3-rospy')}", "ros/test_ros1.py", ROBOT),
    "player": Row(lambda: f"Player 3.1.1, {SAID}", "player", AGAIN),
    "rosbridge": Row(lambda: f"rosbridge_server 0.11.17, {SAID}", "ros/test_rosbridge.py", ROBOT),
    "unitree": Row(sdks, "unitree", ITSELF, lambda: "99"),
}


def contract() -> dict[str, Counter[str]]:
    """Runs the contract suite. Returns the numbers of tests that passed and failed, by middleware."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        options = ["-q", "-n", "2", "--dist", "loadgroup", f"--junitxml={report}"]
        subprocess.run([sys.executable, "-m", "pytest", *options, CONTRACT], cwd=ROOT, check=False)
        cases = list(ElementTree.parse(report).getroot().iter("testcase"))
    found: dict[str, Counter[str]] = {name: Counter() for name in PEERS}
    for case in cases:
        passed = not {child.tag for child in case} & {"failure", "error", "skipped"}
        name = case.attrib["name"].rpartition("[")[2].partition("]")[0]
        found[name]["passed" if passed else "not"] += 1
    return found


def held_after(peer: Peer) -> float:
    """Returns the time [ms] from the SIGKILL of the robot's process to the first command with which the gate
    holds the robot."""
    peer.start()
    try:
        with peer.open(arm=True, silence=peer.usual_silence) as driver:
            for _ in driver.ticks(duration=1.0):
                driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))
            peer.kill()
            died = time.monotonic()
            for _ in driver.ticks(duration=20.0):
                sent = driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))
                if sent.state is not GateState.RUN:
                    return (time.monotonic() - died) * 1e3
    finally:
        peer.stop()
    raise SystemExit("the gate did not hold the robot within 20 s after its process was killed")


def timed(name: str, row: Row) -> tuple[str, str]:
    """Returns the medians and 99th percentiles [ms] of round-trip times over one middleware and over raw TCP.
    Starts the name server or master of the middleware if one is needed."""
    where = row.where()
    with ExitStack() as stack:
        if name == "ros1":
            roscore()
        if name == "ros2":
            here_only()
        if name.startswith("yarp"):
            server = stack.enter_context(NameServer())
            where = f"{server.address[0]}:{server.address[1]},{'4' if name == 'yarp4' else '3'}"
        if name == "rosbridge":
            relay = subprocess.Popen(
                [sys.executable, str(ROOT / "tests/helpers/rosbridge_relay.py")],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )  # fmt: skip
            stack.callback(relay.communicate)
            stack.callback(relay.kill)
            assert relay.stdout is not None
            where = relay.stdout.readline().strip()
        ours, theirs = in_turn(name, where)
    return (
        f"{1e3 * np.median(ours):.2f} / {1e3 * np.percentile(ours, 99):.2f}",
        f"{1e3 * np.median(theirs):.3f} / {1e3 * np.percentile(theirs, 99):.3f}",
    )


def share(found: Counter[str]) -> str:
    return f"{found['passed']} of {found.total()}"


def main() -> None:
    load = os.getloadavg()[0]
    figures = {name: timed(name, row) for name, row in track(ROWS.items(), "round trips")}
    held = {name: held_after(PEERS[name]()) for name in track(ROWS, "killing peers")}
    tests = contract()
    table = markdown(HEAD, [
        (f"`{name}`", share(tests[name]), row.peer(), ", ".join(f"`{name}`" for name in row.tests.split()),
         *figures[name], f"{held[name]:.0f}", row.back)
        for name, row in ROWS.items()
    ])  # fmt: skip
    about = f"Times are median / 99th percentile, on {os.cpu_count()} cores at a load of {load:.1f}."
    TABLE.write_text(f"{table}\n{about}\n")
    print(TABLE.read_text())


if __name__ == "__main__":
    main()
