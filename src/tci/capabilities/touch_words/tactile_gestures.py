"""Gestures on the three switches of a NAO's head, with the names and times of NAOqi's ALTactileGesture.

A gesture is a sequence of states of the switches, front, middle and rear: `010` presses the middle one.
Fingers don't land on three switches at once, so between two states of a sequence others are passed over, as
many as switches change, less one. A sequence that doesn't end with `000` is held.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

SETTLED, HELD, OVER = 0.04, 0.8, 0.2
"""Times [s] of NAOqi 2.5: from a change until a state is read, until a state is held (and told again), and
after which released switches end a sequence."""
GESTURES: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "SingleFront": ("000", "100", "000"),
    "SingleMiddle": ("000", "010", "000"),
    "SingleRear": ("000", "001", "000"),
    "DoubleFront": ("000", "100", "000", "100", "000"),
    "DoubleMiddle": ("000", "010", "000", "010", "000"),
    "DoubleRear": ("000", "001", "000", "001", "000"),
    "SingleTap": ("000", "111", "000"),
    "DoubleTap": ("000", "111", "000", "111", "000"),
    "CaressFtoR": ("000", "100", "010", "001", "000"),
    "CaressRtoF": ("000", "001", "010", "100", "000"),
    "ZoomIn": ("000", "101", "010", "000"),
    "ZoomOut": ("000", "010", "101", "000"),
    "SecretCode": ("000", "101", "000", "101", "010", "000"),
    "TheClaw": ("000", "101", "000"),
    "SingleFrontHold": ("000", "100"),
    "SingleMiddleHold": ("000", "010"),
    "SingleRearHold": ("000", "001"),
    "SingleTapHold": ("000", "111"),
    "TheClawHold": ("000", "101"),
})  # fmt: skip
"""The default gestures of NAOqi 2.5, by name."""
NONE = "000"


@dataclass(frozen=True, slots=True)
class Strokes:
    """What has been done to three switches since they were last left alone."""

    states: tuple[str, ...] = (NONE,)
    """The states that were read."""
    seen: str = NONE
    """The present state, also if it was not read yet."""
    reads: float | None = None
    """When the present state is to be read [s]; None if it was."""
    due: float | None = None
    """When it is held, or over [s]; None while nothing is done."""
    held: bool = False
    """True once something was held."""


def follow(
    memory: Strokes, state: str, now: float, gestures: Mapping[str, tuple[str, ...]] = GESTURES
) -> tuple[Strokes, str, bool]:
    """What follows from the state of the switches at the time `now` [s]: the new memory, the name of the
    gesture that is told now (or ""), and True if a sequence is over."""
    told, over = "", False
    if memory.reads is not None and now >= memory.reads - 1e-9:
        memory = replace(memory, reads=None)
        if state != memory.states[-1]:
            due = _due(state, now)
            memory = replace(memory, states=(*memory.states[-100:], state), due=due)
    if state != memory.seen:
        # only the first of several changes counts
        memory = replace(memory, seen=state, reads=now + SETTLED if memory.reads is None else memory.reads)
    if memory.due is not None and now >= memory.due - 1e-9 and memory.reads is None:
        if memory.states[-1] != NONE:
            told = gesture_of(memory.states, gestures)
            memory = replace(memory, held=True, due=now + HELD)
        else:
            told, over = "" if memory.held else gesture_of(memory.states, gestures), True
            memory = Strokes(seen=state)
    return memory, told, over


def _due(state: str, now: float) -> float:
    return now + (HELD if state != NONE else OVER)


def gesture_of(states: tuple[str, ...], gestures: Mapping[str, tuple[str, ...]] = GESTURES) -> str:
    """The gesture with this sequence of states, that with the fewest states to pass over; "" for none."""
    fits = [
        (len(states) - len(sequence), name) for name, sequence in gestures.items() if _fits(states, sequence)
    ]
    return min(fits, key=lambda one: one[0])[1] if fits else ""


def _fits(states: tuple[str, ...], sequence: tuple[str, ...]) -> bool:
    at = 0
    if states[0] != sequence[0]:
        return False
    for before, after in pairwise(sequence):
        changed = sum(a != b for a, b in zip(before, after, strict=True))
        ahead = states[at + 1 : at + 1 + changed]
        if after not in ahead:
            return False
        at += 1 + ahead.index(after)
    return at == len(states) - 1
