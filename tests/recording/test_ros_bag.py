"""Import of bags that an independent library has written, in the formats of ROS 1 and ROS 2."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from helpers.command_line import tci
from helpers.recorded import record_poke, two_parts
from tci.errors import RecordingError
from tci.messages import Reading
from tci.recording.names import servo_names
from tci.recording.recording import Recording
from tci.recording.ros_bag import _joints, import_ros_bag
from tci.recording.schemas import SKIN
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.runtime.loop import Tick

JOINT_STATE = "sensor_msgs/msg/JointState"


@pytest.fixture(scope="module")
def ticks(tmp_path_factory: pytest.TempPathFactory) -> list[Tick]:
    return record_poke(tmp_path_factory.mktemp("bag") / "poke.mcap")


def write_bag(
    path: Path,
    ticks: list[Tick],
    kind: str,
    *,
    by_model: bool = False,
    epoch: float = 0.0,
    stamped: str = "joints skin",
) -> Path:
    """Writes the readings of a run as a bag, with joints in reversed order, since ROS guarantees none.

    Message times, and the times in the headers that are `stamped`, count from `epoch` [s]. Skin frames also
    contain the sender's own time.
    """
    robot = load_robot("nao")
    types = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types.register({SKIN.name: get_types_from_msg(SKIN.definition, SKIN.name)[SKIN.name]})
    make = types.types
    names = [(servo.joint or servo.name) if by_model else servo.name for servo in robot.servos][::-1]
    seen: dict[str, int] = {}
    if kind == "ros1":
        path = path.with_suffix(".bag")
        writer: Any = Writer1(path)
        pack = types.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        pack = types.serialize_cdr

    def head(stamp: float, frame: str) -> Any:
        kind_of = "skin" if frame else "joints"
        nanoseconds = round((stamp + epoch) * 1e9) if kind_of in stamped else 0
        time = make["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        words = (0, time, frame) if kind == "ros1" else (time, frame)
        return make["std_msgs/msg/Header"](*words)

    with writer:
        topics = {
            patch.name: writer.add_connection(f"/nao/skin/{patch.name}", SKIN.name, typestore=types)
            for patch in robot.patches
        }
        states = writer.add_connection("/nao/joint_states", JOINT_STATE, typestore=types)
        other = writer.add_connection("/other/joint_states", JOINT_STATE, typestore=types)
        for tick in ticks:
            at = round((tick.now + epoch) * 1e9)
            for number, frame in enumerate(tick.reading.skin):
                if seen.get(frame.patch) == frame.sequence:
                    continue
                seen[frame.patch] = frame.sequence
                data = np.frombuffer(frame.values.tobytes(), dtype=np.uint8)
                message = make[SKIN.name](
                    head(frame.stamp, frame.patch), frame.stamp, frame.sequence, number, frame.patch,
                    frame.values.dtype.str, data,
                )  # fmt: skip
                writer.write(topics[frame.patch], at, pack(message, SKIN.name))
            joints = tick.reading.joints
            assert joints.torque is not None
            columns = [joints.position[::-1], joints.velocity[::-1], joints.torque[::-1]]
            state = make[JOINT_STATE](head(joints.stamp, ""), names, *(c.copy() for c in columns))
            writer.write(states, at, pack(state, JOINT_STATE))
            stranger = make[JOINT_STATE](head(joints.stamp, ""), ["x"], *(np.zeros(1) for _ in range(3)))
            writer.write(other, at, pack(stranger, JOINT_STATE))
    return path


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_bag_becomes_a_recording_bit_for_bit(kind: str, ticks: list[Tick], tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", ticks, kind, by_model=kind == "mcap")
    assert import_ros_bag(bag, tmp_path / "out.mcap", load_robot("nao")).periods == len(ticks)
    for found, tick in zip(Recording(tmp_path / "out.mcap").ticks(), ticks, strict=True):
        assert found.now == pytest.approx(tick.now, abs=1e-9)
        for name in ("position", "velocity", "torque"):
            assert np.array_equal(getattr(found.reading.joints, name), getattr(tick.reading.joints, name))
        frames = {frame.patch: frame for frame in found.reading.skin}
        for frame in tick.reading.skin:
            assert frames[frame.patch].values.dtype == frame.values.dtype
            assert np.array_equal(frames[frame.patch].values, frame.values)
            assert frames[frame.patch].stamp == pytest.approx(frame.stamp, abs=1e-9)


@pytest.mark.parametrize("stamped", ["joints skin", "joints", "skin", ""])
def test_joints_and_skin_are_on_one_clock(stamped: str, ticks: list[Tick], tmp_path: Path) -> None:
    epoch = 1.7e9
    bag = write_bag(tmp_path / "bag", ticks, "mcap", epoch=epoch, stamped=stamped)
    import_ros_bag(bag, tmp_path / "out.mcap", load_robot("nao"))
    late = 0.0 if stamped == "joints skin" else ticks[0].reading.joints.stamp - ticks[0].now
    for found, tick in zip(Recording(tmp_path / "out.mcap").ticks(), ticks, strict=True):
        assert found.now == pytest.approx(tick.now + epoch, abs=1e-6)
        ages = {frame.patch: found.reading.joints.stamp - frame.stamp for frame in found.reading.skin}
        for frame in tick.reading.skin:
            assert ages[frame.patch] == pytest.approx(
                tick.reading.joints.stamp - frame.stamp - late, abs=1e-5
            )


def test_an_imported_bag_is_replayed_at_its_own_rate(ticks: list[Tick], tmp_path: Path) -> None:
    slow = ticks[::20]
    bag = write_bag(tmp_path / "bag", slow, "mcap")
    out = tmp_path / "out.mcap"
    import_ros_bag(bag, out, load_robot("nao"))
    assert Recording(out).period == pytest.approx(slow[1].now - slow[0].now)
    told = json.loads(tci("run", "withdrawal", "nao", "--via", f"replay:{out}", "--json"))
    assert (told["worst"], told["loop"]["missed"]) == ("run", 0)
    assert "touch" in [event["kind"] for event in told["events"]]


def test_what_comes_twice_or_late_is_left_out_and_a_second_run_refused(
    ticks: list[Tick], tmp_path: Path
) -> None:
    again = [*ticks[:20], *ticks[10:30]]
    bag = write_bag(tmp_path / "again", again, "mcap")
    assert import_ros_bag(bag, tmp_path / "a.mcap", load_robot("nao")).periods == 30
    runs = [replace(ticks[10], reading=_at(ticks[10].reading, 5.0)), ticks[11]]
    bag = write_bag(tmp_path / "runs", runs, "mcap")
    with pytest.raises(RecordingError, match=r"clock goes back from 5\.000 to 0\.\d+ s; valid"):
        import_ros_bag(bag, tmp_path / "b.mcap", load_robot("nao"))
    assert not (tmp_path / "b.mcap").exists()


def _at(reading: Reading, stamp: float) -> Reading:
    return Reading(replace(reading.joints, stamp=stamp), reading.skin)


def test_the_command_imports_and_plots_a_bag(ticks: list[Tick], tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", ticks, "mcap")
    out = str(tmp_path / "out.mcap")
    assert "does not name its robot; valid: tci log import" in tci("log", "import", str(bag), out, status=1)
    told = tci("log", "import", str(bag), out, "nao")
    assert f"{len(ticks)} periods" in told
    assert f"used: joints of nao, {len(ticks)} readings" in told
    told = json.loads(tci("plot", out, "--json"))
    assert [touch["patch"] for touch in told["touches"]] == ["left_forearm"]


def test_what_does_not_fit_is_told(ticks: list[Tick], tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", ticks[:5], "sqlite")
    with pytest.raises(
        RecordingError, match=r"240 values at .*; valid: the 384 channels of left_fore.* of icub"
    ):
        import_ros_bag(bag, tmp_path / "a.mcap", load_robot("icub"))
    bare = load_robot("nao").model_copy(update={"patches": ()})
    with pytest.raises(RecordingError, match=r"has skin '.*'; nao has"):
        import_ros_bag(bag, tmp_path / "a.mcap", bare)
    short = [replace(frame, values=frame.values[1:]) for frame in ticks[0].reading.skin]
    bag = write_bag(
        tmp_path / "short", [replace(ticks[0], reading=replace(ticks[0].reading, skin=(*short,)))], "mcap"
    )
    with pytest.raises(RecordingError, match=r"values at .*; valid: the \d+ channels of .* of nao"):
        import_ros_bag(bag, tmp_path / "a.mcap", load_robot("nao"))
    assert not (tmp_path / "a.mcap").exists()
    (tmp_path / "broken.bag").write_bytes(b"#ROSBAG V2.0\nnonsense")
    with pytest.raises(RecordingError, match=r"broken.bag is"):
        import_ros_bag(tmp_path / "broken.bag", tmp_path / "b.mcap", load_robot("nao"))
    with pytest.raises(RecordingError, match=r"none.bag is no ROS bag"):
        import_ros_bag(tmp_path / "none.bag", tmp_path / "c.mcap", load_robot("nao"))


def test_servos_of_equal_names_are_told_apart_by_their_part(tmp_path: Path) -> None:
    robot = two_parts(tmp_path)
    make: Any = get_typestore(Stores.ROS2_HUMBLE).types
    head = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](0, 0), "")

    def state(*names: str) -> Any:
        return make[JOINT_STATE](head, list(names), np.arange(float(len(names))), np.zeros(0), np.zeros(0))

    found = _joints(state("two.servo0", "servo1", "one.servo0"), robot, 0.0, 0)
    assert found is not None
    assert found.position.tolist() == [2.0, 0.0, 1.0]
    assert _joints(state("servo0", "servo1"), robot, 0.0, 0) is None


def small_bag(path: Path, joints: dict[str, float], *, points: bool = False, force: bool = False) -> Path:
    """Writes 5 messages of each kind as other people's programs do: joint states, unless `joints` is empty,
    a cloud of points with 2-byte raw values, and a wrench."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    make = types.types
    plugin = StoragePlugin.MCAP
    with Writer2(path, version=9, storage_plugin=plugin) as writer:

        def send(topic: str, kind: str, number: int, *fields: Any) -> None:
            connection = next((c for c in writer.connections if c.topic == topic), None)
            connection = connection or writer.add_connection(topic, kind, typestore=types)
            time = make["builtin_interfaces/msg/Time"](1700000000, number * 10_000_000)
            message = make[kind](make["std_msgs/msg/Header"](time, ""), *fields)
            writer.write(connection, 1700000000 * 10**9 + number * 10**7, types.serialize_cdr(message, kind))

        for number in range(5):
            if points:
                field = make["sensor_msgs/msg/PointField"]("raw", 2, 4, 1)
                channels = load_robot("nao").patch("left_forearm").channels
                data = np.zeros((channels, 4), np.uint8)
                data[:, 2] = number
                cloud = 1, channels, [field], False, 4, data.size, data.ravel(), True
                send("/skin/left_forearm/points", "sensor_msgs/msg/PointCloud2", number, *cloud)
            if force:
                vector = make["geometry_msgs/msg/Vector3"](0.0, 0.0, 1.0)
                wrench = make["geometry_msgs/msg/Wrench"](vector, vector)
                send("/ft", "geometry_msgs/msg/WrenchStamped", number, wrench)
            if joints:
                values = np.array([*joints.values()])
                send("/joint_states", JOINT_STATE, number, [*joints], values, 0 * values, 0 * values)
    return path


