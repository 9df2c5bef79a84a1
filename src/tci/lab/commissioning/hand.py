"""Examines a tactile hand that somebody presses when asked: dead, stuck, saturated and exchanged fingers, and
which way round each pad lies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.source_reader import SourceReader
from tci.lab.commissioning.hand_corners import examine_corners
from tci.lab.commissioning.hand_rest import SHARE, compare_rest
from tci.lab.commissioning.hand_shapes import ask_shapes, shapes_told
from tci.lab.commissioning.hand_turns import keep_turns, pads_as_found
from tci.lab.commissioning.hand_watch import LEAST, NOISE, Ask, Seen, named, share, watch
from tci.robot.tactile_devices import FINGERS, devices, pads_of, place_of


def examine_hand(
    reader: SourceReader, ask: Ask, *, seconds: float, last: Path | None = None, turns: Path | None = None,
    shapes: Path | None = None,
) -> tuple[Finding, ...]:  # fmt: skip
    """
    Args:
        reader: The hand.
        ask: Asks a person.
        seconds: How long to look after each thing that it asks for.
        last: File with the rest of the last session, which this one replaces unless a pad rests elsewhere.
        turns: File with which way round the pads lie, where what three corners show is kept.
        shapes: File with how the values of pads lie that the table of devices lacks; it asks for those that
            are not in it either.
    """
    ask("take your hands off it")
    rest = watch(reader, seconds)
    found = list(_at_rest(reader, rest))
    if last is not None:
        seen = {pad: one for pad, one in rest.items() if len(one.frames)}
        least = {pad: _elsewhere(reader, pad, one) for pad, one in seen.items()}
        found += compare_rest(last, {pad: np.median(one.frames, axis=0) for pad, one in seen.items()}, least)
    felt: dict[str, str] = {}
    most = {pad: np.zeros(seen.frames.shape[1]) for pad, seen in rest.items()}
    for place in dict.fromkeys(map(place_of, reader.pads)):
        ask(f"press {named(place)} all over")
        pressed = {pad: seen.change(rest[pad]) for pad, seen in watch(reader, seconds).items()}
        for pad, change in pressed.items():
            most[pad] = np.maximum(most[pad], change)
        # in parts of its own noise, so that a restless pad is not taken for the pressed one
        strength = {pad: share(change, rest[pad]) for pad, change in pressed.items()}
        if max(strength.values()) >= 1.0:
            felt[place] = _place_felt(strength, place)
        else:
            said = f"pressing {named(place)} changes nothing"
            found.append(
                Finding(Level.FAULT, place, said, "check its cable; press harder; its sensor may be dead")
            )
    found += _exchanged(felt)
    found += _after_presses(reader, rest, most, felt)
    assumed = pads_of(reader.source.device, reader.channels)
    if shapes is not None:
        assumed |= shapes_told(reader.channels, shapes)
        unknown = {pad: count for pad, count in reader.channels.items() if pad not in assumed}
        if reader.source.values_per_point == 1:
            assumed |= ask_shapes(unknown, ask, shapes)
    known = assumed if turns is None else pads_as_found(assumed, turns)
    told, lie = examine_corners(
        reader, rest, {pad: one for pad, one in known.items() if felt.get(place_of(pad)) == place_of(pad)},
        ask, seconds,
    )  # fmt: skip
    if turns is not None and lie:
        keep_turns(turns, assumed, known | lie)
    return (*found, *told)


def _place_felt(strength: dict[str, float], asked: str) -> str:
    """The finger or palm with the most pads that changed: one pad may be exchanged with that of another
    finger. Of several it is the one that was asked for, or else the one that changed most."""
    places: dict[str, list[float]] = {}
    for pad, one in strength.items():
        places.setdefault(place_of(pad), []).append(one)
    return max(
        places,
        key=lambda place: (sum(one >= 1.0 for one in places[place]), place == asked, max(places[place])),
    )


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


def _exchanged(felt: dict[str, str]) -> Iterator[Finding]:
    wrong = {place: other for place, other in felt.items() if other != place}
    mirrored = dict(zip(FINGERS, reversed(FINGERS), strict=True))
    if len(wrong) > 2 and all(mirrored.get(place) == other for place, other in wrong.items()):
        said = "all fingers come in the opposite order"
        yield Finding(Level.WARNING, "fingers", said, "it may be the other hand: try side=left or side=right")
        return
    for place, other in wrong.items():
        said = f"pressing {named(place)} shows on {named(other)}"
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
