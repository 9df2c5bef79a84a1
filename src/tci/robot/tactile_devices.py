"""Tactile devices that people own (`tactile_devices.toml`): their pads, and how a pad's values lie."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tci.errors import UnknownNameError

FINGERS = ("thumb", "index", "middle", "ring", "little")
ALIKE = 0.15
"""Largest relative difference between a pad's size in a model and in the table. Assumed: the pads of the left
and the right Inspire hand differ from each other by 2 %, the tip of the thumb from the other tips by 9 %."""


@dataclass(frozen=True, slots=True)
class DevicePad:
    """One pad of a device."""

    name: str
    rows: int
    columns: int
    fingers: tuple[str, ...] = ()
    """Places that have such a pad: fingers, or "palm"; empty if it may be anywhere."""
    size: tuple[float, float] | None = None
    """Size [m] along the rows and along the columns; None if no source tells it."""
    order: Literal["row-major", "column-major"] = "row-major"
    from_last_row: bool = False
    """True if a frame begins with the last row."""
    from_last_column: bool = False
    """True if rows begin with the last column."""
    found_by_size: bool = True
    """False if a pad of a model is not taken for this one because it has its size."""

    @property
    def channels(self) -> int:
        return self.rows * self.columns

    def misfit(self, size: tuple[float, float]) -> float:
        """Largest relative difference from a pad of this `size` [m]; infinite if size says nothing."""
        if self.size is None or not self.found_by_size:
            return float("inf")
        return max(abs(own / other - 1.0) for own, other in zip(size, self.size, strict=True))


@dataclass(frozen=True, slots=True)
class DeviceJoint:
    """A joint that a hand measures itself."""

    name: str
    model: str
    """Its name in the maker's model of the hand, behind the side: `left_` and this."""
    rad: tuple[float, float]
    """Angles [rad] where the source says 0, and where it says 1. Between them it counts evenly: assumed."""

    def angle(self, share: float) -> float:
        """[rad], of what the source says."""
        return self.rad[0] + share * (self.rad[1] - self.rad[0])

    def share(self, angle: float) -> float:
        """What the source says at an `angle` [rad]; outside its range the nearest end."""
        share = (angle - self.rad[0]) / (self.rad[1] - self.rad[0])
        return min(max(share, 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class Device:
    """A tactile hand, or a single pad."""

    name: str
    title: str
    sources: tuple[str, ...]
    values: tuple[int, int]
    """Smallest and largest raw value of a taxel."""
    pads: tuple[DevicePad, ...]
    read_by: str
    """Name of the source that reads it."""
    rest: int = 0
    """Raw value of a taxel that nothing touches."""
    newton_per_count: float | None = None


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


@cache
def hand_joints(hand: str) -> tuple[DeviceJoint, ...]:
    """The joints that a hand measures itself, in its own order; none of a hand that the table lacks."""
    return tuple(
        DeviceJoint(joint["name"], joint["model"], (joint["rad"][0], joint["rad"][1]))
        for one in _table()["hand"]
        if one["name"] == hand
        for joint in one["joint"]
    )


@cache
def devices() -> tuple[Device, ...]:
    """All devices of the table."""
    return tuple(
        Device(
            name=one["name"], title=one["title"], sources=tuple(one["sources"]),
            values=(one["values"][0], one["values"][1]), rest=one.get("rest", 0),
            read_by=one["read_by"],
            newton_per_count=one.get("newton_per_count"),
            pads=tuple(_pad(dict(pad)) for pad in one["pad"]),
        )
        for one in _table()["device"]
    )  # fmt: skip


def _pad(pad: dict[str, object]) -> DevicePad:
    size = pad.pop("size_mm", None)
    if isinstance(size, list):
        pad["size"] = (1e-3 * size[0], 1e-3 * size[1])
    return DevicePad(**pad | {"fingers": tuple(pad.get("fingers", ()))})  # type: ignore[arg-type]


def device(name: str) -> Device:
    """Raises UnknownNameError, with the valid names, for a device that the table lacks."""
    for one in devices():
        if one.name == name:
            return one
    raise UnknownNameError("tactile device", name, [one.name for one in devices()])


def best_fit(
    sizes: Collection[tuple[float, float]], place: str | None
) -> tuple[Device, DevicePad, tuple[float, float]] | None:
    """The device and its pad whose size is nearest to one of `sizes`, and this size; None if none is alike.

    Args:
        sizes: Size [m] of the pad along its rows and its columns, in each way in which these may lie.
        place: Finger on which the pad is, or "palm"; None if it is unknown.
    """
    found = [
        (pad.misfit(size), one.name, one, pad, size)
        for one in devices()
        for pad in one.pads
        if place is None or not pad.fingers or place in pad.fingers
        for size in sizes
    ]
    misfit, _, one, pad, size = min(found, key=lambda row: row[0])
    return (one, pad, size) if misfit <= ALIKE else None


def place_of(pad: str) -> str:
    """The finger or palm that a pad is on, from its name; its name if that does not say."""
    words = pad.split("_")
    return next((one for one in (*FINGERS, "palm") if one in words), pad)


def pads_of(device: str, sent: Mapping[str, int]) -> dict[str, DevicePad]:
    """Those pads of a source that the table of devices has, by the source's names for them.

    A pad of the table that is on no finger is each pad with as many values.

    Args:
        device: Name in the table; empty if the source's device is not there.
        sent: Number of values of each pad that the source has.
    """
    table = [pad for one in devices() if one.name == device for pad in one.pads]
    return {
        name: pad
        for pad in table
        for name in ([place if place == pad.name else f"{place}_{pad.name}" for place in pad.fingers] or sent)
        if sent.get(name) == pad.channels
    }


def in_rows(values: NDArray[np.generic], pad: DevicePad | None) -> NDArray[np.generic]:
    """A frame as it lies on the pad, (rows, columns); one row if the shape is unknown."""
    if pad is None:
        return values[None]
    if pad.order == "column-major":
        laid = values.reshape(pad.columns, pad.rows).T
    else:
        laid = values.reshape(pad.rows, pad.columns)
    return laid[:: -1 if pad.from_last_row else 1, :: -1 if pad.from_last_column else 1]
