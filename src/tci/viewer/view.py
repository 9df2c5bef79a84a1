"""What is shown of one robot at one instant, wherever it comes from, and what is kept for plots."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tci.frames import Array
from tci.gate.gate import GateState
from tci.messages import Contact, JointReading

WINDOW = 10.0
"""Time [s] that plots show."""
SAMPLE = 0.05
"""Time [s] between two samples of them. Of force and response the largest since the one before is kept."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One robot at one instant."""

    time: float
    """Time [s] on the driver's clock."""
    joints: JointReading
    """Where the servos are."""
    posture: Mapping[str, Array]
    """Generic angles (n,) [rad] by part."""
    pressure: Mapping[str, Array]
    """Pressure (taxels,) [Pa] by patch; a patch that has not sent is absent."""
    contacts: Sequence[Contact]
    """Contacts on the skin."""
    state: GateState | None
    """State of the gate; None where nothing is commanded."""
    reason: str
    """Why the gate holds or has stopped; where nothing is commanded, why the joint data can't be used."""
    response: float
    """Largest speed [rad/s] of a servo that was sent."""
    finger: Array | None = None
    """`T_WF` (4, 4) of the simulated finger's tip, z into the skin; None while there is none."""

    @property
    def force(self) -> float:
        """Force [N] of all contacts."""
        return float(sum(contact.force for contact in self.contacts))


_Row = tuple[float, float, float, Mapping[str, Array]]


class History:
    """The last seconds of a robot's views, for plots. One thread adds, another may look."""

    def __init__(self) -> None:
        self._rows: deque[_Row] = deque(maxlen=int(WINDOW / SAMPLE))
        self._latest: _Row | None = None

    def add(self, view: View) -> None:
        """Keep a view, at most one per `SAMPLE`. Time that runs backwards begins anew."""
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
        """Forget all."""
        self._rows.clear()
        self._latest = None

    def series(self, part: str) -> tuple[Array, Array, Array, Array]:
        """Time (k,) [s], force (k,) [N], response (k,) [rad/s] and posture (n, k) [rad] of a part."""
        latest, rows = self._latest, list(self._rows)
        if latest is not None and rows and latest[0] > rows[-1][0]:
            rows.append(latest)
        rows = [row for row in rows if part in row[3]]
        if not rows:
            return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 0))
        times, forces, responses, postures = zip(*rows, strict=True)
        angles = np.array([posture[part] for posture in postures]).T
        return np.array(times), np.array(forces), np.array(responses), angles
