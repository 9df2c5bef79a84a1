"""Programs for the other end of each driver's connection in the contract suite. A new middleware adds its
program to `PEERS`."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import zenoh

import tci
from helpers import HELPERS, TESTS
from helpers.dds_domains import DOMAINS
from helpers.patient import PATIENCE, patient
from helpers.peers import bindings_dialect
from helpers.ros_robots import anywhere, garbage_on, here_only, roscore
from helpers.served import needs_qi
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver
from tci.shared.interface_node import InterfaceNode
from tci.shared.ros1_node import Ros1Node
from tci.shared.ros2_dds import DdsNode
from tci.wires.lcm.datagrams import Transmitter
from tci.wires.ros.rosbridge import RosbridgeNode, parse
from tci.wires.unitree.messages import STATE
from tci.wires.unitree.wire import HEAD
from tci.wires.unitree.wire import STATE as STATE_RECORD
from tci.wires.zenoh.session import close_session, open_session, parse_address
from yarpwire.carrier import FAST_TCP
from yarpwire.errors import PortError
from yarpwire.names import Names
from yarpwire.names import parse_address as parse_names
from yarpwire.outgoing import dial

SERVED = HELPERS / "patient.py"


class Peer(ABC):
    """The other end of a driver's connection: a robot that the driver can read and command."""

    other_process = True
    """True if the peer is another process, which can be lost."""
    usual_silence = 0.08
    """Age [s] of joint data above which a robot of this middleware holds, except in tests."""

    @abstractmethod
    def start(self) -> None:
        """Starts the peer."""

    @abstractmethod
    def open(self, *, arm: bool, silence: float = PATIENCE) -> Driver:
        """Opens a driver of the peer's NAO. The gate of this driver holds after `silence` [s] without
        data."""

    def freeze(self) -> None:
        """Suspends the peer until `thaw`."""
        raise NotImplementedError

    def thaw(self) -> None:
        """Resumes the peer."""
        raise NotImplementedError

    def kill(self) -> None:
        """Kills the peer, without a farewell message."""
        raise NotImplementedError

    def commander(self) -> subprocess.Popen[str]:
        """Starts another process that moves the robot and prints `moving`."""
        raise NotImplementedError

    def disturb(self, messages: Iterable[bytes]) -> None:
        """Sends bytes to the address at which the driver receives."""
        raise NotImplementedError

    @abstractmethod
    def stop(self) -> None:
        """Ends the peer and all programs that it started."""


class Simulated(Peer):
    """The simulation in the same process."""

    other_process = False

    def start(self) -> None:
        pass

    def open(self, *, arm: bool, silence: float = PATIENCE) -> Driver:
        return SimulatedDriver(tci.load_robot("nao"), arm=arm)

    def stop(self) -> None:
        pass


