"""A light grasp closes a hand whose palm is touched, holds the object with the requested force, and opens at
a pull. Tested on every robot with hands, which have six motors, nine motors or one motor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tci
from helpers import made_hands
from helpers.made_hands import with_hands
from helpers.made_humanoid import MadeHumanoid
from helpers.pressing import RISE, press
from tci.capabilities.light_grasp import Grips, LightGrasp
from tci.errors import TciError
from tci.lab.authoring.proposal import propose
from tci.lab.experiments.grasp import try_grasp
from tci.messages import GenericCommand
from tci.robot.description import Robot
from tci.robot.generic_fingers import FLEXIONS
from tci.robot.xml import read_robot
from tci.robot.xml.writer import write_robot
from tci.simulation.held_ball import held_ball
from tci.simulation.world import World
from tci.testing import TouchedRobot

HANDS = ("icub-hands", "nao-hands", "g1-hands")
PART = "left_fingers"


def proposed(folder: Path, kind: str) -> Robot:
    """Returns a made robot with one kind of hand, as `tci new-robot --hand-skin` describes it."""
    # values of the maker; slow motors also push with full force
    motor = (1.0, 0.5) if kind == "inspire" else (2.0, 6.28)
    model = with_hands(MadeHumanoid(legs=False).urdf(folder), getattr(made_hands, kind)(), motor=motor)
    target = folder / "robot.xml"
    target.write_text(write_robot(propose(model, name="made", skin_on_hands=True), file=model.name))
    return read_robot(target)


class Felt:
    """A hand that is touched step by step, and the memory of the grasp."""

    def __init__(self, name: str) -> None:
        self.touched, self.grasp = TouchedRobot(name), LightGrasp(patience=0.05, quiet=0.1)
        self.memory: Grips = self.grasp.init(self.touched.body)
        self.last: GenericCommand | None = None

    def feel(self, times: int, patch: str | None = None, force: float = 2.0) -> GenericCommand | None:
        """Touches the robot `times` times and returns the last command for the left hand."""
        for _ in range(times):
            seen = self.touched.perceive(patch, force=force)
            commands, self.memory = self.grasp.step(self.memory, seen, self.touched.body)
            for command in commands:
                assert isinstance(command, GenericCommand)
                self.last = command if command.part == PART else self.last
        return self.last

    @property
    def closed(self) -> bool:
        return self.memory[PART].closed


@pytest.mark.parametrize("name", HANDS)
def test_a_touched_palm_closes_all_fingers_of_that_hand_and_no_touch_none(name: str) -> None:
    felt = Felt(name)
    assert felt.feel(10) is None
    command = felt.feel(10, "left_palm")
    assert command is not None
    has = [joint for joint in FLEXIONS if felt.touched.body.has_joint(PART)[joint]]
    rest = felt.touched.robot.part(PART).initial_posture
    assert np.all(command.values[has] > rest[has] + 0.02)
    assert not felt.memory["right_fingers"].closed


@pytest.mark.parametrize(
    ("name", "finger", "stays", "go_on"),
    [
        ("icub-hands", "index", (3,), (1, 5, 7, 9)),
        # one motor moves the little finger together with the ring finger
        ("icub-hands", "little", (7, 9), (1, 3, 5)),
        ("nao-hands", "thumb", (1, 3, 5), ()),
        ("g1-hands", "index", (3,), (1, 5)),
    ],
)
def test_a_finger_that_presses_enough_waits_with_those_on_its_motor(
    name: str, finger: str, stays: tuple[int, ...], go_on: tuple[int, ...]
) -> None:
    felt = Felt(name)
    felt.feel(5, "left_palm")
    before = felt.memory[PART].flexion
    felt.feel(3, f"left_{finger}_tip", force=2.0)
    change = felt.memory[PART].flexion - before
    assert np.all(change[list(stays)] < 0.0)
    assert np.all(change[list(go_on)] > 0.0)


@pytest.mark.parametrize("name", HANDS)
def test_a_pull_opens_and_the_next_touch_closes_again(name: str) -> None:
    felt = Felt(name)
    felt.feel(5, "left_palm")
    felt.feel(2, "left_thumb_tip", force=1.0)
    assert felt.closed
    # the object has left the palm but still touches the thumb
    command = felt.feel(5, "left_thumb_tip", force=1.0)
    assert not felt.closed
    assert command is not None
    np.testing.assert_array_equal(command.values, felt.touched.robot.part(PART).initial_posture)
    felt.feel(10)
    felt.feel(2, "left_palm")
    assert felt.closed


@pytest.mark.parametrize("name", HANDS)
def test_a_hand_begins_to_close_without_pressing_on_what_touches_its_palm(name: str) -> None:
    robot = tci.load_robot(name)
    world = World(robot, skin=[patch.name for patch in robot.patches if patch.part == PART])
    center = len(world.surfaces["left_palm"].positions) // 2
    told = press(world, "left_palm", center, LightGrasp(), depth=0.004)
    assert told.answered
    assert told.rise <= RISE


@pytest.mark.parametrize("name", HANDS)
def test_nothing_left_in_the_hand_opens_it(name: str) -> None:
    felt = Felt(name)
    felt.feel(5, "left_palm")
    felt.feel(10)
    assert not felt.closed


def test_settings_that_do_not_fit_are_refused() -> None:
    with pytest.raises(TciError, match=r"pull 0\.5; valid: above the force of 1"):
        LightGrasp(pull=0.5)
    with pytest.raises(TciError, match="speed 0"):
        LightGrasp(speed=0.0)


@pytest.mark.parametrize(
    ("name", "presses"),
    [("nao-hands", "thumb"), ("icub-hands", "index middle ring"), ("g1-hands", "thumb index middle"),
     ("g1-inspire", "thumb index middle ring"),
     ("franka-hand", "thumb index"), ("allegro", "thumb index middle ring"),
     ("inspire", "thumb index middle"),
     ("shadow", "thumb index middle ring little"), ("dex3", "thumb index middle")],
)  # fmt: skip
def test_a_ball_in_the_palm_is_held_with_one_newton_by_each_finger_and_let_go_on_a_pull(
    name: str, presses: str, tmp_path: Path
) -> None:
    robot = tci.load_robot(name) if "-" in name else proposed(tmp_path, name)
    grasp = try_grasp(robot, PART)
    assert not grasp.refused
    assert " ".join(grasp.forces) == presses
    assert [*grasp.forces.values()] == pytest.approx([1.0] * len(grasp.forces), abs=0.15)
    assert grasp.opened


def test_a_hand_without_skin_or_without_room_for_a_ball_is_named(tmp_path: Path) -> None:
    robot = tci.load_robot("g1-hands")
    bare = robot.model_copy(update={"patches": ()})
    with pytest.raises(TciError, match="left_fingers of g1-hands: no skin on its palm; valid: a patch"):
        held_ball(bare, PART)
    only_palm = tuple(patch for patch in robot.patches if patch.name == "left_palm")
    with pytest.raises(TciError, match="its fingers meet no ball on its palm"):
        held_ball(robot.model_copy(update={"patches": only_palm}), PART)
