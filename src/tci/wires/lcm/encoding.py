"""Conversion between the messages of `tci.drivers.remote` and the LCM messages in `tci_lcm/tci.lcm`.

The program lcm-gen generates code for these LCM messages in eight languages. The last field of each message,
`check`, is the CRC-32 of all bytes before this field.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np

from tci.drivers.remote.encoding import to_met
from tci.drivers.remote.protocol import (
    HIGHEST,
    MOST_COMMANDERS,
    MOST_ORDERS,
    MOST_WORDS,
    Commander,
    Orders,
    SessionFrame,
    State,
    shown,
)
from tci.errors import FrameError, RecordingError
from tci.exports.facts import query
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import read_only
from tci.messages.met import ANSWERS
from tci.reasons import number_of, reason_of, text_of
from tci.recording.schemas import MODES, UNKNOWN, mode_number, to_frame
from tci.robot.description import Robot
from tci.wires.lcm.tci_lcm import commander_t, facts_t, met_t, order_t, orders_t, skin_t, state_t


def robot_number(robot: Robot) -> int:
    """Returns the first 8 bytes of the SHA-256 hash of the robot's description, as a signed integer."""
    return int.from_bytes(bytes.fromhex(robot.digest[:16]), "big", signed=True)


def facts_bytes(robot: Robot) -> bytes:
    """Encodes the facts about the robot as the bytes of a facts_t."""
    json = zlib.compress(query(robot).model_dump_json().encode())
    return _sealed(facts_t, robot=robot_number(robot), size=len(json), json=json)


def state_bytes(robot: Robot, state: State) -> bytes:
    """Encodes a state as the bytes of a state_t."""
    joints, effort = state.joints, state.joints.torque
    modes = () if joints.modes is None else joints.modes
    powered = () if joints.powered is None else joints.powered.tolist()
    return _sealed(
        state_t, robot=robot_number(robot), session=state.session, sequence=state.sequence, sent=state.sent,
        now=state.now, joints_stamp=joints.stamp, joints_sequence=joints.sequence,
        num_joints=len(joints.position), position=joints.position.tolist(),
        velocity=joints.velocity.tolist(),
        num_effort=0 if effort is None else len(effort), effort=() if effort is None else effort.tolist(),
        num_modes=len(modes), modes=bytes(mode_number(mode) for mode in modes),
        num_powered=len(powered), powered=powered, gate=state.gate,
        code=number_of(state.reason), reason=text_of(state.reason)[:200],
        num_commanders=len(state.commanders),
        commanders=[
            _filled(
                commander_t, client=member.client, name=member.name, acknowledged=member.acknowledged,
                refused=member.refused, code=number_of(member.reason), reason=text_of(member.reason),
            )
            for member in state.commanders
        ],
        num_met=len(state.met),
        met=[
            _filled(
                met_t, part=one.part, force=one.force, joint=one.joint or "", behind=one.behind,
                answer=ANSWERS.index(one.answer),
            )
            for one in state.met
        ],
    )  # fmt: skip


def to_state(robot: Robot, data: bytes) -> State:
    """Decodes a state_t. Raises FrameError if the state_t is invalid or belongs to another robot."""
    found = _opened(robot, state_t, data)
    if found.num_joints != len(robot.servos) or found.num_commanders > MOST_COMMANDERS:
        raise FrameError(f"{found.num_joints} joints, {found.num_commanders} commanders for {robot.name}")
    joints = JointReading(
        found.joints_stamp, found.joints_sequence, read_only(found.position), read_only(found.velocity),
        read_only(found.effort) if found.num_effort else None,
        tuple(_mode(number) for number in found.modes) if found.num_modes else None,
        read_only(found.powered, np.bool_) if found.num_powered else None,
    )  # fmt: skip
    members = tuple(
        Commander(
            one.client,
            shown(one.name, 64),
            one.acknowledged,
            one.refused,
            reason_of(one.code, shown(one.reason, MOST_WORDS)),
        )
        for one in found.commanders
    )
    return State(
        found.session, found.sequence, found.sent, found.now, joints, shown(found.gate, 16),
        reason_of(found.code, shown(found.reason, 200)), members,
        to_met(*([getattr(one, name) for one in found.met] for name in met_t.__slots__)),
    )  # fmt: skip


def frame_bytes(robot: Robot, message: SessionFrame) -> bytes:
    """Encodes a skin frame as the bytes of a skin_t."""
    frame = message.frame
    data = np.ascontiguousarray(frame.values).tobytes()
    return _sealed(
        skin_t, robot=robot_number(robot), session=message.session, patch=frame.patch, stamp=frame.stamp,
        sequence=frame.sequence, dtype=frame.values.dtype.str, size=len(data), data=data,
    )  # fmt: skip