class Process(Peer):
    """A simulated NAO that another process serves."""

    process: subprocess.Popen[str] | None = None
    script = SERVED
    """Program that serves the robot."""

    def __init__(self, via: Callable[[], str]) -> None:
        self.make_via = via

    def prepare(self) -> None:
        """Starts programs that a server needs, such as a master or a relay."""

    def start(self) -> None:
        self.prepare()
        self.via = self.driver_via = self.make_via()
        self.process = subprocess.Popen(
            [sys.executable, str(self.script), self.via],
            stdout=subprocess.PIPE, text=True, cwd=TESTS,
        )  # fmt: skip
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def open(self, *, arm: bool, silence: float = PATIENCE) -> Driver:
        return tci.connect(patient("nao", silence), self.driver_via, arm=arm)

    def freeze(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def commander(self) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "helpers.commander", self.driver_via]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=TESTS)

    def stop(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.thaw()
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.kill()


class Zenoh(Process):
    """A NAO over Zenoh."""

    def __init__(self) -> None:
        super().__init__(lambda: f"zenoh:tcp/127.0.0.1:{free_port()}")

    def disturb(self, messages: Iterable[bytes]) -> None:
        session = open_session(parse_address(self.via.removeprefix("zenoh:"), "nao"), "connect")
        publishers = [
            session.declare_publisher(f"tci/nao/{key}", congestion_control=zenoh.CongestionControl.BLOCK)
            for key in ("state", "skin/left_forearm")
        ]
        for message in messages:
            for publisher in publishers:
                publisher.put(message)
        close_session(session)


class Lcm(Process):
    """A NAO over LCM."""

    def __init__(self, ttl: int = 0) -> None:
        super().__init__(lambda: f"lcm:{lcm_url(ttl)}")

    def disturb(self, messages: Iterable[bytes]) -> None:
        stranger = Transmitter(self.via.removeprefix("lcm:"))
        for message in messages:
            stranger.send_raw(message)
            for channel in ("state", "skin"):
                stranger.send(f"tci/nao/{channel}", message)
        stranger.close()


class Naoqi(Process):
    """A NAO over NAOqi."""

    def __init__(self) -> None:
        super().__init__(lambda: f"naoqi:127.0.0.1:{free_port()}")

    def prepare(self) -> None:
        needs_qi()

    def start(self) -> None:
        super().start()
        self.driver_via = self.via.replace("naoqi:", "naoqi://")

    def disturb(self, messages: Iterable[bytes]) -> None:
        for message in messages:
            with socket.socket() as stranger:
                stranger.connect(("127.0.0.1", int(self.via.rpartition(":")[2])))
                stranger.sendall(message)


class Yarp(Process):
    """A NAO over YARP 3.12."""

    dialect = "3"

    def __init__(self) -> None:
        super().__init__(lambda: f"yarp:127.0.0.1:{free_port()},dialect={self.dialect}")

    def start(self) -> None:
        super().start()
        self.driver_via = self.via.partition(",")[0]

    def disturb(self, messages: Iterable[bytes]) -> None:
        names = Names(parse_names(self.via.removeprefix("yarp:").partition(",")[0]))
        ports = [contact for contact in names.list() if contact.name.startswith("/tci/")]
        for number, message in enumerate(messages):
            contact = ports[number % len(ports)]
            try:
                sock = dial(contact, f"/stranger/{number}", FAST_TCP, None)[0]
                with sock:
                    sock.sendall(message)
            except (PortError, OSError):
                continue


class Yarp4(Yarp):
    """A NAO over YARP 4.0."""

    dialect = "4"


class YarpBindings(Yarp):
    """A NAO over YARP's own bindings, in the dialect of the bindings."""

    def __init__(self) -> None:
        self.dialect = bindings_dialect() or ""
        self.configured = ExitStack()
        Process.__init__(self, lambda: f"yarp:{bindings_server()},dialect={self.dialect}")

    def start(self) -> None:
        self.configured.enter_context(bindings_configured())
        Process.start(self)
        self.driver_via = "yarp:bindings"

    def stop(self) -> None:
        super().stop()
        self.configured.close()


class Player(Process):
    """A NAO over Player's protocol."""

    def __init__(self) -> None:
        super().__init__(lambda: f"player:127.0.0.1:{free_port()}")

    def disturb(self, messages: Iterable[bytes]) -> None:
        for message in messages:
            with socket.socket() as stranger:
                stranger.connect(("127.0.0.1", int(self.via.rpartition(":")[2])))
                stranger.sendall(message)


class Ros2(Process):
    """A NAO in ROS 2, through cyclonedds."""

    def __init__(self) -> None:
        super().__init__(lambda: f"ros2:{anywhere()}")

    def prepare(self) -> None:
        here_only()

    def disturb(self, messages: Iterable[bytes]) -> None:
        garbage_on(DdsNode("stranger"), self.via.removeprefix("ros2:"), messages)


class Ros1(Process):
    """A NAO in ROS 1."""

    def __init__(self) -> None:
        super().__init__(lambda: f"ros1:{anywhere()}")

    def prepare(self) -> None:
        roscore()

    def disturb(self, messages: Iterable[bytes]) -> None:
        garbage_on(Ros1Node("stranger"), self.via.removeprefix("ros1:"), messages)


class Rosbridge(Process):
    """A NAO behind a rosbridge server."""

    relay: subprocess.Popen[str] | None = None

    def __init__(self) -> None:
        super().__init__(lambda: f"rosbridge:127.0.0.1:{self.port}{anywhere()}")

    def prepare(self) -> None:
        self.relay = subprocess.Popen(
            [sys.executable, str(SERVED.with_name("rosbridge_relay.py"))],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.relay.stdout is not None
        self.port = int(self.relay.stdout.readline())

    def disturb(self, messages: Iterable[bytes]) -> None:
        host, port, namespace = parse(self.via.removeprefix("rosbridge:"))
        garbage_on(RosbridgeNode(host, port), namespace, messages)

    def stop(self) -> None:
        super().stop()
        if self.relay is not None:
            self.relay.kill()
            self.relay.communicate()


class Unitree(Process):
    """A NAO on the topics of a Unitree G1, which have no skin data."""

    usual_silence = 0.1

    def __init__(self) -> None:
        super().__init__(lambda: f"unitree:lo/{next(DOMAINS)}")

    def disturb(self, messages: Iterable[bytes]) -> None:
        stranger = InterfaceNode("lo", int(self.via.rpartition("/")[2]))
        send, size = stranger.out("rt/lowstate", STATE), STATE_RECORD.itemsize - 4
        for message in messages:
            send(HEAD + message.ljust(size)[:size])
        stranger.close()


def free_port() -> int:
    """Returns a free TCP port number of the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@cache
def bindings_server() -> str:
    """Returns HOST:PORT of the name server for YARP's bindings. In one process the bindings use only the
    first name server."""
    return f"127.0.0.1:{free_port()}"


@contextmanager
def bindings_configured() -> Iterator[str]:
    """Writes YARP's configuration so that it contains this name server."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        Path(folder, "yarp.conf").write_text(f"{bindings_server().replace(':', ' ')} yarp\n")
        patch.setenv("YARP_CONFIG_HOME", folder)
        yield bindings_server()


def lcm_url(ttl: int = 0) -> str:
    """Returns the URL of a multicast group that no other test uses. By default the messages stay on this
    machine."""
    return f"udpm://239.255.76.67:{free_port()}?ttl={ttl}"


PEERS: dict[str, Callable[[], Peer]] = {
    "sim": Simulated,
    "zenoh": Zenoh,
    "lcm": Lcm,
    "naoqi": Naoqi,
    "yarp": Yarp,
    "yarp4": Yarp4,
    "ros2": Ros2,
    "ros1": Ros1,
    "player": Player,
    "rosbridge": Rosbridge,
    "unitree": Unitree,
}
"""Peer of every driver, by the driver's name."""

BINDINGS: dict[str, Callable[[], Peer]] = {"yarp-bindings": YarpBindings} if bindings_dialect() else {}
"""Peers of the driver that uses YARP's bindings, which neither Debian nor PyPI has. If the bindings are
installed, the contract suite tests this driver too."""


@contextmanager
def wire(name: str) -> Iterator[str]:
    """Yields an address `NAME:WHERE` at which a robot can be served. The programs that its server needs are
    running."""
    peer = PEERS[name]()
    assert isinstance(peer, Process)
    try:
        peer.prepare()
        yield peer.make_via()
    finally:
        peer.stop()
