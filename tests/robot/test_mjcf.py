"""An MJCF as its makers write it: a robot in a scene, masses in the shapes, any name of the file. MuJoCo on
the untouched file is the judge."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import pytest

from helpers.made_humanoid import MadeHumanoid
from tci.lab.authoring.left_out import left_out
from tci.lab.authoring.proposal import propose
from tci.robot.description import Robot
from tci.robot.gravity import weighted_model
from tci.simulation.world import World

FIRST = """
  <geom name="floor" type="plane" size="0 0 .05"/><geom name="wall" type="box" size=".1 1 1" pos="0.3 0 0"/>
  <geom name="hills" type="hfield" hfield="h"/><light mode="targetbody" target="cube"/><light/>
  <camera name="eye" mode="targetbody" target="cube"/><site name="goal"/>
  <body name="table"><geom type="box" size=".2 .2 .4"/></body><body><geom type="plane" size="1 1 1"/></body>
  <body name="goal_hand" mocap="true"><geom size=".02"/></body>
"""
LAST = """
  <body name="cube" pos="0.2 0 0"><freejoint/><geom name="cube" type="box" size=".1 .1 .1"/>
    <site name="top"/></body>
"""
AROUND = """
<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="0 0 0 1"/></asset>
<actuator><motor joint="left_elbow" ctrlrange="-9 9"/></actuator>
<equality><weld body1="goal_hand" body2="left_elbow_link"/>
  <connect body1="cube" body2="table" anchor="0 0 0"/>
</equality>
<contact><pair geom1="floor" geom2="cube"/><exclude body1="table" body2="left_elbow_link"/></contact>
<tendon><spatial><site site="top"/><site site="goal"/></spatial></tendon>
<sensor><framepos objtype="body" objname="cube"/><touch site="top"/><framepos objtype="geom" objname="floor"/>
  <framepos objtype="geom" objname="cube" reftype="camera" refname="eye"/>
  <framepos objtype="body" objname="left_elbow_link" reftype="geom" refname="wall"/></sensor>
"""


FLOATING = "<body name='pelvis' pos='0 0 1'><freejoint/><geom size='.1 .1' pos='0 0 -.08' type='cylinder'/>"


def text_of(folder: Path, base: str = FLOATING) -> str:
    """A made humanoid with a base of its own, in no scene."""
    folder.mkdir(exist_ok=True)
    text = MadeHumanoid(legs=False).mjcf(folder).read_text()
    fixed = '<geom size="0.1 0.1" pos="0 0 -0.08" type="cylinder"/>'
    assert fixed in text  # MuJoCo writes the shape of a fixed base into the world
    return text.replace(fixed, base, 1).replace("</worldbody>", "</body></worldbody>")


def in_scene(text: str) -> str:
    """The same robot in a scene with all that a scene can have."""
    scene = text.replace("<worldbody>", f"<worldbody>{FIRST}", 1)
    scene = scene.replace("</worldbody>", f"{LAST}</worldbody>").replace("</mujoco>", f"{AROUND}</mujoco>")
    pose = " ".join(["0"] * mujoco.MjModel.from_xml_string(scene).nq)
    return scene.replace("</mujoco>", f'<keyframe><key qpos="{pose}"/></keyframe></mujoco>')


def proposed(folder: Path, text: str, file: str = "robot.xml") -> Robot:
    folder.mkdir(exist_ok=True)
    (folder / file).write_text(text)
    return propose(folder / file, name="made")


def names_of(model: mujoco.MjModel) -> list[str]:
    """All bodies, joints and geoms of a compiled model."""
    return [
        getattr(model, kind)(k).name
        for kind in ("body", "jnt", "geom")
        for k in range(getattr(model, f"n{kind}"))
    ]


def test_the_world_around_a_robot_is_no_part_of_it(tmp_path: Path) -> None:
    text = text_of(tmp_path)
    robots = [proposed(tmp_path / "bare", text), proposed(tmp_path / "scene", in_scene(text))]
    assert robots[0].servos == robots[1].servos
    assert robots[0].parts == robots[1].parts
    models = [World(robot).model for robot in robots]
    assert names_of(models[0]) == names_of(models[1])
    told = " ".join(left_out(robots[1]))
    assert all(name in told for name in ("floor", "wall", "hills", "table", "goal_hand", "cube"))
    assert "world" not in " ".join(left_out(robots[0]))


def test_shapes_on_the_world_are_those_of_a_fixed_base(tmp_path: Path) -> None:
    text = MadeHumanoid(legs=False).mjcf(tmp_path).read_text()
    floor = '<geom name="floor" type="plane" size="0 0 .05"/>'
    robot = proposed(tmp_path / "fixed", text.replace("<worldbody>", f"<worldbody>{floor}"))
    model = World(robot).model
    own = [kind for kind in model.geom_type[model.geom_bodyid == 0] if kind == mujoco.mjtGeom.mjGEOM_CYLINDER]
    assert len(own) == 1
    assert "floor" not in names_of(model)


WEIGHED = {
    "density": ("", ""),
    "default": ('<default><geom density="300"/></default>', ""),
    "mass": ("", 'mass="0.4"'),
    "total": ('<compiler angle="radian" settotalmass="30"/>', ""),
    "always": ('<compiler angle="radian" inertiafromgeom="true"/>', ""),
    "half": ("", ""),
}


@pytest.mark.parametrize("way", WEIGHED)
def test_masses_are_those_of_mujoco_however_a_file_gives_them(tmp_path: Path, way: str) -> None:
    """With and without shapes, in the simulation and in the gravity torques; "half" has some inertias."""
    before, of_geom = WEIGHED[way]
    text = in_scene(text_of(tmp_path)).replace("<geom size", f"<geom {of_geom} size")
    if way not in ("always", "total"):
        text = re.sub(r"<inertial[^>]*/>", "", text, count=4 if way == "half" else 0)
    text = text.replace("<worldbody>", f"{before}<worldbody>", 1)
    judge = mujoco.MjModel.from_xml_string(text)
    own = [
        judge.body(k).name for k in range(judge.nbody) if judge.body(judge.body_rootid[k]).name == "pelvis"
    ]
    robot = proposed(tmp_path / "robot", text)
    for model in (World(robot).model, weighted_model(robot)[0]):
        for name in own:
            assert model.body(name).mass[0] == pytest.approx(judge.body(name).mass[0], rel=1e-3), name
            assert model.body(name).inertia == pytest.approx(judge.body(name).inertia, rel=1e-3)
            assert model.body(name).ipos == pytest.approx(judge.body(name).ipos, abs=1e-4)
    assert judge.body("left_elbow_link").mass[0] > 0.0


def test_a_model_is_read_by_its_content_whatever_its_name(tmp_path: Path) -> None:
    """Also one that includes a file and has meshes, whose paths are relative to it."""
    text = text_of(tmp_path)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "cone.obj").write_text(
        "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    (tmp_path / "scene.xml").write_text('<mujoco><worldbody><light name="sun"/></worldbody></mujoco>')
    mesh = '<compiler meshdir="parts"/><asset><mesh name="cone" file="cone.obj"/></asset>'
    text = text.replace("<worldbody>", f'{mesh}<include file="scene.xml"/><worldbody>', 1)
    text = text.replace("<geom size", '<geom type="mesh" mesh="cone"/><geom size', 1)
    models = [World(proposed(tmp_path, text, f"a{end}")).model for end in (".xml", ".mjcf", ".XML", "")]
    assert "cone" in [models[0].mesh(k).name for k in range(models[0].nmesh)]
    assert all(names_of(model) == names_of(models[0]) for model in models)
