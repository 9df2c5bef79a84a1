"""Encodes and decodes the messages of `remote`. A message consists of an envelope with a checksum and a body
in CDR, the binary format of messages in ROS 2.

The envelope has these fields:

- `TCI4`
- the kind of the message (1 byte)
- the first 8 bytes of the SHA-256 of the robot's description
- the CRC-32 (a checksum) of the 13 bytes above and the body

If a part of the envelope is wrong, the message is rejected and the body is not decoded.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from tci.drivers.remote.protocol import (
    HIGHEST,
    MOST_COMMANDERS,
    MOST_MET,
    MOST_ORDERS,
    MOST_WORDS,
    Commander,
    Orders,
    SessionFrame,
    State,
    shown,
)
from tci.errors import FrameError, RecordingError
from tci.messages import Met, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import read_only
from tci.messages.met import ANSWERS
from tci.reasons import NO_REASON, number_of, reason_of, text_of
from tci.recording.rosmsg.cdr import MessageType, decode, encode
from tci.recording.schemas import MODES, SKIN, header, mode_number, skin_values, to_frame, to_joints
from tci.robot.description import Robot

ENVELOPE = struct.Struct("<4sc8sI")
FAMILY = b"TCI"
MAGIC = FAMILY + b"4"
LONGEST = 1 << 16
"""Size [bytes] of the longest accepted message. Assumed: this is about the size of UDP's longest datagram."""
Kind = Literal[b"S", b"F", b"O"]
"""Kinds of messages: a state (S), a skin frame (F), orders (O)."""

STATE = MessageType(
    "tci_msgs/msg/State",
    (
        ("int64", "session"), ("int64", "sequence"), ("float64", "sent"), ("float64", "now"),
        ("float64", "joints_stamp"), ("int64", "joints_sequence"),
        ("float64[]", "position"), ("float64[]", "velocity"), ("float64[]", "effort"),
        ("bool", "has_modes"), ("uint8[]", "modes"), ("bool", "has_powered"), ("bool[]", "powered"),
        ("string", "gate"), ("uint16", "code"), ("string", "reason"),
        ("int64[]", "clients"), ("string[]", "names"), ("int64[]", "acknowledged"), ("int64[]", "refused"),
        ("uint16[]", "codes"), ("string[]", "reasons"),
        ("string[]", "met"), ("float64[]", "met_force"), ("string[]", "met_joint"),
        ("float64[]", "met_behind"), ("uint8[]", "met_answer"),
    ),
    says="State of a served robot in one period: [s], [rad], [rad/s], [N m]; joints as in its description.\n"
    f"code, codes: numbers of tci.reasons.Code, {NO_REASON} for no reason.\n"
    "met: each part in contact, with its force [N], the servo that is held or an empty text, by how much\n"
    f"[rad], and the gate's answer: {', '.join(f'{n} {answer}' for n, answer in enumerate(ANSWERS))}.",
)  # fmt: skip
FRAME = MessageType(
    "tci_msgs/msg/SessionFrame", (("int64", "session"), *SKIN.fields),
    says="A SkinFrame with the session of the robot's process that sent it.",
)  # fmt: skip
ORDERS = MessageType(
    "tci_msgs/msg/Orders",
    (
        ("int64", "session"), ("float64", "seen"), ("int64", "client"), ("string", "name"),
        ("int64", "sequence"), ("uint16", "halt_code"), ("string", "halt"), ("bool", "leaving"),
        ("int64", "first"),
        ("bool[]", "switches"), ("uint8[]", "modes"), ("uint32[]", "counts"),
        ("uint32[]", "servos"), ("float64[]", "values"), ("float64[]", "speeds"),
    ),
    says="Orders of a process that commands the robot. For each order: switches, true for a change of mode;\n"
    "modes; counts, its number of servos. servos, values and speeds: of all orders in turn; 0 for a switch.",
)  # fmt: skip


def seal(robot: Robot, kind: Kind, body: bytes) -> bytes:
    """Returns a message of `kind`: the envelope, then `body`."""
    begin = MAGIC + kind + bytes.fromhex(robot.digest[:16])
    return begin + struct.pack("<I", zlib.crc32(body, zlib.crc32(begin))) + body


