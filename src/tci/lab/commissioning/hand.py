"""Examines a tactile hand that somebody presses when asked: dead, stuck, saturated and exchanged fingers, and
which corner of a pad is which."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.source_reader import SourceReader
from tci.lab.commissioning.hand_rest import SHARE, compare_rest
from tci.lab.commissioning.hand_turns import WAYS, keep_turn, pads_as_found, turned
from tci.robot.tactile_devices import FINGERS, DevicePad, devices, in_rows, pads_of, place_of

NOISE = 5.0
"""A change counts from this multiple of the largest change at rest, and from `LEAST` counts."""
LEAST = 3.0
CORNERS = {"far left": (0, 0), "far right": (0, -1), "near left": (-1, 0)}
"""Row and column as the table of devices assumes them: row 1 at the far end, seen from outside with the
finger pointing away."""
Ask = Callable[[str], None]
"""Shows a person what to do, and returns when it is being done."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The frames of one pad in a span of time."""

    frames: NDArray[np.float64]
    """(frames, values)."""

    def change(self, rest: Seen) -> NDArray[np.float64]:
        """(values,) largest distance from the median at rest."""
        if not len(self.frames) or not len(rest.frames):
            return np.zeros(self.frames.shape[1])
        found: NDArray[np.float64] = np.abs(self.frames - np.median(rest.frames, axis=0)).max(axis=0)
        return np.nan_to_num(found)


def examine_hand(
    reader: SourceReader, ask: Ask, *, seconds: float, last: Path | None = None, turns: Path | None = None
) -> tuple[Finding, ...]:
    """
    Args:
        reader: The hand.
        ask: Asks a person.
        seconds: How long to look after each thing that it asks for.
        last: File with the rest of the last session, which this one replaces unless a pad rests elsewhere.
        turns: File with which way round the pads lie, where what three corners show is kept.
    """
    ask("take your hands off it")
    rest = _watch(reader, seconds)
    found = list(_at_rest(reader, rest))
    if last is not None:
        seen = {pad: one for pad, one in rest.items() if len(one.frames)}
        least = {pad: _elsewhere(reader, pad, one) for pad, one in seen.items()}
        found += compare_rest(last, {pad: np.median(one.frames, axis=0) for pad, one in seen.items()}, least)
    felt: dict[str, str] = {}
    most = {pad: np.zeros(seen.frames.shape[1]) for pad, seen in rest.items()}
    for place in dict.fromkeys(map(place_of, reader.pads)):
        ask(f"press {_named(place)} all over")
        pressed = {pad: seen.change(rest[pad]) for pad, seen in _watch(reader, seconds).items()}
        for pad, change in pressed.items():
            most[pad] = np.maximum(most[pad], change)
        # in parts of its own noise, so that a restless pad is not taken for the pressed one
        strength = {pad: _share(change, rest[pad]) for pad, change in pressed.items()}
        strongest = max(strength, key=lambda pad: strength[pad])
        if strength[strongest] >= 1.0:
            felt[place] = place_of(strongest)
        else:
            said = f"pressing {_named(place)} changes nothing"
            found.append(
                Finding(Level.FAULT, place, said, "check its cable; press harder; its sensor may be dead")
            )
    found += _exchanged(felt)
    found += _after_presses(reader, rest, most, felt)
    device = reader.source.device
    shapes = pads_of(device) if turns is None else pads_as_found(device, turns)
    if known := [pad for pad in reader.pads if pad in shapes]:
        largest = max(known, key=lambda one: shapes[one].channels)
        told, way = _corners(reader, rest, largest, shapes[largest], ask, seconds)
        found.append(told)
        if turns is not None and way in WAYS:
            keep_turn(turns, device, shapes | {largest: turned(shapes[largest], *way)})
    return tuple(found)


def _named(place: str) -> str:
    finger = " finger" * (place in FINGERS[1:])
    return f"the {place.replace('_', ' ')}{finger}"


def _watch(reader: SourceReader, seconds: float) -> dict[str, Seen]:
    taken: dict[str, list[NDArray[np.float64]]] = {pad: [] for pad in reader.pads}
    before = {pad: state.sequence for pad, state in reader.pads.items()}
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for pad, state in reader.pads.items():
            if state.sequence != before[pad] and state.values is not None:
                before[pad] = state.sequence
                taken[pad].append(state.values.astype(float))
        time.sleep(0.002)
    return {
        pad: Seen(np.array(frames).reshape(-1, reader.pads[pad].channels)) for pad, frames in taken.items()
    }


def _top(reader: SourceReader, pad: str) -> float:
    """Largest value that a taxel can have; infinite if nobody says."""
    for device in devices():
        if device.name == reader.source.device:
            return float(device.values[1])
    values = reader.pads[pad].values
    return 255.0 if values is not None and values.dtype == np.uint8 else float("inf")


