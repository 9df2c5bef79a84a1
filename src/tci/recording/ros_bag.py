"""Imports joint states and raw skin frames from bags of ROS 1 and ROS 2.

Needs rosbags (extra `ros2`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, RecordingError
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.recording.importing import FIRST, Imported, Plausibility, Unmeasured, check_size, importing
from tci.recording.names import servo_names
from tci.recording.schemas import CLOUD, JOINTS, SKIN, raw_of_cloud, to_frame
from tci.robot.description import Robot
from tci.robot.wire_units import WireUnits, wire_joint
from tci.support.installed import needs

SUFFIXES = (".bag", ".db3", ".mcap")
JUMP = 1.0
"""Largest time [s] by which a stamp may be earlier than the previous stamp. If the difference is larger, a
person or program has set the clock back. Assumed: far above network delays."""


def is_bag(path: Path) -> bool:
    """Returns True if a path looks like a bag, which is a folder made by `ros2 bag record`, or a single
    file."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def import_ros_bag(bag: Path, out: Path, robot: Robot) -> Imported:
    """Converts the joint states and skin frames of a bag to a recording.

    The types of these messages are `sensor_msgs/JointState` and `tci_msgs/SkinFrame`, or for a patch without
    the latter `sensor_msgs/PointCloud2` with a field `raw` on a topic that ends in `PATCH/points`. Each joint
    state that names every servo of the robot (by the servo's or the joint's name) becomes one period. The
    period contains the latest frame of each patch. If all kinds of messages in the bag have stamps, the times
    [s] in the recording are these stamps. Otherwise they are the times at which the messages were written to
    the bag. A joint state that is not newer than the previous one is dropped. Raises MissingExtraError if the
    library for bags is missing. Raises RecordingError if the bag can't be read, does not fit the robot, or
    has a clock that was set back.
    """
    left_out = _left_out(bag, robot)
    readings, angles = _readings(bag, robot), Plausibility(robot)
    first = list(islice(readings, FIRST))
    if not first:
        servos = ", ".join(servo_names(robot)[:4])
        raise RecordingError(f"{bag} has no {JOINTS.name} of all servos of {robot.name}: {servos}, ...")
    period = float(np.median(np.diff([reading.joints.stamp for reading in first]))) if len(first) > 1 else 0.0
    source, unmeasured = f"ROS bag {bag.name}", Unmeasured(robot, first)
    with importing(out, robot, middleware="ros2", source=source, period=period) as importer:
        for reading in chain(first, readings):
            angles.see(reading.joints.position)
            importer.write(unmeasured.mend(reading))
    return Imported(importer.recorder.ticks, angles.doubts(), left_out, joints=True)


def _readings(bag: Path, robot: Robot) -> Iterator[Reading]:
    patches = {patch.name for patch in robot.patches}
    frames: dict[str, SkinFrame] = {}
    number, before = 0, -np.inf
    stamped = _is_stamped(bag, robot)
    for kind, topic, arrival, message in _messages(bag, robot):
        stamp = _stamp(message) if stamped else 1e-9 * arrival
        if kind != JOINTS.name:
            # The header's stamp is used, because the field `stamp` is a time on the sender's clock, and the
            # joints have another clock.
            if kind == SKIN.name:
                frame = to_frame({name: getattr(message, name) for _, name in SKIN.fields} | {"stamp": stamp})
            else:
                patch = _patch_of(topic)
                sequence = frames[patch].sequence + 1 if patch in frames else 0
                frame = SkinFrame(patch, stamp, sequence, _raw(message))
            if frame.patch not in patches:
                valid = ", ".join(sorted(patches))
                raise RecordingError(f"{bag} has skin {frame.patch!r}; {robot.name} has {valid}")
            check_size(frame, robot)
            frames[frame.patch] = frame
            continue
        joints = _joints(message, robot, stamp, number)
        if joints is None:
            continue
        if stamp < before - JUMP:
            raise RecordingError(
                f"{bag}: the joints' clock goes back from {before:.3f} to {stamp:.3f} s; "
                "valid: a bag of one run"
            )
        if stamp > before:
            number, before = number + 1, stamp
            yield Reading(joints, tuple(frames.values()))


