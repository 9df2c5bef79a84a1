"""Message types of a recording, and conversions between these messages and TCI's types."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError, RecordingError
from tci.gate.safe_command import SafeCommand
from tci.messages import (
    CartesianCommand,
    ExpectContact,
    GenericCommand,
    JointReading,
    Mode,
    Order,
    PlatformCommand,
    PlatformSwitch,
    SkinFrame,
    SwitchMode,
)
from tci.messages.frames import Array, read_only
from tci.reasons import NO_REASON, number_of, text_of
from tci.recording.rosmsg.cdr import MessageType, decode, encode

MODES = tuple(Mode)
"""Modes in the order of their numbers in a recording. The number 255 means that the mode is unknown."""
UNKNOWN = 255
DTYPE = re.compile(r"[<>|]?([buif][1248]|[US][1-9][0-9]{0,3})")
"""Types of raw values that a recording may contain. Besides numbers, text is possible, since a faulty source
may send text."""

JOINTS = MessageType(
    "sensor_msgs/msg/JointState",
    (("string[]", "name"), ("float64[]", "position"), ("float64[]", "velocity"), ("float64[]", "effort")),
)
IMU = MessageType(
    "sensor_msgs/msg/Imu",
    (
        ("Quaternion", "orientation"), ("float64[9]", "orientation_covariance"),
        ("Vector3", "angular_velocity"), ("float64[9]", "angular_velocity_covariance"),
        ("Vector3", "linear_acceleration"), ("float64[9]", "linear_acceleration_covariance"),
    ),
    needs=(
        ("geometry_msgs/Quaternion", tuple(("float64", axis) for axis in "xyzw")),
        ("geometry_msgs/Vector3", tuple(("float64", axis) for axis in "xyz")),
    ),
)  # fmt: skip
SKIN = MessageType(
    "tci_msgs/msg/SkinFrame",
    (
        ("float64", "stamp"), ("int64", "sequence"), ("uint16", "number"),
        ("string", "patch"), ("string", "dtype"), ("uint8[]", "data"),
    ),
    says="One frame of one patch of skin, as the robot sent it.\n"
    "stamp: time [s] on the driver's clock; number: index of the patch in this file; dtype: of NumPy.",
)  # fmt: skip
TICK = MessageType(
    "tci_msgs/msg/Tick",
    (
        ("float64", "now"), ("float64", "joints_stamp"), ("int64", "joints_sequence"),
        ("bool", "has_modes"), ("uint8[]", "modes"), ("bool", "has_powered"), ("bool[]", "powered"),
        ("uint16[]", "skin"),
    ),
    says="One period of the loop. now: time [s]; joints_stamp to powered: of the latest joint_states;\n"
    "skin: numbers of the patches whose latest frames were read. "
    f"Modes: {', '.join(mode.value for mode in MODES)}, from 0.",
)  # fmt: skip
TRUTH = MessageType(
    "tci_msgs/msg/Truth",
    (("string[]", "bodies"), ("float64[]", "poses")),
    says="What touches a simulated robot: pads of people's hands, and the finger. poses: of each body place\n"
    "[m] and quaternion w, x, y, z in the world frame of the simulation.",
)
COMMAND_1 = MessageType(
    "tci_msgs/msg/Command",
    (
        ("string", "kind"), ("string", "part"), ("string", "mode"), ("float64[]", "values"),
        ("string", "point"), ("bool", "nearest"), ("int32[]", "servos"),
    ),
    says="A command of the behaviour to a generic part.",
)  # fmt: skip
COMMAND = replace(
    COMMAND_1,
    fields=(*COMMAND_1.fields, ("float64[]", "speed")),
    says=f"{COMMAND_1.says}\nspeed: largest speeds [rad/s]: none, one for all joints, or one for each.",
)
FORMAT = 3
"""Format of the recordings that this version writes. In format 1, decisions have no codes; in formats 1 and
2, commands have no speed."""
DECISION_1 = MessageType(
    "tci_msgs/msg/Decision",
    (
        ("float64", "stamp"), ("string", "state"), ("string", "reason"), ("uint32[]", "servos"),
        ("uint8[]", "modes"), ("float64[]", "position"), ("float64[]", "velocity"), ("float64[]", "torque"),
        ("uint32[]", "stiffness_servos"), ("float64[]", "stiffness"),
        ("uint32[]", "damping_servos"), ("float64[]", "damping"),
        ("string[]", "clamped"), ("string[]", "refusals"),
    ),
    says="Command that the gate passed and the driver sent: [rad], [rad/s], [N m]; shares 0..1.",
)  # fmt: skip
DECISION = replace(
    DECISION_1,
    fields=(*DECISION_1.fields, ("uint16[]", "codes")),
    says=f"{DECISION_1.says}\n"
    f"codes: that of the reason ({NO_REASON} for none), then of each refusal: numbers of tci.reasons.Code.",
)
TEXTS = ("reason", "clamped", "refusals")
"""Fields of the gate's decision (`DECISION`) that are texts for people. The wording may change, so programs
must not compare these fields."""
CLOUD = MessageType(
    "sensor_msgs/msg/PointCloud2",
    (
        ("uint32", "height"), ("uint32", "width"), ("PointField[]", "fields"), ("bool", "is_bigendian"),
        ("uint32", "point_step"), ("uint32", "row_step"), ("uint8[]", "data"), ("bool", "is_dense"),
    ),
    needs=(("sensor_msgs/PointField",
            (("string", "name"), ("uint32", "offset"), ("uint8", "datatype"), ("uint32", "count"))),),
)  # fmt: skip

FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy's type code for each datatype of the ROS message PointField."""


