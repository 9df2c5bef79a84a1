"""State of one robot at one instant, for the page, and history of states, for the plots."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tci.gate.gate import GateState
from tci.messages import Contact, JointReading
from tci.messages.frames import Array

WINDOW = 10.0
"""Time span [s] of the plots."""
SAMPLE = 0.05
"""Time [s] between two samples of the plots. Each sample has the largest force and the largest response since
the previous sample."""


@dataclass(frozen=True, slots=True, eq=False)
class TouchingHand:
    """A finger of a simulated hand that somebody moves on the page."""

    tip: Array
    """Pose `T_WF` (4, 4), as of `View.finger`."""
    asked: float
    """Force [N] that the person asks for."""
    force: float
    """Force [N] between finger and skin in the physics."""
    felt: float
    """Force [N] of all contacts that were found on the touched patch."""

    @property
    def words(self) -> str:
        return f"asked {self.asked:.1f} N, presses {self.force:.1f} N, felt {self.felt:.1f} N"


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The state of one robot at one instant."""

    time: float
    """Time [s] on the driver's clock."""
    joints: JointReading
    """Angles of the servos."""
    posture: Mapping[str, Array]
    """Generic angles (n,) [rad] by part."""
    pressure: Mapping[str, Array]
    """Pressure (taxels,) [Pa] by patch. A patch that has not sent any frame is not included."""
    contacts: Sequence[Contact]
    """Contacts on the skin."""
    state: GateState | None
    """State of the gate, or None if TCI only reads the robot."""
    reason: str
    """Reason for which the gate holds or has stopped. If TCI only reads the robot: reason for which the joint
    data can't be used."""
    response: float
    """Largest servo speed [rad/s] in the command that was sent."""
    finger: Array | None = None
    """Pose `T_WF` (4, 4) of the simulated finger's tip. The z axis of F points into the skin. The value is
    None if there is no finger."""

    hands: Sequence[TouchingHand] = ()
    """Simulated hands that touch."""

    @property
    def force(self) -> float:
        """Sum [N] of the forces of all contacts."""
        return float(sum(contact.force for contact in self.contacts))


_Row = tuple[float, float, float, Mapping[str, Array]]


class History:
    """Stores the last seconds of a robot's views, for plots. One thread adds views. Another thread may read
    the views."""

    def __init__(self) -> None:
        self._rows: deque[_Row] = deque(maxlen=int(WINDOW / SAMPLE))
        self._latest: _Row | None = None

    def add(self, view: View) -> None:
        """Adds a view. The history contains at most one sample in 0.05 s (`SAMPLE`). If the view is older
        than the last view, the history is cleared first."""
        if self._rows and view.time < self._rows[-1][0]:
            self.clear()
        _, force, response, _ = self._latest or (0.0, 0.0, 0.0, {})
        row = view.time, max(force, view.force), max(response, view.response), view.posture
        if not self._rows or view.time >= self._rows[-1][0] + SAMPLE - 1e-9:
            self._rows.append(row)
            self._latest = None
        else:
            self._latest = row

    def clear(self) -> None:
        """Removes all views."""
        self._rows.clear()
        self._latest = None

    def series(self, part: str) -> tuple[Array, Array, Array, Array]:
        """Returns time (k,) [s], force (k,) [N], largest commanded servo speed (k,) [rad/s], and the posture
        (n, k) [rad] of a part. Force and speed are those of the whole robot."""
        latest, rows = self._latest, list(self._rows)
        if latest is not None and rows and latest[0] > rows[-1][0]:
            rows.append(latest)
        rows = [row for row in rows if part in row[3]]
        if not rows:
            return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 0))
        times, forces, responses, postures = zip(*rows, strict=True)
        angles = np.array([posture[part] for posture in postures]).T
        return np.array(times), np.array(forces), np.array(responses), angles
