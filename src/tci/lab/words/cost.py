"""The Corpus of Social Touch (CoST, Jung et al. 2014): 14 gestures of 31 people on a grid around an arm.

Its file is not free for every use (CC BY-NC-SA 4.0, doi 10.4121/uuid:5ef62345-3b3e-479c-8e1d-c922748c9b29),
and not part of TCI. `CoST.csv` has the columns subject, variant, gesture and frame, and one for each of 8 x 8
channels; a touch begins where the number of the frame doesn't go on.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tci.capabilities.touch_words.features import MOMENT, NAMES, features, moment_of
from tci.errors import DescriptionError, Fault
from tci.lab.words.examples import Examples
from tci.messages.frames import Array

GESTURES = (
    "grab", "hit", "massage", "pat", "pinch", "poke", "press", "rub", "scratch", "slap", "squeeze", "stroke",
    "tap", "tickle",
)  # fmt: skip
"""By their number in the file, from 1 on."""
SIDE, RATE, PITCH = 8, 135.0, 0.02
"""Channels along and around the arm, frames per second; distance [m] of two channels, assumed."""
PASCAL, LEAST = 100.0, 30.0
"""Pressure [Pa] of a count, and counts that are noise. Assumed: the sensor was not calibrated, and a
recogniser that is trained on the same sensor doesn't need it."""
COLUMNS = "subject", "variant", "gesture", "frame"


def read_cost(path: str | Path) -> Examples:
    """The touches of `CoST.csv`, in groups of one person each. Raises DescriptionError for another file."""
    values, words, groups = [], [], []
    for subject, gesture, frames in _touches(Path(path)):
        rows = _summed(frames)
        if rows is not None:
            values.append(rows)
            words.append(gesture)
            groups.append(f"person {subject}")
    found = np.array(values).reshape(-1, len(NAMES))
    return Examples(found, tuple(words), tuple(groups), f"{Path(path).name}, {len(words)} touches")


def _touches(path: Path) -> Iterator[tuple[str, str, Array]]:
    """Person, gesture and frames (t, 64) [counts] of each touch."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        names = [name.strip().lower() for name in next(reader, [])]
        if not set(COLUMNS) <= set(names) or len(names) != len(COLUMNS) + SIDE**2:
            message = f"columns {', '.join(names[:6])} ...; valid: {', '.join(COLUMNS)} and 64 channels"
            raise DescriptionError(str(path), [Fault(1, message)])
        at = {name: names.index(name) for name in COLUMNS}
        channels = [k for k in range(len(names)) if k not in at.values()]
        key: tuple[str, str, str] | None = None
        last, frames = 0, list[list[float]]()
        for number, row in enumerate(reader, 2):
            try:
                own = (row[at["subject"]], row[at["variant"]], row[at["gesture"]])
                frame, counts = int(float(row[at["frame"]])), [float(row[k]) for k in channels]
            except (ValueError, IndexError):
                raise DescriptionError(str(path), [Fault(number, "valid: numbers in all columns")]) from None
            if key is not None and (own != key or frame != last + 1):
                yield key[0], _gesture(key[2], path, number - 1), np.array(frames)
                frames = []
            key, last = own, frame
            frames.append(counts)
        if key is not None:
            yield key[0], _gesture(key[2], path, number), np.array(frames)


def _gesture(text: str, path: Path, line: int) -> str:
    name = text.strip().lower()
    if name in GESTURES:
        return name
    if name.replace(".0", "").isdigit() and 1 <= int(float(name)) <= len(GESTURES):
        return GESTURES[int(float(name)) - 1]
    message = f"gesture {text!r}; valid: 1 to {len(GESTURES)}, or {', '.join(GESTURES)}"
    raise DescriptionError(str(path), [Fault(line, message)])


def _summed(frames: Array) -> Array | None:
    """Features (n,) of one touch; None if nothing is felt."""
    across, along = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    points = PITCH * np.column_stack([along.ravel(), across.ravel(), np.zeros(SIDE**2)])
    angle = 2.0 * np.pi * across.ravel() / SIDE
    normals = np.column_stack([np.zeros(SIDE**2), np.cos(angle), np.sin(angle)])
    counts = frames - np.median(frames, axis=0).clip(max=LEAST)
    rows = bytearray()
    for number in range(0, len(counts), max(1, round(0.02 * RATE))):
        on = counts[number] > LEAST
        force = PASCAL * PITCH**2 * counts[number, on]
        now = number / RATE
        areas = np.full(int(on.sum()), PITCH**2)
        rows += moment_of(now, float(force.sum()), force, areas, points[on], normals[on], places=1)
    moments = np.frombuffer(bytes(rows), MOMENT)
    felt = np.flatnonzero(moments["force"] > 0.0)
    return features(moments[felt[0] : felt[-1] + 1], 0.0) if len(felt) else None
