"""Contacts that are estimated from joint torques, on a simulated arm with wrong masses and unknown friction,
and together with skin."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import tci
from helpers.bare_body import FOREARM, UPPER_ARM, bare_body, without_skin
from helpers.push_trials import NEWTON, Felt, pushed, untouched
from helpers.pushed_arm import ARM, PERIOD, Plant, Push, calibration
from tci.body.generic_body import BodySettings, GenericBody
from tci.body.perceiver import Perceiver
from tci.cli.session import poke_skin
from tci.errors import TciError
from tci.joint_touch.contacts import JointTouchSettings
from tci.messages import JointReading, Perception, Reading, SkinFrame
from tci.robot.description import Robot
from tci.robot.dynamics import Dynamics
from tci.robot.gravity import STANDARD_GRAVITY
from tci.robot.joint_map import initial_position
from tci.skin import contacts as skin_contacts
from tci.skin.kernels.arrays import Clusters


@pytest.fixture(scope="module")
def forearm() -> list[Felt]:
    return [pushed(FOREARM, seed) for seed in range(12)]


def test_pushes_on_a_moving_forearm_are_located(forearm: list[Felt]) -> None:
    assert np.mean([one.right for one in forearm]) >= 0.85
    assert np.median([one.error for one in forearm]) <= 0.05
    assert np.median([one.force_error for one in forearm]) <= 0.25


def test_an_upper_arm_is_told_as_less_certain(forearm: list[Felt]) -> None:
    upper = [pushed(UPPER_ARM, seed) for seed in range(5)]
    assert max(one.certainty for one in upper) < np.median([one.certainty for one in forearm])


def test_motion_is_no_touch() -> None:
    assert untouched(1, 5.0)[0] == 0


def test_an_arm_that_withdraws_from_a_poke_is_not_felt_to_be_touched_by_its_own_motion() -> None:
    forces: list[tuple[float, float]] = []
    with tci.connect("g1-bare", "sim") as driver:
        poke_skin(driver)

        def observe(tick: tci.Tick) -> None:
            real = driver.world.contact_truth("left_forearm").force
            forces.append((real, sum(one.force for one in tick.perception.contacts)))

        assert tci.run(driver, tci.WithdrawalReflex(), duration=0.8, observe=observe)
    real, felt = np.array(forces).T
    lost = int(np.flatnonzero(real)[-1])
    assert real.max() > 10.0
    assert felt.max() == pytest.approx(real.max(), rel=0.25)
    assert not felt[lost + 25 :].any()  # 50 ms later


def test_the_loop_that_describes_touches_has_room_for_every_taxel(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is called without numba's checks, so without this room it writes into memory that is not its own."""
    rooms: list[tuple[int, int]] = []
    describe = skin_contacts.describe

    def see(*arguments: object) -> None:
        (clusters,) = (one for one in arguments if isinstance(one, Clusters))
        rooms.append((len(clusters.force), int(clusters.member.max())))
        describe(*arguments)

    body = bare_body()
    position, last = initial_position(body.robot), len(body.layout.sites) - 1
    posture = body.posture(JointReading(0.0, 0, position, np.zeros(len(position))))
    poses = body.skin.kinematics.pose_array(position, body.layout.links)
    taxel = len(body.skin.surfaces[body.robot.patches[last].name].positions) - 1
    monkeypatch.setattr(skin_contacts, "describe", see)
    made = skin_contacts.describe_touches(body.layout, [(last, taxel, 10.0)], poses, posture)
    assert made.rows["peak"].tolist() == [10.0]
    ((room, highest),) = rooms
    assert room > highest


def in_motion(robot_body: GenericBody, push: Push, until: float, seed: int = 4) -> list[Perception]:
    """Returns the perceptions of a push on a simulated arm in motion."""
    plant, perceiver, seen = Plant(robot_body.robot, seed), Perceiver(robot_body), []
    while plant.time < until:
        joints = plant.step(push)
        seen.append(perceiver.step(Reading(joints, ()), joints.stamp))
    return seen


def middle_push(begin: float, end: float) -> Push:
    surface = bare_body().skin.surfaces[FOREARM]
    place = len(surface.positions) // 2
    link = bare_body().robot.patch(FOREARM).link
    return Push(link, surface.positions[place], -NEWTON * surface.normals[place], begin, end)


