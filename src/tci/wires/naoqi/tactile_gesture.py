"""NAOqi's service for gestures on the head's three switches, with NAOqi's names and times."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import qi

from tci.capabilities.touch_words.tactile_gestures import GESTURES, NONE, Strokes, follow
from tci.wires.naoqi.services import ALMemory

KEYS = "FrontTactilTouched", "MiddleTactilTouched", "RearTactilTouched"
GESTURE, RELEASE = "ALTactileGesture/Gesture", "ALTactileGesture/Release"
"""Keys of ALMemory that hold the latest gesture, and 1 when a sequence is over, for `SHOWN`."""
SHOWN = 1.0
"""Time [s] after which NAOqi takes these values away."""
MOST, LONGEST = 200, 50
"""Largest number of gestures, and of states in one. Assumed."""


@qi.multiThreaded()
class ALTactileGesture:
    """Tells gestures as signals, `onGesture` with the name and `onRelease`, and in ALMemory."""

    def __init__(self, memory: ALMemory) -> None:
        self.onGesture = qi.Signal("(s)")
        self.onRelease = qi.Signal("()")
        self._memory, self._lock = memory, threading.Lock()
        self._strokes, self._gestures = Strokes(), dict(GESTURES)
        self._shown: dict[str, float] = {}

    @qi.bind(qi.Map(qi.String, qi.List(qi.String)), [])
    def getGestures(self) -> dict[str, list[str]]:
        """All gestures: from the name to the states of the switches front, middle, rear."""
        with self._lock:
            return {name: list(states) for name, states in self._gestures.items()}

    @qi.bind(qi.Dynamic, [qi.Dynamic])
    def getGesture(self, sequence: Any) -> str | None:
        """The name of a sequence of states, as a list or with commas; None if there is no such gesture."""
        states = _states(sequence)
        with self._lock:
            return next((name for name, one in self._gestures.items() if one == states), None)

    @qi.bind(qi.Dynamic, [qi.String])
    def getSequence(self, name: str) -> list[str] | None:
        with self._lock:
            return list(self._gestures[name]) if name in self._gestures else None

    @qi.bind(qi.String, [qi.Dynamic])
    def createGesture(self, sequence: Any) -> str:
        """Adds a gesture, and returns its name, for example `gesture-0505020`: the states as numbers."""
        states = _states(sequence)
        with self._lock:
            for name, one in self._gestures.items():
                if one == states:
                    return name
            if len(self._gestures) >= MOST:
                raise ValueError(f"{MOST} gestures; there is no room for more")
            name = "gesture-" + "".join(str(int(state, 2)) for state in states)
            self._gestures[name] = states
            return name

    def _follow(self, now: float) -> None:
        """Called by the loop in each period, with its time [s]."""
        pressed = self._memory.getListData(list(KEYS))
        state = "".join("1" if isinstance(one, int | float) and one > 0.5 else "0" for one in pressed)
        for key in [key for key, until in self._shown.items() if now >= until]:
            del self._shown[key]
            with suppress(KeyError):  # a client has removed it
                self._memory.removeData(key)
        with self._lock:
            self._strokes, told, over = follow(self._strokes, state, now, self._gestures)
        if told:
            self._show(GESTURE, told, now)
            self.onGesture(told)
        if over:
            self._show(RELEASE, 1, now)
            self.onRelease()

    def _show(self, key: str, value: Any, now: float) -> None:
        with suppress(ValueError):  # clients have filled it
            self._memory.insertData(key, value)
        self._shown[key] = now + SHOWN


def _states(sequence: Any) -> tuple[str, ...]:
    states: Sequence[Any] = sequence.split(",") if isinstance(sequence, str) else sequence
    valid = (
        isinstance(states, list | tuple)
        and 2 <= len(states) <= LONGEST
        and all(isinstance(one, str) and len(one) == 3 and set(one) <= {"0", "1"} for one in states)
        and states[0] == NONE
    )
    if not valid:
        raise ValueError(f"sequence {str(sequence)[:80]}; valid: 000, then states such as 100, 010, 111")
    return tuple(states)
