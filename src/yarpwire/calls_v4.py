"""Calls to a served control board by YARP 4.0's names: `getEncoderAllRPC`, `positionMoveOneRPC 0 12.5`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from yarpwire.board import Stream
from yarpwire.board_service import BoardService
from yarpwire.errors import CallError, YarpError
from yarpwire.values import Array, Loose, Vocab

OK, FAIL = Vocab("ok"), Vocab("fail")
METHOD_FAILED = Vocab("err5")
PROTOCOL = b"\0\1\0\0\1\0\0\0" + b"\0\0\4\0\0\0\0\0"
"""Answer of 4.0's control boards to `getRemoteProtocolVersion`: no valid Bottle, but clients expect it."""
INTERFACES = (
    "iAxisInfo", "iControlLimits", "iControlMode", "iEncodersTimed", "iImpedanceControl", "iInteractionMode",
    "iPositionControl", "iPositionDirect", "iTorqueControl", "iVelocityControl",
)  # fmt: skip
Answers = Callable[..., Sequence[Any] | None]


def answer_v4(board: BoardService, items: Sequence[Any]) -> list[Any] | bytes:
    """Returns 4.0's answer to a call: `[ok]`, `([ok]) data`, `[err5]` for a failure, `[fail]` for an unknown
    call."""
    method = items[0] if items and isinstance(items[0], str) else ""
    if method == "getRemoteProtocolVersion":
        return PROTOCOL
    if method not in CALLS:
        return [FAIL]
    try:
        with board.awaited():
            found = CALLS[method](board, *items[1:])
    except (YarpError, ArithmeticError, LookupError, TypeError, ValueError):
        return Loose([METHOD_FAILED])
    return Loose([OK]) if found is None else [Loose([OK]), *found]


def _axis(values: Callable[[BoardService], Array | None]) -> tuple[Answers, Answers]:
    """Returns the answers with the value of one joint, and with those of all."""

    def one(board: BoardService, joint: int) -> list[Any]:
        return [float(_known(values(board))[board.joints([joint])[0]])]

    def every(board: BoardService) -> list[Any]:
        return [_known(values(board)).tolist()]

    return one, every


def _known(values: Array | None) -> Array:
    if values is None:
        raise CallError("the robot does not measure it")
    return values


def _words(board: BoardService, joints: Sequence[int] | None) -> list[int]:
    interactions = board.state.interactions or (0,) * board.count
    return [int(interactions[joint]) for joint in board.joints(joints)]


def _interfaces(board: BoardService) -> list[Any]:
    return [[[name, OK] for name in INTERFACES]]


def _truth(value: bool) -> list[Any]:
    return [OK if value else FAIL]


def _zeros(board: BoardService) -> Array:
    return np.zeros(board.count)


POSITION, VELOCITY = _axis(lambda b: b.state.position), _axis(lambda b: b.state.velocity)
ACCELERATION = _axis(_zeros)
SPEEDS, ACCELERATIONS = _axis(lambda b: b.speeds), _axis(lambda b: b.accelerations)

