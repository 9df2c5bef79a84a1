"""What the simulation adds to a robot does not depend on `<default>`s and `<option>`s of the robot's file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import tci
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.model_file import load_spec
from tci.simulation.world import World

HOSTILE: dict[str, dict[str, Any]] = {
    "damping": {"default.joint.damping": [30.0, 0.0, 0.0]},
    "armature": {"default.joint.armature": 2.0},
    "stiffness": {"default.joint.stiffness": [500.0, 0.0, 0.0]},
    "friction": {"default.joint.frictionloss": 3.0},
    "range": {"default.joint.range": [0.0, 0.0], "default.joint.limited": 1},
    "margin": {"default.geom.margin": 0.02},
    "soft": {"default.geom.solref": [0.2, 3.0], "default.geom.solimp": [0.1, 0.2, 0.05, 0.5, 2.0]},
    "contact": {
        "default.geom.contype": 0, "default.geom.condim": 6, "default.geom.friction": [9.0, 9.0, 9.0],
    },
    "actuator": {
        "default.actuator.gear": [7.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "default.actuator.ctrlrange": [0.0, 1e-3], "default.actuator.ctrllimited": 1,
    },
    "option": {
        "default.mesh.scale": [3.0, 3.0, 3.0], "option.viscosity": 5.0, "option.o_solref": [0.3, 1.0],
        "option.enableflags": int(mujoco.mjtEnableBit.mjENBL_OVERRIDE),
    },
}  # fmt: skip


def as_file(robot: Robot, folder: Path, lines: dict[str, Any]) -> Robot:
    """The robot with its model in an MJCF file in which each element states its own values, so that `lines`
    of the file's defaults and options mean nothing for the robot."""
    assert robot.model is not None
    spec = load_spec(robot.model)
    for path, value in lines.items():
        *way, name = path.split(".")
        element: Any = spec
        for step in way:
            element = getattr(element, step)
        setattr(element, name, value)
    folder.mkdir()
    file = folder / "robot.xml"
    file.write_text(spec.to_xml())
    model = robot.model.model_copy(update={"format": "mjcf", "path": str(file), "package": None})
    return robot.model_copy(update={"model": model})


def poked(robot: Robot) -> Array:
    """Force [N] of the finger over time."""
    world = World(robot, skin=["left_forearm"], step=0.002)
    world.finger.poke("left_forearm", 37, speed=0.3, depth=0.006)
    world.advance(0.15)
    return world.finger.trace[:, 1]


def test_a_poke_has_the_same_force_under_hostile_defaults(tmp_path: Path) -> None:
    robot = tci.load_robot("g1")
    expected = poked(as_file(robot, tmp_path / "plain", {}))
    assert expected.max() > 3.0
    for name, lines in HOSTILE.items():
        force = poked(as_file(robot, tmp_path / name, lines))
        assert force == pytest.approx(expected, abs=1e-3), (name, float(np.abs(force - expected).max()))
