"""What is plugged into this machine, on a made-up system."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from helpers.serial_devices import Robotiq
from tci.cli.main import app
from tci.drivers.registry import source_at
from tci.drivers.source_reader import SourceReader
from tci.errors import DriverError
from tci.shared.serial_ports import SerialPortInfo, can_channels, findings, holders, serial_ports

pytestmark = pytest.mark.timeout(60)


def plug_in(root: Path, name: str, *, latency: str = "", **usb: str) -> None:
    """A tty on USB as Linux shows it: the port, its interface and, above, the device."""
    interface = root / f"sys/devices/usb1/{name}-device/{name}-interface"
    (interface / name).mkdir(parents=True)
    for file, text in usb.items():
        (interface.parent / file).write_text(f"{text}\n")
    if latency:
        (interface / name / "latency_timer").write_text(latency)
    tty = root / "sys/class/tty" / name
    tty.mkdir(parents=True)
    (tty / "device").symlink_to(interface / name)
    for kind, link in (("by-id", f"usb-{usb['serial']}"), ("by-path", f"pci-{name}")):
        folder = root / "dev/serial" / kind
        folder.mkdir(parents=True, exist_ok=True)
        (folder / link).symlink_to(f"../../{name}")
    (root / "dev" / name).touch()


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    plug_in(tmp_path, "ttyACM0", idVendor="16d0", idProduct="14cc", serial="R85", product="TSF-85")
    plug_in(tmp_path, "ttyUSB1", idVendor="0403", idProduct="6001", serial="F2", latency="16")
    (tmp_path / "sys/class/tty/ttyS0").mkdir()  # no USB
    for name, state in (("can0", "down"), ("eth0", "up")):
        (tmp_path / "sys/class/net" / name).mkdir(parents=True)
        (tmp_path / "sys/class/net" / name / "operstate").write_text(state)
        (tmp_path / "sys/class/net" / name / "type").write_text("280" if name == "can0" else "1")
    process = tmp_path / "proc/77/fd"
    process.mkdir(parents=True)
    (process.parent / "comm").write_text("ModemManager\n")
    (process / "5").symlink_to(tmp_path / "dev/ttyUSB1")
    return tmp_path


def test_each_device_is_told_by_all_its_names(machine: Path) -> None:
    robotiq, ftdi = serial_ports(machine)
    assert robotiq.port == "/dev/ttyACM0"
    assert robotiq.vid_pid == "16d0:14cc"
    assert (robotiq.product, robotiq.serial_number) == ("TSF-85", "R85")
    assert robotiq.by_id == "/dev/serial/by-id/usb-R85"
    assert robotiq.by_path == "/dev/serial/by-path/pci-ttyACM0"
    assert robotiq.kind.startswith("robotiq")
    assert (ftdi.port, ftdi.latency_ms, ftdi.holders) == ("/dev/ttyUSB1", 16, ("ModemManager 77",))
    assert can_channels(machine) == {"can0": "down"}


def test_a_slow_adapter_and_another_program_are_warned_of_by_any_name_of_the_port(machine: Path) -> None:
    for path in ("/dev/ttyUSB1", "/dev/serial/by-id/usb-F2"):
        slow, shared = findings(path, machine)
        assert "16 ms" in slow.what
        assert "ttyUSB1/latency_timer" in slow.advice
        assert "ModemManager 77" in shared.what
    assert list(findings("/dev/ttyACM0", machine)) == []


def test_the_list_chooses_none(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found: tuple[SerialPortInfo, ...] = serial_ports(machine)
    monkeypatch.setattr("tci.shared.serial_ports.serial_ports", lambda: found)
    monkeypatch.setattr("tci.shared.serial_ports.can_channels", lambda: {"can0": "down"})
    said = CliRunner().invoke(app, ["hand"], env={"COLUMNS": "200"})
    assert said.exit_code == 0
    for words in (
        "16d0:14cc",
        "R85",
        "by-id/usb-F2",
        "by-path/pci-ttyUSB1",
        "none is chosen",
        "ip link set can0",
    ):
        assert words in said.stdout


def test_a_port_that_is_held_names_who_holds_it() -> None:
    device = Robotiq()
    device.plug()
    try:
        source = source_at(device.via)
        reader = SourceReader(device.via, source, source.pads)
        assert any(one.endswith(f" {os.getpid()}") for one in holders(str(device.path)))
        with pytest.raises(DriverError, match=r"is held by .*; end it"):
            SourceReader(device.via, source_at(device.via), source.pads)
        reader.close()
    finally:
        device.unplug()


@pytest.mark.parametrize(
    ("via", "advice"),
    [
        ("inspire:127.0.0.1:9", "nobody listens at this port"),
        ("robotiq:/dev/nothing", "tci hand lists the ports"),
        ("paxini:/dev/nothing", "tci hand lists the ports"),
        ("xela:127.0.0.1:9", "nobody listens at this port"),
    ],
)
def test_a_refused_connection_says_what_to_do_next(via: str, advice: str) -> None:
    said = CliRunner().invoke(app, ["hand", via])
    assert said.exit_code == 1
    assert isinstance(said.exception, DriverError)
    assert str(said.exception).startswith(via)
    assert advice in str(said.exception)


def test_no_permission_is_told_with_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str, flags: int) -> int:
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setattr("tci.shared.serial_port.os.open", refuse)
    with pytest.raises(
        DriverError, match=r"robotiq:/dev/ttyACM0.*no permission; add yourself to the group dialout"
    ):
        SourceReader("robotiq:/dev/ttyACM0", source_at("robotiq:/dev/ttyACM0"), {"finger_0": 28})


WINDOWS = """
import sys, types
for module in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules[module] = None
from importlib.metadata import entry_points
for point in entry_points(group="tci.sources"):
    point.load()  # importing a source needs no POSIX
from tci.drivers.registry import source_at
from tci.errors import DriverError
source = source_at("array:serial://" + sys.argv[1])
sys.modules["serial"] = None
try:
    source.open()
except DriverError as error:
    print(error)
class Serial:
    def __init__(self, port, baud, timeout):
        self.rest, self.asked = b"pad 1 2 3\\n", (port, baud, timeout)
    in_waiting = property(lambda self: len(self.rest))
    def read(self, count):
        data, self.rest = self.rest[:count], self.rest[count:]
        return data
    def close(self):
        print("closed", *self.asked)
sys.modules["serial"] = types.SimpleNamespace(Serial=Serial)
source.open()
print([(one.pad, one.values.tolist()) for one in source.read()], list(source.read()))
source.close()
"""
"""Sources without the parts of POSIX that Windows lacks, and a stand-in of pyserial."""


@pytest.mark.parametrize("port", ["COM5", "/dev/cu.usbmodem1"])
def test_ports_are_read_through_pyserial_where_the_system_has_no_termios(port: str) -> None:
    ran = subprocess.run([sys.executable, "-c", WINDOWS, port], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert f"{port}: this system has no termios; valid: pip install pyserial" in ran.stdout
    assert "[('pad', [1.0, 2.0, 3.0])] []" in ran.stdout
    assert f"closed {port} 115200 0" in ran.stdout