CALLS: dict[str, Answers] = {
    "getAxesRPC": lambda b: [b.count],
    "getAxisNameRPC": lambda b, j: [b.name(j)],
    "getJointTypeRPC": lambda b, j: [int(Vocab("atrv"))],
    "getDeviceInterfacesRPC": _interfaces,
    "getPosLimitsRPC": lambda b, j: [*b.limits(j)],
    "getVelLimitsRPC": lambda b, j: [0.0, b.speed_limit(j)],
    "getTorqueRangeOneRPC": lambda b, j: [-b.torque_limit(j), b.torque_limit(j)],
    "getEncoderOneRPC": POSITION[0],
    "getEncoderAllRPC": POSITION[1],
    "getEncoderTimedAllRPC": lambda b: [b.state.position.tolist(), [b.stamp] * b.count],
    "getEncoderSpeedOneRPC": VELOCITY[0],
    "getEncoderSpeedAllRPC": VELOCITY[1],
    "getEncoderAccelerationOneRPC": ACCELERATION[0],
    "getEncoderAccelerationAllRPC": ACCELERATION[1],
    "getTrajSpeedOneRPC": SPEEDS[0],
    "getTrajSpeedsAllRPC": SPEEDS[1],
    "getTrajAccelerationOneRPC": ACCELERATIONS[0],
    "getTrajAccelerationAllRPC": ACCELERATIONS[1],
    "getAvailableControlModesRPC": lambda b, j: [[int(word) for word in b.available(j)]],
    "setControlModeOneRPC": lambda b, j, mode: b.set_modes([j], [mode]),
    "setControlModeGroupRPC": lambda b, js, modes: b.set_modes(js, modes),
    "setControlModeAllRPC": lambda b, modes: b.set_modes(None, modes),
    "getInteractionModeOneRPC": lambda b, j: [*_words(b, [j])],
    "getInteractionModesGroupRPC": lambda b, js: [_words(b, js)],
    "getInteractionModesAllRPC": lambda b: [_words(b, None)],
    "setInteractionModeOneRPC": lambda b, j, mode: b.set_interactions([j], [mode]),
    "setInteractionModesGroupRPC": lambda b, js, modes: b.set_interactions(js, modes),
    "setInteractionModesAllRPC": lambda b, modes: b.set_interactions(None, modes),
    "getImpedanceRPC": lambda b, j: b.impedance(j).tolist(),
    "setImpedanceRPC": lambda b, j, k, d: b.set_impedance(j, k, d),
    "getCurrentImpedanceLimitRPC": lambda b, j: [x for most in b.impedance_limits() for x in (0.0, most)],
    "positionMoveOneRPC": lambda b, j, value: b.move([j], [value]),
    "positionMoveGroupRPC": lambda b, js, values: b.move(js, values),
    "positionMoveAllRPC": lambda b, values: b.move(None, values),
    "relativeMoveOneRPC": lambda b, j, value: b.move([j], [value], relative=True),
    "relativeMoveGroupRPC": lambda b, js, values: b.move(js, values, relative=True),
    "relativeMoveAllRPC": lambda b, values: b.move(None, values, relative=True),
    "setTrajSpeedOneRPC": lambda b, j, value: b.set_speeds([j], [value]),
    "setTrajSpeedGroupRPC": lambda b, js, values: b.set_speeds(js, values),
    "setTrajSpeedAllRPC": lambda b, values: b.set_speeds(None, values),
    "setTrajAccelerationOneRPC": lambda b, j, value: b.set_accelerations([j], [value]),
    "setTrajAccelerationsAllRPC": lambda b, values: b.set_accelerations(None, values),
    "stopOneRPC": lambda b, j: b.stop([j]),
    "stopGroupRPC": lambda b, js: b.stop(js),
    "stopAllRPC": lambda b: b.stop(None),
    "checkMotionDoneOneRPC": lambda b, j: _truth(b.is_done([j])),
    "checkMotionDoneGroupRPC": lambda b, js: _truth(b.is_done(js)),
    "checkMotionDoneAllRPC": lambda b: _truth(b.is_done(None)),
    "setRefPositionOneRPC": lambda b, j, value: b.stream(Stream.POSITION, [j], [value]),
    "setRefPositionGroupRPC": lambda b, js, values: b.stream(Stream.POSITION, js, values),
    "setRefPositionAllRPC": lambda b, values: b.stream(Stream.POSITION, None, values),
    "velocityMoveOneRPC": lambda b, j, value: b.stream(Stream.VELOCITY, [j], [value]),
    "velocityMoveGroupRPC": lambda b, js, values: b.stream(Stream.VELOCITY, js, values),
    "velocityMoveAllRPC": lambda b, values: b.stream(Stream.VELOCITY, None, values),
    "setRefTorqueOneRPC": lambda b, j, value: b.stream(Stream.TORQUE, [j], [value]),
    "setRefTorqueGroupRPC": lambda b, js, values: b.stream(Stream.TORQUE, js, values),
    "setRefTorqueAllRPC": lambda b, values: b.stream(Stream.TORQUE, None, values),
}
