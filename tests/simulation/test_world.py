"""The simulated world: time, servos, self-collision and determinism."""

from __future__ import annotations

import copy
import pickle
import threading
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from ruckig import InputParameter, OutputParameter, Ruckig

from tci.errors import CommandError, DescriptionError, UnknownNameError
from tci.lab.authoring.dense_skin import with_skin_rate
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.collisions import LEFT, RIGHT
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.simulation.stepping import find_library
from tci.simulation.world import World, start_angles


def arm_servos(world: World, part: str = "left_arm") -> list[int]:
    """Returns the indices of the servos of an arm that move a joint of the model."""
    return [servo.servo for servo in world.robot.part(part).servos if servo.servo is not None]


def test_it_starts_at_the_initial_posture_and_stays_there(world: World) -> None:
    home = start_angles(world.robot, {})
    assert world.joints().position == pytest.approx(home, abs=1e-12)
    assert world.data.ncon == 0
    world.advance(0.5)
    assert world.joints().position == pytest.approx(home, abs=1e-6)


def test_time_is_at_least_what_was_asked_for_in_whole_steps(nao: World) -> None:
    nao.advance(0.0101)
    assert nao.time == pytest.approx(0.011)
    nao.advance(0.005)
    assert nao.time == pytest.approx(0.011)
    assert nao.joints().sequence == 11
    for tick in range(12, 400):
        nao.advance(tick * 0.001)
        assert nao.time == tick * 0.001


def test_frames_of_skin_change_nothing_that_moves_even_where_joints_are_moved_from_outside() -> None:
    """For a skin frame, the simulation computes the next step without its motion. The step is computed again
    if joints or forces are changed afterwards."""
    robot = load_robot("nao")
    ends = []
    for rate in (1000.0, 45.0):
        world = World(with_skin_rate(robot, rate))
        world.finger.poke("left_forearm", 100, depth=0.006)
        servos = arm_servos(world, "left_arm")
        world.set_position_targets(servos, world.joints().position[servos] - 0.1)
        world.advance(0.1)
        assert world.finger.touching
        world.data.qpos[2] += 1e-3
        world.data.qvel[3] -= 0.1
        world.advance(0.11)
        world.set_stiffness(servos, 0.5 * np.ones(len(servos)))
        world.advance(0.12)
        world.data.xfrc_applied[-5, 0] = world.data.qfrc_applied[3] = 0.5
        world.advance(0.13)
        world.data.xfrc_applied[-5, 0] = world.data.qfrc_applied[3] = 0.0
        world.advance(0.2)
        ends.append((world.data.qpos.tobytes(), world.data.qvel.tobytes(), world.finger.trace.tobytes()))
    assert ends[0] == ends[1]


def test_torques_that_are_read_are_those_that_move_the_joints() -> None:
    """At a constant speed no joint accelerates, with and without a computed skin frame or picture."""
    world = World(load_robot("nao"), period=0.002)
    servos = arm_servos(world, "left_arm")[:1]
    home = world.joints().position[servos]
    for tick in range(1, 101):
        world.set_position_targets(servos, home + 0.002 * tick)
        world.advance(0.002 * tick)
        if tick % 2:
            world.refresh()
        if tick > 60:
            joints = world.joints()
            assert joints.velocity[servos] == pytest.approx(1.0, abs=0.02)
            assert abs(joints.torque[servos]) < 0.05 * 1.6


def test_the_loop_takes_the_steps_that_mujoco_takes() -> None:
    world = World(load_robot("nao"))
    world.finger.poke("left_forearm", 100, depth=0.006)
    world.advance(0.001)
    data = mujoco.MjData(world.model)
    mujoco.mj_copyData(data, world.model, world.data)
    for tick in range(2, 62):
        data.ctrl[:] = world.data.ctrl  # of the next step
        world.advance(0.001 * tick)
        mujoco.mj_step(world.model, data)
        assert data.qpos.tobytes() == world.data.qpos.tobytes(), tick
    assert world.finger.touching


def test_same_calls_give_the_same_bits_and_looking_changes_nothing() -> None:
    robot = load_robot("nao")
    results = []
    for look in (False, True):
        world = World(robot)
        for _ in range(2):  # the second run follows a reset
            world.reset()
            patch = robot.patches[0].name
            world.finger.poke(patch, 100)
            servos = arm_servos(world, "right_arm")
            world.set_position_targets(servos, world.joints().position[servos] + 0.1)
            for tick in range(1, 150):
                world.advance(tick * 0.002)
                if look:
                    world.contact_truth(patch)
                    world.skin_point(patch, 3)
            results.append((world.data.qpos.tobytes(), [frame.values.tobytes() for frame in world.frames()]))
    assert all(result == results[0] for result in results)


