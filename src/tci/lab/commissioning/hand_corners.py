"""Which way round each pad of a hand lies, and which pads are exchanged: somebody presses three corners of
each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.source_reader import SourceReader
from tci.lab.commissioning.hand_turns import MIRRORED, WAYS, turned
from tci.lab.commissioning.hand_watch import Ask, Seen, named, share, watch
from tci.robot.tactile_devices import DevicePad, in_rows

CORNERS = {"far left": (0, 0), "far right": (0, -1), "near left": (-1, 0)}
"""Row and column as the table of devices assumes them: row 1 at the far end, seen from outside with the
finger pointing away."""
SKIP = "s"
"""What a person types to leave out the corners that are left."""
Way = tuple[bool, bool]
"""Whether rows and whether columns come from the other end than assumed."""


def examine_corners(
    reader: SourceReader, rest: Mapping[str, Seen], shapes: Mapping[str, DevicePad], ask: Ask, seconds: float
) -> tuple[list[Finding], dict[str, DevicePad]]:
    """What to say, and the pads that lie otherwise than `shapes` says, as they lie. The largest come first.

    Args:
        reader: The hand.
        rest: Its pads, untouched.
        shapes: The pads to ask for.
        ask: Asks a person.
        seconds: How long to look at each corner.
    """
    found: list[Finding] = []
    ways: dict[str, Way] = {}
    left = sorted(shapes, key=lambda pad: -shapes[pad].channels)
    while left:
        seen = _press(reader, rest, left[0], ask, seconds)
        if seen is None:
            break
        pad = left.pop(0)
        told, way = _judge(pad, seen, shapes[pad])
        found.append(told)
        if way is not None:
            ways[pad] = way
    if left:
        said = f"which way round {len(left)} of {len(shapes)} pads lie is assumed: {', '.join(left[:6])}"
        found.append(Finding(Level.NOTE, "corners", said, "press their corners, too"))
    if len(ways) > 1 and {*ways.values()} == {MIRRORED}:
        said = f"all {len(ways)} pads lie mirrored"
        advice = "left may be taken for right: try side=left or side=right"
        found.append(Finding(Level.WARNING, "corners", said, advice))
    return found, {pad: turned(shapes[pad], *way) for pad, way in ways.items() if way in WAYS}


def _press(
    reader: SourceReader, rest: Mapping[str, Seen], pad: str, ask: Ask, seconds: float
) -> dict[str, tuple[str, int]] | None:
    """For each corner the pad that changes most, and its value that does; no pad if none changes. None if the
    person does not want to."""
    seen: dict[str, tuple[str, int]] = {}
    for corner in CORNERS:
        words = f"press only the {corner} corner of {named(pad)} with a pen's end, the fingers pointing away"
        if ask(f"{words} from you ({SKIP} leaves out all other corners)") == SKIP:
            return None
        changes = {one: each.change(rest[one]) for one, each in watch(reader, seconds).items()}
        strength = {one: share(change, rest[one]) for one, change in changes.items()}
        most = max(strength, key=lambda one: strength[one])
        seen[corner] = (most if strength[most] >= 1.0 else "", int(changes[most].argmax()))
    return seen


def _judge(pad: str, seen: Mapping[str, tuple[str, int]], shape: DevicePad) -> tuple[Finding, Way | None]:
    """What to say, and the way that explains it; None if none does."""
    for corner, (other, _) in seen.items():
        if not other:
            said = f"pressing its {corner} corner changes nothing"
            return Finding(Level.WARNING, pad, said, "press harder"), None
    others = {other for other, _ in seen.values()}
    if others != {pad}:
        said = f"pressing {named(pad)} shows on {' and '.join(map(named, sorted(others)))}"
        advice = "their cables are exchanged, or the other pad was pressed"
        return Finding(Level.WARNING, pad, said, advice), None
    place = in_rows(np.arange(shape.channels), shape)
    at = {corner: tuple(map(int, np.argwhere(place == value)[0])) for corner, (_, value) in seen.items()}
    fitting = [
        way
        for way in ((False, False), *WAYS)
        if all(_near(at[corner], _corner(corner, way, shape), shape) for corner in CORNERS)
    ]
    if fitting == [(False, False)]:
        return Finding(Level.OK, pad, "three corners show where they are taken to be"), fitting[0]
    where = ", ".join(f"{corner} at row {one[0] + 1}, column {one[1] + 1}" for corner, one in at.items())
    said = f"corners show elsewhere than they are taken to be: {where}"
    if len(fitting) != 1:
        return Finding(Level.WARNING, pad, said, "press only the corner that is asked for"), None
    advice = (
        f"the pad lies {WAYS[fitting[0]]}: tci hand shows and describes it so from now on; turn it yourself "
        "in a description of your own"
    )
    return Finding(Level.WARNING, pad, said, advice), fitting[0]


def _corner(corner: str, way: Way, shape: DevicePad) -> tuple[int, int]:
    """Row and column of a corner if rows or columns come from the other end."""
    row, column = CORNERS[corner]
    row, column = (-1 - row if way[0] else row), (-1 - column if way[1] else column)
    return row % shape.rows, column % shape.columns


def _near(seen: Sequence[int], expected: Sequence[int], shape: DevicePad) -> bool:
    """Within a quarter of the pad: a finger is wider than a taxel."""
    return abs(seen[0] - expected[0]) <= shape.rows // 4 and abs(seen[1] - expected[1]) <= shape.columns // 4