def test_a_contact_has_one_identity_from_onset_to_end() -> None:
    seen = in_motion(bare_body(), middle_push(0.2, 0.5), 0.7)
    touched = [one for one in seen if one.contacts]
    assert {one.contacts[0].identity for one in touched} == {-1}
    assert len({one.contacts[0].onset for one in touched}) == 1
    assert touched[0].contacts[0].onset == touched[0].contacts[0].stamp == touched[0].joints.stamp
    assert [one.ended for one in seen if one.ended] == [(-1,)]
    (contact,) = touched[len(touched) // 2].contacts
    assert (contact.part, contact.segment, contact.patch) == (ARM, "forearm", FOREARM)
    assert 0.0 <= contact.u <= 1.0
    np.testing.assert_allclose(contact.f_T, -contact.force * contact.n_T)
    assert contact.taxel_forces.tolist() == [contact.force]
    assert 0.5 < contact.certainty <= 1.0


def test_copies_and_pickles_of_a_perceiver_feel_the_same() -> None:
    body, push = bare_body(), middle_push(0.1, 1.0)
    plant, perceiver = Plant(body.robot, 4), Perceiver(body)
    others: list[Perceiver] = []
    for number in range(120):
        joints = plant.step(push)
        if number == 80:
            others = [perceiver.copy(), pickle.loads(pickle.dumps(perceiver))]
        here = perceiver.step(Reading(joints, ()), joints.stamp)
        for other in others:
            there = other.step(Reading(joints, ()), joints.stamp)
            assert [(c.identity, c.force, c.u) for c in there.contacts] == [
                (c.identity, c.force, c.u) for c in here.contacts
            ]
    assert here.contacts


def test_a_reading_that_repeats_changes_nothing() -> None:
    body = bare_body()
    plant, once, twice = Plant(body.robot, 6), Perceiver(body), Perceiver(body)
    push = middle_push(0.05, 1.0)
    for _ in range(80):
        joints = plant.step(push)
        a = once.step(Reading(joints, ()), joints.stamp)
        twice.step(Reading(joints, ()), joints.stamp)
        b = twice.step(Reading(joints, ()), joints.stamp + 0.5 * PERIOD)
        assert [c.force for c in a.contacts] == [c.force for c in b.contacts]
    assert a.contacts


def test_a_robot_that_leans_feels_no_touch_if_it_reports_its_gravity() -> None:
    """If the gravity direction were not reported, the robot's own weight would be estimated as a push on its
    arm."""
    body, count = bare_body(), len(bare_body().robot.servos)
    here = np.array(initial_position(body.robot))
    leaning = STANDARD_GRAVITY * np.array([np.sin(0.5), 0.0, -np.cos(0.5)])
    held = Dynamics(body.robot, calibration(body.robot)).at(here, np.zeros(count), leaning)[1]
    felt = {}
    for gravity in (None, leaning):
        perceiver = Perceiver(body)
        for k in range(100):
            joints = JointReading(0.002 * k, k, here, np.zeros(count), held, gravity=gravity)
            felt[gravity is None] = len(perceiver.step(Reading(joints, ()), joints.stamp).contacts)
    assert felt == {True: 1, False: 0}


def test_without_torques_nothing_is_felt() -> None:
    body = bare_body()
    plant, perceiver = Plant(body.robot, 7), Perceiver(body)
    for _ in range(60):
        joints = replace(plant.step(middle_push(0.0, 1.0)), torque=None)
        assert not perceiver.step(Reading(joints, ()), joints.stamp).contacts


def both(robot: Robot) -> Robot:
    """Returns a robot whose arm has skin and also senses touches through its joints."""
    bare = without_skin(robot, ARM)
    felt = [patch.model_copy(update={"name": f"{patch.name}_joints"}) for patch in bare.patches]
    worn = [patch for patch in robot.patches if patch.part == ARM]
    return robot.model_copy(update={"patches": (*worn, *felt)})


def test_skin_tells_where_and_joints_tell_how_much() -> None:
    """The skin measures 40 % of the force at the correct place. The joint torques correct the force."""
    calibration = bare_body().settings.joint_calibration
    body = GenericBody(both(tci.load_robot("g1")), BodySettings(joint_calibration=calibration))
    patch, surface = body.robot.patch(FOREARM), body.skin.surfaces[FOREARM]
    push = middle_push(0.2, 2.0)
    place = len(surface.positions) // 2
    beside = surface.neighbours[(surface.neighbours == place).any(axis=1)]
    pressed = np.unique([place, *beside.ravel()])
    counts = 0.4 * NEWTON / surface.areas[pressed].sum() / abs(patch.sensor.pascal_per_count)
    rest = np.full(patch.channels, patch.sensor.rest)
    touched = rest.copy()
    touched[surface.channels[pressed]] -= counts
    plant, perceiver = Plant(body.robot, 8), Perceiver(body)
    for number in range(300):
        joints = plant.step(push)
        raw = touched if joints.stamp >= push.begin else rest
        frame = SkinFrame(FOREARM, joints.stamp, number, raw.astype(np.uint8))
        seen = perceiver.step(Reading(joints, (frame,)), joints.stamp)
    (contact,) = seen.contacts
    assert contact.patch == FOREARM
    assert contact.certainty == 1.0
    assert np.linalg.norm(contact.p_L - push.point) < 0.01
    assert contact.force == pytest.approx(NEWTON, rel=0.25)
    assert 0.4 * contact.force < contact.taxel_forces.sum() < contact.force, "the rest presses between taxels"
    np.testing.assert_allclose(contact.f_T, -contact.force * contact.n_T, atol=1e-9)


@pytest.mark.parametrize(
    "wrong", [{"begin": 1.0, "end": 2.0}, {"end": 0.0}, {"begin": np.inf}, {"skin": 0.0}]
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TciError, match="valid"):
        JointTouchSettings(**wrong)
