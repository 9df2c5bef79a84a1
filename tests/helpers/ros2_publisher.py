"""A plain publisher of hands and patches on ROS 2 topics, written with cyclonedds' own encoder and nothing of
TCI: types and names as ROS 2 gives them. The message types of makers are written down from their texts.

python ros2_publisher.py NAMESPACE reliable|best-effort
"""

import json
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import byte, float32, float64, int32, sequence, uint16, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


def name(package: str, last: str) -> str:
    return f"{package}::msg::dds_::{last}_"


@dataclass
class Time(IdlStruct, typename=name("builtin_interfaces", "Time")):
    sec_: int32
    nanosec_: uint32


@dataclass
class Header(IdlStruct, typename=name("std_msgs", "Header")):
    stamp_: Time
    frame_id_: str


@dataclass
class Dimension(IdlStruct, typename=name("std_msgs", "MultiArrayDimension")):
    label_: str
    size_: uint32
    stride_: uint32


@dataclass
class Layout(IdlStruct, typename=name("std_msgs", "MultiArrayLayout")):
    dim_: sequence[Dimension]
    data_offset_: uint32


@dataclass
class Float32MultiArray(IdlStruct, typename=name("std_msgs", "Float32MultiArray")):
    layout_: Layout
    data_: sequence[float32]


@dataclass
class UInt16MultiArray(IdlStruct, typename=name("std_msgs", "UInt16MultiArray")):
    layout_: Layout
    data_: sequence[uint16]


@dataclass
class UInt8MultiArray(IdlStruct, typename=name("std_msgs", "UInt8MultiArray")):
    layout_: Layout
    data_: sequence[byte]


@dataclass
class String(IdlStruct, typename=name("std_msgs", "String")):
    data_: str


@dataclass
class PointField(IdlStruct, typename=name("sensor_msgs", "PointField")):
    name_: str
    offset_: uint32
    datatype_: byte
    count_: uint32


@dataclass
class PointCloud2(IdlStruct, typename=name("sensor_msgs", "PointCloud2")):
    header_: Header
    height_: uint32
    width_: uint32
    fields_: sequence[PointField]
    is_bigendian_: bool
    point_step_: uint32
    row_step_: uint32
    data_: sequence[byte]
    is_dense_: bool


@dataclass
class Taxel(IdlStruct, typename=name("xela_server_ros2", "Taxel")):
    x_: uint16
    y_: uint16
    z_: uint16


@dataclass
class Forces(IdlStruct, typename=name("xela_server_ros2", "Forces")):
    x_: float32
    y_: float32
    z_: float32


@dataclass
class SensorFull(IdlStruct, typename=name("xela_server_ros2", "SensorFull")):
    message_: uint32
    time_: float64
    model_: str
    sensor_pos_: byte
    taxels_: sequence[Taxel]
    forces_: sequence[Forces]


@dataclass
class SensStream(IdlStruct, typename=name("xela_server_ros2", "SensStream")):
    sensors_: sequence[SensorFull]


@dataclass
class InterfaceValue(IdlStruct, typename=name("control_msgs", "InterfaceValue")):
    interface_names_: sequence[str]
    values_: sequence[float64]


@dataclass
class DynamicJointState(IdlStruct, typename=name("control_msgs", "DynamicJointState")):
    header_: Header
    joint_names_: sequence[str]
    interface_values_: sequence[InterfaceValue]


@dataclass
class HandTouchParam(IdlStruct, typename=name("booster_interface", "HandTouchParam")):
    finger_one_: sequence[byte]
    finger_palm_: sequence[byte]


@dataclass
class HandTouchData(IdlStruct, typename=name("booster_interface", "HandTouchData")):
    touch_data_: HandTouchParam
    hand_index_: int32
    hand_type_: int32


@dataclass
class TactileData(IdlStruct, typename=name("omnihand_2025_node_msgs", "TactileData")):
    tactiles_: sequence[byte]