def stream(world: World, part: str, goal: Array, duration: float) -> tuple[Array, Array]:
    """Follows a jerk-limited path to `goal` (k,) [rad]. Returns velocities and errors (periods, k), at 500
    Hz."""
    servos = arm_servos(world, part)
    limits = [world.robot.servos[servo].limits for servo in servos]
    planner, wanted, planned = (
        Ruckig(len(servos), 0.002),
        InputParameter(len(servos)),
        OutputParameter(len(servos)),
    )
    wanted.current_position = world.joints().position[servos].tolist()
    wanted.max_velocity = [limit.velocity for limit in limits]
    wanted.max_acceleration = [limit.acceleration for limit in limits]
    wanted.max_jerk = [limit.jerk for limit in limits]
    wanted.target_position = goal.tolist()
    start = world.time
    velocities, errors = [], []
    for tick in range(1, round(duration / 0.002)):
        planner.update(wanted, planned)
        planned.pass_to_input(wanted)
        world.set_position_targets(servos, planned.new_position)
        world.advance(start + tick * 0.002)
        joints = world.joints()
        velocities.append(joints.velocity[servos])
        errors.append(joints.position[servos] - planned.new_position)
    return np.array(velocities), np.array(errors)


def test_a_set_point_stream_is_followed_within_the_speed_limit(world: World) -> None:
    generator = np.random.default_rng(5)
    # With raised and spread arms the path is free of collisions.
    low, high = np.deg2rad([[20, 30, -20, 15, -40], [90, 70, 40, 60, 40]])
    for _ in range(6):
        part = world.robot.part("left_arm")
        generic = generator.uniform(low, high)
        goal = np.array(
            [(g - servo.offset) / servo.scale for g, servo in zip(generic, part.servos, strict=True)]
        )
        velocities, errors = stream(world, "left_arm", goal, 1.5)
        top = np.array([world.robot.servos[servo].limits.velocity for servo in arm_servos(world)])
        assert np.abs(velocities).max() > 0.5
        assert (np.abs(velocities) <= 1.01 * top).all()
        assert (np.abs(errors) <= 0.015 * top + 0.002).all()
        assert np.abs(errors[-1]).max() < 1e-4


def test_a_far_target_is_reached_at_the_speed_limit_not_above(world: World) -> None:
    servo = arm_servos(world)[3]
    limits = world.robot.servos[servo].limits
    start = world.joints().position[servo]
    target = start + 0.8 * max((limits.lower - start, limits.upper - start), key=abs)
    world.set_position_targets([servo], [target])
    top = 0.0
    for tick in range(1, 1000):
        world.advance(tick * 0.002)
        top = max(top, abs(world.joints().velocity[servo]))
    assert 0.8 * limits.velocity < top <= 1.01 * limits.velocity
    assert world.joints().position[servo] == pytest.approx(target, abs=1e-4)


def test_joints_stay_inside_their_limits(world: World) -> None:
    for servo in arm_servos(world)[3:]:
        for end in ("lower", "upper"):
            world.reset()
            bound = getattr(world.robot.servos[servo].limits, end)
            world.set_position_targets([servo], [bound + (0.5 if end == "upper" else -0.5)])
            world.advance(1.5)
            assert abs(world.joints().position[servo] - bound) < np.deg2rad(1.0)


def test_torques_stay_inside_their_limits(nao: World) -> None:
    servos = arm_servos(nao)
    nao.set_position_targets(servos, nao.joints().position[servos] + [0.6, 0.5, 0.5, 0.3, 0.5])
    for tick in range(1, 200):
        nao.advance(tick * 0.001)
        for servo in servos:
            description = nao.robot.servos[servo]
            torque = nao.data.actuator(description.joint).force[0]
            assert abs(torque) <= description.limits.torque * (1.0 + 1e-9)


def test_a_limp_arm_gives_way_and_a_damped_one_slowly(nao: World) -> None:
    moved = []
    servos = arm_servos(nao)
    for stiffness, damping in ((1.0, 0.0), (0.1, 0.0), (0.1, 1.0), (0.0, 0.0)):
        nao.reset()
        nao.set_stiffness(servos, [stiffness] * len(servos))
        nao.set_damping(servos, [damping] * len(servos))
        before = nao.joints().position
        nao.finger.poke("left_forearm", 100, speed=0.5, gap=0.001)
        nao.advance(0.06)
        moved.append(np.abs(nao.joints().position - before).max())
    stiff, soft, damped, limp = moved
    assert limp > 1.2 * soft
    assert soft > 3.0 * stiff
    assert damped < soft


