"""Lists the sockets that each server opens by default, as reported by the operating system, and writes the
table of docs/reliability.md.

Each server starts in a network namespace that has the loopback interface and one other interface, which has
the default route. So the usual ports of the server are free. A socket that is bound to all interfaces or to
the other interface can be reached from outside the machine. `python exposure.py` prints the table, `python
exposure.py page` writes it.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from ipaddress import ip_address
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.append(str(Path(__file__).parents[1]))  # needed if this file runs as a program

import psutil
from report import ROOT, markdown, write_between
from row import PAGE, Row

BEGIN, END = "<!-- exposure -->\n", "<!-- end of exposure -->\n"
HEAD = (
    "server",
    "address",
    "port",
    "programs that may read",
    "programs that may command",
    "setting that opens the server to a network",
)
ALONE = """
ip link set lo up
ip link add eth0 type veth peer name far
ip address add 10.99.0.2/24 dev eth0
ip link set eth0 up
ip link set far up
ip route add default dev eth0
exec "$@"
"""
HERE = "every program of this machine"
EPHEMERAL = 32768
"""First ephemeral port. From this number on the operating system assigns a different port at each start."""
SETTINGS = ("ROS_", "CYCLONE", "LCM_", "YARP_", "XDG_", "TCI_")
"""Prefixes of environment variables that change a server's defaults. These variables are removed."""


@dataclass(frozen=True)
class Server:
    """A server: its command, and facts that its sockets do not show."""

    words: tuple[str, ...]
    """Arguments of `tci`."""
    opened_by: str
    read: str = HERE
    command: str = HERE
    beside: tuple[str, ...] = ()
    """Program that must run before the server; it prints a line when it is ready."""


def _serve(via: str, opened_by: str, **more: str | tuple[str, ...]) -> Server:
    return Server(("serve", "nao", "--via", via), opened_by, **more)


