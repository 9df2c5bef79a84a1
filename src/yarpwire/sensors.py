"""Messages of `MultipleAnalogSensors`, YARP 4's devices with several sensors, for example skin patches.

The port `/PREFIX/measures:o` streams one list for each kind of sensor. This list has an item `((values)
time)` for each sensor of the kind. The port `/PREFIX/rpc:o` answers `getMetadata` with the metadata of each
sensor, in the order of these items: `(name frame more)`, where `more` is any further text.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from yarpwire.calls_v4 import PROTOCOL
from yarpwire.errors import RepetitionError, WireError
from yarpwire.values import Array, Loose, Vocab

KINDS = (
    "ThreeAxisGyroscopes", "ThreeAxisLinearAccelerometers", "ThreeAxisMagnetometers", "OrientationSensors",
    "TemperatureSensors", "SixAxisForceTorqueSensors", "ContactLoadCellArrays", "EncoderArrays",
    "SkinPatches", "PositionSensors", "LinearVelocitySensors", "ThreeAxisAngularAccelerometers",
)  # fmt: skip
"""Kinds of sensors, in the order of their lists in a message."""
SKIN = KINDS.index("SkinPatches")
MEASURES, METADATA = "/measures:o", "/rpc:o"
"""Endings of the port names of a device, which has one port for measures and one for metadata."""
MOST = 1000
"""Largest number of sensors of a kind in one message. Assumed: this bounds the memory; an iCub has a few
sensors of a kind."""


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """Values that one sensor measured, and their time."""

    values: Array
    """Measured values (n,), in the units of the sensor."""
    time: float
    """Time [s] of measurement on the sender's clock."""


def encode_measures(measures: Sequence[Measure], kind: int = SKIN) -> list[Any]:
    """Returns the message with the measures of a device that has only sensors of `kind`."""
    message: list[Any] = [[] for _ in KINDS]
    message[kind] = [[one.values, float(one.time)] for one in measures]
    return message


def decode_measures(message: Sequence[Any], kind: int = SKIN) -> tuple[Measure, ...]:
    """Returns the measures of one kind in a message. Raises WireError if the message is invalid."""
    if len(message) != len(KINDS) or not all(isinstance(part, list) for part in message):
        raise WireError(
            f"{len(message)} parts of measures; valid: {len(KINDS)} lists, one for each kind of sensor"
        )
    if len(message[kind]) > MOST:
        raise WireError(f"{len(message[kind])} {KINDS[kind]} in one message; valid: up to {MOST}")
    return tuple(_measure(one, KINDS[kind]) for one in message[kind])


class Renewal:
    """Detects measures that are repeated. A server writes a new stamp into each message, even if the sensors
    have no new values."""

    def __init__(self) -> None:
        self._last: tuple[float, ...] = ()

    def check(self, measures: Sequence[Measure]) -> None:
        """Raises RepetitionError if a measure has the same time as the last accepted measure of the same
        sensor. Times of 0 and NaN are not compared, since they mean that the sensor has no valid time."""
        times = tuple(one.time for one in measures)
        if len(times) == len(self._last) and any(
            time == last != 0.0 for time, last in zip(times, self._last, strict=True)
        ):
            raise RepetitionError("measures that came before")
        self._last = times


def _measure(one: Any, kind: str) -> Measure:
    match one:
        case [[*values], float(time)] if all(isinstance(value, float) for value in values):
            return Measure(np.array(values, dtype=np.float64), time)
    raise WireError(f"{str(one)[:60]} in {kind}; valid: a list of numbers, and a time")


def answer_metadata(items: Sequence[Any], names: Sequence[str], kind: int = SKIN) -> list[Any] | bytes:
    """Returns the answer to a call to the rpc port of a device. `names` are the names of the device's
    sensors."""
    first = items[0] if items else ""
    word = first.word if isinstance(first, Vocab) else str(first)
    if word == "getRemoteProtocolVersion":
        return PROTOCOL
    if word == "getMetadata":
        return Loose(
            [[Loose([name, "", ""]) for name in names] if at == kind else [] for at in range(len(KINDS))]
        )
    if word == "help":
        return [Vocab("many"), "getMetadata: names of all sensors", "help: this list"]
    return [Vocab("fail")]
