"""A standing robot frees whom an arm meets without falling on somebody."""

from __future__ import annotations

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from helpers.gate_checks import position_command, reading
from tci.errors import TciError
from tci.gate.contact.settings import ContactSettings
from tci.gate.gate import Gate, GateSettings
from tci.messages import Contacts
from tci.messages.contacts import CONTACT, TAXEL, Site
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.robot.collisions import solid_spec
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.skin.surfaces import surfaces_of

ROBOT = load_robot("nao-whole")
PLACE = {servo.name: servo.index for servo in ROBOT.servos}
ARM, ANKLE = PLACE["LShoulderPitch"], PLACE["LAnklePitch"]
SOLE = next(one for one in surfaces_of(ROBOT) if one.patch == "left_sole")
PERIOD, BALL = 0.01, 1e-3
"""[s]; radius [m] of what touches the floor under each sensor."""
START, HELD = 30.0, 60.0
"""The arm goes down, from somewhat before the robot, and is held on its way [degrees]."""


@cache
def on_ground() -> tuple[Any, Any]:
    """MuJoCo's model of the robot, a small ball under each sensor of the left sole, and a floor that moves
    with it."""
    spec = solid_spec(ROBOT)
    for point in SOLE.positions:
        ball = [*(point - BALL * SOLE.normals[0])]
        spec.body(SOLE.link).add_geom(pos=ball, size=[BALL, 0.0, 0.0], contype=2, conaffinity=2, mass=0.0)
    floor = spec.worldbody.add_body(name="floor", mocap=True)
    kind = mujoco.mjtGeom.mjGEOM_PLANE
    floor.add_geom(type=kind, size=[1.0, 1.0, 1.0], contype=2, conaffinity=2)
    model = spec.compile()
    return model, mujoco.MjData(model)


def margin(angles: Array) -> float:
    """Of the centre of mass inside the points that touch the floor [m], both as MuJoCo says."""
    model, data = on_ground()
    for servo in ROBOT.servos:
        for joint in servo.joints:
            turned = joint.multiplier * angles[servo.index] + joint.offset
            data.qpos[model.joint(joint.joint).qposadr[0]] = turned
    mujoco.mj_forward(model, data)
    foot = data.body(SOLE.link)
    pose = foot.xmat.reshape(3, 3)
    up = -pose @ SOLE.normals[0]
    data.mocap_pos[0] = foot.xpos + pose @ SOLE.positions[0] + 1e-5 * up
    mujoco.mju_quatZ2Vec(data.mocap_quat[0], up)
    mujoco.mj_forward(model, data)
    floor = int(model.body("floor").geomadr[0])
    touching = data.contact.pos[(data.contact.geom == floor).any(axis=1)]
    assert len(touching) == len(SOLE.positions)
    across = np.linalg.svd(up[None])[2][1:]
    hull = ConvexHull(touching @ across.T).equations
    return -float((hull[:, :2] @ (across @ data.subtree_com[1]) + hull[:, 2]).max())


def leaning(arm: float) -> Array:
    """Angles on the left foot, leaning until the centre of mass is over the sole's edge with the arm at `arm`
    [degrees]."""
    angles = turned(np.array(initial_position(ROBOT)), ARM, np.deg2rad(arm))
    angles[PLACE["LAnkleRoll"]] = np.deg2rad(12.0)
    stands, falls = np.deg2rad([-20.0, -40.0])
    for _ in range(30):
        middle = 0.5 * (stands + falls)
        stands, falls = (middle, falls) if margin(turned(angles, ANKLE, middle)) > 0.0 else (stands, middle)
    return turned(angles, ANKLE, stands)


def turned(angles: Array, place: int, value: float) -> Array:
    changed = angles.copy()
    changed[place] = value
    return changed


def standing(force: float) -> Contacts:
    rows = np.zeros(1, CONTACT)
    rows["identity"], rows["force"] = 3, force
    site = Site("left_sole", "left_leg", "foot")
    return Contacts(
        (site,), np.zeros(1), np.zeros(1, np.int64), rows, np.zeros(2, np.int64), np.zeros(0, TAXEL)
    )