def header(stamp: float, frame: str = "") -> tuple[int, int, str]:
    """Returns the values of a `std_msgs/Header` with the time `stamp` [s]."""
    nanoseconds = to_nanoseconds(stamp)
    return min(nanoseconds // 10**9, 2**31 - 1), nanoseconds % 10**9, frame


def to_nanoseconds(stamp: float) -> int:
    """Converts a time [s] to whole nanoseconds, for other programs.

    TCI's own messages contain the exact time.
    """
    return int(min(max(stamp, 0.0), 9e9) * 1e9) if np.isfinite(stamp) else 0


def joints_values(names: Sequence[str], joints: JointReading, stamp: float) -> tuple[Any, ...]:
    """Returns the values of a JointState with the time `stamp` [s]."""
    effort = joints.torque if joints.torque is not None else ()
    return *header(stamp), names, joints.position, joints.velocity, effort


def joints_bytes(names: list[str], joints: JointReading) -> bytes:
    """Encodes a JointState. Raises ValueError if the values are not a vector of floats."""
    return encode(JOINTS, joints_values(names, joints, joints.stamp))


def imu_bytes(joints: JointReading) -> bytes:
    """Encodes the acceleration of the robot's root link in an Imu message.

    The message's other fields are marked as unknown. If the robot does not report the acceleration any more,
    the acceleration is NaN.
    """
    unknown = [-1.0, *[0.0] * 8]  # In an Imu message, a first value of -1 marks a quantity as unknown.
    force = np.full(3, np.nan) if joints.gravity is None else -joints.gravity
    values = ((0.0, 0.0, 0.0, 0.0), unknown, (0.0, 0.0, 0.0), unknown, tuple(force.tolist()), [0.0] * 9)
    return encode(IMU, (*header(joints.stamp), *values))


def to_gravity(imu: Mapping[str, Any]) -> Array | None:
    """Returns gravity minus acceleration (3,) [m/s2] from an Imu message.

    Returns None if the message has no acceleration.
    """
    gravity = -np.array([imu["linear_acceleration"][axis] for axis in "xyz"])
    return read_only(gravity) if np.isfinite(gravity).all() else None


def skin_values(frame: SkinFrame, number: int, stamp: float) -> tuple[Any, ...]:
    """Returns the values of all fields of a SkinFrame message, beginning with the header. `stamp` [s] is the
    time in the header, and `number` the index of the patch."""
    data = np.frombuffer(np.ascontiguousarray(frame.values).tobytes(), dtype=np.uint8)
    values = (frame.stamp, frame.sequence, number, frame.patch, frame.values.dtype.str, data)
    return *header(stamp, frame.patch), *values


def skin_bytes(frame: SkinFrame, number: int) -> bytes:
    """Encodes a SkinFrame, with exact raw values. `number` is the index of the patch in the recording."""
    return encode(SKIN, skin_values(frame, number, frame.stamp))


def tick_bytes(now: float, joints: JointReading, skin: list[int]) -> bytes:
    """Encodes a Tick, the message that a recording contains for each period."""
    modes = [] if joints.modes is None else [mode_number(mode) for mode in joints.modes]
    powered = () if joints.powered is None else joints.powered
    return encode(
        TICK,
        (
            *header(now), now, joints.stamp, joints.sequence, joints.modes is not None, modes,
            joints.powered is not None, powered, skin,
        ),
    )  # fmt: skip


def truth_bytes(now: float, poses: Mapping[str, Array]) -> bytes:
    """Encodes a Truth: the pose (7,) of each body that touches the robot, by its name."""
    return encode(TRUTH, (*header(now), [*poses], np.concatenate([*poses.values()])))


def command_bytes(now: float, command: Order) -> bytes:
    """Encodes a Command of any kind.

    The command is for a generic part (by name) or for servos (by their indices).
    """
    kind = type(command).__name__
    part = getattr(command, "part", "")
    nothing = np.empty(0)
    values: tuple[Any, ...]
    match command:
        case CartesianCommand():
            values = (Mode.POSITION.value, command.target, command.point, command.nearest, ())
        case GenericCommand():
            values = (command.mode.value, command.values, "", False, ())
        case SwitchMode():
            values = (command.mode.value, nothing, "", False, ())
        case ExpectContact():
            values = (Mode.EXPECTED_CONTACT.value, np.array([command.force]), "", False, ())
        case PlatformCommand():
            values = (command.mode.value, command.values, "", False, command.servos)
        case PlatformSwitch():
            values = (command.mode.value, nothing, "", False, command.servos)
    speed = getattr(command, "speed", None)
    speeds = nothing if speed is None else np.atleast_1d(np.asarray(speed, np.float64))
    return encode(COMMAND, (*header(now), kind, part, *values, speeds))


def decision_bytes(sent: SafeCommand) -> bytes:
    """Encodes a command that the driver sent as the message `DECISION`."""
    return encode(
        DECISION,
        (
            *header(sent.stamp), sent.stamp, sent.state.value, text_of(sent.reason), sent.servos,
            [mode_number(mode) for mode in sent.modes], sent.position, sent.velocity, sent.torque,
            list(sent.stiffness), list(sent.stiffness.values()),
            list(sent.damping), list(sent.damping.values()), [clamp.text for clamp in sent.clamped],
            [refusal.text for refusal in sent.refusals],
            [number_of(sent.reason), *(int(refusal.code) for refusal in sent.refusals)],
        ),
    )  # fmt: skip


def same_decision(sent: SafeCommand, recorded: Mapping[str, Any]) -> bool:
    """Returns True if a decision equals a recorded decision bit for bit: in its numbers, modes, state and
    codes.

    Texts are not compared. Codes are not compared if the recording has no codes.
    """
    now = decode(DECISION, decision_bytes(sent))
    return all(
        np.asarray(now[field]).tobytes() == np.asarray(value).tobytes()
        for field, value in recorded.items()
        if field not in TEXTS
    )


def cloud_fields(points: NDArray[np.float32]) -> tuple[Any, ...]:
    """Returns the values of those fields of a CLOUD message that follow the header. `points` (n, 4) are x, y,
    z [m] and pressure [Pa]."""
    float32 = 7  # PointField.FLOAT32
    names = ("x", "y", "z", "pressure")
    fields = [(name, 4 * place, float32, 1) for place, name in enumerate(names)]
    data = np.frombuffer(points.tobytes(), dtype=np.uint8)
    return 1, len(points), fields, False, 16, 16 * len(points), data, True


def raw_of_cloud(fields: Mapping[str, Any], name: str = "raw") -> NDArray[np.generic]:
    """Returns the field `name` (n,) of a PointCloud2. Raises FrameError if the field is missing or its size
    is wrong."""
    field = next((field for field in fields["fields"] if field["name"] == name), None)
    if field is None or field["datatype"] not in FORMATS or fields["is_bigendian"]:
        valid = ", ".join(str(field["name"]) for field in fields["fields"]) or "none"
        raise FrameError(f"PointCloud2: no little-endian field named {name}; valid: {valid}")
    dtype = np.dtype("<" + FORMATS[field["datatype"]])
    step, data = int(fields["point_step"]), fields["data"]
    count = int(fields["width"]) * int(fields["height"])
    offset = int(field["offset"])
    if offset + dtype.itemsize > step or count * step != len(data):
        raise FrameError(
            f"PointCloud2: {count} points of {step} bytes, {name} at {offset}, {len(data)} bytes"
        )
    column = np.asarray(data).reshape(count, step)[:, offset : offset + dtype.itemsize]
    return np.frombuffer(column.tobytes(), dtype=dtype)


def to_frame(fields: Mapping[str, Any]) -> SkinFrame:
    """Returns the frame that a SkinFrame message contains. Raises RecordingError for values of an unknown
    type."""
    if not DTYPE.fullmatch(fields["dtype"]):
        raise RecordingError(f"skin values of type {fields['dtype']!r}; valid: as <f8, |u1, <U5")
    try:
        values = np.frombuffer(fields["data"].tobytes(), dtype=np.dtype(fields["dtype"]))
    except (TypeError, ValueError) as error:
        raise RecordingError(f"a frame of {fields['patch']!r} can't be read: {error}") from error
    return SkinFrame(fields["patch"], fields["stamp"], fields["sequence"], values)


def to_joints(
    state: Mapping[str, Any], tick: Mapping[str, Any], gravity: Array | None = None
) -> JointReading:
    """Returns the joint reading that a JointState and its Tick contain. Raises RecordingError for an unknown
    mode."""
    try:
        modes = tuple(None if number == UNKNOWN else MODES[number] for number in tick["modes"])
    except IndexError:
        raise RecordingError(f"modes {tick['modes'].tolist()}; valid: 0 to {len(MODES) - 1}") from None
    return JointReading(
        stamp=tick["joints_stamp"],
        sequence=tick["joints_sequence"],
        position=read_only(state["position"]),
        velocity=read_only(state["velocity"]),
        torque=read_only(state["effort"]) if len(state["effort"]) else None,
        modes=modes if tick["has_modes"] else None,
        powered=read_only(tick["powered"], np.bool_) if tick["has_powered"] else None,
        gravity=gravity,
    )


def mode_number(mode: Mode | None) -> int:
    return UNKNOWN if mode is None else MODES.index(mode)
