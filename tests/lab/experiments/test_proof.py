"""Tests of descriptions in simulation, including proposed descriptions of humanoids that TCI does not
contain."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.pressing import SHORT_POKE, with_pad
from tci.body.generic_body import GenericBody
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose
from tci.lab.commissioning.plausibility import doubts
from tci.lab.experiments.measure import cop_error, measure
from tci.lab.experiments.patch_trials import patch_trials_of
from tci.lab.experiments.poke import Stimulus, poke
from tci.lab.experiments.proof import prove, trial_faults
from tci.lab.experiments.verdict import compare_axes, limit_faults
from tci.messages import GenericCommand, Mode, Order, Perception
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.xml import read_robot
from tci.robot.xml.model import packaged
from tci.robot.xml.writer import write_robot
from tci.simulation.world import World

PACKAGE = "example-robot-data"
# the page's example, and one with four legs; docs/tables/robots-tried.md has all
UNKNOWN = {
    "romeo": "romeo_description/urdf/romeo.urdf",
    "centauro": "centauro_description/urdf/centauro.urdf",
}


def proposed(name: str, file: str, folder: Path) -> Robot:
    path = packaged(PACKAGE, file)
    assert path is not None
    target = folder / "robot.xml"
    target.write_text(write_robot(propose(path, name=name, package=PACKAGE), file=file))
    return read_robot(target)


@pytest.mark.parametrize("name", UNKNOWN)
def test_a_proposed_robot_is_proved_as_it_is(name: str, tmp_path: Path) -> None:
    """The proposed description passes without changes."""
    proof = prove(proposed(name, UNKNOWN[name], tmp_path), stimulus=SHORT_POKE)
    print(proof.axes)
    assert not proof.faults
    assert len(proof.trials) == 10


def test_an_arm_whose_limits_keep_it_away_from_every_posture_is_refused(tmp_path: Path) -> None:
    file = "simple_humanoid_description/urdf/simple_humanoid.urdf"
    with pytest.raises(
        DescriptionError,
        match="RARM_SHOULDER_R would need -15 degrees, and its limits are 0 to 164 degrees; valid",
    ):
        proposed("simple", file, tmp_path)


def test_arms_without_skin_and_with_wrong_limits_are_found_out() -> None:
    nao = load_robot("nao")
    servos = tuple(
        servo.model_copy(update={"limits": servo.limits.model_copy(update={"upper": -1.0})})
        if servo.name == "LShoulderPitch"
        else servo
        for servo in nao.servos
    )
    worn = tuple(patch for patch in nao.patches if patch.name == "left_upper_arm")
    wrong = prove(nao.model_copy(update={"servos": servos}))
    assert any("Check the signs (gamma) and offsets (sigma)" in fault for fault in wrong.faults)
    assert not wrong.trials
    proof = prove(nao.model_copy(update={"patches": worn}))
    assert {"forearm of left_arm", "right_arm"} <= {*proof.without_skin}
    assert {trial.part for trial in proof.trials} <= {"left_arm"}


def test_a_wrong_sign_is_found_out() -> None:
    """Mistakes are a wrong sign of the elbow, a wrong sign of pronation, and an offset of 5 degrees."""
    robot = load_robot("g1")
    arm = robot.part("left_arm")
    good = compare_axes(robot, arm)
    assert good.worst_deg < 1e-6
    for id, change in ((3, {"scale": 1.0}), (4, {"scale": -arm.servos[4].scale}), (3, {"offset": 1.66})):
        servos = list(arm.servos)
        servos[id] = servos[id].model_copy(update=change)
        wrong = arm.model_copy(update={"servos": tuple(servos)})
        spoilt = robot.model_copy(update={"parts": (wrong, *robot.parts[1:])})
        bad = compare_axes(spoilt, wrong)
        assert bad.worst_deg > 0.5 or bad.within_limits < 100, (id, change)


class Jumpy(WithdrawalReflex):
    """A reflex that already moves a little before a touch, and withdraws at the touch."""

    def step(self, memory: Any, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], Any]:
        orders, memory = super().step(memory, perception, body)
        early = perception.stamp < 0.003
        goal = perception.posture["left_arm"] + 0.02 * np.array(self.fields[0].motion)
        return ((GenericCommand("left_arm", Mode.POSITION, goal),) if early else orders), memory


def test_a_motion_before_the_touch_is_found_out() -> None:
    robot, site = load_robot("nao"), WithdrawalReflex().fields[0]
    world = World(robot)
    held = poke(world, "left_arm", site, Stimulus(), reflex=WithdrawalReflex(fields=()), seed=0)
    faults = []
    for reflex in (WithdrawalReflex(), Jumpy()):
        acted = poke(world, "left_arm", site, Stimulus(), reflex=reflex, seed=0)
        trial = measure(robot, "left_arm", site.name, acted, held)
        faults.append(trial_faults(robot, trial))
    assert not faults[0]
    assert any("first motion after -" in fault for fault in faults[1])
    why = "left_arm was touched and does not move: its motion would drag left_forearm along"
    assert why in trial_faults(robot, replace(trial, responded=False, notes=(why,)))[0]


def test_a_late_first_motion_names_what_took_the_time() -> None:
    """The same 60 ms: of joints that start slowly, and of a skin that feels the touch late."""
    robot, site = load_robot("nao"), WithdrawalReflex().fields[0]
    limits = [
        one.limits.model_copy(
            update={"acceleration": 0.05 * one.limits.acceleration, "jerk": 0.01 * one.limits.jerk}
        )
        for one in robot.servos
    ]
    servos = [one.model_copy(update={"limits": own}) for one, own in zip(robot.servos, limits, strict=True)]
    slow = robot.model_copy(update={"servos": tuple(servos), "digest": "slow"})
    world, traces = World(slow), []
    for reflex in (WithdrawalReflex(fields=()), WithdrawalReflex()):
        traces.append(poke(world, "left_arm", site, Stimulus(), reflex=reflex, seed=0))
    trial = measure(slow, "left_arm", site.name, traces[1], traces[0])
    assert trial.trigger_ms, trial_faults(slow, trial)
    said = next(fault for fault in trial_faults(slow, trial) if "first motion after" in fault)
    assert "the joints start slowly" in said
    assert ", here LShoulderPitch (170 degrees/s2" in said
    assert trial.first_motion_ms is not None
    late = replace(trial, trigger_ms=trial.first_motion_ms - 10.0)
    said = next(fault for fault in trial_faults(slow, late) if "first motion after" in fault)
    assert "the skin feels late" in said


def test_faster_skin_elsewhere_does_not_shift_the_centre_of_pressure() -> None:
    """Palms of 100 Hz tell the contacts of forearms of 50 Hz again, 10 ms later, where they are by then."""
    robot, reflex = load_robot("icub-hands"), WithdrawalReflex()
    site = next(field for field in reflex.fields if field.name == "forearm_extensor")
    acted = poke(World(robot), "left_arm", site, Stimulus(duration=0.3), reflex=reflex, seed=2)
    error = cop_error(acted)
    assert error is not None
    assert error < 0.5


def test_every_patch_is_poked_and_a_motion_towards_the_finger_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot has a pad only on the palm, and the wrist motion presses the pad against the finger."""
    palm, towards = np.array([0.07, -0.02, 0.0]), np.array([0.0, -1.0, 0.0])
    robot = with_pad(
        load_robot("g1"), "left_hand", "left_wrist_yaw_link", tmp_path, centre=palm, normal=towards
    )
    robot = robot.model_copy(update={"patches": robot.patches[-1:]})
    right = BodyWithdrawal()
    fields = [
        field.model_copy(update={"motion_deg": {"flexion": 25.0}}) if field.name == "palm" else field
        for field in right.fields.field
    ]
    wrong = BodyWithdrawal(fields=right.fields.model_copy(update={"field": tuple(fields)}), response="meant")
    (away,) = patch_trials_of(robot, WithdrawalReflex(), right)
    assert away.answered
    assert not away.fault
    (refused,) = patch_trials_of(robot, WithdrawalReflex(), wrong)
    assert not refused.answered
    assert "would press pad" in refused.reason
    assert not refused.fault
    monkeypatch.setattr("tci.capabilities.withdrawal_rule.why_not", lambda *a, **options: "")
    (pressed,) = patch_trials_of(robot, WithdrawalReflex(), wrong)
    assert not pressed.answered, "the gate frees the finger afterwards, not the reflex"
    assert "left_hand moves towards the finger" in pressed.fault