def _at_rest(reader: SourceReader, rest: dict[str, Seen]) -> Iterator[Finding]:
    for pad, seen in rest.items():
        if not len(seen.frames):
            yield Finding(Level.FAULT, pad, "sends nothing", "check its cable, and the hand's own settings")
            continue
        high = int((np.median(seen.frames, axis=0) >= _top(reader, pad)).sum())
        if high:
            said = f"{high} of {seen.frames.shape[1]} taxels are at their largest value, untouched"
            advice = "something pressed it when it was switched on, or a wire is broken: switch it off and on"
            yield Finding(Level.WARNING, pad, said, advice)
        if none := int(np.isnan(seen.frames).all(axis=0).sum()):
            yield Finding(Level.WARNING, pad, f"{none} taxels have no value", "check its cable")


def _elsewhere(reader: SourceReader, pad: str, rest: Seen) -> float:
    """Difference [counts] from the last session that is neither noise nor warmth."""
    top = _top(reader, pad)
    noise = float(rest.change(rest).max(initial=0.0))
    return max(LEAST, NOISE * noise, SHARE * top if np.isfinite(top) else 0.0)


def _share(change: NDArray[np.float64], rest: Seen) -> float:
    """Largest change, in parts of what counts as one."""
    return float(change.max(initial=0.0) / max(LEAST, NOISE * rest.change(rest).max(initial=0.0)))


def _exchanged(felt: dict[str, str]) -> Iterator[Finding]:
    wrong = {place: other for place, other in felt.items() if other != place}
    mirrored = dict(zip(FINGERS, reversed(FINGERS), strict=True))
    if len(wrong) > 2 and all(mirrored.get(place) == other for place, other in wrong.items()):
        said = "all fingers come in the opposite order"
        yield Finding(Level.WARNING, "fingers", said, "it may be the other hand: try side=left or side=right")
        return
    for place, other in wrong.items():
        said = f"pressing {_named(place)} shows on {_named(other)}"
        yield Finding(
            Level.WARNING, place, said, "their cables are exchanged, or the other finger was pressed"
        )


def _after_presses(
    reader: SourceReader, rest: dict[str, Seen], most: dict[str, NDArray[np.float64]], felt: dict[str, str]
) -> Iterator[Finding]:
    for pad, change in most.items():
        if place_of(pad) not in felt.values() or not len(rest[pad].frames):
            continue
        still = int((change == 0.0).sum())
        level = np.median(rest[pad].frames, axis=0) + change
        full = int((level >= _top(reader, pad)).sum())
        if still:
            said = f"{still} of {change.size} taxels never changed"
            yield Finding(Level.NOTE, pad, said, "press there: a taxel that stays is stuck")
        else:
            yield Finding(Level.OK, pad, f"all {change.size} taxels change when pressed")
        if full:
            said = f"{full} taxels reach their largest value, {_top(reader, pad):.0f}"
            yield Finding(Level.NOTE, pad, said, "they feel no difference above it")


def _corners(
    reader: SourceReader, rest: dict[str, Seen], pad: str, shape: DevicePad, ask: Ask, seconds: float
) -> tuple[Finding, tuple[bool, bool] | None]:
    """What to say, and whether rows and columns come from the other end; None if neither explains it."""
    seen: dict[str, tuple[int, int]] = {}
    for corner in CORNERS:
        ask(f"press only the {corner} corner of {_named(pad)}, the fingers pointing away from you")
        change = _watch(reader, seconds)[pad].change(rest[pad])
        if _share(change, rest[pad]) < 1.0:
            said = f"pressing its {corner} corner changes nothing"
            return Finding(Level.WARNING, pad, said, "press harder"), None
        laid = in_rows(change, shape)
        row, column = np.unravel_index(int(laid.argmax()), laid.shape)
        seen[corner] = int(row), int(column)
    fitting = [
        way
        for way in ((False, False), *WAYS)
        if all(_near(seen[corner], _corner(corner, way, shape), shape) for corner in CORNERS)
    ]
    if fitting == [(False, False)]:
        return Finding(Level.OK, pad, "three corners show where they are taken to be"), fitting[0]
    where = ", ".join(
        f"{corner} at row {row + 1}, column {column + 1}" for corner, (row, column) in seen.items()
    )
    said = f"corners show elsewhere than they are taken to be: {where}"
    if len(fitting) != 1:
        return Finding(Level.WARNING, pad, said, "press only the corner that is asked for"), None
    advice = (
        f"the pad lies {WAYS[fitting[0]]}: tci hand shows and describes it so from now on; turn it yourself "
        "in a description of your own"
    )
    return Finding(Level.WARNING, pad, said, advice), fitting[0]


def _corner(corner: str, way: tuple[bool, bool], shape: DevicePad) -> tuple[int, int]:
    """Row and column of a corner if rows or columns come from the other end."""
    row, column = CORNERS[corner]
    row, column = (-1 - row if way[0] else row), (-1 - column if way[1] else column)
    return row % shape.rows, column % shape.columns


def _near(seen: Sequence[int], expected: Sequence[int], shape: DevicePad) -> bool:
    """Within a quarter of the pad: a finger is wider than a taxel."""
    return abs(seen[0] - expected[0]) <= shape.rows // 4 and abs(seen[1] - expected[1]) <= shape.columns // 4
