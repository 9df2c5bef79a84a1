"""Messages from senders that do not belong to the robot, on another machine and on this machine, have no
effect."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import psutil
import pytest

from helpers.namespaces import Network, needs_namespaces
from helpers.remote_messages import JOINTS, NAO, ORDERS
from helpers.remote_wire import Wire
from helpers.wire_peers import Lcm, lcm_url
from tci.drivers.remote.commanders import LEASE
from tci.drivers.remote.protocol import SessionFrame, State
from tci.drivers.simulated import SimulatedDriver
from tci.gate.safe_command import GateState, SafeCommand
from tci.messages import SkinFrame
from tci.reasons import Reason
from tci.shared.own_sockets import on_loopback
from tci.wires.lcm.datagrams import Receiver, Transmitter, parse_url
from tci.wires.lcm.driver import LcmDriver, LcmServer
from tci.wires.lcm.encoding import frame_bytes, orders_bytes, state_bytes

pytestmark = [pytest.mark.timeout(240), pytest.mark.xdist_group("namespaces")]
LISTEN = """
import sys, time
from tci.wires.lcm.datagrams import Receiver
receiver = Receiver(sys.argv[1])
print("ready", flush=True)
end, came = time.monotonic() + float(sys.argv[2]), 0
while time.monotonic() < end:
    came += len(list(receiver.poll()))
    time.sleep(0.01)
print("came", came)
"""
SHOUT = """
import socket, sys, time
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
    stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
    stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("10.77.1.1"))
    for number in range(50):
        data = b"LC02" + number.to_bytes(4, "big") + b"tci/nao/skin\\0body"
        stranger.sendto(data, (sys.argv[1], int(sys.argv[2])))
        time.sleep(0.01)
"""
LOOK = """
import os, time
os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": "10.77.1.2"}
from tci.shared.ros2_node import open_node
node, end, seen = open_node("stranger", ""), time.monotonic() + 5.0, ()
while not seen and time.monotonic() < end:
    seen = node.types_of("/joint_states")
    time.sleep(0.05)
