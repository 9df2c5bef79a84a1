"""The frame of a joint may lie anywhere on the joint's axis; the shapes tell where the forearm ends."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ARM = """<body name="{s}_a" pos="0 {y} .4"><joint name="{s}_pitch" axis="0 1 0" range="-2.5 2.5"/>{m}
<body name="{s}_b"><joint name="{s}_roll" axis="1 0 0" range="{r}"/>{m}
<body name="{s}_c"><joint name="{s}_yaw" axis="0 0 1" range="-1.5 1.5"/>{m}
<geom type="capsule" fromto="0 0 0 0 0 -.22" size=".04"/>
<body name="{s}_d" pos="0 0 -.26"><joint name="{s}_elbow" axis="0 1 0" range="-2.2 .1"/>{m}
<geom type="capsule" fromto="0 0 0 0 0 -.19" size=".035"/>
<body name="{s}_e" pos="0 0 {at}"><joint name="{s}_turn" axis="0 0 1" range="-1.5 1.5"/>
<inertial pos="0 0 {hand}" mass=".2" diaginertia=".001 .001 .001"/>
<geom type="box" size=".03 .02 .05" pos="0 0 {hand}"/></body></body></body></body></body>"""
MASS = '<inertial pos="0 0 -.05" mass=".5" diaginertia=".002 .002 .002"/>'


@pytest.mark.parametrize("at", [0.3, -0.18, -0.8])
def test_a_forearm_ends_where_its_shapes_end_wherever_the_frame_lies(tmp_path: Path, at: float) -> None:
    arms = "".join(
        ARM.format(s=side, y=y, r=limits, m=MASS, at=at, hand=-0.25 - at)
        for side, y, limits in (("left", 0.2, "-.2 2"), ("right", -0.2, "-2 .2"))
    )
    motors = "".join(
        f'<motor joint="{side}_{name}" ctrlrange="-40 40"/>'
        for side in ("left", "right")
        for name in ("pitch", "roll", "yaw", "elbow", "turn")
    )
    (tmp_path / "robot.xml").write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 1"><freejoint/>'
        '<inertial pos="0 0 0" mass="8" diaginertia=".1 .1 .1"/><geom type="box" size=".08 .1 .25"/>'
        f"{arms}</body></worldbody><actuator>{motors}</actuator></mujoco>"
    )
    command = [
        sys.executable,
        "-m",
        "tci.cli.main",
        "new-robot",
        "robot.xml",
        "--name",
        "m",
        "--out",
        "m.xml",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    lengths = re.findall(r'name="forearm" link="\w+" length="([\d.]+)"', (tmp_path / "m.xml").read_text())
    assert len(lengths) == 2
    assert all(0.15 < float(length) < 0.23 for length in lengths)
