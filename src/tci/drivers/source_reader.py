"""The thread that reads one source: stamps, measured rates and health of each pad."""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tci.drivers.angle_track import AngleTrack
from tci.drivers.diagnosis import Finding, Level
from tci.drivers.remote.source_clock import SourceClock
from tci.drivers.source import FingerAngles, Sample, Source
from tci.errors import DriverError, FrameError, TciError

AGAIN = 0.5
"""Time [s] between closing a lost device and opening it again: Inspire's hands need 0.3 s."""
LEAST_SILENCE, MOST_SILENCE, GAPS = 0.25, 5.0, 4.0
"""A pad is silent after `GAPS` times its usual gap between two frames, within these bounds [s]."""
MOST_REASONS = 20
AT_FIRST = 2
"""Unusable messages of one kind before it is told: a port is opened amid one."""
ADVICE: dict[type[Exception], str] = {
    ConnectionRefusedError: "the computer is there, but nobody listens at this port: start what serves the "
    "hand, end its other clients, or correct the port",
    socket.gaierror: "no computer has this name: write its number, such as 192.168.11.210",
    TimeoutError: "switch it on, and see that this computer has an address in its network (ip address)",
    FileNotFoundError: "plug it in; tci hand lists the ports",
}
"""What to do next, by the error."""
_log = logging.getLogger("tci")


@dataclass(slots=True)
class PadState:
    """What is known of one pad."""

    channels: int
    values: NDArray[np.generic] | None = None
    sequence: int = 0
    stamp: float = -np.inf
    """[s], on this machine's monotonic clock."""
    arrival: float = -np.inf
    first: float = np.inf
    gap: float = np.nan
    """Usual time [s] between two frames: a moving average."""
    jitter: float = 0.0
    """How far [s] a gap is from the usual one: a moving average."""
    changed: int = 0
    """Frames that differ from the frame before."""
    clock: SourceClock = field(default_factory=SourceClock)

    @property
    def rate(self) -> float:
        """Measured frames per second; 0 before the second frame."""
        return (self.sequence - 1) / (self.arrival - self.first) if self.sequence > 1 else 0.0

    @property
    def patience(self) -> float:
        """Time [s] without a frame after which it is silent."""
        gap = GAPS * self.gap if np.isfinite(self.gap) else 1.0
        return float(min(max(gap, LEAST_SILENCE), MOST_SILENCE))

    def take(self, values: NDArray[np.generic], stamp: float | None, arrival: float) -> None:
        placed = arrival if stamp is None else self.clock.place(stamp, arrival)
        if placed is None:  # an older frame after a newer one
            return
        if self.values is not None:
            self.changed += not np.array_equal(values, self.values)
            gap = arrival - self.arrival
            if np.isnan(self.gap):
                self.gap = gap
            self.jitter += 0.1 * (abs(gap - self.gap) - self.jitter)
            self.gap += 0.1 * (gap - self.gap)
        self.first = min(self.first, arrival)
        self.values, self.stamp, self.arrival = values, placed, arrival
        self.sequence += 1


def said(error: Exception) -> str:
    """An error, and what to do next."""
    text = str(error) or type(error).__name__
    for kind, advice in ADVICE.items():
        if isinstance(error, kind):
            return f"{text}; {advice}"
    return text