print("sees", *seen)
"""


@pytest.fixture
def network() -> Iterator[Network]:
    """Yields a network in which an unknown program runs on the router. A robot's machine uses the router as
    its default route."""
    needs_namespaces()
    made = Network(f"tcis{os.getpid()}")
    made.ip("-n", made.at("robots"), "route", "add", "default", "via", "10.77.1.1")
    yield made
    made.end()


def said(process: subprocess.Popen[str], word: str) -> str:
    """Returns the next line of the process that begins with `word`."""
    assert process.stdout is not None
    return next(line for line in process.stdout if line.startswith(word)).strip()


@pytest.mark.parametrize(("ttl", "came"), [(0, "came 0"), (1, "came 50")])
def test_lcm_hears_other_machines_only_where_its_url_says_so(network: Network, ttl: int, came: str) -> None:
    url = lcm_url(ttl)
    group = parse_url(url)
    receiver = network.start("robots", "-c", LISTEN, url, "3.0")
    said(receiver, "ready")
    network.says("router", "-c", SHOUT, group.address, str(group.port))
    assert said(receiver, "came") == came


@pytest.mark.parametrize(
    ("reach", "seen"), [("", "sees"), ("SUBNET", "sees sensor_msgs/msg/JointState")], ids=["default", "wide"]
)
def test_ros_2_is_seen_from_other_machines_only_where_the_range_says_so(
    network: Network, monkeypatch: pytest.MonkeyPatch, reach: str, seen: str
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", reach)
    monkeypatch.setenv("COLUMNS", "200")  # keeps the message on one line
    robot = network.start("robots", "-m", "tci.cli.main", "serve", "nao", "--via", "ros2")
    words = said(robot, "serving")
    assert ("everybody on the network" in words) == bool(reach)
    looked = network.says("router", "-c", LOOK)
    assert [line for line in looked.splitlines() if line.startswith("sees")] == [seen]


def test_what_a_library_opens_on_every_interface_is_kept_on_loopback() -> None:
    def device(sock: socket.socket) -> bytes:
        return sock.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(b"\0")

    with ExitStack() as stack:

        def opened() -> socket.socket:
            return stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))

        before = opened()
        with on_loopback():
            during = opened()
        after = opened()
        assert [device(sock) for sock in (before, during, after)] == [b"", b"lo", b""]


def test_lcm_hears_nothing_that_comes_in_on_another_interface_of_this_machine() -> None:
    """This test needs no root: data sent to that interface are also received on this machine."""
    others = [
        address.address for name, addresses in psutil.net_if_addrs().items() for address in addresses
        if address.family.name == "AF_INET" and not address.address.startswith("127.")
        and psutil.net_if_stats()[name].isup
    ]  # fmt: skip
    if not others:
        pytest.skip("did not run: needs an interface beside loopback")
    url = lcm_url()
    group, receiver, here = parse_url(url), Receiver(url), Transmitter(url)
    wide = Receiver(
        url.replace("ttl=0", "ttl=1")
    )  # a program that joins the group on another interface must not make this program receive from there
    for address in others:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
            stranger.sendto(b"LC02\0\0\0\1c\0body", (group.address, group.port))
    here.send("c", b"mine")
    time.sleep(0.2)
    assert [data for _, data, _ in receiver.poll()] == [b"mine"]
    for one in (receiver, here, wide):
        one.close()


TOUCH = SkinFrame("left_forearm", 1.0, 1 << 40, np.full(NAO.patch("left_forearm").channels, 255, np.uint8))
"""A frame in which every taxel is pressed, with a higher sequence number than all other frames."""


def test_of_a_served_robot_only_its_own_skin_and_states_count() -> None:
    """An unknown program on this machine may have read the session number, which is part of every message."""
    peer = Lcm()
    peer.start()
    url = peer.via.removeprefix("lcm:")
    stranger = Transmitter(url)
    try:
        with peer.open(arm=True) as driver:
            assert isinstance(driver, LcmDriver)
            assert driver._state is not None
            own = driver._state.session
            driver.read()
            for session in (own, own + 1):
                joints = replace(JOINTS, position=np.full(len(NAO.servos), 0.1))
                false = State(session, 1 << 40, 0.0, 0.0, joints, "stop", Reason.of("a lie"), ())
                stranger.send("tci/nao/state", state_bytes(driver.robot, false))
                stranger.send("tci/nao/skin", frame_bytes(driver.robot, SessionFrame(session, TOUCH)))
            before = {frame.patch: frame.sequence for frame in driver.read().skin}
            for _ in driver.ticks(duration=1.0):
                reading = driver.read()
                if driver.strangers >= 4 and all(f.sequence > before[f.patch] for f in reading.skin):
                    break
            assert driver.strangers == 4
            assert driver.gate.state is not GateState.STOP
            for frame in reading.skin:
                assert before[frame.patch] < frame.sequence < TOUCH.sequence
            assert reading.joints.position[0] != 0.1
            (finding,) = [found for found in driver.diagnose() if found.subject == "strangers"]
            assert finding.what.startswith("4 messages ignored")
    finally:
        stranger.close()
        peer.stop()


def test_orders_in_the_name_of_a_commander_count_from_its_own_place_only() -> None:
    url = lcm_url()
    with SimulatedDriver(NAO) as driver, LcmServer(driver, url) as server:
        commander, stranger = Transmitter(url), Transmitter(url)

        def order(sender: Transmitter, sequence: int) -> None:
            mine = replace(ORDERS, session=server.number, seen=time.monotonic(), sequence=sequence, orders=())
            sender.send("tci/nao/orders", orders_bytes(NAO, mine))
            server.fault()

        order(commander, 1)
        order(stranger, 1 << 40)
        assert server.rejected == 1
        order(commander, 2)
        assert server.commanders.rejected == 0
        assert server.commanders._members[ORDERS.client].sequence == 2
        commander.close()
        stranger.close()


def test_skin_of_another_session_is_counted_and_changes_nothing() -> None:
    wire = Wire()
    wire.inbox.append(SessionFrame(1, TOUCH))  # before a state message contains the session number
    wire.tell()
    wire.inbox.append(SessionFrame(2, TOUCH))
    assert wire.read().skin == ()
    wire.inbox.append(SessionFrame(1, replace(TOUCH, sequence=5)))
    assert [frame.sequence for frame in wire.read().skin] == [5]
    assert wire.strangers == 1


def test_a_state_of_another_session_ends_a_driver_only_once_its_own_robot_is_silent() -> None:
    wire = Wire()
    wire.tell()
    wire.read()

    def other() -> SafeCommand:
        wire.inbox.append(State(2, 1, 0.0, 0.0, JOINTS, "run", None, ()))
        reading = wire.read()
        return wire.write(wire.gate.step([], reading.joints, wire.time.now()))

    wire.time.advance(wire.period)
    assert other().state is GateState.RUN
    assert wire.strangers == 1
    wire.time.advance(LEASE + 0.1)
    ended = other()
    assert ended.state is GateState.STOP
    assert "restarted" in str(ended.reason)


def test_frames_of_the_session_that_are_older_are_refused() -> None:
    """Within a session, sequence numbers only increase."""
    wire = Wire()
    wire.tell()
    for sequence in (5, 4, 6):
        wire.inbox.append(SessionFrame(1, replace(TOUCH, sequence=sequence)))
    assert [frame.sequence for frame in wire.read().skin] == [6]
    assert (wire.rejected, wire.strangers) == (1, 0)
