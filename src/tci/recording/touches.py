"""Finds the touches in a recording, and the latencies of the responses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tci.frames import Array
from tci.recording.perceived import Perceived

PAUSE = 0.3
"""Time [s] without contact that separates two touches. Assumed: a shorter time would split a flickering
touch, a longer one would join quick touches."""
MOVED = np.deg2rad(0.5)
"""Change [rad] of a generic joint that counts as motion. Assumed: above encoder noise."""


@dataclass(slots=True)
class Touch:
    """One touch of one part."""

    part: str
    """Generic part that was touched."""
    patch: str
    """Patch with the first contact."""
    began: float
    """Time [s] of the first period with a contact."""
    ended: float
    """Time [s] of the last period with a contact."""
    peak_force: float = 0.0
    """Largest total force [N] of the part's contacts."""
    commanded: float | None = None
    """Time [s] of the first command for the part since then; None without one."""
    moved: float | None = None
    """Time [s] at which a generic joint of the part had changed by `MOVED`; None if none did."""

    def to_json(self) -> dict[str, object]:
        """Returns plain values for JSON; times are relative to the first contact, in milliseconds."""
        return {
            "part": self.part,
            "patch": self.patch,
            "began_s": self.began,
            "peak_force_n": self.peak_force,
            "command_ms": None if self.commanded is None else 1e3 * (self.commanded - self.began),
            "motion_ms": None if self.moved is None else 1e3 * (self.moved - self.began),
            "lost_ms": 1e3 * (self.ended - self.began),
        }


def find_touches(periods: Iterable[Perceived]) -> list[Touch]:
    """Returns all touches in the order of their beginnings."""
    found: list[Touch] = []
    last: dict[str, Touch] = {}
    start: dict[str, Array] = {}
    for period in periods:
        forces: dict[str, float] = {}
        patches: dict[str, str] = {}
        for contact in period.perception.contacts:
            forces[contact.part] = forces.get(contact.part, 0.0) + contact.force
            patches.setdefault(contact.part, contact.patch)
        for part, force in forces.items():
            touch = last.get(part)
            if touch is None or period.now - touch.ended > PAUSE:
                touch = last[part] = Touch(part, patches[part], period.now, period.now)
                start[part] = period.perception.posture[part]
                found.append(touch)
            touch.ended = period.now
            touch.peak_force = max(touch.peak_force, force)
        for part, touch in last.items():
            if period.now - touch.ended > PAUSE:
                continue
            wanted = any(command["part"] == part and len(command["values"]) for command in period.commands)
            if touch.commanded is None and wanted:
                touch.commanded = period.now
            turned = float(np.abs(period.perception.posture[part] - start[part]).max(initial=0.0))
            if touch.moved is None and turned > MOVED:
                touch.moved = period.now
    return found
