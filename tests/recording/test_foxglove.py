"""The Node packages with which Foxglove reads MCAP files can read every message of every topic of a
recording."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from helpers.peers import node_packages, peer_program
from helpers.recorded import record_poke
from tci.recording.recording import Recording


def test_foxglove_s_own_packages_read_every_message(tmp_path: Path) -> None:
    node, packages = peer_program("node", "node"), node_packages("foxglove")
    path = tmp_path / "poke.mcap"
    ticks = record_poke(path)
    command = [node, str(Path(__file__).with_name("foxglove.js")), packages, str(path)]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    found = json.loads(answer.stdout)
    assert found["profile"] == "ros2"
    assert found["positions"] == [tick.reading.joints.position.tolist() for tick in ticks]
    topics = found["topics"]
    assert all(topic["encodings"] == ["ros2msg", "cdr"] for topic in topics.values())
    assert {name: topic["count"] for name, topic in topics.items()} == {
        name: topic.messages for name, topic in Recording(path).topics().items()
    }
    # Fields that Foxglove's 3D panel requires for a point cloud: see docs.foxglove.dev, ROS 2 messages.
    cloud = topics["/skin/points"]
    assert cloud["schema"] == "sensor_msgs/msg/PointCloud2"
    assert [(field["name"], field["datatype"]) for field in cloud["cloud"]["fields"]] == [
        ("x", 7), ("y", 7), ("z", 7), ("pressure", 7),
    ]  # fmt: skip
    assert cloud["cloud"]["frame"]
    assert cloud["cloud"]["width"] > 100
    assert found["metadata"]["tci"]["robot"] == "nao"