def _is_stamped(bag: Path, robot: Robot) -> bool:
    """Returns True if for each kind of message in the bag at least one message has a stamp.

    One message with a stamp is enough: stamps of 0 may be valid, since a clock may begin at 0.
    """
    seen, stamped = set[str](), set[str]()
    for kind, _, _, message in _messages(bag, robot):
        seen.add(kind)
        if _stamp(message) > 0.0:
            stamped.add(kind)
        if {JOINTS.name, SKIN.name} <= stamped:
            break
    return seen == stamped


def _stamp(message: Any) -> float:
    """Returns the stamp [s] in the header of a message."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def _joints(message: Any, robot: Robot, stamp: float, number: int) -> JointReading | None:
    """Returns the joint reading in a ROS message of the type JointState, with the time `stamp` [s].

    Returns None if a servo of the robot is missing, or if the message does not have one angle for each name.
    """
    index = {name: place for place, name in enumerate(message.name)}
    names = zip(servo_names(robot), robot.servos, strict=True)
    places = [index.get(name, index.get(wire_joint(servo) or name)) for name, servo in names]
    if any(place is None for place in places) or len(message.position) != len(index):
        return None
    order = np.array(places, dtype=int)
    velocity = message.velocity if len(message.velocity) == len(index) else np.zeros(len(index))
    units = WireUnits(robot)
    angles = units.angles(np.arange(len(order)), message.position[order])
    torque = read_only(message.effort[order] * units.radius) if len(message.effort) == len(index) else None
    return JointReading(stamp, number, read_only(angles), read_only(velocity[order] / units.radius), torque)


def _raw(cloud: Any) -> NDArray[np.generic]:
    """Returns the field `raw` of a ROS message of the type PointCloud2."""
    fields = [
        {name: getattr(field, name) for name in ("name", "offset", "datatype")} for field in cloud.fields
    ]
    names = ("width", "height", "is_bigendian", "point_step", "data")
    try:
        return raw_of_cloud({"fields": fields} | {name: getattr(cloud, name) for name in names})
    except FrameError as error:
        raise RecordingError(str(error)) from error


def _patch_of(topic: str) -> str:
    """Returns the patch of skin whose points a topic has; an empty text for other topics."""
    *_, patch, last = ("", "", *topic.split("/"))
    return patch if last == "points" else ""


def _messages(bag: Path, robot: Robot) -> Iterator[tuple[str, str, int, Any]]:
    """Yields all joint states and skin frames of a bag, in the order of time.

    Each item consists of the message's type, its topic, its time in the bag [ns], and the message.
    """
    with _opened(bag) as reader:
        connections = _used(reader, robot)
        for connection, arrival, raw in reader.messages(connections) if connections else ():
            message = reader.deserialize(raw, connection.msgtype)
            yield connection.msgtype, connection.topic, arrival, message


def _used(reader: Any, robot: Robot) -> list[Any]:
    """Returns the connections from which a recording is made. A patch with raw frames needs no points."""
    patches = {patch.name for patch in robot.patches}
    framed = {c.topic.rstrip("/").rpartition("/")[2] for c in reader.connections if c.msgtype == SKIN.name}
    return [
        c
        for c in reader.connections
        if c.msgtype in (JOINTS.name, SKIN.name)
        or (c.msgtype == CLOUD.name and _patch_of(c.topic) in patches - framed)
    ]


def _left_out(bag: Path, robot: Robot) -> tuple[str, ...]:
    """Returns what no recording is made of: topic, number of messages and type.

    Raises RecordingError if the bag has no joint states.
    """
    with _opened(bag) as reader:
        used = _used(reader, robot)
        others = [c for c in reader.connections if c not in used]
        told = tuple(f"{c.topic}, {c.msgcount} messages of {c.msgtype}" for c in others)
        if not any(c.msgtype == JOINTS.name for c in used):
            has = ", ".join(f"{c.topic} ({c.msgtype})" for c in reader.connections[:8]) or "nothing"
            raise RecordingError(f"{bag} has no {JOINTS.name} of {robot.name}; it has {has}")
    return told


@contextmanager
def _opened(bag: Path) -> Iterator[Any]:
    with needs("importing a ROS bag", "ros2"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(SKIN.definition, SKIN.name))
    try:
        with AnyReader([bag], default_typestore=types) as reader:
            yield reader
    except RecordingError:
        raise
    except (AnyReaderError, OSError) as error:
        raise RecordingError(f"{bag} is no ROS bag that can be read: {error}") from error
    except Exception as error:  # rosbags raises errors of many types for damaged messages
        raise RecordingError(f"{bag} is damaged: {type(error).__name__}: {error}") from error