def to_skin(robot: Robot, data: bytes) -> SessionFrame:
    """Decodes a skin_t. Raises FrameError if the skin_t is invalid or belongs to another robot. Skin
    conditioning later checks if the frame fits the patch."""
    found = _opened(robot, skin_t, data)
    if found.patch not in {patch.name for patch in robot.patches}:
        raise FrameError(f"frame of a patch {found.patch[:40]!r}, which {robot.name} lacks")
    raw = np.frombuffer(found.data, dtype=np.uint8)
    try:
        frame = to_frame(
            {"patch": found.patch, "stamp": found.stamp, "sequence": found.sequence, "dtype": found.dtype,
             "data": raw}
        )  # fmt: skip
    except RecordingError as error:
        raise FrameError(str(error)) from None
    return SessionFrame(found.session, frame)


def orders_bytes(robot: Robot, message: Orders) -> bytes:
    """Encodes orders as the bytes of an orders_t."""
    return _sealed(
        orders_t, robot=robot_number(robot), session=message.session, seen=message.seen,
        client=message.client, name=message.name, sequence=message.sequence,
        halt_code=number_of(message.halt), halt=text_of(message.halt),
        leaving=message.leaving, first=message.first, num_orders=len(message.orders),
        orders=[_order(order) for order in message.orders],
    )  # fmt: skip


def to_orders(robot: Robot, data: bytes) -> Orders:
    """Decodes an orders_t. Raises FrameError if the orders_t is invalid or belongs to another robot. The gate
    later checks if the orders are allowed."""
    found = _opened(robot, orders_t, data)
    if found.num_orders > MOST_ORDERS or not 0 < found.first < HIGHEST:
        raise FrameError(f"{found.num_orders} orders from number {found.first}; valid: {MOST_ORDERS}, from 1")
    orders = tuple(_to_order(order) for order in found.orders)
    return Orders(
        found.session, found.seen, found.client, shown(found.name, 64), found.sequence,
        reason_of(found.halt_code, shown(found.halt, 200)), found.leaving, found.first, orders,
    )  # fmt: skip


def _order(order: PlatformOrder) -> Any:
    many = len(order.servos)
    command = isinstance(order, PlatformCommand)
    return _filled(
        order_t, switches=not command, mode=mode_number(order.mode), num_servos=many,
        servos=order.servos.tolist(),
        values=order.values.tolist() if isinstance(order, PlatformCommand) else [0.0] * many,
        speeds=order.speed.tolist() if isinstance(order, PlatformCommand) else [0.0] * many,
    )  # fmt: skip


def _to_order(order: Any) -> PlatformOrder:
    servos, mode = read_only(order.servos, np.intp), _mode(order.mode)
    if mode is None:
        raise FrameError(f"an order in mode {order.mode}; valid: 0 to {len(MODES) - 1}")
    if order.switches:
        return PlatformSwitch(servos, mode)
    return PlatformCommand(mode, servos, read_only(order.values), read_only(order.speeds))


def _mode(number: int) -> Mode | None:
    if number == UNKNOWN:
        return None
    if number >= len(MODES):
        raise FrameError(f"mode {number}; valid: 0 to {len(MODES) - 1}")
    return MODES[number]


def _filled(kind: Any, **fields: Any) -> Any:
    message = kind()
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def _sealed(kind: Any, **fields: Any) -> bytes:
    body: bytes = _filled(kind, **fields).encode()[:-4]
    return body + struct.pack(">I", zlib.crc32(body))


def _opened(robot: Robot, kind: Any, data: bytes) -> Any:
    if len(data) < 16 or struct.unpack(">I", data[-4:])[0] != zlib.crc32(data[:-4]):
        raise FrameError("no message of TCI, or a damaged one")
    if data[:8] != kind._get_packed_fingerprint():
        raise FrameError(f"no {kind.__name__} of this version of TCI; valid: the same version on both sides")
    try:
        found = kind.decode(data)
    except (ValueError, struct.error, MemoryError, OverflowError) as error:
        raise FrameError(f"no {kind.__name__}: {error}") from None
    if found.robot != robot_number(robot):
        raise FrameError(
            f"message for a robot of description {found.robot % (1 << 64):016x}; "
            f"this is {robot.name}, {robot.digest[:16]}"
        )
    return found