def met(
    angles: Array, force: float, servo: int, *, goal: float, at: float, robot: Robot = ROBOT, fits: int = 1
) -> tuple[str, float]:
    """What is told, and the reference [rad] in the end of a joint that goes to `goal` [rad] and is held. One
    of `fits` frames of skin fits."""
    settings = GateSettings(contact=ContactSettings())
    gate = Gate(robot, period=PERIOD, stale_after=0.1, settings=settings, streams=True)
    angles, told, upwards = angles.copy(), list[str](), goal > at
    for step in range(150):
        orders = [position_command([servo], [goal])] if step == 0 else []
        now = step * PERIOD
        contacts = None if step % fits else standing(force)
        safe = gate.step(orders, reading(angles, now), now, contacts=contacts)
        angles[safe.servos] = safe.position
        angles[servo] = min(angles[servo], at) if upwards else max(angles[servo], at)
        told += [one.text for one in safe.clamped if one.code is Code.CONTACT]
    return told[0], float(safe.position[safe.servos.tolist().index(servo)])


def test_an_arm_of_a_standing_robot_goes_back_only_if_it_still_stands() -> None:
    angles, at = leaning(HELD - 1.5), np.deg2rad(HELD)
    assert margin(turned(angles, ARM, at)) > 0.0 > margin(turned(angles, ARM, at - np.deg2rad(3.0)))
    begins = turned(angles, ARM, np.deg2rad(START))
    told, rests = met(begins, 0.5, ARM, goal=np.deg2rad(90.0), at=at)
    assert told.endswith("it goes back softly"), "no sole is loaded"
    assert rests < at - np.deg2rad(2.5)
    told, rests = met(begins, 50.0, ARM, goal=np.deg2rad(90.0), at=at)
    assert told.endswith("it gives way")
    assert abs(rests - at) < np.deg2rad(0.5)
    told, rests = met(begins, 50.0, PLACE["RShoulderPitch"], goal=np.deg2rad(20.0), at=np.deg2rad(45.0))
    assert told.endswith("it goes back softly"), "the other arm's way leads back over the sole"


def test_the_waist_of_a_standing_robot_stays_stiff() -> None:
    robot = load_robot("icub-whole")
    waist = next(servo.index for servo in robot.servos if servo.name == "torso_pitch")
    for force, fits, does in ((50.0, 1, "it stops"), (50.0, 60, "it stops"), (0.0, 1, "it goes back")):
        angles, at = np.array(initial_position(robot)), np.deg2rad(10.0)
        told, rests = met(angles, force, waist, goal=np.deg2rad(30.0), at=at, robot=robot, fits=fits)
        assert told.endswith(does)
        assert abs(rests - at) < 1e-3 if force else rests < at - np.deg2rad(1.0), "it presses no further"


@pytest.mark.parametrize("name", ["icub-whole", "icub"])
def test_an_answer_that_standing_overrides_is_told(name: str, caplog: pytest.LogCaptureFixture) -> None:
    robot = load_robot(name)
    answers = ContactSettings(answers={"torso": "retreat"})
    Gate(robot, period=PERIOD, stale_after=0.1, settings=GateSettings(contact=answers), streams=True)
    assert ("torso retreat: only while no sole is loaded" in caplog.text) is (name == "icub-whole")
    if name == "icub-whole":
        legs = ContactSettings(answers={"left_leg": "soft"})
        with pytest.raises(TciError, match="left_leg soft; valid: answers of left_arm"):
            Gate(robot, period=PERIOD, stale_after=0.1, settings=GateSettings(contact=legs), streams=True)


@pytest.mark.parametrize(("force", "soft"), [(50.0, False), (0.0, True)])
def test_the_waist_of_a_standing_robot_does_not_give_way_at_rest(force: float, soft: bool) -> None:
    """By 4 degrees for the 3 that somebody, or a load, bends it by."""
    robot = load_robot("icub-whole")
    waist = next(servo.index for servo in robot.servos if servo.name == "torso_pitch")
    settings = GateSettings(contact=ContactSettings())
    gate = Gate(robot, period=PERIOD, stale_after=0.1, settings=settings, streams=True)
    angles = np.array(initial_position(robot))
    orders = [position_command([waist], [start := angles[waist]])]
    for step in range(400):
        now = step * PERIOD
        safe = gate.step(orders, reading(angles, now), now, contacts=standing(force))
        angles[safe.servos], orders = safe.position, []
        angles[waist] += np.deg2rad(np.clip(0.1 * (step - 250), 0.0, 3.0))
    moved = abs(float(safe.position[safe.servos.tolist().index(waist)]) - start)
    assert moved > np.deg2rad(2.0) if soft else moved < 1e-9
    assert {one.answer for one in safe.met} == {"soft" if soft else "told"}
