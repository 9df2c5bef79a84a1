"""`tci new-robot`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from helpers.command_line import tci
from tci.robot.xml import read_robot
from tci.robot.xml.model import packaged


def test_from_a_folder_and_from_a_package(tmp_path: Path) -> None:
    urdf = packaged("example-robot-data", "g1_description/urdf/g1_29dof_rev_1_0.urdf")
    assert urdf is not None
    own = (
        tmp_path / "example-robot-data" / "robots" / "g1_description"
    )  # the package that the mesh paths contain
    shutil.copytree(urdf.parent.parent, own)
    model = own / "urdf" / urdf.name
    told = json.loads(tci("new-robot", str(model), "--name", "mine", "--json"))
    robot = read_robot(told["file"])
    assert robot.name == "mine"
    assert len(robot.patches) == 4
    assert any("shoulder_pitch = left_shoulder_pitch_joint (retarget)" in line for line in told["found"])
    assert "exists" in tci("new-robot", str(model), status=1)
    assert "--package" in tci("new-robot", str(model), "--out", str(tmp_path / "x" / "robot.xml"), status=1)
    out = tmp_path / "elsewhere" / "robot.xml"
    tci("new-robot", str(urdf), "--package", "example-robot-data", "--out", str(out))
    assert read_robot(out).parts == robot.parts
    tci("new-robot", urdf.name, "--package", "example-robot-data", "--out", str(out), "--force")
    assert read_robot(out).parts == robot.parts
    told = tci("new-robot", "no.urdf", "--package", "example-robot-data", "--out", str(out), status=1)
    assert "has no model 'no.urdf'" in told
    assert "g1_description/urdf/g1_29dof_rev_1_0.urdf" in told
