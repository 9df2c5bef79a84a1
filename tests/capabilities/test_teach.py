"""Teaching by touch (judge: `helpers.taught`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tci
from helpers import taught
from helpers.squeezed import squeeze
from helpers.squeezes import draw
from helpers.taught import ends_with_a_tap, guide, hands_apart
from tci.capabilities import ArbiterMemory, Companion, Feel, Layer, Motion
from tci.capabilities.teach.guide import guided
from tci.cli.lesson import expect_lesson, save_lesson
from tci.errors import CommandError, TciError
from tci.gestures import Gesture, fit, read_csv
from tci.messages import ExpectContact, GenericCommand, Met, Mode, SwitchMode
from tci.messages.frames import Array
from tci.runtime.loop import Tick, run
from tci.testing import TouchedRobot


@pytest.mark.parametrize(
    ("name", "seed", "other"),
    [("nao", 5, "icub"), ("icub", 2, "nao"), ("g1", 2, "talos"), ("franka", 11, "nao")],
)
def test_a_guided_arm_goes_along_lightly_and_repeats_it(name: str, seed: int, other: str) -> None:
    seen = guide(name, seed)
    assert seen is not None
    assert seen.median <= 5.0
    assert seen.high <= 8.0
    assert seen.kept >= 0.95
    assert seen.peak > 2.0, "it was pushed"
    assert seen.tapped
    assert seen.off <= 2.0
    assert seen.state == "RUN"
    assert seen.gesture is not None
    assert hands_apart(seen.gesture, name, other) <= 10.0


@pytest.mark.parametrize(("name", "seed"), [("icub", 2), ("g1", 5)])
def test_in_a_slow_loop_a_hand_is_pressed_with_no_more_than_12_newtons(name: str, seed: int) -> None:
    """Readings and commands come every 40 ms, and commands up to three periods late."""
    seen = guide(name, seed, repeat=False, slow=25.0)
    assert seen is not None
    assert 2.0 < seen.high <= 12.0
    assert seen.kept >= 0.95
    assert seen.state == "RUN"


@pytest.mark.parametrize(("name", "seed", "rate"), [("g1", 2, 50.0), ("alex", 3, 25.0)])
def test_an_arm_that_lost_its_hand_may_go_on_for_as_long_as_its_commands_are_late(
    name: str, seed: int, rate: float
) -> None:
    """Its motion against its newest command stopped the robot, and the G1 then pressed the hand with 50 N."""
    seen = guide(name, seed, repeat=False, slow=rate)
    assert seen is not None
    assert seen.state == "RUN"
    assert seen.kept < 0.9, "the hand was lost for a while"
    assert seen.high <= 12.0


def test_a_finger_that_springs_back_in_a_slow_loop_stops_no_robot() -> None:
    """A hand on a finger slid off: 30 degrees in 20 ms were called a jump of the encoder."""
    seen = guide("g1-inspire", 3009, repeat=False, slow=50.0)
    assert seen is not None
    assert seen.state == "RUN"


def test_a_hand_that_pushes_an_arm_on_beside_its_body_stops_no_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge counts such a push only if it ended in a stop: a NAO's did, since its motor gave in."""
    pushes, states = [0.0], []

    def watched(driver: tci.Driver, *given: Any, observe: Callable[[Tick], None], **named: Any) -> Any:
        def see(tick: Tick) -> None:
            pushes.extend(one.force for one in tick.perception.contacts)
            observe(tick)

        result = run(driver, *given, observe=see, **named)
        states.append(result.state.name)
        return result

    monkeypatch.setattr(taught, "run", watched)
    guide("nao", 2001, repeat=False)
    assert max(pushes) > 15.0, "somebody pushes harder than the arm handles"
    assert states == ["RUN"]


def test_nobody_stays_squeezed_by_an_arm_that_repeats_a_lesson() -> None:
    """Somebody who can't give way, before an arm on its way after a tap; without the gate's answer they bear
    21 N for ever. Bars of somebody in the way."""
    robot = tci.load_robot("nao")
    met = squeeze(robot, replace(draw(robot, 1, by="gesture"), by="lesson"))
    assert met.peak > 15.0
    assert met.half <= 65.0
    assert met.over <= 0.2
    assert met.late <= 15.0
    assert met.state == "RUN"


