"""The other sides of drivers in the contract suite. A new middleware adds its own to `PEERS`."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import zenoh

import tci
from drivers.patient import patient
from drivers.ros_robots import anywhere, garbage_on, here_only, roscore
from drivers.served import needs_qi
from peers import bindings_dialect
from tci.drivers.driver import Driver
from tci.drivers.lcm.datagrams import Transmitter
from tci.drivers.ros.ros1 import Ros1Node
from tci.drivers.ros.ros2_dds import DdsNode
from tci.drivers.ros.rosbridge import RosbridgeNode, parse
from tci.drivers.simulated import SimulatedDriver
from tci.drivers.zenoh.session import close_session, open_session, parse_address
from yarpwire.carrier import FAST_TCP
from yarpwire.errors import PortError
from yarpwire.names import Names
from yarpwire.names import parse_address as parse_names
from yarpwire.outgoing import dial

SERVED = Path(__file__).with_name("patient.py")


class Peer(ABC):
    """What is at the other end of a driver."""

    other_process = True
    """Whether it can be lost."""

    @abstractmethod
    def start(self) -> None:
        """Be there."""

    @abstractmethod
    def open(self, *, arm: bool) -> Driver:
        """A driver to the NAO there."""

    def freeze(self) -> None:
        """Say nothing until `thaw`."""
        raise NotImplementedError

    def thaw(self) -> None:
        """Go on."""
        raise NotImplementedError

    def kill(self) -> None:
        """Die without a word."""
        raise NotImplementedError

    def commander(self) -> subprocess.Popen[str]:
        """Another process, which moves the robot and says `moving`."""
        raise NotImplementedError

    def disturb(self, messages: list[bytes]) -> None:
        """Send bytes to wherever the driver listens."""
        raise NotImplementedError

    @abstractmethod
    def stop(self) -> None:
        """Be gone, with everything that was started."""


class Simulated(Peer):
    """The simulation in the same process."""

    other_process = False

    def start(self) -> None:
        pass

    def open(self, *, arm: bool) -> Driver:
        return SimulatedDriver(tci.load_robot("nao"), arm=arm)

    def stop(self) -> None:
        pass


class Process(Peer):
    """A simulated NAO that another process serves."""

    process: subprocess.Popen[str] | None = None
    script = SERVED
    """What serves it."""

    def __init__(self, via: Callable[[], str]) -> None:
        self.make_via = via

    def start(self) -> None:
        self.via = self.driver_via = self.make_via()
        self.process = subprocess.Popen(
            [sys.executable, str(self.script), self.via],
            stdout=subprocess.PIPE, text=True, cwd=SERVED.parents[1],
        )  # fmt: skip
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def open(self, *, arm: bool) -> Driver:
        return tci.connect(patient("nao"), self.driver_via, arm=arm)

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
        command = [sys.executable, str(SERVED.with_name("commander.py")), self.driver_via]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=SERVED.parents[1])

    def stop(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.thaw()
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.kill()


class Zenoh(Process):
    """Over Zenoh."""

    def __init__(self) -> None:
        super().__init__(lambda: f"zenoh:tcp/127.0.0.1:{free_port()}")

    def disturb(self, messages: list[bytes]) -> None:
        session = open_session(parse_address(self.via.removeprefix("zenoh:"), "nao"), "connect")
        for key in ("state", "skin/left_forearm"):
            publisher = session.declare_publisher(
                f"tci/nao/{key}", congestion_control=zenoh.CongestionControl.BLOCK
            )
            for message in messages:
                publisher.put(message)
        close_session(session)


class Lcm(Process):
    """Over LCM."""

    def __init__(self, ttl: int = 0) -> None:
        super().__init__(lambda: f"lcm:{lcm_url(ttl)}")

    def disturb(self, messages: list[bytes]) -> None:
        stranger = Transmitter(self.via.removeprefix("lcm:"))
        for message in messages:
            stranger.send_raw(message)
            for channel in ("state", "skin"):
                stranger.send(f"tci/nao/{channel}", message)
        stranger.close()


class Naoqi(Process):
    """Over NAOqi."""

    def __init__(self) -> None:
        super().__init__(lambda: f"naoqi:127.0.0.1:{free_port()}")

    def start(self) -> None:
        needs_qi()
        super().start()
        self.driver_via = self.via.replace("naoqi:", "naoqi://")

    def disturb(self, messages: list[bytes]) -> None:
        for message in messages:
            with socket.socket() as stranger:
                stranger.connect(("127.0.0.1", int(self.via.rpartition(":")[2])))
                stranger.sendall(message)


class Yarp(Process):
    """Over YARP 3.12."""

    dialect = "3"

    def __init__(self) -> None:
        super().__init__(lambda: f"yarp:127.0.0.1:{free_port()},dialect={self.dialect}")

    def start(self) -> None:
        super().start()
        self.driver_via = self.via.partition(",")[0]

    def disturb(self, messages: list[bytes]) -> None:
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
    """Over YARP 4.0."""

    dialect = "4"


class YarpBindings(Yarp):
    """Over YARP by its own bindings, in their dialect."""

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
    """By Player's protocol."""

    def __init__(self) -> None:
        super().__init__(lambda: f"player:127.0.0.1:{free_port()}")

    def disturb(self, messages: list[bytes]) -> None:
        for message in messages:
            with socket.socket() as stranger:
                stranger.connect(("127.0.0.1", int(self.via.rpartition(":")[2])))
                stranger.sendall(message)