def test_a_servo_without_a_joint_reads_its_target(nao: World) -> None:
    hand = next(servo for servo in nao.robot.servos if servo.joint is None)
    nao.set_position_targets([hand.index], [0.4])
    nao.advance(0.05)
    assert nao.joints().position[hand.index] == 0.4
    assert nao.joints().velocity[hand.index] == 0.0


def test_joints_that_no_servo_drives_are_held(world: World) -> None:
    driven = {servo.joint for servo in world.robot.servos if servo.joint is not None}
    joints = {world.model.joint(index).name for index in range(world.model.njnt)}
    assert joints == driven | {"tci_finger_tip"}


def test_links_are_where_kinematics_say(world: World) -> None:
    world.advance(0.01)
    kinematics = KinematicChain(world.robot)
    for patch in world.robot.patches:
        pose = kinematics.poses(world.joints().position, [patch.link])[patch.link]
        surface = world.surfaces[patch.name]
        for taxel in (0, len(surface.positions) - 1):
            point, normal = world.skin_point(patch.name, taxel)
            assert point == pytest.approx(pose[:3, :3] @ surface.positions[taxel] + pose[:3, 3], abs=1e-9)
            assert normal == pytest.approx(pose[:3, :3] @ surface.normals[taxel], abs=1e-9)


def test_the_present_pose_is_told_not_that_of_the_step_before(nao: World) -> None:
    servo = arm_servos(nao)[0]
    nao.set_position_targets([servo], [nao.joints().position[servo] + 0.5])
    nao.advance(0.1)
    told, _ = nao.skin_point("left_forearm", 0)
    fresh = mujoco.MjData(nao.model)
    fresh.qpos[:] = nao.data.qpos
    mujoco.mj_kinematics(nao.model, fresh)
    pose = fresh.body(nao.surfaces["left_forearm"].link)
    point = pose.xmat.reshape(3, 3) @ nao.surfaces["left_forearm"].positions[0] + pose.xpos
    torso = fresh.body(nao.robot.model.torso_link).xpos
    assert abs(nao.joints().velocity[servo]) > 1.0
    assert told == pytest.approx(point - torso, abs=1e-12)


def test_the_library_is_that_of_the_module_beside_another_release(tmp_path: Path) -> None:
    """MuJoCo 3 and mujoco-core 4 install their files in the same folder, so this folder contains both
    libraries."""
    for version in ("3.17.0", "4.0.1"):
        (tmp_path / f"libmujoco.so.{version}").touch()
    for version in ("3.17.0", "4.0.1"):
        assert find_library(tmp_path, version).name == f"libmujoco.so.{version}"
    with pytest.raises(ImportError, match=r"no library of MuJoCo 4\.0\.0 in .*; install mujoco-core again"):
        find_library(tmp_path, "4.0.0")


def test_an_arm_that_is_driven_into_the_body_is_stopped_by_it(world: World) -> None:
    # Arm down, turned inward, elbow bent: without collision the hand would pass through the belly.
    through = {"nao": [0.0, -15.0, 80.0, 80.0, 0.0], "icub": [0.0, 5.0, 75.0, 80.0, 0.0]}[world.robot.name]
    part = world.robot.part("left_arm")
    servos = arm_servos(world)
    goal = [(np.deg2rad(g) - s.offset) / s.scale for g, s in zip(through, part.servos, strict=True)]
    world.set_position_targets(servos, goal)
    touched = set()
    speeds = []
    for tick in range(1, 1500):
        world.advance(tick * 0.002)
        touched |= {tuple(sorted(pair)) for pair in world.model.geom_bodyid[world.data.contact.geom].tolist()}
        speeds.append(np.abs(world.joints().velocity[servos]))
    assert touched
    assert np.abs(world.joints().position[servos] - goal).max() > np.deg2rad(2.0)
    # The hand does not jump when it is released.
    world.set_position_targets(servos, start_angles(world.robot, {})[servos])
    for tick in range(1500, 2200):
        world.advance(tick * 0.002)
        speeds.append(np.abs(world.joints().velocity[servos]))
    top = np.array([world.robot.servos[servo].limits.velocity for servo in servos])
    # An arm that is pressed against the body slides along the body at a speed that is 3 to 6 % higher,
    # depending on the depth.
    assert (np.array(speeds) <= 1.07 * top).all()
    assert world.joints().position == pytest.approx(start_angles(world.robot, {}), abs=1e-3)