class SourceReader:
    """Reads one source until `close`. A lost device is opened again."""

    def __init__(self, name: str, source: Source, pads: Mapping[str, int]) -> None:
        """Opens the source. `pads` is the number of values of each pad that is wanted.

        Raises DriverError, with the address `name`, if the source can't be opened.
        """
        self.name, self.source = name, source
        source.wants = tuple(pads)
        self.pads = {pad: PadState(channels) for pad, channels in pads.items()}
        self.track = AngleTrack()
        """Angles of the device's own joints."""
        self.rejected: Counter[str] = Counter()
        """Number of unusable messages, by the reason."""
        self.lost = 0
        """How often the connection was lost."""
        self.trouble = ""
        """Why the source can't be read now; empty if it can."""
        self.began = time.monotonic()
        self._closed = threading.Event()
        try:
            source.open()
        except (OSError, TciError) as error:
            source.close()
            raise DriverError(f"{name}: {said(error)}") from error
        self._thread = threading.Thread(target=self._run, name=f"source {name}", daemon=True)
        self._thread.start()

    @property
    def channels(self) -> dict[str, int]:
        """Number of values of each pad."""
        return {name: pad.channels for name, pad in self.pads.items()}

    def close(self) -> None:
        self._closed.set()
        self._thread.join(timeout=2.0)
        self.source.close()

    def wait(self, seconds: float) -> None:
        """Waits until every pad has sent a frame, and the joints their angles, at most `seconds`."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not (
            all(pad.sequence for pad in self.pads.values()) and (self.track.latest or not self.source.hand)
        ):
            time.sleep(0.005)

    def silence(self, pad: str, now: float) -> float | None:
        """For how long [s] a silent pad has sent nothing at `now` (monotonic); None if it is not silent."""
        state = self.pads[pad]
        waited = now - max(state.arrival, self.began)
        return waited if waited > state.patience else None

    def diagnose(self) -> tuple[Finding, ...]:
        found = []
        if self.trouble:
            found.append(
                Finding(Level.FAULT, self.name, self.trouble, "switch the device on; check its cable")
            )
        seen = [pad for pad in self.pads.values() if pad.sequence]
        if seen:
            rates = [pad.rate for pad in seen]
            jitter = 1e3 * max(pad.jitter for pad in seen)
            said = (
                f"{len(seen)} of {len(self.pads)} pads send, {min(rates):.0f} to {max(rates):.0f} frames/s, "
                f"jitter {jitter:.0f} ms"
            )
            figures = {"least_rate_hz": min(rates), "most_rate_hz": max(rates), "jitter_ms": jitter,
                       "lost": float(self.lost)}  # fmt: skip
            found.append(Finding(Level.OK, self.name, f"{said}; sent to the device: {self.source.writes}",
                                 figures=figures))  # fmt: skip
        elif not self.trouble:
            found.append(
                Finding(Level.FAULT, self.name, "it is open, and nothing usable has come",
                        "start what sends, and see that it sends to this address")
            )  # fmt: skip
        if self.lost:
            said = f"the connection was lost {self.lost} times"
            found.append(
                Finding(Level.WARNING, self.name, said, "check cable, power, and other programs on it")
            )
        still = [name for name, pad in self.pads.items() if pad.sequence > 1 and not pad.changed]
        if still:
            said = f"no value of {len(still)} pads has changed: {', '.join(still[:6])}"
            found.append(Finding(Level.NOTE, self.name, said, "press each of them: only a change shows life"))
        found += self.source.diagnose()
        found += [
            Finding(
                Level.WARNING,
                self.name,
                f"{count} messages unusable: {reason}",
                "send what is valid, or correct the description",
            )
            for reason, count in self.rejected.items()
        ]
        return tuple(found)

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                if self.trouble:
                    self.source.open()
                    self.trouble = ""
                for one in self.source.read():
                    self._take(one)
            except FrameError as error:
                self._reject(str(error))
            except Exception as error:  # a fault of one source must not end the run
                self.lost += not self.trouble
                self.trouble = said(error)
                self._quietly(self.source.close)
                self._closed.wait(AGAIN)

    def _take(self, one: Sample | FingerAngles) -> None:
        arrival = time.monotonic()
        if isinstance(one, FingerAngles):
            self.track.take(one.angles, arrival)
            return
        state = self.pads.get(one.pad)
        if state is None:
            if one.pad not in self.source.pads:
                self._reject(f"no pad {one.pad!r}; valid: {', '.join(self.pads)}")
            return
        values = np.array(one.values)
        values.flags.writeable = False
        if values.shape != (state.channels,) or values.dtype.kind not in "uif":
            self._reject(
                f"{one.pad}: {values.size} values of type {values.dtype}; valid: {state.channels} numbers"
            )
        else:
            state.take(values, one.stamp, arrival)

    def _reject(self, reason: str) -> None:
        reason = reason if len(self.rejected) < MOST_REASONS else "and others"
        self.rejected[reason] += 1
        if self.rejected[reason] == AT_FIRST:
            _log.warning("%s: unusable: %s", self.name, reason)

    def _quietly(self, do: Callable[[], None]) -> None:
        try:
            do()
        except Exception as error:
            self._reject(f"close: {error}")
