"""Which way round the pads of a hand lie: no maker says where row 1 is, so the doctor asks for three corners
of each pad and keeps what it saw."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tci.lab.commissioning.hand_rest import rest_file
from tci.robot.tactile_devices import DevicePad

MIRRORED = (False, True)
WAYS = {(True, False): "upside down", MIRRORED: "mirrored", (True, True): "turned by half a turn"}
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


def pads_as_found(assumed: Mapping[str, DevicePad], path: Path) -> dict[str, DevicePad]:
    """The pads as the table of devices `assumed` them, turned as the file `path` says if there is one."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        ways = {pad: (bool(rows), bool(columns)) for pad, (rows, columns) in kept.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        ways = {}
    return {pad: turned(one, *ways.get(pad, (False, False))) for pad, one in assumed.items()}


def keep_turns(path: Path, assumed: Mapping[str, DevicePad], pads: Mapping[str, DevicePad]) -> None:
    """Keeps which way round `pads` lie."""
    ways = {
        name: (pad.from_last_row != before.from_last_row, pad.from_last_column != before.from_last_column)
        for name, pad in pads.items()
        if pad != (before := assumed[name])
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(ways), encoding="utf-8")