def test_an_arm_that_was_pushed_away_does_not_rush_back(nao: World) -> None:
    """The arm receives no targets while it is pushed. After its release it must not be faster than with
    targets."""
    top = np.array([servo.limits.velocity or np.inf for servo in nao.robot.servos])
    nao.advance(0.05)
    home = nao.joints().position
    nao.finger.poke("left_forearm", 5, depth=0.08)
    nao.advance(0.5)
    assert np.abs(nao.joints().position - home).max() > 0.3
    nao.finger.retire()
    for tick in range(1, 200):
        nao.advance(0.5 + tick * 0.002)
        assert (np.abs(nao.joints().velocity) <= 1.05 * top).all()
    assert nao.joints().position == pytest.approx(home, abs=1e-3)


def test_torque_mode_begins_without_a_torque_and_a_halt_ends_it(nao: World) -> None:
    servo = arm_servos(nao)[0]
    nao.set_modes([servo], [Mode.TORQUE])
    nao.advance(0.1)
    start = nao.joints().position[servo]
    assert abs(start) > 1.0
    assert start == initial_position(nao.robot)[servo]
    nao.set_torques([servo], [0.2])
    nao.advance(0.15)
    there = nao.joints().position[servo]
    assert there > start + 0.01
    nao.halt()
    nao.advance(0.5)
    assert nao.joints().modes[servo] is Mode.POSITION
    assert nao.joints().position[servo] == pytest.approx(there, abs=0.02)


def test_a_servo_that_was_off_pushes_only_when_told_again(nao: World) -> None:
    servo = arm_servos(nao)[0]
    nao.set_modes([servo], [Mode.TORQUE])
    nao.set_torques([servo], [0.2])
    for on, torque in ((True, 0.2), (False, 0.0), (True, 0.0)):
        nao.set_power([servo], on)
        nao.advance(nao.time + 0.02)
        assert nao.joints().torque[servo] == pytest.approx(torque)


def test_links_of_one_arm_never_collide_with_one_another(world: World) -> None:
    first, second = world.model.geom_contype, world.model.geom_conaffinity
    for bit, other in ((LEFT, RIGHT), (RIGHT, LEFT)):
        assert (first == bit).any()
        assert not (second[first == bit] & bit).any()
        assert (second[first == bit] & other).all()


def test_a_posture_by_part_is_where_it_starts() -> None:
    robot = load_robot("nao")
    posture = np.deg2rad([60.0, 20.0, 0.0, 40.0, 0.0])
    world = World(robot, posture={"left_arm": posture})
    part = robot.part("left_arm")
    angles = world.joints().position
    assert [s.scale * angles[s.servo] + s.offset for s in part.servos] == pytest.approx(posture)
    world.advance(0.1)
    world.reset()
    assert world.joints().position == pytest.approx(angles, abs=1e-12)


def test_without_skin_there_are_no_frames() -> None:
    world = World(load_robot("nao"), skin=False)
    world.advance(0.05)
    assert world.frames() == ()
    with pytest.raises(UnknownNameError, match="left_forearm"):
        world.contact_truth("left_forearm")


def test_bad_input_says_what_is_valid(nao: World) -> None:
    robot = nao.robot
    with pytest.raises(DescriptionError, match="no <model>"):
        World(robot.model_copy(update={"model": None}))
    for step in (0.0, -0.001, np.nan, 0.006):
        with pytest.raises(CommandError, match="valid: above 0"):
            World(robot, step=step)
    for wrong in ({"noise": -1.0}, {"noise": np.nan}, {"period": 0.0}, {"period": np.nan}, {"seed": -1}):
        with pytest.raises(CommandError, match=f"{next(iter(wrong))} .*valid: "):
            World(robot, **wrong)
    with pytest.raises(CommandError, match=r"seed 1.5; valid: a whole number"):
        nao.reset(seed=1.5)
    with pytest.raises(UnknownNameError, match="left_arm"):
        World(robot, posture={"third_arm": np.zeros(5)})
    with pytest.raises(CommandError, match="5 finite angles"):
        World(robot, posture={"left_arm": [0.0, np.nan, 0.0, 0.0, 0.0]})
    with pytest.raises(CommandError, match="2 values for 1 servos"):
        nao.set_position_targets([0], [0.0, 0.0])
    for servo in (-1, len(robot.servos), 0.5):
        with pytest.raises(CommandError, match=f"valid: 0 to {len(robot.servos) - 1}"):
            nao.set_position_targets([servo], [0.0])
    with pytest.raises(CommandError, match="valid: finite numbers"):
        nao.set_position_targets([0], [np.nan])
    for share in (-0.1, 1.1):
        with pytest.raises(CommandError, match="valid: 0 to 1"):
            nao.set_stiffness([0], [share])
        with pytest.raises(CommandError, match="valid: 0 to 1"):
            nao.set_damping([0], [share])


