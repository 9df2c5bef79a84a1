"""The state of one robot at one instant as the page shows it, and the history for plots."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tci.frames import Array
from tci.gate.gate import GateState
from tci.messages import Contact, JointReading

WINDOW = 10.0
"""Time span [s] of the plots."""
SAMPLE = 0.05
"""Time [s] between two samples of the plots. Force and response are the largest since the sample before."""


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
    """Pressure (taxels,) [Pa] by patch; a patch that has not sent is absent."""
    contacts: Sequence[Contact]
    """Contacts on the skin."""
    state: GateState | None
    """State of the gate; None if nothing is commanded."""
    reason: str
    """Reason why the gate holds or has stopped; if nothing is commanded, why the joint data can't be used."""
    response: float
    """Largest speed [rad/s] of a servo among those sent."""
    finger: Array | None = None
    """`T_WF` (4, 4) of the simulated finger's tip, z into the skin; None if there is no finger."""

    @property
    def force(self) -> float:
        """Sum [N] of the forces of all contacts."""
        return float(sum(contact.force for contact in self.contacts))


_Row = tuple[float, float, float, Mapping[str, Array]]


class History:
    """The last seconds of a robot's views, for plots. One thread adds, another may read."""

    def __init__(self) -> None:
        self._rows: deque[_Row] = deque(maxlen=int(WINDOW / SAMPLE))
        self._latest: _Row | None = None

    def add(self, view: View) -> None:
        """Adds a view, at most one per `SAMPLE`. A time before the last one clears the history first."""
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
        """Returns time (k,) [s], force (k,) [N], response (k,) [rad/s] and posture (n, k) [rad] of a part."""
        latest, rows = self._latest, list(self._rows)
        if latest is not None and rows and latest[0] > rows[-1][0]:
            rows.append(latest)
        rows = [row for row in rows if part in row[3]]
        if not rows:
            return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 0))
        times, forces, responses, postures = zip(*rows, strict=True)
        angles = np.array([posture[part] for posture in postures]).T
        return np.array(times), np.array(forces), np.array(responses), angles
