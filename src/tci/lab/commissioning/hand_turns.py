"""Which way round the pads of a hand lie: no maker says where row 1 is, so the doctor asks for three corners
and keeps what it saw."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tci.lab.commissioning.hand_rest import rest_file
from tci.robot.tactile_devices import DevicePad, pads_of

WAYS = {(True, False): "upside down", (False, True): "mirrored", (True, True): "turned by half a turn"}
"""By whether rows and whether columns come from the other end than the table of devices assumes."""


def turns_file(name: str) -> Path:
    """Where the turns of the source `name` are kept."""
    return rest_file(name).with_suffix(".turns.json")


def turned(pad: DevicePad, rows: bool, columns: bool) -> DevicePad:
    """The pad with its rows or columns from the other end."""
    return replace(
        pad,
        from_last_row=pad.from_last_row ^ rows,
        from_last_column=pad.from_last_column ^ columns,
    )


def pads_as_found(device: str, path: Path) -> dict[str, DevicePad]:
    """Pads of the table of devices, turned as the file `path` says if there is one."""
    found = pads_of(device)
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        ways = {pad: (bool(rows), bool(columns)) for pad, (rows, columns) in kept.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return found
    return found | {pad: turned(found[pad], *way) for pad, way in ways.items() if pad in found}


def keep_turn(path: Path, device: str, pads: Mapping[str, DevicePad]) -> None:
    """Keeps which way round `pads` lie."""
    assumed = pads_of(device)
    ways = {
        name: (pad.from_last_row != assumed[name].from_last_row, pad.from_last_column)
        for name, pad in pads.items()
        if pad != assumed[name]
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(ways), encoding="utf-8")