def test_modes_are_switched_although_the_caller_reuses_its_array(nao: World) -> None:
    """A command with the same read-only array is a repetition; a caller may write into its own array."""
    one, other = arm_servos(nao)[:2]
    servos, modes = np.array([one]), (Mode.TORQUE,)
    nao.set_modes(servos, modes)
    servos[0] = other
    nao.set_modes(servos, modes)
    assert [nao.joints().modes[servo] for servo in (one, other)] == [Mode.TORQUE, Mode.TORQUE]
    servos.setflags(write=False)
    nao.set_modes(servos, modes)
    nao.set_modes([other], [Mode.POSITION])
    nao.set_modes(servos, modes)
    assert nao.joints().modes[other] is Mode.TORQUE


def test_modes_are_switched_although_the_caller_shows_a_read_only_view(nao: World) -> None:
    one, other = arm_servos(nao)[:2]
    base, modes = np.array([one]), (Mode.TORQUE,)
    view = base.view()
    view.setflags(write=False)
    nao.set_modes(view, modes)
    base[0] = other
    nao.set_modes(view, modes)
    assert nao.joints().modes[other] is Mode.TORQUE


@pytest.mark.parametrize("duplicate", [copy.deepcopy, pickle.dumps])
def test_a_world_can_not_be_copied(nao: World, duplicate: Callable[[World], object]) -> None:
    """A copy moved the original, and crashed once the original was gone."""
    with pytest.raises(TypeError, match="valid: a new World"):
        duplicate(nao)


def test_a_poke_that_has_not_begun_changes_no_torque() -> None:
    """Readings between the order of a poke and the next step contained the torques of a touch."""
    world = World(load_robot("g1-bare"), skin=True)
    world.advance(0.1)
    before = world.joints().torque
    world.finger.poke("left_forearm", 0, gap=0.004)
    assert world.joints().torque == pytest.approx(before, abs=1e-9)


@pytest.mark.parametrize("angle", [float("nan"), float("inf")])
def test_a_refused_target_changes_no_target(nao: World, angle: float) -> None:
    servos = np.array(arm_servos(nao)[:2])
    before = nao.joints().position
    with pytest.raises(CommandError, match="finite numbers"):
        nao.set_position_targets(servos, np.array([0.5, angle]))
    with pytest.raises(CommandError, match="valid: 0 to"):
        nao.set_position_targets(np.array([servos[0], 999]), np.array([0.5, 0.5]))
    nao.advance(0.1)
    assert np.allclose(nao.joints().position, before, atol=1e-6)


def test_readers_in_other_threads_leave_the_noise_of_the_skin_as_it_is() -> None:
    seen = []
    for readers in (0, 2):
        world, done = World(load_robot("nao"), noise=2.0, seed=5), threading.Event()

        def read(world: World = world, done: threading.Event = done) -> None:
            while not done.is_set():
                world.frames()
                world.refresh()

        threads = [threading.Thread(target=read) for _ in range(readers)]
        for thread in threads:
            thread.start()
        values = []
        for tick in range(1, 200):
            world.advance(0.01 * tick)
            values.append([frame.values.tolist() for frame in world.frames()])
        done.set()
        for thread in threads:
            thread.join()
        seen.append(values)
    assert seen[0] == seen[1]


def test_poses_are_computed_without_a_change_of_the_measured_torques(nao: World) -> None:
    arm = arm_servos(nao)
    home = nao.joints().position[arm]
    for tick in range(1, 50):
        nao.set_position_targets(arm, home + 0.05 * np.sin(0.1 * tick))
        nao.advance(0.002 * tick)
        before = nao.joints().torque
        nao.refresh()
        np.testing.assert_array_equal(nao.joints().torque, before)
