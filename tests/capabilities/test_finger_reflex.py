"""A hand lets go when a finger is pressed, holds what touches its palm, and asks for counts where nobody
knows newtons. And the demo pokes what a robot has."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import tci
from helpers.pressing import SHORT_POKE
from tci.body.posture import to_platform
from tci.capabilities import FingerReflex, InCounts, lacks
from tci.errors import TciError
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.poke import Stimulus
from tci.lab.experiments.trial_places import unanswered
from tci.messages import GenericCommand, Mode
from tci.messages.frames import Array
from tci.robot.generic_fingers import FLEXIONS
from tci.robot.joint_map import initial_position
from tci.robot.skin_files.calibration import PatchCalibration, SkinCalibration
from tci.simulation.world import World
from tci.testing import TouchedRobot

HAND = "left_fingers"


class Hand:
    """A hand of a robot that is touched step by step."""

    def __init__(
        self, capability: tci.Capability[object], robot: TouchedRobot | None = None, part: str = HAND
    ) -> None:
        self.robot, self.part = robot or TouchedRobot("g1-inspire"), part
        self.capability = capability
        self.memory = capability.init(self.robot.body)

    def feel(
        self, times: int, patch: str | None = None, force: float = 2.0, taxel: int | None = None
    ) -> list[GenericCommand]:
        """What the hand is told while it is touched `times` times."""
        told = []
        for _ in range(times):
            seen = self.robot.perceive(patch, force=force, taxel=taxel)
            orders, self.memory = self.capability.step(self.memory, seen, self.robot.body)
            told += [
                order for order in orders if isinstance(order, GenericCommand) and order.part == self.part
            ]
        return told

    def opens(self, told: list[GenericCommand]) -> bool:
        return bool(told) and np.array_equal(
            told[-1].values, self.robot.robot.part(self.part).initial_posture
        )


@pytest.mark.parametrize("finger", ["thumb", "index", "middle", "ring", "little"])
@pytest.mark.parametrize("pad", ["tip", "top", "pad"])
def test_a_press_on_any_pad_opens_the_hand_and_later_it_hangs_again(finger: str, pad: str) -> None:
    reflex = FingerReflex()
    hand = Hand(reflex)
    (hangs,) = hand.feel(1)  # the test's robot begins with straight fingers
    np.testing.assert_allclose(hangs.values[list(FLEXIONS)], np.deg2rad(3.0) + reflex.curl)
    assert hand.feel(5) == []
    assert hand.opens(hand.feel(3, f"left_{finger}_{pad}"))
    assert reflex.notes(hand.memory) == (f"{HAND} lets go: its {finger} is pressed",)  # type: ignore[arg-type]
    assert hand.feel(20) == [], "it waits"
    (again,) = hand.feel(10)
    np.testing.assert_array_equal(again.values, hangs.values)


def test_an_open_hand_that_is_pressed_on_gives_way_with_that_finger_alone() -> None:
    reflex = FingerReflex()
    hand = Hand(reflex)
    hand.feel(1)
    first, *later = hand.feel(30, "left_thumb_tip")
    assert hand.opens([first])
    goal, others = later[-1].values, [joint for joint in range(10) if joint not in (0, 1)]
    start = hand.robot.robot.part(HAND).initial_posture
    np.testing.assert_allclose(goal[others], start[others], atol=1e-9)
    assert np.abs(goal - start).max() > np.deg2rad(2.0)
    assert reflex.notes(hand.memory) == (f"{HAND} gives way with its thumb, which is pressed",)  # type: ignore[arg-type]


def test_a_touched_palm_is_held_and_only_a_pull_opens_then() -> None:
    hand = Hand(FingerReflex())
    hand.feel(1)
    closing = hand.feel(10, "left_palm")
    assert closing[-1].values[3] > closing[0].values[3] > 0.0
    assert not hand.opens(hand.feel(1, "left_index_top", force=1.0)), "it presses by itself"
    assert hand.opens(hand.feel(15, "left_index_top", force=4.0))


def test_counts_stand_for_newtons_until_the_patch_is_calibrated() -> None:
    robot = TouchedRobot("g1-inspire")
    patch = robot.robot.patch("left_index_top")
    press, touch = 2.0, FingerReflex().touch
    seen = [robot.perceive(patch.name, force=press) for _ in range(3)][-1]
    (contact,) = seen.contacts
    counts = robot.body.counts(contact)
    # one user's 0.827 mN per count; what a taxel's neighbours feel below their threshold is not counted
    assert 0.5 * press / 0.000827 < counts <= 1.01 * press / 0.000827
    for share, answered in ((0.9, True), (1.1, False)):
        hand = Hand(InCounts(FingerReflex(), share * counts / touch), robot)
        assert hand.opens(hand.feel(3, patch.name, press)) == answered

    known = PatchCalibration(rest=(0.0,) * 96, noise=(0.5,) * 96, report={})
    calibration = SkinCalibration(robot="g1-inspire", date="2026-11-27", patches={patch.name: known})
    body = tci.GenericBody("g1-inspire", tci.body.BodySettings(calibration=calibration))
    assert body.calibrated(patch.name)
    assert not body.calibrated("left_index_tip")
    given: list[float] = []

    class Listens(tci.Capability[None]):
        def init(self, body: tci.GenericBody) -> None:
            return None

        def step(
            self, memory: None, perception: tci.Perception, body: tci.GenericBody
        ) -> tuple[tuple[()], None]:
            given.extend(one.force for one in perception.contacts)
            return (), None

    for own in (body, robot.body):
        InCounts(Listens(), 100.0).step(None, seen, own)
    assert given == pytest.approx([contact.force, counts / 100.0])


def test_settings_and_robots_that_do_not_fit_are_told() -> None:
    with pytest.raises(TciError, match="finger reflex: curl 0"):
        FingerReflex(curl=0.0)
    with pytest.raises(TciError, match="in counts: newton nan"):
        InCounts(FingerReflex(), float("nan"))
    assert lacks(FingerReflex(), "nao-plain") == ("no skin on a finger of this robot",)
    assert not lacks(FingerReflex(), "g1-hands")


def test_the_demo_pokes_what_a_robot_has_and_all_of_it_is_answered() -> None:
    """Ten touches anywhere on the pads of two hands, and the switches of a NAO as it is sold."""
    reflex = tci.WithdrawalReflex()
    trials = [
        *trials_of(tci.load_robot("g1-inspire"), reflex, stimulus=SHORT_POKE, seed=3),
        *trials_of(tci.load_robot("nao-plain"), reflex, stimulus=Stimulus(), seed=3),
    ]
    told = [(trial.part, trial.capability) for trial in trials]
    assert told == [
        *[("left_fingers", "finger-reflex")] * 5, *[("right_fingers", "finger-reflex")] * 5,
        ("head", "head-stop"), ("left_arm", "soft-hands"), ("right_arm", "soft-hands"),
        ("left_leg", "withdrawal"), ("right_leg", "withdrawal"),
    ]  # fmt: skip
    for trial in trials[:-2]:
        assert trial.responded, trial
        assert not trial.violations
        assert not trial.halts
        assert trial.first_motion_ms is not None
        assert trial.first_motion_ms <= 60.0, trial
    assert unanswered(tci.load_robot("nao-plain")) == ("left_bumper", "right_bumper")
    assert unanswered(tci.load_robot("nao-whole")) == ()


def test_no_finger_moves_into_whoever_presses_it_and_every_one_gives_way() -> None:
    """MuJoCo moves the hand as it is told; the tips of this one have taxels all around. Pressed on its outer
    side, where opening would press back, the finger gives way alone."""
    reflex, robot = FingerReflex(), tci.load_robot("allegro")
    (part,) = (one.name for one in robot.parts)
    body = tci.GenericBody(robot)
    hangs, model = reflex.relaxed(part, body), World(robot).model
    data, opened, alone = mujoco.MjData(model), 0, 0

    def place(patch: str, taxel: int, posture: Array) -> tuple[Array, Array]:
        told = GenericCommand(part, Mode.POSITION, posture)
        sent = to_platform(robot, told, position=initial_position(robot))
        for servo, angle in zip(sent.servos, sent.values, strict=True):
            data.joint(robot.servos[servo].joint).qpos = angle
        mujoco.mj_kinematics(model, data)
        link, surface = data.body(robot.patch(patch).link), body.skin.surfaces[patch]
        turned = link.xmat.reshape(3, 3)
        return link.xpos + turned @ surface.positions[taxel], turned @ surface.normals[taxel]

    for patch in (one.name for one in robot.skin if one.name.endswith("_tip")):
        for taxel in range(0, len(body.skin.surfaces[patch].positions), 7):
            hand = Hand(reflex, TouchedRobot(robot, posture={part: hangs}), part)
            hand.feel(1)
            goal = hand.feel(1, patch, taxel=taxel)[0].values
            start, outward = place(patch, taxel, hangs)
            ways = [hangs + share * (goal - hangs) for share in np.linspace(0.1, 1.0, 10)]
            assert all((place(patch, taxel, way)[0] - start) @ outward < 1e-4 for way in ways)
            away = (start - place(patch, taxel, goal)[0]) @ outward
            by_itself = "gives way with its" in reflex.notes(hand.memory)[0]  # type: ignore[arg-type]
            assert by_itself != np.allclose(goal, robot.part(part).initial_posture)
            assert away >= (1e-3 if by_itself else 0.0)
            opened, alone = opened + (not by_itself), alone + by_itself
    assert min(opened, alone) >= 5
