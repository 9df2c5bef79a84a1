"""Cartesian actuators: hands, elbows and points of the description reach their commanded positions."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tci.body.cartesian import Reach, reach_of
from tci.body.generic_body import GenericBody, order_to_platform
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, UnknownNameError
from tci.exports.facts import query, read_facts
from tci.lab.experiments.same_stimulus import initial_joints
from tci.messages import CartesianCommand, JointReading, PlatformCommand
from tci.messages.frames import Array, apply, invert, transform
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.generic_arm import forearm_rotation, upper_arm_rotation
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain, bare_model
from tci.simulation.world import World

ARMS = [(name, side) for name in ("nao", "icub") for side in ("left", "right")]
ROBOTS = {name: load_robot(name) for name in ("nao", "icub")}
BODIES = {name: GenericBody(robot) for name, robot in ROBOTS.items()}
COMMON_RANGE = np.deg2rad([[0, 90], [10, 70], [-20, 60], [20, 85], [-50, 50]])


KINEMATICS = {name: KinematicChain(robot) for name, robot in ROBOTS.items()}


def centre(robot: Robot, part: str) -> Array:
    """Returns the intersection (3,) [m] of the axes of the first two shoulder joints, from MuJoCo's anchors
    and axes."""
    assert robot.model is not None
    model = bare_model(robot.model)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    servos = [robot.servos[joint.servo] for joint in robot.part(part).servos[:2] if joint.servo is not None]
    joints = [model.joint(servo.joint).id for servo in servos]
    anchors, axes = data.xanchor[joints], data.xaxis[joints]
    along = np.linalg.lstsq(np.column_stack([axes[0], -axes[1]]), anchors[1] - anchors[0], rcond=None)[0]
    meets = anchors + along[:, None] * axes
    assert np.linalg.norm(meets[0] - meets[1]) < 1e-4
    torso = model.body(robot.model.torso_link).id
    T_WT = transform(data.xmat[torso].reshape(3, 3), data.xpos[torso]) @ robot.model.T_LT
    return apply(invert(T_WT), meets[0])


CENTRES = {(name, f"{side}_arm"): centre(ROBOTS[name], f"{side}_arm") for name, side in ARMS}


def ideal_place(generic: Array, side: str, point: str) -> Array:
    """Returns the position of elbow or hand (3,) [arm lengths] of a generic arm whose segments have equal
    lengths."""
    down = np.array([0.0, 0.0, -0.5])
    elbow = upper_arm_rotation(generic, side, axial=False) @ down
    return elbow if point == "elbow" else elbow + forearm_rotation(generic, side, axial=False) @ down


def judged(robot: Robot, part: str, point: str, position: Array) -> Array:
    """Returns the position of hand or elbow (3,) [arm lengths], computed from the frames of the model: the
    ends of the forearm relative to the origin of the upper arm."""
    words = robot.part(part)
    forearm = words.segment("forearm")
    kinematics = KINEMATICS[robot.name]
    elbow = apply(kinematics.poses(position, [forearm.link])[forearm.link], np.array(forearm.origin))
    posture = joint_map(robot, part).to_generic(position)
    rotation = words.R_TM @ forearm_rotation(posture, words.side or "left", axial=False)
    end = elbow if point == "elbow" else elbow - forearm.length * rotation[:, 2]
    length = words.segment("upper_arm").length + forearm.length
    return words.R_TM.T @ (end - CENTRES[robot.name, part]) / length


@pytest.mark.parametrize("point", ["hand", "elbow"])
@pytest.mark.parametrize(("name", "side"), ARMS)
def test_places_that_an_arm_can_reach_are_met_to_a_millimetre(name: str, side: str, point: str) -> None:
    """Targets are 200 positions of random postures. The solver uses only the five joints of the arm."""
    robot, part = ROBOTS[name], f"{side}_arm"
    body, joints = BODIES[name], initial_joints(robot)
    reach = reach_of(robot, part, point)
    random = np.random.default_rng(3)
    worst = 0.0
    for generic in random.uniform(*COMMON_RANGE.T, size=(200, 5)):
        position = initial_position(robot).copy()
        there = joint_map(robot, part)
        position[there.servos] = there.to_robot(generic, position)
        target = judged(robot, part, point, position)
        ((order,), _) = body.to_platform([CartesianCommand(part, target, point)], joints)
        assert isinstance(order, PlatformCommand)
        reached = initial_position(robot).copy()
        reached[order.servos] = order.values
        error = np.linalg.norm(judged(robot, part, point, reached) - target) * reach.length
        np.testing.assert_allclose(reach.place(reached), judged(robot, part, point, reached), atol=1e-4)
        worst = max(worst, float(error))
    print(f"{name} {side} {point}: worst {1e3 * worst:.3f} mm")
    assert worst <= 1e-3


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_same_place_is_reached_on_both_robots(side: str) -> None:
    """Targets are positions of an ideal arm, in arm lengths, at 95 % of its reach. Both robots receive the
    same command."""
    random = np.random.default_rng(4)
    part, worst = f"{side}_arm", 0.0
    for generic in random.uniform(*COMMON_RANGE.T, size=(100, 5)):
        target = 0.95 * ideal_place(generic, side, "hand")
        for name, robot in ROBOTS.items():
            reach = reach_of(robot, part, "hand")
            try:
                found, error = reach.solve(target, initial_position(robot))
            except CommandError:
                continue
            there = judged(robot, part, "hand", found)
            if error <= 1e-3:
                worst = max(worst, float(np.linalg.norm(there - target) * reach.length))
            else:
                assert name == "icub" or error < 0.01
    assert worst <= 1e-3


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_a_hand_goes_there_in_simulation(name: str) -> None:
    world = World(ROBOTS[name], skin=False)
    link, body = SimulatedDriver(world.robot, world=world), BODIES[name]
    target = np.array([0.55, 0.10, -0.55])
    command = CartesianCommand("left_arm", target)
    for now in link.ticks(duration=1.5):
        joints = link.read().joints
        orders, _ = body.to_platform([command] if now == 0.0 else [], joints)
        safe = link.write(link.gate.step(orders, joints, now))
        assert not safe.refusals
    reach = Reach(world.robot, "left_arm", "hand")
    error = np.linalg.norm(reach.place(link.read().joints.position) - target) * reach.length
    assert error <= 1e-3


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_out_of_reach_is_one_clear_error_or_the_nearest_place(name: str) -> None:
    body, joints = BODIES[name], initial_joints(ROBOTS[name])
    far = CartesianCommand("left_arm", np.array([2.0, 0.0, 0.0]))
    orders, (reason,) = body.to_platform([far], joints)
    assert not orders
    assert "to [2.0, 0.0, 0.0] arm lengths: out of reach by" in reason.text
    assert reason.code is Code.OUT_OF_REACH
    ((order,), _) = body.to_platform([replace(far, nearest=True)], joints)
    assert isinstance(order, PlatformCommand)
    position = np.array(joints.position)
    position[order.servos] = order.values
    place = reach_of(ROBOTS[name], "left_arm", "hand").place(position)
    assert 0.9 < place[0] < 1.1
    assert np.abs(place[1:]).max() < 0.3


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (
            CartesianCommand("head", np.zeros(3)),
            "point 'hand' of head; valid: (none: its description has no cartesian_actuator)",
        ),
        (
            CartesianCommand("left_arm", np.zeros(3), "nose"),
            "point 'nose' of left_arm; valid: palm, hand, elbow",
        ),
        (CartesianCommand("left_arm", np.zeros(2)), "valid: 3 finite numbers"),
        (CartesianCommand("left_arm", np.array([np.nan, 0, 0])), "valid: 3 finite numbers"),
    ],
)
def test_what_makes_no_sense_is_refused(command: CartesianCommand, words: str) -> None:
    joints: JointReading = initial_joints(ROBOTS["nao"])
    orders, (reason,) = BODIES["nao"].to_platform([command], joints)
    assert not orders
    assert words in reason.text
    with pytest.raises(UnknownNameError):
        BODIES["nao"].to_platform([CartesianCommand("tail", np.zeros(3))], joints)


def test_an_arm_without_all_its_joints_is_refused() -> None:
    """The command is refused as invalid, and the robot continues."""
    nao = ROBOTS["nao"]
    arm = nao.part("left_arm")
    servos = [one if one.id < 3 else one.model_copy(update={"servo": None}) for one in arm.servos]
    short = arm.model_copy(update={"servos": tuple(servos)})
    robot = nao.model_copy(update={"parts": (short,), "patches": (), "digest": "without an elbow"})
    with pytest.raises(CommandError, match="left_arm has no shoulder of the generic arm: it needs"):
        order_to_platform(robot, CartesianCommand("left_arm", np.zeros(3)), initial_position(robot))


LINKS = {"nao": ("LHand", [0.05775, 0.0, -0.01231]), "icub": ("l_hand", [0.0, 0.0, 0.0])}
"""Link and point [m] of the `palm` that each description declares."""


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_a_point_of_the_description_goes_there_in_metres_and_no_faster_than_it_says(name: str) -> None:
    """The test differentiates the position of the point in the model's frames, and does not use the Jacobian
    of TCI."""
    world = World(ROBOTS[name], skin=False)
    driver, body = SimulatedDriver(world.robot, world=world), BODIES[name]
    link, point = LINKS[name]

    def palm() -> Array:
        position = driver.read().joints.position
        return apply(KINEMATICS[name].poses(position, [link])[link], np.array(point))

    start = palm()
    far = ROBOTS[name].part("left_arm").initial_posture + np.deg2rad([50.0, 10.0, -10.0, 20.0, 10.0])
    there = initial_position(ROBOTS[name]).copy()
    joints = joint_map(ROBOTS[name], "left_arm")
    there[joints.servos] = joints.to_robot(far, there)
    target = apply(KINEMATICS[name].poses(there, [link])[link], np.array(point))
    assert np.linalg.norm(target - start) > 0.1
    limit = body.reach("left_arm", "palm").actuator.speed
    assert limit == 0.5

    def fastest(body: GenericBody) -> float:
        world.reset()
        places = []
        driver = SimulatedDriver(world.robot, world=world)
        for now in driver.ticks(duration=2.5):
            joints = driver.read().joints
            first = [CartesianCommand("left_arm", target, "palm")] if not places else []
            orders, refused = body.to_platform(first, joints)
            assert not refused
            driver.write(driver.gate.step(orders, joints, now))
            places.append(apply(KINEMATICS[name].poses(joints.position, [link])[link], np.array(point)))
        assert np.linalg.norm(places[-1] - target) <= 2e-3
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).max() / driver.period)

    kept = fastest(body)
    arms = [
        part.model_copy(
            update={"cartesian": tuple(a.model_copy(update={"speed": None}) for a in part.cartesian)}
        )
        for part in ROBOTS[name].parts
    ]
    free = fastest(GenericBody(ROBOTS[name].model_copy(update={"parts": tuple(arms), "digest": "free"})))
    print(f"{name}: {kept:.3f} m/s kept, {free:.3f} m/s without a limit")
    assert 0.5 * limit < kept <= 1.02 * limit
    assert free > 1.1 * limit


def test_the_query_gives_all_actuators_with_frame_and_speed() -> None:
    for name, robot in ROBOTS.items():
        facts = read_facts(query(robot).model_dump_json())
        arm = next(part for part in facts.parts if part.name == "left_arm")
        assert [one.name for one in arm.cartesian] == ["palm", "hand", "elbow"]
        palm = arm.cartesian[0]
        assert (palm.link, list(palm.xyz)) == LINKS[name]
        assert (palm.frame, palm.speed, palm.tolerance) == ("torso", 0.5, 1e-3)
