"""Sends the skin of a served robot on YARP ports, and reads the skin ports of any robot.

- `/ROBOT/skin/PATCH` sends the raw values of a patch as a Vector.
- `/ROBOT/skin/PATCH_comp` sends the drift-compensated values.
- `/ROBOT/skin/PATCH/rpc:i` exists only in YARP 3: iCub's skinManager and each other `analogsensorclient` only
  start if they can connect to it.
- `/ROBOT/skin/PATCH/measures:o` and `.../rpc:o` exist only in YARP 4: there a patch is also a device with one
  `ISkinPatches` sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.remote.source_clock import SourceClock
from tci.messages import SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.description import Patch, Robot, wire_name
from tci.wires.yarp.address import patch_port
from tci.wires.yarp.skin_layout import SkinLayout, check_order
from yarpwire.dialect import V4, Dialect
from yarpwire.feed import Feed
from yarpwire.incoming import Answer, Delivery
from yarpwire.message import CALL, Stamp
from yarpwire.network import NamedPort, Network
from yarpwire.sensors import (
    MEASURES,
    METADATA,
    Measure,
    Renewal,
    answer_metadata,
    decode_measures,
    encode_measures,
)
from yarpwire.values import Vocab

ANALOG, FAILED = Vocab("iana"), 1
"""First word of a call to an analog sensor, and its answer that something failed (`IAnalogSensor`)."""
Open = Callable[[str, Callable[[Delivery], Answer] | None], NamedPort]


class SkinPorts:
    """The ports of one patch of a served robot."""

    def __init__(self, robot: Robot, patch: Patch, prefix: str, dialect: Dialect, open_port: Open) -> None:
        """Opens all ports with the function `open_port`. Raises the errors of this function."""
        name = patch_port(robot, prefix, patch.name)
        self._layout, self._sensor = SkinLayout.of(robot, patch), patch.sensor
        self._raw, self._compensated = open_port(name, None), open_port(f"{name}_comp", None)
        self._measures: NamedPort | None = None
        if dialect is not V4:
            open_port(f"{name}/rpc:i", lambda delivery: answer_analog(delivery.items(dialect)))
        else:

            def call(delivery: Delivery) -> Answer:
                wanted = delivery.command.kind == CALL
                return answer_metadata(delivery.items(dialect), [wire_name(patch.name)]) if wanted else None

            self._measures = open_port(f"{name}{MEASURES}", None)
            open_port(f"{name}{METADATA}", call)

    def publish(self, frame: SkinFrame, stamp: Stamp) -> None:
        """Sends a skin frame on each port that has a connection."""
        sensor = self._sensor
        values = self._layout.to_port(np.asarray(frame.values, dtype=float), sensor.rest)
        if self._raw.outputs:
            self._raw.write(values, stamp)
        if self._measures is not None and self._measures.outputs:
            self._measures.write(encode_measures([Measure(values, stamp.time)]), stamp)
        if self._compensated.outputs:
            sign = 1.0 if sensor.pascal_per_count > 0 else -1.0
            self._compensated.write(np.clip(sign * (values - sensor.rest), 0.0, 255.0))


def answer_analog(items: Sequence[Any]) -> list[Any]:
    """The answer to a call to an analog sensor of YARP 3. It can only be asked to calibrate itself, and a
    served patch does not: its values are those of the robot's own skin."""
    return [FAILED] if len(items) > 1 and items[0] == ANALOG else [Vocab("fail")]


def read_skin(
    robot: Robot, patch: Patch, prefix: str, network: Network, dialect: Dialect,
    *, own: str, carrier: str, compensated: bool,
) -> Feed[NDArray[np.float64]]:  # fmt: skip
    """Returns a Feed that receives the frames of one patch of the robot at `prefix`.

    If the robot has YARP 4's port `measures:o` for the patch, this port is read. If the device has several
    sensors, their values form the patch, one sensor after the other. Assumed: before YARP 4, iCub's skin
    devices sent their values in this order.

    Raises DriverError if the order of the patch's values is unknown, UnknownNameError if the port is not
    registered, and PortError if the connection fails.
    """
    name, layout, sensor = patch_port(robot, prefix, patch.name), SkinLayout.of(robot, patch), patch.sensor
    check_order(layout, patch, prefix, network)
    source = skin_port(name, dialect, network, compensated=compensated)
    measured, renewal = source.endswith(MEASURES), Renewal()

    def decode(delivery: Delivery) -> Array:
        measures = decode_measures(delivery.items(dialect)) if measured else ()
        if not measured:
            values = delivery.vector(dialect)
        else:
            values = np.concatenate([one.values for one in measures]) if measures else np.empty(0)
        values = layout.from_port(values, source)
        renewal.check(measures)
        if compensated:
            values = sensor.rest + np.copysign(values, sensor.pascal_per_count)
        return read_only(values)

    return Feed(
        source, network, dialect, decode, own=f"{own}/skin/{wire_name(patch.name)}:i", carrier=carrier,
        clock=SourceClock(),
    )  # fmt: skip


def skin_port(name: str, dialect: Dialect | None, network: Network, *, compensated: bool) -> str:
    """Returns the name of the port from which to read a patch. `name` is the patch's port with raw values. If
    `compensated` is True, the result is the port with drift-compensated values."""
    if compensated:
        return f"{name}_comp"
    measures = f"{name}{MEASURES}"
    return measures if dialect is V4 and network.lives(measures) else name
