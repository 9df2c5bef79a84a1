"""Finds the touches in a recording, and the latencies of the robot's responses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tci.messages.frames import Array
from tci.recording.perceived import Perceived

PAUSE = 0.3
"""Least time [s] without contact between two touches. Assumed: with a shorter time, a flickering touch would
be split. With a longer time, quick touches would be joined."""
MOVED = np.deg2rad(0.5)
"""Least change [rad] of a generic joint that counts as motion. Assumed: above encoder noise."""


@dataclass(slots=True)
class RecordedTouch:
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
    """Largest total force [N] of the contacts on the part."""
    lasts: bool = False
    """True if the contact continues until the end of the recording."""
    commands: dict[str, float] = field(default_factory=dict)
    """Time [s] of the first command for each part since the touch began. The key "" is for commands to the
    robot's own joints."""
    motions: dict[str, float] = field(default_factory=dict)
    """Time [s] at which each part first moved, by part. Motion means that a generic joint has turned by more
    than `MOVED` [rad] since the touch began."""

    @property
    def responding(self) -> str:
        """Part whose response is measured. This is the touched part, or the first responding part if only
        other parts respond."""
        among = {part: time for part, time in self.commands.items() if part} or self.motions
        return self.part if self.part in among or not among else min(among, key=among.__getitem__)

    @property
    def commanded(self) -> float | None:
        """Time [s] of the first command to the responding part since the touch began. If this part got no
        command, commands to servos by the robot's own names count instead. The value is None if there was no
        command of either kind."""
        return self.commands.get(self.responding, self.commands.get(""))

    @property
    def moved(self) -> float | None:
        """Time [s] at which the responding part first moved after the touch began. The value is None if it
        did not move."""
        return self.motions.get(self.responding)

    def to_json(self) -> dict[str, object]:
        """Returns plain values for JSON.

        The times of the command, of the motion and of the contact's end are in milliseconds after the first
        contact.
        """
        return {
            "part": self.part,
            "patch": self.patch,
            "began_s": self.began,
            "peak_force_n": self.peak_force,
            "command_ms": None if self.commanded is None else 1e3 * (self.commanded - self.began),
            "motion_ms": None if self.moved is None else 1e3 * (self.moved - self.began),
            "lost_ms": None if self.lasts else 1e3 * (self.ended - self.began),
            "responding_part": self.responding,
        }


def find_touches(periods: Iterable[Perceived]) -> list[RecordedTouch]:
    """Returns all touches, in the order of their first contacts.

    If a part other than the touched one was commanded immediately before the touch, for example in a gesture,
    the commands and the motion of that part do not count as a response.
    """
    found: list[RecordedTouch] = []
    last: dict[str, RecordedTouch] = {}
    start: dict[str, Mapping[str, Array]] = {}
    before: set[str] = set()
    busy: dict[str, set[str]] = {}
    for period in periods:
        forces: dict[str, float] = {}
        patches: dict[str, str] = {}
        for contact in period.perception.contacts:
            forces[contact.part] = forces.get(contact.part, 0.0) + contact.force
            patches.setdefault(contact.part, contact.patch)
        for part, force in forces.items():
            touch = last.get(part)
            if touch is None or period.now - touch.ended > PAUSE:
                touch = last[part] = RecordedTouch(part, patches[part], period.now, period.now)
                start[part], busy[part] = period.perception.posture, before - {part}
                found.append(touch)
            touch.ended = period.now
            touch.peak_force = max(touch.peak_force, force)
        for part, touch in last.items():
            if period.now - touch.ended > PAUSE:
                continue
            for command in period.commands:
                known = command["part"] in ("", *start[part]) and command["part"] not in busy[part]
                if known and len(command["values"]):
                    touch.commands.setdefault(command["part"], period.now)
            for name, angles in period.perception.posture.items():
                if (
                    name not in {*touch.motions, *busy[part]}
                    and np.abs(angles - start[part][name]).max(initial=0.0) > MOVED
                ):
                    touch.motions[name] = period.now
        before = {command["part"] for command in period.commands if len(command["values"])}
    for touch in last.values():
        touch.lasts = touch.ended == period.now
    return found
