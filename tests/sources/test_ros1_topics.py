"""Patches on topics of ROS 1, from a publisher in Debian's rospy."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from helpers import HELPERS
from helpers.peers import DEBIAN_PYTHON
from helpers.read_topics import judge_values
from helpers.ros_robots import Programs, anywhere, roscore
from tci.drivers.registry import source_at
from tci.drivers.source_reader import SourceReader
from tci.errors import DriverError

pytestmark = [pytest.mark.xdist_group("driver-ros1"), pytest.mark.timeout(120)]
TOPICS = {
    "floats": "",
    "octets": "",
    "cloud": "",
    "shadow": ",path=tactiles[-1].distal",
    "nested": ",path=points[].positions",
}
"""What a user writes after the name of the topic."""


@pytest.fixture(scope="module")
def published() -> Iterator[str]:
    """The namespace of the publisher."""
    roscore()
    programs, namespace = Programs(), anywhere()
    programs.start(DEBIAN_PYTHON, str(HELPERS / "ros1_publisher.py"), f"__ns:={namespace}")
    yield namespace
    programs.kill()


def reader_of(via: str, **pads: int) -> SourceReader:
    """Waits for the publisher, which needs a second to start."""
    end = time.monotonic() + 60.0
    while True:
        try:
            return SourceReader("pads", source_at(f"array:ros1://{via}"), pads)
        except DriverError as error:
            if "nobody publishes" not in str(error) or time.monotonic() > end:
                raise


@pytest.mark.parametrize("topic", TOPICS)
def test_values_are_those_that_were_published(topic: str, published: str) -> None:
    reader = reader_of(f"{published}/{topic}{TOPICS[topic]}", pad=16)
    try:
        lost = (3, 5) if topic == "floats" else ()
        judge_values(reader, f"{published}/{topic}", lost=lost, says="ROS master http://127.0.0.1")
    finally:
        reader.close()


def test_one_topic_feeds_several_patches(published: str) -> None:
    reader = reader_of(f"{published}/octets,path=data[0:4]/data[4:]/data[99]", palm=4, tip=12, none=1)
    try:
        end = time.monotonic() + 10.0
        while not (reader.rejected and all(reader.pads[pad].sequence for pad in ("palm", "tip"))):
            assert time.monotonic() < end, reader.rejected
            time.sleep(0.01)
        palm, tip = reader.pads["palm"].values, reader.pads["tip"].values
        assert palm is not None, reader.rejected
        assert tip is not None, reader.rejected
        np.testing.assert_array_equal(palm, (np.arange(4) * 7 + palm[0]) % 200)
        np.testing.assert_array_equal(tip, (np.arange(12) * 7 + tip[0]) % 200)
        assert any("there are 16" in reason for reason in reader.rejected), "what is not there is told"
    finally:
        reader.close()


def test_what_does_not_fit_is_told_with_what_there_is(published: str) -> None:
    reader_of(f"{published}/octets", pad=16).close()  # the publisher runs
    with pytest.raises(DriverError, match=rf"seen: .*{published}/shadow \(sr_robot_msgs/msg/UBI0All\)"):
        SourceReader("gone", source_at(f"array:ros1://{published}/shade"), {"pad": 16})
    with pytest.raises(DriverError, match=r"no paths for 2 patches; valid: one for each"):
        reader_of(f"{published}/octets", palm=4, tip=12)
    with pytest.raises(DriverError, match="publishers send definitions"):
        source_at("array:ros1:///x,msg=/tmp")
