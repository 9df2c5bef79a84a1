"""Unitree's message types for DDS. `wire` encodes and decodes the bytes of their samples.

Members that the vendor declares as `uint8` are declared as octets in this module. cyclonedds 11 would
announce `uint8` with the newer type TK_UINT8. Cyclone 0.10, which runs in the robot, does not connect to a
topic with TK_UINT8.
"""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, byte, float32, int16, int32, int64, sequence, uint32

from tci.shared.dds_types import carry_raw


def _struct(package: str, name: str, **fields: Any) -> type[IdlStruct]:
    made = make_idl_struct(name, f"{package}.msg.dds_.{name}", fields)
    kept: type[IdlStruct] = autoid("sequential")(final(made))
    return kept


def _many(item: Any, count: int) -> Any:
    return array[item, count]  # type: ignore[misc] # cyclonedds' own form


def _any(item: Any) -> Any:
    return sequence[item]  # type: ignore[misc] # cyclonedds' own form


def _hg(name: str, **fields: Any) -> type[IdlStruct]:
    return _struct("unitree_hg", name, **fields)


def _api(name: str, **fields: Any) -> type[IdlStruct]:
    return _struct("unitree_api", name, **fields)


_MOTOR_COMMAND: Any = _hg(
    "MotorCmd_", mode=byte, q=float32, dq=float32, tau=float32, kp=float32, kd=float32, reserve=uint32
)
_MOTOR_STATE: Any = _hg(
    "MotorState_", mode=byte, q=float32, dq=float32, ddq=float32, tau_est=float32,
    temperature=_many(int16, 2), vol=float32, sensor=_many(uint32, 2), motorstate=uint32,
    reserve=_many(uint32, 4),
)  # fmt: skip
_IMU: Any = _hg(
    "IMUState_", quaternion=_many(float32, 4), gyroscope=_many(float32, 3), accelerometer=_many(float32, 3),
    rpy=_many(float32, 3), temperature=int16,
)  # fmt: skip
_PRESS: Any = _hg(
    "PressSensorState_", pressure=_many(float32, 12), temperature=_many(float32, 12), lost=uint32,
    reserve=uint32,
)  # fmt: skip
COMMAND = carry_raw(_hg(
    "LowCmd_", mode_pr=byte, mode_machine=byte, motor_cmd=_many(_MOTOR_COMMAND, 35),
    reserve=_many(uint32, 4), crc=uint32,
))  # fmt: skip
STATE = carry_raw(_hg(
    "LowState_", version=_many(uint32, 2), mode_pr=byte, mode_machine=byte, tick=uint32, imu_state=_IMU,
    motor_state=_many(_MOTOR_STATE, 35), wireless_remote=_many(byte, 40), reserve=_many(uint32, 4),
    crc=uint32,
))  # fmt: skip
HAND_COMMAND = carry_raw(_hg("HandCmd_", motor_cmd=_any(_MOTOR_COMMAND), reserve=_many(uint32, 4)))
HAND_STATE = carry_raw(_hg(
    "HandState_", motor_state=_any(_MOTOR_STATE), press_sensor_state=_any(_PRESS), imu_state=_IMU,
    power_v=float32, power_a=float32, system_v=float32, device_v=float32, error=_many(uint32, 2),
    reserve=_many(uint32, 2),
))  # fmt: skip
IDENTITY: Any = _api("RequestIdentity_", id=int64, api_id=int64)
LEASE: Any = _api("RequestLease_", id=int64)
POLICY: Any = _api("RequestPolicy_", priority=int32, noreply=bool)
REQUEST_HEADER: Any = _api("RequestHeader_", identity=IDENTITY, lease=LEASE, policy=POLICY)
REQUEST: Any = _api("Request_", header=REQUEST_HEADER, parameter=str, binary=_any(byte))
STATUS: Any = _api("ResponseStatus_", code=int32)
RESPONSE_HEADER: Any = _api("ResponseHeader_", identity=IDENTITY, status=STATUS)
RESPONSE: Any = _api("Response_", header=RESPONSE_HEADER, data=str, binary=_any(byte))