def unseal(robot: Robot, kind: Kind, data: bytes) -> bytes:
    """Returns the body of a message.

    Raises FrameError if the bytes are damaged, or if the message is of another kind or for another robot.
    """
    if not ENVELOPE.size <= len(data) <= LONGEST:
        raise FrameError(f"message of {len(data)} bytes; valid: {ENVELOPE.size} to {LONGEST}")
    magic, found, digest, check = ENVELOPE.unpack_from(data)
    body = data[ENVELOPE.size :]
    if magic != MAGIC and magic.startswith(FAMILY):
        raise FrameError(
            f"message of protocol {magic!r}; this is {MAGIC!r}: the TCI there has another version; "
            "valid: the same on both sides"
        )
    if magic != MAGIC or check != zlib.crc32(body, zlib.crc32(data[:13])):
        raise FrameError("no message of TCI, or a damaged one")
    if found != kind:
        raise FrameError(f"message of kind {found!r}; valid here: {kind!r}")
    if digest != bytes.fromhex(robot.digest[:16]):
        raise FrameError(
            f"message for a robot of description {digest.hex()}; this is {robot.name}, {robot.digest[:16]}"
        )
    return body


def state_bytes(robot: Robot, state: State) -> bytes:
    """Returns a State as bytes."""
    joints, members = state.joints, state.commanders
    modes = [] if joints.modes is None else [mode_number(mode) for mode in joints.modes]
    values = (
        state.session, state.sequence, state.sent, state.now, joints.stamp, joints.sequence,
        joints.position, joints.velocity, joints.torque if joints.torque is not None else (),
        joints.modes is not None, modes,
        joints.powered is not None, joints.powered if joints.powered is not None else (),
        state.gate, number_of(state.reason), text_of(state.reason)[:200],
        [m.client for m in members], [m.name for m in members], [m.acknowledged for m in members],
        [m.refused for m in members],
        [number_of(m.reason) for m in members], [text_of(m.reason) for m in members],
        [one.part for one in state.met], [one.force for one in state.met],
        [one.joint or "" for one in state.met], [one.behind for one in state.met],
        [ANSWERS.index(one.answer) for one in state.met],
    )  # fmt: skip
    return seal(robot, b"S", encode(STATE, (*header(state.now), *values)))


def to_state(robot: Robot, data: bytes) -> State:
    """Returns the State in a message. Raises FrameError if the message is invalid."""
    found = _decode(STATE, unseal(robot, b"S", data))
    columns = [found[name] for name in ("clients", "names", "acknowledged", "refused", "codes", "reasons")]
    sizes = {len(column) for column in columns}
    joints = _checked(robot, to_joints, found, found)
    if len(sizes) != 1 or max(sizes) > MOST_COMMANDERS:
        raise FrameError(f"state with {sizes} commanders; valid: at most {MOST_COMMANDERS}")
    members = tuple(
        Commander(
            int(client),
            shown(name, 64),
            int(acknowledged),
            int(refused),
            reason_of(int(code), shown(text, MOST_WORDS)),
        )
        for client, name, acknowledged, refused, code, text in zip(*columns, strict=True)
    )
    met = to_met(*(found[name] for name in ("met", "met_force", "met_joint", "met_behind", "met_answer")))
    return State(
        found["session"], found["sequence"], found["sent"], found["now"], joints,
        shown(found["gate"], 16), reason_of(found["code"], shown(found["reason"], 200)), members, met,
    )  # fmt: skip


def to_met(
    parts: Sequence[str], forces: Sequence[float], joints: Sequence[str], behind: Sequence[float],
    answers: Sequence[int],
) -> tuple[Met, ...]:  # fmt: skip
    """Contacts from columns of equal length. Raises FrameError for anything that a server doesn't send."""
    columns = parts, forces, joints, behind, answers
    if len({len(column) for column in columns}) != 1 or len(parts) > MOST_MET:
        raise FrameError(f"state with {len(parts)} parts in contact; valid: at most {MOST_MET}, each whole")
    if not np.isfinite([*forces, *behind]).all() or any(number >= len(ANSWERS) for number in answers):
        raise FrameError("state with a contact that is none")
    return tuple(
        Met(shown(part, 64), float(force), shown(joint, 64) or None, float(angle), ANSWERS[number])
        for part, force, joint, angle, number in zip(*columns, strict=True)
    )