@dataclass
class TactileSensor(IdlStruct, typename=name("omnihand_2025_node_msgs", "TactileSensor")):
    header_: Header
    tactile_datas_: sequence[TactileData]


@dataclass
class Empty(IdlStruct, typename=name("std_msgs", "Empty")):
    structure_needs_at_least_one_member_: byte


@dataclass
class MSTBlock(IdlStruct, typename=name("sr_robot_msgs", "UBI0")):
    distal_: sequence[uint16]


@dataclass
class UBI0All(IdlStruct, typename=name("sr_robot_msgs", "UBI0All")):
    header_: Header
    tactiles_: sequence[MSTBlock]


def numbers(count: int, k: int) -> list[int]:
    """What the pads say in turn `k`: numbers from 0 to 199 that differ from taxel to taxel."""
    return [int(one) for one in (np.arange(count) * 7 + k) % 200]


def messages(k: int, stamp: float) -> dict[str, Any]:
    """One message for each topic."""
    head = Header(Time(int(stamp), int(stamp % 1.0 * 1e9)), "pad")
    layout = Layout([], 0)
    values = numbers(16, k)
    floats = [float(one) for one in values]
    floats[3], floats[5] = -1.0, float("nan")
    cloud = np.zeros(16, [("place", "<f4", 3), ("val", "u1"), ("rest", "u1", 3)])
    cloud["val"] = values
    fields = [PointField(one, 4 * i, 7, 1) for i, one in enumerate("xyz")] + [PointField("val", 12, 2, 1)]
    other = SensorFull(k, stamp, "uSPa44", 1, [Taxel(1, 2, 3)] * 16, [])
    sensor = SensorFull(k, stamp, "uSPa44", 2, [Taxel(9, 9, one) for one in values], [])
    joints = ["finger_l_sensor1", "finger_l_joint1"]
    states = ["Present Temperature", *(f"Present Pressure {one}" for one in range(1, 17))]
    held = [InterfaceValue(states, [30.0, *map(float, values)]), InterfaceValue(["position"], [0.5])]
    octets = np.array(values, ">u2").tobytes()
    hand = {
        "stamp": {"sec": 0},
        "thumb_matrix": np.reshape(values, (4, 4)).tolist(),
        "index_matrix": [[-1] * 4] * 4,
    }
    return {
        "floats": Float32MultiArray(layout, floats),
        "words": UInt16MultiArray(layout, values),
        "octets": UInt8MultiArray(layout, values),
        "cloud": PointCloud2(head, 1, 16, fields, False, 16, 256, list(cloud.view("u1").tobytes()), True),
        "xela": SensStream([other, sensor]),
        "robotis": DynamicJointState(head, joints, held),
        "json": String(json.dumps(hand)),
        "booster": HandTouchData(HandTouchParam(list(octets), [0] * 8), 0, 2),
        "omnihand": TactileSensor(head, [TactileData([1] * 4), TactileData(values)]),
        "shadow": UBI0All(head, [MSTBlock([5] * 12), MSTBlock(values)]),
    }  # fmt: skip


def main(namespace: str, how: str) -> None:
    participant = DomainParticipant(int(sys.argv[3]) if len(sys.argv) > 3 else None)
    policy = Policy.Reliability.Reliable(0) if how == "reliable" else Policy.Reliability.BestEffort
    qos = Qos(policy, Policy.Durability.Volatile, Policy.DataRepresentation(use_cdrv0_representation=True))
    writers = {
        topic: DataWriter(participant, Topic(participant, f"rt{namespace}/{topic}", type(message)), qos=qos)
        for topic, message in messages(0, 0.0).items()
    }
    asked = DataReader(participant, Topic(participant, f"rt{namespace}/tactile_cmd", Empty), qos=qos)
    for k in range(100_000):
        said = messages(k, time.time())
        if not asked.take(10):  # this hand says nothing unasked
            del said["omnihand"]
        for topic, message in said.items():
            writers[topic].write(message)
        time.sleep(0.02)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
