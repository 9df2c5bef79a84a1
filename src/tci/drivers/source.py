"""A read-only source of touch: a tactile hand or a loose sensor, which is added to any robot.

To add a device, write one small class: `open`, `read`, `close`. Everything else is done for it: a thread that
waits for the device and opens it again, stamps, measured rates, health, and which pad is which patch of the
robot (`tci.drivers.sourced`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.drivers.diagnosis import Finding
from tci.errors import CommandError


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Values of one pad, as the device sent them."""

    pad: str
    values: ArrayLike
    """(n,) raw values in the device's order. NaN is no value."""
    stamp: float | None = None
    """Time [s] on the device's own clock; None if it sends none: then the arrival counts."""


@dataclass(frozen=True, slots=True, eq=False)
class FingerAngles:
    """Angles of the device's own joints."""

    angles: Mapping[str, float]
    """By the names in `Source.joints`, in the device's own unit: 0 to 1 if `Source.hand` has their angles."""


class Source(ABC):
    """One device that only measures. `read` is called by a thread of its own, again and again.

    A constructor takes the address, and keyword-only options as text: `NAME:ADDRESS,option=value`. It opens
    nothing.
    """

    pads: Mapping[str, int] = {}
    """Number of values of each pad, by the device's own names. Empty if the pads have the names of the
    robot's patches, and before `find_pads` where devices differ."""
    joints: tuple[str, ...] = ()
    """The device's own joints, if it measures them."""
    hand: str = ""
    """The hand in the table of devices whose joints these are; empty if their angles are not there."""
    writes: str = "nothing"
    """What is sent to the device, in words. Nothing else may be: no zeroing, no calibration."""
    device: str = ""
    """Name in the table of tactile devices, which knows rows and columns; empty if it is not there."""
    newton_per_count: float | None = None
    """Force [N] that a count is, if the source itself knows it; else the table of devices may."""
    values_per_point: int = 1
    """Values that a pad has for each place: 3 for forces along three axes."""
    wants: tuple[str, ...] = ()
    """Pads that the robot has a patch for, in the order of the address; the others need not be read. Set
    before `open`."""

    def __init__(self, address: str = "") -> None:
        self.address = address

    def find_pads(self) -> None:  # noqa: B027 - most devices are alike
        """Asks the device for its `pads`, if they differ between devices. Raises the errors of `open`."""

    @abstractmethod
    def open(self) -> None:
        """Opens the device. Raises OSError or DriverError if it can't be reached."""

    @abstractmethod
    def read(self) -> Iterable[Sample | FingerAngles]:
        """What arrived; waits at most about 0.2 s for it.

        Raises OSError if the connection is lost, after which `close` and `open` follow; FrameError for data
        that can't be used, which is counted.
        """

    @abstractmethod
    def close(self) -> None:
        """Closes the device. A second call, or one without `open`, does nothing."""

    def diagnose(self) -> Iterable[Finding]:
        """What can be said of the way to the device, beside what arrives."""
        return ()

    def feed(self, pad: str, values: ArrayLike) -> None:
        """Takes values from the program itself. Raises CommandError if the source reads a device."""
        raise CommandError(f"{type(self).__name__} reads a device; valid for feed: ... + array:feed")


def no_values(values: ArrayLike, missing: float | None = None) -> NDArray[np.generic]:
    """The values with NaN where there is none; `missing` is the number that says so, such as -1."""
    found: NDArray[np.generic] = np.asarray(values)
    if missing is None or not (found == missing).any():
        return found
    return np.where(found == missing, np.float32(np.nan), found.astype(np.float32))
