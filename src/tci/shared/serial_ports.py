"""The serial ports of this machine, with what tells one device from another."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from tci.drivers.diagnosis import Finding, Level

KINDS = {
    "16d0:14cc": "robotiq: TSF-85", "04b4:f232": "robotiq: an older TSF-85, or another Cypress UART",
    "1a86:7523": "paxini, or another device with a CH340", "0403:6001": "an FTDI adapter",
    "0403:6015": "an FTDI adapter",
}  # fmt: skip
"""What has this vendor and product. An adapter says nothing about the device behind it."""
CAN = "280"
"""Linux's number of this kind of interface."""
FAST = 1
"""Time [ms] that an FTDI adapter should wait for more bytes; 16 as it comes."""


@dataclass(frozen=True, slots=True)
class SerialPortInfo:
    """One port. What the system does not say is empty."""

    port: str
    """Such as /dev/ttyUSB0: changes when devices are plugged in another order."""
    vid_pid: str = ""
    product: str = ""
    serial_number: str = ""
    by_id: str = ""
    """Stays with the device."""
    by_path: str = ""
    """Stays with the socket that it is plugged into."""
    kind: str = ""
    allowed: bool = True
    """Whether this user may open it."""
    holders: tuple[str, ...] = ()
    """Programs that have it open, as far as this user may see them."""
    latency_ms: int | None = None
    """Time for which an FTDI adapter keeps bytes."""

    def to_json(self) -> dict[str, object]:
        return asdict(self)


def serial_ports(root: Path = Path("/")) -> tuple[SerialPortInfo, ...]:
    """Ports on USB, by their names. `root` is another place of /dev, /sys and /proc."""
    found = []
    for entry in sorted((root / "sys/class/tty").glob("*")):
        place = (entry / "device").resolve()
        usb = next((one for one in (place, *place.parents) if (one / "idVendor").is_file()), None)
        if usb is not None:
            found.append(_port(root, entry.name, place, usb))
    return tuple(found)


def can_channels(root: Path = Path("/")) -> dict[str, str]:
    """CAN interfaces of this machine, and whether each is `up` or `down`."""
    nets = sorted((root / "sys/class/net").glob("*"))
    return {one.name: _text(one / "operstate") for one in nets if _text(one / "type") == CAN}


def findings(path: str, root: Path = Path("/")) -> Iterator[Finding]:
    """What is wrong with one port, which may be any name of it."""
    real = os.path.realpath(root / path.lstrip("/"))
    for one in serial_ports(root):
        if os.path.realpath(root / one.port.lstrip("/")) != real:
            continue
        if one.latency_ms is not None and one.latency_ms > FAST:
            setting = f"/sys/bus/usb-serial/devices/{Path(real).name}/latency_timer"
            said = f"the FTDI adapter keeps bytes for {one.latency_ms} ms"
            yield Finding(Level.WARNING, path, said, f"echo {FAST} | sudo tee {setting}")
        if others := [name for name in one.holders if not name.endswith(f" {os.getpid()}")]:
            said = f"also open in {', '.join(others)}, which takes bytes away"
            yield Finding(Level.WARNING, path, said, "end that program")


def holders(path: str, root: Path = Path("/")) -> tuple[str, ...]:
    """Programs that have a port open, as `NAME PID`; only those that this user may see."""
    real = os.path.realpath(path)
    found = set()
    for link in (root / "proc").glob("[0-9]*/fd/*"):
        try:
            if os.readlink(link) == real:
                process = link.parents[1]
                found.add(f"{(process / 'comm').read_text().strip()} {process.name}")
        except OSError:  # it ended, or is another user's
            continue
    return tuple(sorted(found))


def _port(root: Path, name: str, place: Path, usb: Path) -> SerialPortInfo:
    device = root / "dev" / name
    vid_pid = f"{_text(usb / 'idVendor')}:{_text(usb / 'idProduct')}"
    latency = _text(place / "latency_timer")
    return SerialPortInfo(
        port=f"/dev/{name}",
        vid_pid=vid_pid,
        product=" ".join(filter(None, (_text(usb / "manufacturer"), _text(usb / "product")))),
        serial_number=_text(usb / "serial"),
        by_id=_link(root, "by-id", device),
        by_path=_link(root, "by-path", device),
        kind=KINDS.get(vid_pid, ""),
        allowed=os.access(device, os.R_OK | os.W_OK),
        holders=holders(str(device), root),
        latency_ms=int(latency) if latency.isdecimal() else None,
    )


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


def _link(root: Path, kind: str, device: Path) -> str:
    links = sorted((root / "dev/serial" / kind).glob("*"))
    real = os.path.realpath(device)
    return next((f"/dev/serial/{kind}/{one.name}" for one in links if os.path.realpath(one) == real), "")