def test_nobody_is_pressed_harder_by_a_guided_arm() -> None:
    """A touched place moves into whoever touches it only to lower a larger force elsewhere, up to 15 N."""
    robot, second, random = TouchedRobot("icub"), TouchedRobot("icub"), np.random.default_rng(0)
    loaded = 0
    for _ in range(60):
        first, other = random.uniform(1.0, 25.0, 2)
        seen = robot.perceive("left_forearm", taxel=int(random.integers(200)), force=float(first))
        more = second.perceive("left_upper_arm", taxel=int(random.integers(200)), force=float(other))
        contacts = [*seen.contacts, *more.contacts]
        if len(contacts) < 2:
            continue
        rates = guided(
            Feel(), 15.0, "left_arm", contacts, random.uniform(-0.5, 0.5, 5), 0.02, seen, robot.body
        )
        force = np.array([one.force for one in contacts])
        into = np.array([robot.body.jacobian(seen, one).T @ one.n_T for one in contacts])
        if np.linalg.matrix_rank(into, tol=0.05) < len(contacts):
            continue
        most = np.maximum(np.minimum(force.max(), 15.0) - force, 0.0) / Feel().damping
        assert (into @ rates <= most + 0.01).all()
        assert into[int(force.argmax())] @ rates <= 0.01
        loaded += int((into @ rates > 0.01).any())
    assert loaded > 3, "some were loaded to lower a larger force"


class Scene:
    """A robot that goes where it is told at once, in steps of 20 ms, and is touched as a test says."""

    def __init__(self, name: str, capability: tci.Capability[Any]) -> None:
        self.robot, self.capability = TouchedRobot(name), capability
        self.body = self.robot.body
        self.memory: Any = capability.init(self.body)
        self.posture: dict[str, Array] = {}
        self.orders: list[Any] = []
        self.met: tuple[Met, ...] = ()
        for order in capability.begin(self.robot.perceive(), self.body):
            assert isinstance(order, SwitchMode)

    def touch(self, patch: str | None, seconds: float, force: float = 3.0, turn: Array | None = None) -> None:
        """A touch; whoever holds a soft arm leads it by `turn` [rad/s]."""
        for _ in range(round(seconds / 0.02)):
            seen = replace(self.robot.perceive(patch, force=force), met=self.met)
            for part, angles in self.posture.items():
                seen.posture[part] = angles  # type: ignore[index]
            given, self.memory = self.capability.step(self.memory, seen, self.body)
            self.orders += given
            for order in given:
                if isinstance(order, GenericCommand) and order.mode in (Mode.VELOCITY, Mode.IMPEDANCE):
                    here, limit = (
                        seen.posture[order.part],
                        0.02 * (np.inf if order.speed is None else order.speed),
                    )
                    way = 0.02 * order.values if order.mode is Mode.VELOCITY else order.values - here
                    self.posture[order.part] = here + np.clip(way, -limit, limit)
            if turn is not None and patch is not None:
                part = self.body.robot.patch(patch).part
                self.posture[part] = self.posture.get(part, seen.posture[part]) + 0.02 * turn

    def tap(self, patch: str, count: int = 1) -> None:
        for _ in range(count):
            self.touch(patch, 0.1, force=2.0)
            self.touch(None, 0.2)
        self.touch(None, 0.5)


