"""How the values of pads lie that the table of devices lacks: the doctor asks, and keeps what it is told."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from tci.lab.commissioning.hand_rest import rest_file
from tci.lab.commissioning.hand_watch import Ask
from tci.robot.tactile_devices import DevicePad

FORM = re.compile(r"\s*(\d+)\s*x\s*(\d+)(?:\s+(\d+(?:\.\d+)?)(?:\s*mm)?)?\s*")
Told = tuple[int, int, float | None]
"""Rows, columns and distance [mm], which is None if the person does not know it."""


def shapes_file(name: str) -> Path:
    """Where the shapes of the source `name` are kept."""
    return rest_file(name).with_suffix(".shapes.json")


def shapes_told(channels: Mapping[str, int], path: Path) -> dict[str, DevicePad]:
    """What the file `path` says of pads with these numbers of values; nothing if there is none."""
    try:
        found = {pad: _shape(pad, *numbers) for pad, numbers in _kept(path).items()}
    except (ValueError, TypeError):
        return {}
    return {pad: shape for pad, shape in found.items() if channels.get(pad) == shape.channels}


def ask_shapes(channels: Mapping[str, int], ask: Ask, path: Path) -> dict[str, DevicePad]:
    """Asks for these pads, once for all with the same number of values, and keeps what a person knows."""
    found: dict[str, Told] = {}
    for count in dict.fromkeys(channels.values()):
        pads = [pad for pad, own in channels.items() if own == count]
        told = _ask(count, pads, ask)
        if told is not None:
            found |= dict.fromkeys(pads, told)
    if found:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(_kept(path) | found), encoding="utf-8")
    return {pad: _shape(pad, *numbers) for pad, numbers in found.items()}


def _kept(path: Path) -> dict[str, Told]:
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return kept if isinstance(kept, dict) else {}


def _ask(count: int, pads: list[str], ask: Ask) -> Told | None:
    words = (
        f"type how the {count} values of {', '.join(pads)} lie: rows x columns, and their distance in mm, "
        "such as 4x4 2.5, or nothing if you don't know"
    )
    wrong = ""
    while answer := ask(wrong + words):
        form = FORM.fullmatch(answer)
        if form is None:
            wrong = f"{answer!r} is not of this form; "
        elif int(form[1]) * int(form[2]) != count:
            wrong = f"{form[1]} x {form[2]} are {int(form[1]) * int(form[2])}; "
        elif form[3] is not None and not float(form[3]):
            wrong = "at a distance of 0 mm all values lie on one place; "
        else:
            return int(form[1]), int(form[2]), None if form[3] is None else float(form[3])
    return None


def _shape(pad: str, rows: int, columns: int, pitch: float | None) -> DevicePad:
    size = None if pitch is None else (1e-3 * pitch * rows, 1e-3 * pitch * columns)
    return DevicePad(pad, int(rows), int(columns), size=size, found_by_size=False)
