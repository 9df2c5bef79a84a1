"""A taught motion, and corrections of it that can be taken back one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tci.body import GenericBody
from tci.errors import TciError
from tci.gestures.gesture import Gesture, record
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import initial_position

SAMPLE = 0.02
"""Time [s] between two postures."""
SMOOTH = 0.1
"""Half length [s] of the window that takes the trembling of hands off: it halves 5 Hz."""
NEAR = 0.4
"""Least time [s] before and after a correction within which it fades."""
EASY = 0.5
"""Speed [rad/s] that a fading correction adds at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """A part was led elsewhere at one moment of a motion."""

    part: str
    time: float
    """[s]"""
    change: Array
    """(n,) [rad]"""

    @property
    def reach(self) -> float:
        """Time [s] before and after it within which it fades."""
        return max(NEAR, 0.5 * np.pi * float(np.abs(self.change).max()) / EASY)

    def at(self, time: float) -> Array:
        """What it adds (n,) [rad] at `time` [s]: a raised cosine."""
        away = min(abs(time - self.time) / self.reach, 1.0)
        return read_only(self.change * (0.5 + 0.5 * float(np.cos(np.pi * away))))


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion in the robot's own generic joints."""

    taught: Gesture
    """Postures every `SAMPLE`."""
    corrections: tuple[Correction, ...] = ()
    """The newest one last."""

    @staticmethod
    def of(times: Sequence[float], postures: Mapping[str, Sequence[Array]]) -> Motion:
        """From postures that were led. Raises TciError for less than 0.2 s."""
        if len(times) < 2 or times[-1] - times[0] < 0.2:
            raise TciError("a lesson of less than 0.2 s; valid: a longer one")
        known = np.array(times) - times[0]
        even = np.linspace(0.0, known[-1], max(2, round(known[-1] / SAMPLE) + 1))
        smooth = {
            part: read_only(
                _smooth(np.column_stack([np.interp(even, known, one) for one in np.array(rows).T]))
            )
            for part, rows in postures.items()
        }
        return Motion(Gesture(read_only(even), smooth))

    @property
    def duration(self) -> float:
        """[s]."""
        return self.taught.duration

    @property
    def parts(self) -> tuple[str, ...]:
        return tuple(self.taught.postures)

    def at(self, time: float) -> dict[str, Array]:
        """Angles (n,) [rad] of each part at `time` [s], with all corrections."""
        found = {part: np.array(angles) for part, angles in self.taught.at(time).items()}
        for one in self.corrections:
            found[one.part] += one.at(min(time, self.duration))
        return {part: read_only(angles) for part, angles in found.items()}

    def rates(self, time: float) -> dict[str, Array]:
        """Speeds (n,) [rad/s] of each part there; 0 from its end on."""
        if time >= self.duration:
            return {part: read_only(np.zeros(rows.shape[1])) for part, rows in self.taught.postures.items()}
        before, after = max(time - SAMPLE, 0.0), min(time + SAMPLE, self.duration)
        begin, end = self.at(before), self.at(after)
        return {part: read_only((end[part] - begin[part]) / (after - before)) for part in begin}

    def corrected(self, part: str, time: float, posture: ArrayLike) -> Motion:
        """The motion that passes through `posture` (n,) [rad] at `time` [s]."""
        one = Correction(part, time, read_only(np.asarray(posture) - self.at(time)[part]))
        return replace(self, corrections=(*self.corrections, one))

    def undone(self) -> Motion:
        """The motion without its newest correction."""
        return replace(self, corrections=self.corrections[:-1])

    def gesture(self, body: GenericBody) -> Gesture:
        """It for any robot: arm angles relative to the torso, as in gesture files."""
        times, rows = self.taught.times, []
        for time in times.tolist():
            position = np.array(initial_position(body.robot))
            for part, angles in self.at(time).items():
                joints = body.joint_maps[part]
                position[joints.servos] = joints.to_robot(angles, position)
            rows.append(position)
        whole = record(body.robot, times, np.array(rows))
        return Gesture(times, {part: whole.postures[part] for part in self.parts})


def _smooth(rows: Array) -> Array:
    half = min(round(SMOOTH / SAMPLE), (len(rows) - 1) // 2)
    if half < 1:
        return rows
    window = np.hanning(2 * half + 3)[1:-1]
    window /= window.sum()
    # continued by its own reflection through the end, so that begin and end stay where they are
    begin = 2.0 * rows[0] - rows[half:0:-1]
    end = 2.0 * rows[-1] - rows[-2 : -half - 2 : -1]
    padded = np.vstack([begin, rows, end])
    return np.column_stack([np.convolve(column, window, mode="valid") for column in padded.T])