def test_a_lesson_is_repeated_corrected_and_corrections_are_taken_back() -> None:
    scene = Scene("g1", tci.Teach())
    scene.touch(None, 0.1)
    assert scene.capability.claims(scene.memory) == set()
    scene.touch("left_forearm", 1.0)
    assert scene.capability.claims(scene.memory) == {"left_arm"}
    assert any("guided" in note for note in scene.capability.notes(scene.memory))
    scene.touch(None, 1.0)
    end = scene.posture["left_arm"]
    scene.tap("left_forearm")
    assert scene.memory.motion is None, "a poke of the guided arm is no end"
    scene.tap("right_forearm")
    motion = scene.memory.motion
    assert motion.parts == ("left_arm",)
    assert 0.8 < motion.duration < 1.2
    scene.touch(None, 4.0)
    np.testing.assert_allclose(scene.posture["left_arm"], motion.at(motion.duration)["left_arm"], atol=0.02)
    np.testing.assert_allclose(scene.posture["left_arm"], end, atol=0.05)
    scene.tap("left_forearm", 2)  # again
    scene.touch(None, 1.0)
    while scene.memory.played < 0.5:
        scene.touch(None, 0.02)
    scene.touch("left_forearm", 1.0)
    assert scene.memory.played < 0.6, "it waits while it is held"
    led = scene.posture["left_arm"]
    scene.touch(None, 0.1)
    (one,) = scene.memory.motion.corrections
    np.testing.assert_allclose(
        scene.memory.motion.at(one.time)["left_arm"], scene.posture["left_arm"], atol=0.05
    )
    assert np.abs(led - motion.at(one.time)["left_arm"]).max() > 0.1
    scene.touch(None, 3.0)
    scene.tap("right_forearm", 3)
    assert scene.memory.motion.corrections == ()


def test_an_arm_that_met_somebody_while_it_plays_waits_for_a_tap() -> None:
    """It went on into the same person as soon as the gate let it, until the third time stopped the robot."""
    scene = Scene("g1", tci.Teach())
    scene.touch("left_forearm", 1.0)
    scene.touch(None, 0.5)
    scene.tap("right_forearm")
    while scene.memory.played < 0.5:
        scene.touch(None, 0.02)
    scene.met = (Met("left_arm", 0.0, "left_elbow_joint", 0.1, "retreat"),)
    scene.touch(None, 0.02)
    assert any("tap again" in note for note in scene.capability.notes(scene.memory))
    scene.met = ()
    scene.orders.clear()
    scene.touch(None, 1.0)
    assert not [one for one in scene.orders if isinstance(one, GenericCommand) and one.values.any()]
    scene.tap("right_forearm")
    scene.touch(None, 4.0)
    assert scene.memory.played > 0.5


def test_a_lesson_is_written_as_a_gesture(tmp_path: Path) -> None:
    scene, path = Scene("g1", tci.Teach()), tmp_path / "wave.csv"
    assert save_lesson(scene.memory, scene.body.robot, path) is None
    scene.touch("left_forearm", 1.0)
    scene.touch(None, 0.5)
    scene.tap("right_forearm")
    expect_lesson(tci.Teach(), path)
    written = save_lesson(scene.memory, scene.body.robot, path)
    assert written is not None
    np.testing.assert_allclose(
        read_csv(path)[0].postures["left_arm"], written.postures["left_arm"], atol=1e-6
    )
    layers = ArbiterMemory((Layer(None), Layer(scene.memory)))
    assert save_lesson(layers, scene.body.robot, tmp_path / "layers.csv") is not None
    expect_lesson(Companion(), tmp_path / "companion.csv")
    with pytest.raises(CommandError, match=r"wave\.csv exists"):
        expect_lesson(tci.Teach(), path)
    with pytest.raises(CommandError, match=r"valid: tci run teach ROBOT --lesson FILE"):
        expect_lesson(tci.WithdrawalReflex(), tmp_path / "other.csv")


def test_a_companion_names_the_setting_that_was_wrong() -> None:
    for force in (0.5, 50.0, np.nan):
        with pytest.raises(TciError, match=r"companion: lightly .*; valid: 1 to 30"):
            Companion(lightly=force)


def test_whoever_presses_too_hard_gets_the_reflex() -> None:
    layers = tci.Arbiter([tci.Teach(), tci.WithdrawalReflex()])
    scene = Scene("icub", layers)
    scene.touch("left_forearm", 1.0, force=6.0)
    assert "left_arm" in layers.layers[0].claims(scene.memory.layers[0].memory)
    assert max(one.force for one in scene.orders if isinstance(one, ExpectContact)) <= 15.0
    assert not any(isinstance(one, GenericCommand) and one.mode is Mode.POSITION for one in scene.orders)
    scene.orders.clear()
    here = scene.posture["left_arm"]
    scene.touch("left_forearm", 0.2, force=20.0)
    moves = [one for one in scene.orders if isinstance(one, GenericCommand)]
    assert {one.mode for one in moves} == {Mode.POSITION}
    assert 0.05 < np.abs(moves[0].values - here).max() < 1.5, "from where it is now"
    assert any("more than 15 N" in note for note in layers.notes(scene.memory))