def frame_bytes(robot: Robot, message: SessionFrame) -> bytes:
    """Returns a skin frame as bytes, with the number of the patch in the robot's description."""
    frame, names = message.frame, [patch.name for patch in robot.patches]
    seconds, nanoseconds, name, *values = skin_values(frame, names.index(frame.patch), frame.stamp)
    body = encode(FRAME, (seconds, nanoseconds, name, message.session, *values))
    return seal(robot, b"F", body)


def to_skin(robot: Robot, data: bytes) -> SessionFrame:
    """Returns the skin frame in a message. Raises FrameError if the message is invalid. Skin conditioning
    later checks the number of values.
    """
    found = _decode(FRAME, unseal(robot, b"F", data))
    frame = _checked(robot, to_frame, found)
    if frame.patch not in {patch.name for patch in robot.patches}:
        raise FrameError(f"frame of a patch {frame.patch[:40]!r}, which {robot.name} lacks")
    return SessionFrame(found["session"], frame)


def orders_bytes(robot: Robot, message: Orders) -> bytes:
    """Returns Orders as bytes."""
    servos, values, speeds = [], [], []
    for order in message.orders:
        nothing = np.zeros(len(order.servos))
        servos.append(order.servos)
        values.append(order.values if isinstance(order, PlatformCommand) else nothing)
        speeds.append(order.speed if isinstance(order, PlatformCommand) else nothing)
    fields = (
        message.session, message.seen, message.client, message.name, message.sequence,
        number_of(message.halt), text_of(message.halt), message.leaving, message.first,
        [isinstance(order, PlatformSwitch) for order in message.orders],
        [mode_number(order.mode) for order in message.orders],
        [len(order.servos) for order in message.orders],
        _joined(servos), _joined(values), _joined(speeds),
    )  # fmt: skip
    return seal(robot, b"O", encode(ORDERS, (*header(0.0), *fields)))


def to_orders(robot: Robot, data: bytes) -> Orders:
    """Returns the Orders in a message. Raises FrameError for an invalid message.

    The gate later checks the values of the orders.
    """
    found = _decode(ORDERS, unseal(robot, b"O", data))
    counts, columns = found["counts"], [found[name] for name in ("servos", "values", "speeds")]
    if len(counts) > MOST_ORDERS or {len(found[name]) for name in ("switches", "modes")} != {len(counts)}:
        raise FrameError(f"{len(counts)} orders; valid: at most {MOST_ORDERS}, each with its mode")
    if {len(column) for column in columns} != {int(counts.sum())}:
        raise FrameError(f"orders for {counts.tolist()} servos that are not there")
    if not 0 < found["first"] < HIGHEST:
        raise FrameError(f"orders from number {found['first']}; valid: from 1")
    begin, orders = 0, []
    for switch, number, count in zip(found["switches"], found["modes"], counts.tolist(), strict=True):
        if number >= len(MODES):
            raise FrameError(f"an order in mode {number}; valid: 0 to {len(MODES) - 1}")
        parts = [column[begin : begin + count] for column in columns]
        orders.append(_order(bool(switch), MODES[number], *parts))
        begin += count
    return Orders(
        found["session"], found["seen"], found["client"], shown(found["name"], 64), found["sequence"],
        reason_of(found["halt_code"], shown(found["halt"], 200)), found["leaving"], found["first"],
        tuple(orders),
    )  # fmt: skip


def _order(switch: bool, mode: Mode, servos: Any, values: Any, speeds: Any) -> PlatformOrder:
    numbers = read_only(servos, np.intp)
    if switch:
        return PlatformSwitch(numbers, mode)
    return PlatformCommand(mode, numbers, read_only(values), read_only(speeds))


def _joined(columns: Sequence[Any]) -> Any:
    return np.concatenate(columns) if columns else ()


def _decode(kind: MessageType, body: bytes) -> dict[str, Any]:
    try:
        return decode(kind, body)
    except RecordingError as error:
        raise FrameError(str(error)) from None


def _checked(robot: Robot, make: Any, *found: Any) -> Any:
    try:
        return make(*found)
    except RecordingError as error:
        raise FrameError(f"{robot.name}: {error}") from None