def test_limits_are_held_by_every_packaged_robot_that_is_sent_outside_them() -> None:
    for name in ("g1", "alex"):
        assert not limit_faults(load_robot(name))


def test_a_motor_that_is_too_weak_is_named_and_its_twins_torque_mends_it() -> None:
    """The gate takes what it leaves undone for somebody, and blamed an arm that met something in an empty
    world (PAL's MJCF of tiago in robosuite has 15 N m left where it has 50 N m right)."""
    robot = load_robot("nao")
    (joint,) = (one for one in robot.servos if one.name == "LElbowYaw")
    sound = joint.limits.torque
    assert sound is not None

    def with_torque(torque: float) -> Robot:
        limits = joint.limits.model_copy(update={"torque": torque})
        weak = joint.model_copy(update={"limits": limits})
        return robot.model_copy(
            update={"servos": tuple(weak if one is joint else one for one in robot.servos)}
        )

    faults = limit_faults(with_torque(0.04 * sound))
    assert not [fault for fault in faults if "met something" in fault]
    (told,) = (fault for fault in faults if "too little" in fault)
    valid = re.fullmatch(r"LElbowYaw: its torque of 0.08 N m .*; valid: (\S+) N m, as RElbowYaw has", told)
    assert valid
    assert limit_faults(with_torque(float(valid[1]))) == []
    assert [one for one in doubts(with_torque(0.04 * sound)) if "LElbowYaw and RElbowYaw: torque" in one]
