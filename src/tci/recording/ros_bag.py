"""Bags of ROS 1 and ROS 2 with the messages of a recording: joint states and raw frames of skin.

Needs rosbags (extra `ros2`).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from tci.errors import RecordingError
from tci.frames import read_only
from tci.installed import needs
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.importing import importing
from tci.recording.names import servo_names
from tci.recording.schemas import JOINTS, SKIN, to_frame
from tci.robot.description import Robot

SUFFIXES = (".bag", ".db3", ".mcap")
FIRST = 100
"""Periods whose median is that of the recording. Ours."""
JUMP = 1.0
"""A stamp that is by more than this [s] before the last one is of a clock that was set. Ours."""


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: the folder that `ros2 bag record` makes, or a file of one."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def import_ros_bag(bag: Path, out: Path, robot: Robot) -> int:
    """Make a recording of a bag's `sensor_msgs/JointState` and `tci_msgs/SkinFrame`; the number of periods.

    A period for each joint state that names every servo of the robot, as the robot calls it or as its model
    does, with the latest frame of each patch. Times [s] are those of the headers, of the bag where no
    joint state is stamped; a joint state that is not newer than the one before is left out. Raises
    MissingExtraError, RecordingError for a bag that can't be read, does not fit the robot, or whose clock was
    set back.
    """
    known = {binding.middleware for binding in robot.bindings}
    middleware = "ros2" if "ros2" in known else "sim"
    readings = _readings(bag, robot)
    first = list(islice(readings, FIRST))
    if not first:
        servos = ", ".join(servo_names(robot)[:4])
        raise RecordingError(f"{bag} has no {JOINTS.name} of all servos of {robot.name}: {servos}, ...")
    period = float(np.median(np.diff([reading.joints.stamp for reading in first]))) if len(first) > 1 else 0.0
    source = f"ROS bag {bag.name}"
    with importing(out, robot, middleware=middleware, source=source, period=period) as recorder:
        for reading in chain(first, readings):
            recorder.tick(reading.joints.stamp, reading)
    return recorder.ticks


def _readings(bag: Path, robot: Robot) -> Iterator[Reading]:
    patches = {patch.name for patch in robot.patches}
    frames: dict[str, SkinFrame] = {}
    number, before = 0, -np.inf
    stamped = any(_stamp(message) > 0.0 for kind, _, message in _messages(bag) if kind == JOINTS.name)
    for kind, arrival, message in _messages(bag):
        stamp = _stamp(message) if stamped else 1e-9 * arrival
        if kind == SKIN.name:
            # Its field `stamp` is on the sender's own clock, not on that of the joints.
            frame = to_frame({name: getattr(message, name) for _, name in SKIN.fields} | {"stamp": stamp})
            if frame.patch not in patches:
                valid = ", ".join(sorted(patches))
                raise RecordingError(f"{bag} has skin {frame.patch!r}; {robot.name} has {valid}")
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


def _stamp(message: Any) -> float:
    """The stamp [s] in a message's header."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def _joints(message: Any, robot: Robot, stamp: float, number: int) -> JointReading | None:
    """The reading in a JointState of `stamp` [s]; None when it is another's."""
    index = {name: place for place, name in enumerate(message.name)}
    names = zip(servo_names(robot), robot.servos, strict=True)
    places = [index.get(name, index.get(servo.joint or name)) for name, servo in names]
    if any(place is None for place in places) or len(message.position) != len(index):
        return None
    order = np.array(places, dtype=int)
    velocity = message.velocity if len(message.velocity) == len(index) else np.zeros(len(index))
    torque = read_only(message.effort[order]) if len(message.effort) == len(index) else None
    return JointReading(stamp, number, read_only(message.position[order]), read_only(velocity[order]), torque)


def _messages(bag: Path) -> Iterator[tuple[str, int, Any]]:
    """Type, time in the bag [ns] and message of those that count, in the order of the bag."""
    with needs("importing a ROS bag", "ros2"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(SKIN.definition, SKIN.name))
    wanted = (JOINTS.name, SKIN.name)
    try:
        with AnyReader([bag], default_typestore=types) as reader:
            connections = [c for c in reader.connections if c.msgtype in wanted]
            for connection, arrival, raw in reader.messages(connections):
                yield connection.msgtype, arrival, reader.deserialize(raw, connection.msgtype)
    except RecordingError:
        raise
    except (AnyReaderError, OSError) as error:
        raise RecordingError(f"{bag} is no ROS bag that can be read: {error}") from error
    except Exception as error:  # whatever a damaged message makes rosbags raise
        raise RecordingError(f"{bag} is damaged: {type(error).__name__}: {error}") from error
