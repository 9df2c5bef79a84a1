"""Every command that needs a missing extra (optional dependency) immediately prints how to install the
extra."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from helpers import HELPERS, ROOT
from tci.cli.demo import demo
from tci.drivers.registry import driver_names
from tci.errors import TciError
from tci.robot.generic_arm import JOINTS
from tci.support.installed import advice

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
HIDDEN = (
    "qi", "cyclonedds", "rosbags", "roslibpy", "pyarrow", "viser", "av", "py_trees", "lcm", "zenoh",
    "gymnasium", "trimesh", "collada", "rclpy", "rospy", "yarp", "icub-models", "example-robot-data",
    "onnxruntime", "can", "websockets", "numcodecs", "submitit",
)  # fmt: skip
"""Modules, and distributions that contain robot models, which are hidden in these tests."""
ELSEWHERE = {
    "ros1": "apt-get install python3-rospy",
    "yarp:bindings": "conda install -c conda-forge yarp-python",
}
"""Installation advice for libraries that are not on PyPI."""
VIAS = {**ELSEWHERE, **{name: advice(name) for name in ("naoqi", "ros2", "rosbridge", "unitree", "zenoh")}}
WITH_VIA = (
    "demo nao --headless --via {}",
    "run withdrawal nao --via {}",
    "record new.mcap nao --via {}",
    "serve nao --via {}",
    "serve nao --from {} --via player",
    "check nao --hardware --via {}",
    "doctor nao --via {}",
    "skin calibrate nao --patch left_forearm --via {}",
    "gesture record new.csv nao --via {}",
    "gesture play wave.csv nao --via {}",
)
WITH_ROBOT = (
    "demo {} --headless",
    "describe {}",
    "run withdrawal {}",
    "doctor {}",
    "skin check {}",
    "serve {} --via player",
)
ALONE = {
    "demo --view --headless": "viewer",
    "view --headless": "viewer",
    "run withdrawal nao --film a.mp4": "video",
    "zenoh secure keys --endpoint tls/here:1 nao": "zenoh",
    "zenoh router wave.csv": "zenoh",
    "log export one.mcap a.parquet --format parquet": "parquet",
    "log import packed.zarr a.mcap": "oxt",
    "log import bag a.mcap nao": "ros2",
    "new-robot arm.urdf": "robots",
    "run tci.capabilities.behaviour_tree:BehaviourTree nao": "behaviours",
    "run policy.onnx nao": "onnx",
    "hand linkerhand:can0,side=left": "linkerhand",
    "hand xela:127.0.0.1": "xela",
    "run tci.learn.touch_env:TouchEnv nao": "gym",
    "sweep withdrawal nao --cluster slurm": "cluster",
}
CASES = {
    **{
        words.format(via): told
        for words in WITH_VIA
        for via, told in VIAS.items()
        # a demo first checks whether the middleware supports a NAO
        if (words, via) != (WITH_VIA[0], "unitree")
    },
    **{words.format("icub"): advice("icub") for words in WITH_ROBOT},
    **{words.format(name): advice("robots") for words in WITH_ROBOT for name in ("g1", "talos", "alex")},
    **{words: advice(extra) for words, extra in ALONE.items()},
}
RECORD = "record one.mcap nao --duration 0.1"
SERVE = "serve nao --via lcm --duration 0.1"
"""A command that needs no extra, because TCI implements LCM itself."""
DOCTOR = "doctor --json"
pytestmark = pytest.mark.xdist_group("bare")  # one group, so that the fixture runs once
GESTURE = f"time_s,{','.join(f'left_arm.{joint}_deg' for joint in JOINTS)}\n0,0,0,0,10,0\n1,0,0,0,20,0\n"
URDF = (
    '<robot name="arm"><link name="a"><visual><geometry><mesh filename="a.dae"/></geometry></visual></link>'
    "</robot>"
)
GROUP = '{"zarr_format": 2}'
PACKED = {
    ".zgroup": GROUP, "data/.zgroup": GROUP, "meta/.zgroup": GROUP, "meta/episode_ends/0": "packed",
    "meta/episode_ends/.zarray": json.dumps({
        "zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "<i8", "order": "C", "fill_value": 0,
        "filters": None, "compressor": {"id": "blosc", "cname": "lz4", "clevel": 5, "shuffle": 1},
    }),
}  # fmt: skip


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[object, str]]:
    """Runs every case in one process, and returns exit status and output by case."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "wave.csv").write_text(GESTURE)
    (folder / "bag").mkdir()
    (folder / "bag" / "metadata.yaml").touch()
    (folder / "arm.urdf").write_text(URDF)
    (folder / "a.dae").touch()
    (folder / "policy.onnx").touch()
    for name, text in PACKED.items():
        (folder / "packed.zarr" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "packed.zarr" / name).write_text(text)
    words = [RECORD, SERVE, DOCTOR, *CASES]
    done = subprocess.run(
        [sys.executable, str(HELPERS / "bare_install.py"), ",".join(HIDDEN)],
        input=json.dumps([command.split() for command in words]), capture_output=True, text=True, check=False,
        cwd=folder, env={**os.environ, "COLUMNS": "500"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = dict(zip(words, json.loads(done.stdout), strict=True))
    for works in (RECORD, SERVE):
        assert found[works][0] == 0, found[works]
    assert not (folder / "new.mcap").exists()
    return found


def test_every_extra_is_needed_by_some_command() -> None:
    told = set(CASES.values())
    # `tci.batch` has no command: tests/batch/test_gpu.py has what it says.
    # Without `camera` TCI's own renderer draws: tests/lab/pictures/test_head_camera.py has what it says.
    assert {extra for extra in EXTRAS if advice(extra) not in told} == {"batch", "camera"}


@pytest.mark.parametrize("words", CASES)
def test_it_ends_with_what_to_install(words: str, said: dict[str, tuple[object, str]]) -> None:
    status, text = said[words]
    assert status == 1, text
    assert CASES[words] in text
    assert text.count("needs ") == 1
    assert "building the worlds" not in text


def test_the_doctor_tells_every_driver_that_lacks_its_library(said: dict[str, tuple[object, str]]) -> None:
    found = {each["subject"]: each for each in json.loads(said[DOCTOR][1])["findings"]}
    lacking = {name for name in driver_names() if found[f"driver {name}"]["level"] != "ok"}
    assert lacking == {"naoqi", "ros1", "ros2", "rosbridge", "unitree", "zenoh"}
    for name in lacking:
        assert found[f"driver {name}"]["level"] == "note"
        assert VIAS[name] in found[f"driver {name}"]["advice"]


def test_the_doctor_tells_the_extra_of_every_robot_that_lacks_its_model(
    said: dict[str, tuple[object, str]],
) -> None:
    found = [each for each in json.loads(said[DOCTOR][1])["findings"] if each["subject"].startswith("robot ")]
    lacking = [each["what"] for each in found if each["level"] != "ok"]
    assert len(lacking) > 8
    for what in lacking:
        assert advice("icub") in what or advice("robots") in what, what


@pytest.mark.parametrize(
    ("via", "told"),
    [
        ("ros1", "no ROS master at http://127.0.0.1:1|apt-get install python3-rospy"),
        ("rosbridge:127.0.0.1:1", "no rosbridge server at ws://127.0.0.1:1"),
        ("player:no.such.host", "Player at no.such.host:6665: .*valid: a free port"),
        ("zenoh:nao@/no/file.json5", "No such file"),
    ],
)
def test_a_demo_looks_first_for_what_serves_it(
    via: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")
    monkeypatch.setattr(
        "tci.lab.experiments.experiment.run_experiment", lambda *words, **options: pytest.fail("trials begin")
    )
    with pytest.raises(TciError, match=told):
        demo(["nao"], out=tmp_path / "out", via=via, headless=True)
    assert not (tmp_path / "out").exists()
