"""Patches and hands on topics of ROS 2, from a publisher that shares no code with TCI."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from helpers import HELPERS
from helpers.dds_domains import DOMAINS, LOOPBACK
from helpers.read_topics import judge_values
from helpers.ros_robots import anywhere
from tci.drivers.registry import source_at
from tci.drivers.source_reader import SourceReader
from tci.errors import DriverError, FrameError
from tci.shared.ros_types import fields_of, message_type
from tci.sources.array.path import FieldPath

MADE = {
    "xela_server_ros2/msg/Taxel": "uint16 x\nuint16 y\nuint16 z",
    "xela_server_ros2/msg/Forces": "float32 x\nfloat32 y\nfloat32 z",
    "xela_server_ros2/msg/SensorFull": (
        "uint32 message\nfloat64 time\nstring model\nuint8 sensor_pos # where it is\nTaxel[] taxels\n"
        "xela_server_ros2/Forces[] forces"
    ),
    "xela_server_ros2/msg/SensStream": "# all sensors\nSensorFull[] sensors",
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values",
    "control_msgs/msg/DynamicJointState": (
        "std_msgs/Header header\n\nstring[] joint_names\nInterfaceValue[] interface_values"
    ),
    "booster_interface/msg/HandTouchParam": "byte[] finger_one\nuint8[] finger_palm",
    "booster_interface/msg/HandTouchData": (
        "int32 LEFT=0\nHandTouchParam touch_data\nint32 hand_index\nint32 hand_type"
    ),
    "omnihand_2025_node_msgs/msg/TactileData": "uint8[] tactiles",
    "omnihand_2025_node_msgs/msg/TactileSensor": "std_msgs/Header header\nTactileData[] tactile_datas",
    "sr_robot_msgs/msg/UBI0": "uint16[] distal",
    "sr_robot_msgs/msg/UBI0All": "Header header\nUBI0[] tactiles",
}
"""Messages as their makers write them down, where no package is installed."""
TOPICS = {
    "floats": "",
    "words": "",
    "octets": ",path=data",
    "cloud": "",
    "xela": ",path=sensors[sensor_pos=2].taxels[].z",
    "robotis": (
        ",path=interface_values[joint_names=finger_l_sensor1].values[interface_names=Present Pressure *]"
    ),
    "json": ",path=data.thumb_matrix",
    "booster": ",path=touch_data.finger_one,pack=be16",
    "omnihand": ",path=tactile_datas[1].tactiles,ask={namespace}/tactile_cmd",
    "shadow": ",path=tactiles[-1].distal",
}  # fmt: skip
"""What a user writes after the name of the topic."""


@pytest.fixture(scope="module")
def msgs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("msgs")
    for name, text in MADE.items():
        path = folder / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    return folder


@pytest.fixture(scope="module", params=["reliable", "best-effort"])
def published(request: pytest.FixtureRequest) -> Iterator[str]:
    """The namespace of a plain publisher, in a domain of this test."""
    with pytest.MonkeyPatch.context() as patched:
        number, namespace = next(DOMAINS), anywhere()
        patched.setenv("ROS_DOMAIN_ID", str(number))
        patched.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        words = [sys.executable, str(HELPERS / "ros2_publisher.py"), namespace, request.param, str(number)]
        process = subprocess.Popen(words, env=os.environ | {"CYCLONEDDS_URI": LOOPBACK})
        yield namespace
        process.kill()
        process.wait()


def reader_of(via: str) -> SourceReader:
    source = source_at(f"array:ros2://{via}")
    return SourceReader(via, source, {"pad": 16})


@pytest.mark.parametrize("topic", TOPICS)
def test_values_are_those_that_were_published(topic: str, published: str, msgs: Path) -> None:
    options = TOPICS[topic].replace("{namespace}", published)
    reader = reader_of(f"{published}/{topic},msg={msgs}{options}")
    try:
        lost = (3, 5) if topic == "floats" else ()
        domain = f"ROS domain {os.environ['ROS_DOMAIN_ID']}"
        judge_values(reader, f"{published}/{topic}", lost=lost, says=domain)
    finally:
        reader.close()


def test_one_topic_feeds_several_patches(published: str) -> None:
    via = f"{published}/json,path=data.thumb_matrix/data.index_matrix"
    reader = SourceReader(via, source_at(f"array:ros2://{via}"), {"thumb": 16, "index": 16})
    try:
        reader.wait(10.0)
        thumb, index = reader.pads["thumb"].values, reader.pads["index"].values
        assert thumb is not None, reader.rejected
        assert index is not None, reader.rejected
        np.testing.assert_array_equal(thumb, (np.arange(16) * 7 + thumb[0]) % 200)
        assert np.isnan(index).all(), "never read by the hand"
    finally:
        reader.close()


def test_what_does_not_fit_is_told_with_what_there_is(published: str, msgs: Path) -> None:
    with pytest.raises(
        DriverError, match=r"nobody publishes /nowhere \(ROS domain.*xela \(xela_server_ros2/msg/S"
    ):
        reader_of("/nowhere")
    with pytest.raises(DriverError, match=r"no definition of xela_server_ros2/SensStream.*msg=FOLDER"):
        reader_of(f"{published}/xela")
    with pytest.raises(DriverError, match=r"words is std_msgs/msg/UInt16MultiArray; valid: type=std_msgs"):
        reader_of(f"{published}/words,type=std_msgs/msg/String")
    reader = reader_of(f"{published}/xela,msg={msgs},path=sensors[sensor_pos=7].taxels[].z")
    try:
        end = time.monotonic() + 10.0
        while not reader.rejected and time.monotonic() < end:
            time.sleep(0.01)
        assert "no sensor_pos=7; valid: sensor_pos=1, 2" in next(iter(reader.rejected))
    finally:
        reader.close()


def test_paths_and_definitions_that_cannot_be_meant_are_refused(tmp_path: Path) -> None:
    for text in ("", "a..b", "a[", "a[x]", "[0]", "a[1:2:3]"):
        with pytest.raises(DriverError, match=r"valid: name, name\[\]"):
            FieldPath(text)
    message = {"a": [{"k": 1, "v": [1, 2]}, {"k": 2, "v": [3, 4]}], "t": "{no json", "s": ["x"]}
    assert FieldPath("a[].v").values(message).tolist() == [1, 2, 3, 4]
    assert FieldPath("a[k=2].v[0]").values(message).tolist() == [3]
    assert FieldPath("a[-1].v").values(message).tolist() == [3, 4]
    assert FieldPath("a[:1].v").values(message).tolist() == [1, 2]
    assert FieldPath("a[].v[1:]").values(message).tolist() == [2, 4]
    for text, said in {
        "b": "no b; valid: a, t, s", "a[5].v": "there are 2", "t.x": "no JSON", "s": "no numbers",
        "a[k=9].v": "valid: k=1, 2", "t[0]": "no list",
    }.items():  # fmt: skip
        with pytest.raises(FrameError, match=said):
            FieldPath(text).values(message)
    with pytest.raises(DriverError, match="wide strings"):
        fields_of("wstring name", "a/B")
    with pytest.raises(DriverError, match="package/msg/Name"):
        message_type("Name")
    assert fields_of("int32 X=3\nint16[<=9] tip # all\nstring<=10 name 'x'\nB[2] two", "a/C") == (
        ("int16[]", "tip"), ("string", "name"), ("a/B[2]", "two"),
    )  # fmt: skip
    (tmp_path / "B.msg").write_text("float32 x\n")
    (tmp_path / "C.msg").write_text("B[2] two\n")
    found = message_type("a/msg/C", str(tmp_path / "C.msg"))
    assert found.needs == (("a/B", (("float32", "x"),)),)
    assert list(itertools.chain(*found.fields)) == ["a/B[2]", "two"]


@pytest.mark.parametrize(
    "via",
    [
        "array:udp://0.0.0.0:1,path=data",
        "array:ros2:///x,pack=be32",
        "array:ros2://x",
        "array:ros2:///x,ask=cmd",
        "array:feed,ask=/cmd",
    ],
)
def test_options_that_do_not_fit_are_refused(via: str) -> None:
    with pytest.raises(DriverError, match=r"valid|are for"):
        source_at(via)