ROSCORE = """
import subprocess, time, xmlrpc.client
core = subprocess.Popen(["roscore"], stdout=subprocess.DEVNULL)
while True:
    try:
        xmlrpc.client.ServerProxy("http://localhost:11311").getPid("/look")
        break
    except OSError:
        time.sleep(0.1)
print("ready", flush=True)
core.wait()
"""
SERVERS = {
    "lcm": _serve("lcm", "`lcm:...?ttl=1`"),
    "naoqi": _serve("naoqi", "`naoqi:ADDRESS:PORT`"),
    "player": _serve("player", "`player:ADDRESS:PORT`"),
    "ros1": _serve(
        "ros1", "`ROS_IP`, `ROS_HOSTNAME`, or `ROS_MASTER_URI` elsewhere", beside=("-c", ROSCORE)
    ),
    "ros2": _serve("ros2", "`ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`"),
    "rosbridge": _serve(
        "rosbridge", "the settings of the rosbridge server",
        read="every program that can connect to the rosbridge server",
        command="every program that can connect to the rosbridge server",
        beside=(str(ROOT / "tests" / "helpers" / "rosbridge_relay.py"),),
    ),
    "unitree": Server(("serve", "g1", "--via", "unitree"), "`unitree:INTERFACE`"),
    "yarp": _serve(
        "yarp", "`yarp:ADDRESS:PORT`, or `yarp.conf`",
        command=f"{HERE}; with `auth.conf`, only programs with its key"
    ),
    "zenoh": _serve(
        "zenoh", "`zenoh:tcp/ADDRESS:PORT`; with rights: `zenoh:FILE.json5`",
        command=f"{HERE}; with a file of `tci zenoh`, only the users in this file",
    ),
    "view": Server(
        ("view", "nao", "--headless"), "`--host ADDRESS`, and then a token is needed",
        command=f"{HERE}, but no web page of another site",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Seen:
    """A listening socket."""

    address: str
    port: int
    interface: str
    """Interface to which the socket is bound, or on which it has joined the multicast group; empty for all
    interfaces of the address."""

    @property
    def beyond(self) -> bool:
        """True if other machines can reach the socket."""
        return self.interface != "lo" and not ip_address(self.address).is_loopback

    def __str__(self) -> str:
        shown = ip_address(self.address)
        return f"`{shown}`{'' if shown.is_loopback or self.interface != 'lo' else ', from loopback only'}"


def look(process: psutil.Process) -> list[Seen]:
    """Returns the listening sockets of a process and its children."""
    mine = {process.pid, *(child.pid for child in process.children(recursive=True))}
    groups = _groups()
    found = []
    for line in subprocess.run(
        ["ss", "-Htulnp"], capture_output=True, text=True, check=True
    ).stdout.splitlines():
        words = line.split()
        if not any(f"pid={pid}," in line for pid in mine):
            continue
        place, _, port = words[4].rpartition(":")
        address, _, interface = place.strip("[]").partition("%")
        address = address.replace("*", "0.0.0.0")
        if ip_address(address).is_multicast:
            interface = "lo" if groups.get(address) == {"lo"} else ""
        found.append(Seen(address, int(port), interface))
    return sorted(found, key=lambda one: (one.address, one.port))


def _groups() -> dict[str, set[str]]:
    """Returns the interfaces on which each multicast group has been joined."""
    joined: dict[str, set[str]] = {}
    device = ""
    for line in Path("/proc/net/igmp").read_text().splitlines()[1:]:
        words = line.split()
        if not line.startswith("\t"):
            device = words[1]
        else:
            address = socket.inet_ntoa(int(words[0], 16).to_bytes(4, sys.byteorder))
            joined.setdefault(address, set()).add(device)
    return joined


@contextmanager
def _running(server: Server, folder: str) -> Iterator[psutil.Process]:
    said = {name: value for name, value in os.environ.items() if not name.startswith(SETTINGS)}
    environment = {**said, "PYTHONUNBUFFERED": "1", "COLUMNS": "200", "YARP_CONFIG_HOME": folder}
    running: list[subprocess.Popen[str]] = []
    words = list(server.words)
    try:
        if server.beside:
            running.append(_start([sys.executable, *server.beside], environment))
            line = _line(running[0], "")
            if line.strip().isdigit():
                words[-1] += f":127.0.0.1:{line.strip()}"
        running.append(_start([sys.executable, "-m", "tci.cli.main", *words], environment))
        while not {"serving", "open"} & {*_line(running[-1], words[0]).split()}:
            pass
        yield psutil.Process(running[-1].pid)
    finally:
        for process in reversed(running):
            for one in (*psutil.Process(process.pid).children(recursive=True), process):
                with suppress(psutil.NoSuchProcess):
                    one.kill()
            process.communicate()


def _start(command: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env=environment,
    )  # fmt: skip


def _line(process: subprocess.Popen[str], what: str) -> str:
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise LookupError(f"tci {what} ended")
    return line


def seen() -> dict[str, list[Seen]]:
    """Returns the sockets of each server that can run on this machine. Each server runs in a separate
    namespace.

    Raises OSError if this system permits no network namespace, CalledProcessError if a server can't be
    examined.
    """
    if not all(map(shutil.which, ("unshare", "ip", "ss"))):
        raise OSError("needs network namespaces: Linux, util-linux and iproute2")
    apart = ["unshare", "--map-root-user", "--net"]
    if subprocess.run([*apart, "true"]).returncode:
        raise OSError("needs network namespaces, which this system does not permit to this user")
    command = [*apart, "sh", "-ec", ALONE, "alone", sys.executable, __file__, "alone"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return {name: [Seen(**one) for one in found] for name, found in json.loads(done.stdout).items()}


def _alone() -> None:
    """Runs the servers, inside the network namespace, and prints their sockets as JSON."""
    found: dict[str, list[dict[str, object]]] = {}
    with TemporaryDirectory() as folder:
        for name, server in SERVERS.items():
            with suppress(LookupError), _running(server, folder) as process:
                found[name] = [asdict(one) for one in look(process)]
    print(json.dumps(found))


def table(found: dict[str, list[Seen]]) -> list[tuple[str, ...]]:
    """Returns the rows of the table, in the order of `HEAD`."""
    rows = []
    for name, sockets in found.items():
        server = SERVERS[name]
        ports: dict[str, set[str]] = {}
        for one in sockets:
            ports.setdefault(str(one), set()).add("any" if one.port >= EPHEMERAL else str(one.port))
        command = "`tci view`" if name == "view" else f"`tci serve --via {name}`"
        addresses = "<br>".join(ports) or "none"
        numbers = "<br>".join(", ".join(sorted(some)) for some in ports.values()) or "none"
        cells = (command, addresses, numbers, server.read, server.command, server.opened_by)
        rows.append(cells)
    return rows


def exposure(full: bool) -> Row:
    """Checks each server once."""
    found = seen()
    sockets = [(name, one) for name, some in found.items() for one in some]
    beyond = [f"{name} at {one.address}:{one.port}" for name, one in sockets if one.beyond]
    said = f": {', '.join(beyond)}" if beyond else ""
    return Row(
        "sockets of every server with default settings", len(found), len(SERVERS), "servers",
        f"{len(beyond)} of {len(sockets)} sockets can be reached from other machines{said}", "0 sockets",
        not beyond,
    )  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:] == ["alone"]:
        _alone()
    else:
        lines = markdown(HEAD, table(seen()))
        print(lines, end="")
        if sys.argv[1:] == ["page"]:
            write_between(PAGE, BEGIN, END, lines)
