"""Joints one way, skin another: a NAO's joints over NAOqi, its skin over YARP, in one connection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tci.clock import MonotonicClock
from tci.drivers.diagnosis import Finding
from tci.drivers.driver import Link
from tci.errors import LinkError
from tci.gate.gate import SafeCommand
from tci.messages import Reading, SkinFrame


class JoinedLink(Link):
    """A link to joints and links to skin. Gate, clock and lease are those of the joints' link."""

    def __init__(self, joints: Link, skins: Sequence[Link]) -> None:
        """Take the joints from `joints`, each patch from the first of `skins` that has sent it.

        All links are closed with this one. Raises LinkError when their clocks are not this machine's own.
        """
        self.joints, self.skins = joints, tuple(skins)
        for link in (joints, *skins):
            if not isinstance(link.clock, MonotonicClock):
                raise LinkError(
                    f"{type(link).__name__} has a time of its own, so it can't be joined to others"
                )
        self.robot, self.clock, self.armed = joints.robot, joints.clock, joints.armed
        self.period, self.gate, self.lease_name = joints.period, joints.gate, joints.lease_name
        self.keep_alive = max((link.keep_alive for link in skins if link.keep_alive), default=None)
        self.about, self.recorded = joints.about, joints.recorded
        self._open = True

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        return self.joints.ticks(duration=duration, start=start)

    def diagnose(self) -> tuple[Finding, ...]:
        return tuple(finding for link in (self.joints, *self.skins) for finding in link.diagnose())

    def _receive(self) -> Reading:
        reading = self.joints.read()
        frames: dict[str, SkinFrame] = {}
        for link in self.skins:
            for frame in link.read().skin:
                frames.setdefault(frame.patch, frame)
        return Reading(reading.joints, tuple(frames.values()))

    def _send(self, safe: SafeCommand) -> None:
        self.joints._send(safe)

    def _halt(self) -> None:
        self.joints._halt()

    def _close(self) -> None:
        for link in (self.joints, *self.skins):
            link.close()