class Ros2(Process):
    """In ROS 2, by cyclonedds."""

    def __init__(self) -> None:
        super().__init__(lambda: f"ros2:{anywhere()}")

    def start(self) -> None:
        here_only()
        super().start()

    def disturb(self, messages: list[bytes]) -> None:
        garbage_on(DdsNode("stranger"), self.via.removeprefix("ros2:"), messages)


class Ros1(Process):
    """In ROS 1."""

    def __init__(self) -> None:
        super().__init__(lambda: f"ros1:{anywhere()}")

    def start(self) -> None:
        roscore()
        super().start()

    def disturb(self, messages: list[bytes]) -> None:
        garbage_on(Ros1Node("stranger"), self.via.removeprefix("ros1:"), messages)


class Rosbridge(Process):
    """Behind a rosbridge server."""

    relay: subprocess.Popen[str] | None = None

    def __init__(self) -> None:
        super().__init__(lambda: f"rosbridge:127.0.0.1:{self.port}{anywhere()}")

    def start(self) -> None:
        self.relay = subprocess.Popen(
            [sys.executable, str(SERVED.with_name("rosbridge_relay.py"))],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.relay.stdout is not None
        self.port = int(self.relay.stdout.readline())
        super().start()

    def disturb(self, messages: list[bytes]) -> None:
        host, port, namespace = parse(self.via.removeprefix("rosbridge:"))
        garbage_on(RosbridgeNode(host, port), namespace, messages)

    def stop(self) -> None:
        super().stop()
        if self.relay is not None:
            self.relay.kill()
            self.relay.communicate()


def free_port() -> int:
    """A TCP port of the loopback that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@cache
def bindings_server() -> str:
    """HOST:PORT of the name server for YARP's bindings: they keep the first of a process for ever."""
    return f"127.0.0.1:{free_port()}"


@contextmanager
def bindings_configured() -> Iterator[str]:
    """YARP's configuration says that this is the name server, whoever it is."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        Path(folder, "yarp.conf").write_text(f"{bindings_server().replace(':', ' ')} yarp\n")
        patch.setenv("YARP_CONFIG_HOME", folder)
        yield bindings_server()


def lcm_url(ttl: int = 0) -> str:
    """A group that nobody else is in, unless told otherwise on this machine only."""
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
}
"""Every driver, by name."""

BINDINGS: dict[str, Callable[[], Peer]] = {"yarp-bindings": YarpBindings} if bindings_dialect() else {}
"""The same by a library that neither Debian nor PyPI has: where it is, the contract holds for it too."""
