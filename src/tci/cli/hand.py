"""`tci hand`: the pressure on the pads of a hand or a loose sensor, live, without a robot."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson

if TYPE_CHECKING:
    from rich.console import RenderableType

    from tci.drivers.source_reader import SourceReader
    from tci.robot.tactile_devices import DevicePad

SHADES = " ·░▒▓█"
EVERY = 0.1
"""Time [s] between two pictures."""


def hand(
    via: Annotated[str, typer.Argument(help="Address of the hand, such as inspire:192.168.11.210.")],
    duration: Annotated[
        float, typer.Option(help="Time \\[s] after which the command ends; 0: until Ctrl-C.", min=0.0)
    ] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Show the pressure on the pads of a tactile hand, live. Nothing moves, and no robot is needed. A shade
    is the value of a taxel, up to the largest value of its pad so far; the numbers are raw counts.

    Example:  tci hand inspire:192.168.11.210
    """
    from rich.live import Live

    from tci.drivers.registry import source_at
    from tci.drivers.source_reader import SourceReader
    from tci.errors import DriverError

    source = source_at(via)
    if not source.pads:
        raise DriverError(f"{via} has no pads of its own; valid: beside a robot, --via 'sim + {via}'")
    reader = SourceReader(via, source, source.pads)
    end = time.monotonic() + (duration or np.inf)
    try:
        if as_json:
            time.sleep(max(0.0, min(end - time.monotonic(), 1e6)))
            print_json(_report(reader))
            return
        most = dict.fromkeys(reader.pads, 1.0)
        with Live(console=console, transient=True) as live:
            while time.monotonic() < end:
                live.update(_picture(reader, most))
                time.sleep(EVERY)
        console.print(_picture(reader, most))
        for finding in reader.diagnose():
            words = f"{finding.level.value}: {finding.what}. {finding.advice}"
            console.print(words, highlight=False, markup=False)
    except KeyboardInterrupt:
        pass
    finally:
        reader.close()


def _report(reader: SourceReader) -> dict[str, Any]:
    return {
        "source": reader.name,
        "pads": {
            name: {
                "frames": pad.sequence,
                "rate_hz": pad.rate,
                "values": [] if pad.values is None else [
                    value if np.isfinite(value) else None for value in pad.values.tolist()
                ],
            }
            for name, pad in reader.pads.items()
        },
        "joints": dict(reader.angles),
        "findings": [finding.to_json() for finding in reader.diagnose()],
    }  # fmt: skip


def _picture(reader: SourceReader, most: dict[str, float]) -> RenderableType:
    from rich.columns import Columns
    from rich.panel import Panel
    from rich.text import Text

    now, shapes = time.monotonic(), _shapes(reader.source.device)
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
        panels.append(Panel(f"{text}\n{values.max():.0f} · {pad.rate:.0f}/s", title=name, expand=False))
    return Columns(panels)


def _shapes(device: str) -> dict[str, DevicePad]:
    """Pads of the device table, by the source's own names."""
    from tci.robot.tactile_devices import devices

    return {
        (place if place == pad.name else f"{place}_{pad.name}"): pad
        for one in devices()
        if one.name == device
        for pad in one.pads
        for place in pad.fingers
    }


def in_rows(values: np.ndarray, pad: DevicePad | None) -> np.ndarray:
    """A frame as it lies on the pad, (rows, columns); one row if the shape is unknown."""
    if pad is None:
        return values[None]
    if pad.order == "column-major":
        laid = values.reshape(pad.columns, pad.rows).T
    else:
        laid = values.reshape(pad.rows, pad.columns)
    return laid[::-1] if pad.from_last_row else laid