def test_what_a_hand_shows_while_it_presses_too_hard_is_taught_too() -> None:
    """Near a joint's limit or a shoulder's singular posture an arm can't go along as fast as its hand."""
    scene = Scene("g1", tci.Teach())
    scene.touch("left_forearm", 1.0)
    given_away = scene.posture["left_arm"]
    scene.touch("left_forearm", 0.4, force=20.0, turn=np.array([-0.4, 0.0, 0.0, 0.0, 0.0]))
    end = scene.posture["left_arm"]
    assert np.abs(end - given_away).max() > 0.1
    scene.touch(None, 1.2)
    scene.tap("right_forearm")
    motion = scene.memory.motion
    np.testing.assert_allclose(motion.at(motion.duration)["left_arm"], end, atol=0.02)
    pushed = Scene("g1", tci.Teach())
    pushed.touch("left_forearm", 1.0, force=20.0, turn=np.array([-0.4, 0.0, 0.0, 0.0, 0.0]))
    pushed.touch(None, 1.2)
    pushed.tap("right_forearm")
    assert pushed.memory.motion is None, "it was never guided"


@pytest.mark.parametrize(("patch", "part"), [("left_hand", "left_arm"), ("head", "head")])
def test_a_plain_nao_is_soft_while_its_hand_or_head_is_held(patch: str, part: str) -> None:
    scene = Scene("nao-plain", tci.Teach())
    turn = np.full(scene.body.robot.part(part).initial_posture.shape, 0.2)
    scene.touch(patch, 1.2, turn=turn)
    soft = [
        one.values for one in scene.orders if isinstance(one, GenericCommand) and one.mode is Mode.STIFFNESS
    ]
    assert [float(one.max()) for one in soft] == [0.2]
    assert {one.part for one in scene.orders} == {part}
    scene.orders.clear()
    scene.touch(None, 0.4)
    stiff = [
        one.values for one in scene.orders if isinstance(one, GenericCommand) and one.mode is Mode.STIFFNESS
    ]
    assert [float(one.min()) for one in stiff] == [1.0]
    end = scene.posture[part]
    scene.tap("right_hand")
    scene.touch(None, 4.0)
    assert scene.memory.motion.parts == (part,)
    np.testing.assert_allclose(scene.posture[part], end, atol=0.03)


def test_the_end_of_a_lesson_is_recognised() -> None:
    """Taps of persons whose pace differs by four times; and nothing that they do before ends it."""
    ended = [ends_with_a_tap("nao", number) for number in range(12)]
    assert ended.count(True) == 12


def test_a_taught_motion_is_a_gesture_for_any_robot() -> None:
    body = tci.GenericBody("talos")
    start = body.robot.part("right_arm").initial_posture
    angles = [start + 0.4 * np.sin(0.05 * k) * np.array([1, 0.5, 0, 1, 0]) for k in range(100)]
    motion = Motion.of([0.02 * k for k in range(100)], {"right_arm": angles})
    gesture = motion.gesture(body)
    own = fit("talos", gesture).gesture.postures["right_arm"]
    np.testing.assert_allclose(own, motion.taught.postures["right_arm"][: len(own)], atol=np.deg2rad(1.0))
    teach = tci.Teach(gesture=gesture)
    assert teach.init(tci.GenericBody("nao-plain")).motion is not None
    assert isinstance(gesture, Gesture)
    with pytest.raises(TciError, match=r"teach: most 40.0; valid: 1 to 30"):
        tci.Teach(most=40.0)
    with pytest.raises(TciError, match=r"less than 0.2 s"):
        Motion.of([0.0], {"right_arm": [start]})
