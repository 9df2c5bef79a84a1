"""`tci hand`: a tactile hand or loose sensor alone, without a robot: which are plugged in, the pressure on
the pads, and what is wrong; or a robot's simulated hand, whose pads are pressed in turn."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson

if TYPE_CHECKING:
    from rich.console import RenderableType

    from tci.drivers.source import Source
    from tci.drivers.source_reader import SourceReader
    from tci.robot.tactile_devices import DevicePad

SHADES = " ·░▒▓█"
EVERY = 0.1
"""Time [s] between two pictures."""
PRESS = 2.0
"""Time [s] for which the doctor looks after each thing that it asks for."""


def hand(
    via: Annotated[
        str | None,
        typer.Argument(
            help="Address of the hand, such as inspire:192.168.11.210, or a robot, whose hand is simulated "
            "and pressed pad by pad; without one, lists what is plugged in."
        ),
    ] = None,
    duration: Annotated[
        float, typer.Option(help="Time \\[s] after which the command ends; 0: until Ctrl-C.", min=0.0)
    ] = 0.0,
    doctor: Annotated[
        bool, typer.Option("--doctor", help="Ask you to press fingers and corners, and tell what is wrong.")
    ] = False,
    describe: Annotated[
        Path | None,
        typer.Option(
            help="Write a description of the hand into this new folder, to record, view or plot it."
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show the pads in the browser; needs the extra viewer.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of --view; 0 chooses a free one.")] = 8080,
    as_json: AsJson = False,
) -> None:
    """Show the pressure on the pads of a tactile hand, live. Nothing moves, and no robot is needed. A shade
    is the value of a taxel, up to the largest value of its pad so far. Below are the force of the pad, where
    somebody has measured what a count is, the largest count, and the rate. Without an address, the command
    lists the devices that are plugged in, and chooses none.

    Example:  tci hand

    Example:  tci hand inspire:192.168.11.210

    Example:  tci hand robotiq:/dev/ttyACM0 --doctor

    Example:  tci hand allegro
    """
    from rich.live import Live

    from tci.drivers.source_reader import SourceReader

    if via is None:
        _list(as_json=as_json)
        return
    source = _source(via, alone=not (doctor or view or describe))
    reader = SourceReader(via, source, source.pads)
    end = time.monotonic() + (duration or np.inf)
    try:
        if doctor:
            _examine(reader, as_json=as_json)
            return
        if describe is not None:
            _describe(reader, describe)
            return
        if view:
            _view(reader, port)
            return
        if as_json:
            time.sleep(max(0.0, min(end - time.monotonic(), 1e6)))
            print_json(_report(reader))
            return
        most, shapes = dict.fromkeys(reader.pads, 1.0), _shapes(reader)
        with Live(console=console, transient=True) as live:
            while time.monotonic() < end:
                live.update(_picture(reader, most, shapes))
                time.sleep(EVERY)
        console.print(_picture(reader, most, shapes))
        for finding in reader.diagnose():
            words = f"{finding.level.value}: {finding.what}. {finding.advice}"
            console.print(words, highlight=False, markup=False)
    except KeyboardInterrupt:
        pass
    finally:
        reader.close()


def _source(via: str, *, alone: bool) -> Source:
    """The source at an address, or the simulated pads of a robot: `alone`, since nobody can be asked to press
    these, and tci view and other commands take the robot itself."""
    from tci.drivers.registry import source_at
    from tci.drivers.simulated_pads import SimulatedPads
    from tci.errors import CommandError, DriverError
    from tci.robot.catalogue import robot_names
    from tci.robot.like import as_robot

    if via not in robot_names() and not via.endswith(".xml"):
        source = source_at(via)
        if not source.pads:
            raise DriverError(f"{via} has no pads of its own; valid: beside a robot, --via 'sim + {via}'")
        return source
    if not alone:
        raise CommandError(
            f"{via} is a robot, whose hand is simulated; valid: tci view {via}, or the address of a hand"
        )
    simulated = SimulatedPads(as_robot(via))
    if not simulated.pads:
        raise CommandError(f"{via} has no pads on its hands; valid: a robot with skin on fingers or palm")
    return simulated


def _list(*, as_json: bool) -> None:
    from rich.table import Table

    from tci.drivers.registry import source_names
    from tci.shared.serial_ports import can_channels, serial_ports

    ports, channels, names = serial_ports(), can_channels(), source_names()
    if as_json:
        print_json({"serial": [one.to_json() for one in ports], "can": channels, "sources": list(names)})
        return
    for port in ports:
        table = Table.grid(padding=(0, 2))
        rows = {
            "USB": f"{port.vid_pid}  {port.product}", "serial number": port.serial_number,
            "may be": port.kind, "by id": port.by_id, "by path": port.by_path,
            "open in": ", ".join(port.holders),
        }  # fmt: skip
        if not port.allowed:
            rows["permission"] = "none: sudo usermod -aG dialout $USER, then log in again"
        if port.latency_ms is not None and port.latency_ms > 1:
            latency = f"/sys/bus/usb-serial/devices/{port.port.removeprefix('/dev/')}/latency_timer"
            rows["slow"] = f"keeps bytes for {port.latency_ms} ms: echo 1 | sudo tee {latency}"
        for name, text in rows.items():
            if text:
                table.add_row(f"  {name}", text)
        console.print(port.port, highlight=False, markup=False)
        console.print(table, highlight=False, markup=False)
    for channel, state in channels.items():
        up = "" if state == "up" else f": sudo ip link set {channel} up type can bitrate 1000000"
        console.print(f"{channel}  CAN, {state}{up}", highlight=False, markup=False)
    if not ports and not channels:
        console.print("no device on USB and no CAN interface; plug it in, then look again with tci hand")
    example = (
        f"tci hand NAME:{ports[0].by_id or ports[0].port}" if ports else "tci hand inspire:192.168.11.210"
    )
    console.print(f"none is chosen. Show one:  {example}", highlight=False, markup=False)
    console.print(f"names: {', '.join(names)}", highlight=False, markup=False)


def _describe(reader: SourceReader, folder: Path) -> None:
    from tci.lab.authoring.hand import write_hand

    reader.wait(2.0)
    time.sleep(1.0)  # the description has the rates that are measured
    path = write_hand(reader, folder, shapes=_shapes(reader))
    via = f'--via "sim + {reader.name}"'
    console.print(f"wrote {path}, which stands for a robot:", highlight=False, markup=False)
    pad = next(iter(reader.pads))
    live = (f"view {path}", f"record touch.mcap {path}", f"skin calibrate {path} --patch {pad}")
    kept = (f"plot touch.mcap {path}", f"log export touch.mcap touch {path}")
    for command in (*(f"{one} {via}" for one in live), *kept):
        console.print(f"  tci {command}", highlight=False, markup=False, soft_wrap=True)


def _view(reader: SourceReader, port: int) -> None:
    """The viewer reads the hand itself, so this reader is closed first."""
    from tempfile import TemporaryDirectory

    from tci.cli.view import needs_viewer, view
    from tci.lab.authoring.hand import write_hand

    needs_viewer()
    reader.wait(2.0)
    with TemporaryDirectory() as folder:
        path = write_hand(reader, Path(folder) / "hand", shapes=_shapes(reader))
        reader.close()
        view([str(path)], [f"sim + {reader.name}"], port=port)


def _examine(reader: SourceReader, *, as_json: bool) -> None:
    """Raises CommandError where nobody can be asked."""
    from tci.cli.doctor import print_findings
    from tci.errors import CommandError
    from tci.lab.commissioning.hand import examine_hand
    from tci.lab.commissioning.hand_rest import rest_file
    from tci.lab.commissioning.hand_shapes import shapes_file
    from tci.lab.commissioning.hand_turns import turns_file

    reader.wait(1.0)

    def ask(words: str) -> str:
        try:
            return str(typer.prompt(f"{words}, and press Enter", default="", show_default=False, err=True))
        except typer.Abort as error:
            raise CommandError("--doctor asks you to press; valid: in a terminal") from error

    found = examine_hand(
        reader, ask, seconds=PRESS, last=rest_file(reader.name), turns=turns_file(reader.name),
        shapes=shapes_file(reader.name),
    )  # fmt: skip
    print_findings(reader.name, (*found, *reader.diagnose()), (), as_json=as_json)


def _shapes(reader: SourceReader) -> dict[str, DevicePad]:
    """The pads as they lie, as far as somebody told."""
    from tci.drivers.simulated_pads import SimulatedPads
    from tci.lab.commissioning.hand_shapes import shapes_file, shapes_told
    from tci.lab.commissioning.hand_turns import pads_as_found, turns_file
    from tci.robot.tactile_devices import pads_of

    if isinstance(reader.source, SimulatedPads):
        return reader.source.shapes
    known = pads_of(reader.source.device, reader.channels)
    known |= shapes_told(reader.channels, shapes_file(reader.name))
    return pads_as_found(known, turns_file(reader.name))


def _report(reader: SourceReader) -> dict[str, Any]:
    return {
        "source": reader.name,
        "pads": {
            name: {
                "frames": pad.sequence,
                "rate_hz": pad.rate,
                "jitter_ms": 1e3 * pad.jitter,
                "values": [] if pad.values is None else [
                    value if np.isfinite(value) else None for value in pad.values.tolist()
                ],
            }
            for name, pad in reader.pads.items()
        },
        "joints": dict(reader.track.latest),
        "findings": [finding.to_json() for finding in reader.diagnose()],
    }  # fmt: skip


def _picture(reader: SourceReader, most: dict[str, float], shapes: dict[str, DevicePad]) -> RenderableType:
    from rich.columns import Columns
    from rich.panel import Panel
    from rich.text import Text

    from tci.robot.tactile_devices import devices, in_rows

    now = time.monotonic()
    newtons = reader.source.newton_per_count or next(
        (one.newton_per_count for one in devices() if one.name == reader.source.device), None
    )
    panels = []
    for name, pad in reader.pads.items():
        silent = reader.silence(name, now)
        if pad.values is None or silent is not None:
            panels.append(Panel(Text("no data", "red"), title=name, expand=False))
            continue
        values = np.nan_to_num(pad.values.astype(float))
        most[name] = max(most[name], float(values.max()))
        shades = (values / most[name] * (len(SHADES) - 1)).round().astype(int).clip(0, len(SHADES) - 1)
        rows = in_rows(shades, shapes.get(name))
        text = "\n".join("".join(2 * SHADES[one] for one in row) for row in rows)
        force = "" if newtons is None else f"{newtons * values.sum():.1f} N · "
        said = f"{text}\n{force}{values.max():.0f} · {pad.rate:.0f}/s"
        panels.append(Panel(said, title=name, expand=False))
    return Columns(panels)
