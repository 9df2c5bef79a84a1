"""Calls to a served control board in the form of YARP 4.0, such as `positionMoveOneRPC 0 12.5`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from yarpwire.board import Stream
from yarpwire.board_service import BoardService
from yarpwire.errors import CallError, YarpError
from yarpwire.returns_v4 import FAIL, METHOD_FAILED, NOT_IMPLEMENTED, OK, RETURNS, explain, refusal, reply
from yarpwire.values import Array, Vocab

PROTOCOL = b"\0\1\0\0\1\0\0\0" + b"\0\0\4\0\0\0\0\0"
"""Answer of YARP 4.0's control boards to `getRemoteProtocolVersion`. The answer is not a valid Bottle, but
clients expect these bytes."""
INTERFACES = (
    "iAxisInfo", "iControlLimits", "iControlMode", "iEncodersTimed", "iImpedanceControl", "iInteractionMode",
    "iPositionControl", "iPositionDirect", "iTorqueControl", "iVelocityControl", "iVelocityDirect",
)  # fmt: skip
Answers = Callable[..., Sequence[Any] | None]


def answer_v4(board: BoardService, items: Sequence[Any]) -> list[Any] | bytes:
    """Returns the answer to a call in the form of YARP 4.0.

    The answer to an executed call is `[ok]`, or, if the method returns data, a list with `[ok]` followed by
    the data. The answer to a refused call has the same fields, with an error instead of `[ok]`. The answer is
    `[fail]` if YARP 4.0 does not have the method.
    """
    first = items[0] if items else ""
    method = first.word if isinstance(first, Vocab) else str(first)
    if method == "getRemoteProtocolVersion":
        return PROTOCOL
    if method == "help":
        return explain(str(items[1]) if len(items) > 1 else "")
    if method not in RETURNS:
        return [FAIL]
    if method not in CALLS:
        return refusal(method, NOT_IMPLEMENTED)
    try:
        with board.awaited():
            found = CALLS[method](board, *items[1:])
    except (YarpError, ArithmeticError, LookupError, TypeError, ValueError):
        return refusal(method, METHOD_FAILED)
    return reply(method, found)


def _axis(values: Callable[[BoardService], Array | None]) -> tuple[Answers, Answers, Answers]:
    """Returns three functions that answer calls: with the value of one joint, of some joints, and of all
    joints. `values` returns the values of all joints of a board."""

    def one(board: BoardService, joint: int) -> list[Any]:
        return [float(_known(values(board))[board.joints([joint])[0]])]

    def some(board: BoardService, joints: Sequence[int]) -> list[Any]:
        return [_known(values(board))[board.joints(joints)].tolist()]

    def every(board: BoardService) -> list[Any]:
        return [_known(values(board)).tolist()]

    return one, some, every


def _known(values: Array | None) -> Array:
    if values is None:
        raise CallError("the robot does not measure it")
    return values


def _words(board: BoardService, joints: Sequence[int] | None) -> list[int]:
    interactions = board.state.interactions or (0,) * board.count
    return [int(interactions[joint]) for joint in board.joints(joints)]


def _interfaces(board: BoardService) -> list[Any]:
    return [[[name, OK] for name in INTERFACES]]


def _torque_ranges(board: BoardService) -> list[Any]:
    most = [board.torque_limit(joint) for joint in range(board.count)]
    return [[-torque for torque in most], most]


def _truth(value: bool) -> list[Any]:
    return [OK if value else FAIL]


POSITION, VELOCITY = _axis(lambda b: b.state.position), _axis(lambda b: b.state.velocity)
ACCELERATION = _axis(lambda b: np.zeros(b.count))
SPEEDS, ACCELERATIONS = _axis(lambda b: b.speeds), _axis(lambda b: b.accelerations)
TARGETS = _axis(lambda b: b.set_points[Stream.POSITION])
TARGET_VELOCITIES = _axis(lambda b: b.set_points[Stream.VELOCITY])
TARGET_TORQUES = _axis(lambda b: b.set_points[Stream.TORQUE])

CALLS: dict[str, Answers] = {
    "getAxesRPC": lambda b: [b.count],
    "getAxisNameRPC": lambda b, j: [b.name(j)],
    "getJointTypeRPC": lambda b, j: [int(Vocab("atrv")) for _ in b.joints([j])],
    "getDeviceInterfacesRPC": _interfaces,
    "getPosLimitsRPC": lambda b, j: [*b.limits(j)],
    "getVelLimitsRPC": lambda b, j: [0.0, b.speed_limit(j)],
    "getTorqueRangeAllRPC": _torque_ranges,
    "getTorqueRangeOneRPC": lambda b, j: [-b.torque_limit(j), b.torque_limit(j)],
    "getEncoderOneRPC": POSITION[0],
    "getEncoderAllRPC": POSITION[2],
    "getEncoderTimedOneRPC": lambda b, j: [*(POSITION[0](b, j) or ()), b.stamp],
    "getEncoderTimedAllRPC": lambda b: [b.state.position.tolist(), [b.stamp] * b.count],
    "getEncoderSpeedOneRPC": VELOCITY[0],
    "getEncoderSpeedAllRPC": VELOCITY[2],
    "getEncoderAccelerationOneRPC": ACCELERATION[0],
    "getEncoderAccelerationAllRPC": ACCELERATION[2],
    "getTrajSpeedOneRPC": SPEEDS[0],
    "getTrajSpeedsGroupRPC": SPEEDS[1],
    "getTrajSpeedsAllRPC": SPEEDS[2],
    "getTrajAccelerationOneRPC": ACCELERATIONS[0],
    "getTrajAccelerationGroupRPC": ACCELERATIONS[1],
    "getTrajAccelerationAllRPC": ACCELERATIONS[2],
    "getTargetPositionOneRPC": TARGETS[0],
    "getTargetPositionGroupRPC": TARGETS[1],
    "getTargetPositionAllRPC": TARGETS[2],
    "getRefPositionOneRPC": TARGETS[0],
    "getRefPositionGroupRPC": TARGETS[1],
    "getRefPositionAllRPC": TARGETS[2],
    "getTargetVelocityOneRPC": TARGET_VELOCITIES[0],
    "getTargetVelocityGroupRPC": TARGET_VELOCITIES[1],
    "getTargetVelocityAllRPC": TARGET_VELOCITIES[2],
    "getRefVelocityOneRPC": TARGET_VELOCITIES[0],
    "getRefVelocityGroupRPC": TARGET_VELOCITIES[1],
    "getRefVelocityAllRPC": TARGET_VELOCITIES[2],
    "getRefTorqueOneRPC": TARGET_TORQUES[0],
    "getRefTorqueGroupRPC": TARGET_TORQUES[1],
    "getRefTorqueAllRPC": TARGET_TORQUES[2],
    "isCalibratorDevicePresentRPC": lambda b: [FAIL],
    "isJointBrakedRPC": lambda b, j: _truth(False) if b.joints([j]) else None,
    "getAutoBrakeEnabledRPC": lambda b, j: _truth(False) if b.joints([j]) else None,
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
    "getImpedanceRPC": lambda b, j: [float(value) for value in b.impedance(j)],
    "setImpedanceRPC": lambda b, j, k, d: b.set_impedance(j, k, d),
    "getCurrentImpedanceLimitRPC": lambda b, j: [x for most in b.impedance_limits(j) for x in (0.0, most)],
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
    "setTrajAccelerationsGroupRPC": lambda b, js, values: b.set_accelerations(js, values),
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
    "setRefVelocityOneRPC": lambda b, j, value: b.stream(Stream.VELOCITY, [j], [value]),
    "setRefVelocityGroupRPC": lambda b, js, values: b.stream(Stream.VELOCITY, js, values),
    "setRefVelocityAllRPC": lambda b, values: b.stream(Stream.VELOCITY, None, values),
    "setRefTorqueOneRPC": lambda b, j, value: b.stream(Stream.TORQUE, [j], [value]),
    "setRefTorqueGroupRPC": lambda b, js, values: b.stream(Stream.TORQUE, js, values),
    "setRefTorqueAllRPC": lambda b, values: b.stream(Stream.TORQUE, None, values),
}