def at_rest() -> dict[str, float]:
    robot = load_robot("nao")
    return dict(zip(servo_names(robot), initial_position(robot).tolist(), strict=True))


def test_a_bag_without_joint_states_says_what_it_has(tmp_path: Path) -> None:
    bag = small_bag(tmp_path / "bag", {}, force=True)
    with pytest.raises(RecordingError, match=r"no sensor_msgs/msg/JointState .*; it has /ft \(geometry_msgs"):
        import_ros_bag(bag, tmp_path / "a.mcap", load_robot("nao"))
    assert not (tmp_path / "a.mcap").exists()


def test_clouds_of_points_are_skin_and_other_topics_are_named(tmp_path: Path) -> None:
    bag = small_bag(tmp_path / "bag", at_rest(), points=True, force=True)
    done = import_ros_bag(bag, tmp_path / "a.mcap", load_robot("nao"))
    assert done.left_out == ("/ft, 5 messages of geometry_msgs/msg/WrenchStamped",)
    assert not done.doubts
    frames = list(Recording(tmp_path / "a.mcap").frames())
    assert [(f.patch, set(f.values.tolist()), f.values.dtype.name) for f in frames] == [
        ("left_forearm", {number}, "uint16") for number in range(5)
    ]


def test_angles_that_no_robot_measures_are_doubted(tmp_path: Path) -> None:
    degrees = {name: float(np.rad2deg(angle)) for name, angle in at_rest().items()}
    said = import_ros_bag(small_bag(tmp_path / "deg", degrees), tmp_path / "a.mcap", load_robot("nao")).doubts
    far = {name for name, angle in degrees.items() if abs(angle) > 10.0}
    assert far <= {one.split()[0] for one in said}
    assert any(one.endswith("degrees? valid: radians") for one in said)
    dead = at_rest() | {"LHand": np.nan}
    printed = tci("log", "import", str(small_bag(tmp_path / "nan", dead)), str(tmp_path / "b.mcap"), "nao")
    assert "LHand is not a number in all 5 joint states" in printed
    names = [servo.name for servo in load_robot("nao").servos]
    for tick in Recording(tmp_path / "b.mcap").ticks():
        angles = dict(zip(names, tick.reading.joints.position, strict=True))
        assert np.isfinite(angles.pop("LHand"))
        assert angles == {name: angle for name, angle in at_rest().items() if name != "LHand"}
    ran = tci("run", "withdrawal", "nao", "--via", f"replay:{tmp_path / 'b.mcap'}", "--json")
    assert json.loads(ran)["state"] == "run"
