"""Skin faults on head, torso or leg, with the whole-body withdrawal; `test_reflex_under_faults` has the arms.
The names of the tests contain the number of the fault."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.body_withdrawal import BodyMemory, BodyWithdrawal
from tci.capabilities.fields import BodyField, default_body_fields
from tci.capabilities.wrapper import CapabilityWrapper
from tci.gate.gate import GateSettings, GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.messages import JointReading, Order, Perception, Reading, SkinFrame
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run
from tci.testing import FakeDriver

LEARNT = 5.0
"""Time [s] after which noise and rest values are estimated."""
RATE = 25.0
"""Rate [Hz] of commands and frames. The rate is low because minutes are simulated."""
FIELDS = {one.name: one for one in default_body_fields().field}
PLACES: Mapping[str, tuple[str, str, BodyField]] = {
    "head": ("head", "head_skin", FIELDS["face"]),
    "torso": ("torso", "torso_skin", FIELDS["chest"]),
    "leg": ("left_leg", "left_shank", FIELDS["shank_front"]),
}
"""Part, patch and field, by kind of part. The patch is the first one of the robot, so the injectors change
this patch."""
JUST_FELT = 40.0
"""Amplitude [counts] of a touch to which the reflex responds."""


def wearing(kind: str) -> Robot:
    """Returns an iCub that has only the skin of one place."""
    robot = tci.load_robot("icub-whole")
    binding = robot.binding("sim").model_copy(update={"rate": RATE})
    return robot.model_copy(
        update={"patches": (robot.patch(PLACES[kind][1]),), "bindings": (binding,), "digest": kind}
    )


class NoisyBody(FakeDriver):
    """An iCub that reaches commanded angles immediately. Its skin has noise of one count. `touches` are the
    times [s] of presses on the middle of the field, each of which lasts half a second."""

    def __init__(self, kind: str, touches: tuple[float, ...] = ()) -> None:
        # The check for self-collision takes most of the computing time, and has no effect here.
        super().__init__(wearing(kind), settings=GateSettings(self_collision=None))
        self.random, self.touches = np.random.default_rng(3), touches
        part, patch, place = PLACES[kind]
        body = GenericBody(self.robot)
        surface = body.skin.surfaces[patch]
        near = np.linalg.norm(surface.positions - body.landmark(part, place.landmark).p_L, axis=1) < 0.015
        self.pressed = surface.channels[near]

    def frames(self, now: float, sequence: int) -> list[SkinFrame]:
        (patch,) = self.robot.patches
        values = patch.sensor.rest + self.random.standard_normal(patch.channels)
        if any(begin <= now < begin + 0.5 for begin in self.touches):
            values[self.pressed] += JUST_FELT * np.sign(patch.sensor.pascal_per_count)
        values = np.clip(np.rint(values), patch.sensor.lowest, patch.sensor.highest)
        return [SkinFrame(patch.name, now, sequence, values)]


class Counted(CapabilityWrapper[BodyMemory]):
    """The whole-body withdrawal. It also records the times [s] at which each part began to respond."""

    def __init__(self) -> None:
        super().__init__(BodyWithdrawal(stance="supported"))
        self.answers: list[tuple[float, str]] = []

    def step(
        self, memory: BodyMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], BodyMemory]:
        orders, after = super().step(memory, perception, body)
        self.answers += [(perception.stamp, part) for part in after if part not in memory]
        return orders, after


def felt(
    kind: str, fault: str, duration: float, *touches: float, lasts: float = np.inf
) -> tuple[Array, list[Tick]]:
    """Returns the times [s] after the fault at which the part responded, and all periods. The fault begins at
    LEARNT."""
    ticks: list[Tick] = []
    reflex = Counted()
    driver = NoisyBody(kind, tuple(LEARNT + touch for touch in touches))
    run(
        FaultInjector(driver, [FaultPlan(fault, LEARNT, lasts)]),
        reflex,
        duration=LEARNT + duration,
        observe=ticks.append,
    )
    assert {part for _, part in reflex.answers} <= {PLACES[kind][0]}
    return np.array([stamp - LEARNT for stamp, _ in reflex.answers if stamp > LEARNT - 1.0]), ticks


def states(ticks: list[Tick]) -> set[GateState]:
    return {tick.sent.state for tick in ticks}


@pytest.mark.parametrize("kind", ["torso"])
def test_01_a_taxel_that_sticks_high_is_answered_once_at_most(kind: str) -> None:
    answers, ticks = felt(kind, "taxel-stuck-high", 84.0, 80.0)
    assert len(answers) <= 2
    assert answers[-1] == pytest.approx(80.0, abs=0.1), "the touch is felt beside it"
    assert states(ticks) == {GateState.RUN}


@pytest.mark.parametrize("kind", PLACES)
def test_03_a_dead_patch_stops_the_robot_since_its_fields_are_blind(kind: str) -> None:
    answers, ticks = felt(kind, "dead-patch", 62.0)
    last = ticks[-1].sent
    assert last.state is GateState.STOP
    assert "is blind: 0% of its taxels are healthy; valid: 50% or more" in str(last.reason)
    assert PLACES[kind][0] in str(last.reason)
    assert len(answers) <= 1


@pytest.mark.parametrize(
    ("kind", "fault"),
    [("head", "out-of-order"), ("torso", "duplicates"), ("leg", "clock-jump"), ("head", "nan-taxel")],
)
def test_04_11_12_13_a_touch_is_answered_once(kind: str, fault: str) -> None:
    answers, ticks = felt(kind, fault, 6.0, 3.0)
    assert answers == pytest.approx([3.0], abs=0.1)
    assert states(ticks) == {GateState.RUN}


@pytest.mark.parametrize("kind", ["leg"])
def test_05_saturated_taxels_are_one_touch_with_a_bounded_answer(kind: str) -> None:
    answers, ticks = felt(kind, "saturated-taxel", 20.0)
    assert len(answers) <= 1
    assert states(ticks) == {GateState.RUN}
    robot = wearing(kind)
    moved = np.ptp([tick.reading.joints.position for tick in ticks], axis=0)
    part, _, place = PLACES[kind]
    most = max(abs(angle) for angle in place.motion)
    servos = [joint.servo for joint in robot.part(part).servos if joint.servo is not None]
    assert moved[servos].max() <= most + 1e-6


@pytest.mark.parametrize("kind", ["head"])
def test_07_a_step_of_the_baseline_is_answered_once(kind: str) -> None:
    answers, ticks = felt(kind, "baseline-step", 54.0, 50.0)
    assert len(answers) <= 2
    assert answers[-1] == pytest.approx(50.0, abs=0.1), "and a touch is felt again"
    quiet = [tick for tick in ticks if LEARNT + 40.0 < tick.now < LEARNT + 50.0]
    assert not any(tick.perception.contacts for tick in quiet)


@pytest.mark.parametrize("name", ["nao-whole", "icub-whole"])
def test_07_the_weight_of_a_robot_that_stands_is_no_step_of_the_baseline(name: str) -> None:
    """While the robot stands, its weight presses the whole sole. A leg with this weight must not be treated
    as a hanging leg."""
    robot, random = tci.load_robot(name), np.random.default_rng(5)
    body, reflex = GenericBody(robot), BodyWithdrawal(stance="supported")
    soles = [patch for patch in robot.patches if patch.name.endswith("_sole")]
    position = np.zeros(len(robot.servos))
    perceiver, memory, frequency = Perceiver(body), reflex.init(body), 20.0
    for tick in range(int(150.0 * frequency)):
        now = tick / frequency
        frames = []
        for patch in soles:
            weight = np.resize([60.0, 55.0, 65.0, 58.0], patch.channels) if now > 5.0 else 0.0
            counts = weight + 0.5 * random.standard_normal(patch.channels)
            sign = np.sign(patch.sensor.pascal_per_count)
            raw = np.clip(
                np.rint(patch.sensor.rest + sign * counts), patch.sensor.lowest, patch.sensor.highest
            )
            frames.append(SkinFrame(patch.name, now, tick, raw))
        joints = JointReading(now, tick, position, position)
        seen = perceiver.step(Reading(joints, tuple(frames)), now)
        orders, memory = reflex.step(memory, seen, body)
        assert not orders, f"a leg moves at {now} s"
        if now > 5.0:
            assert {contact.part for contact in seen.contacts} == {"left_leg", "right_leg"}, f"at {now} s"


@pytest.mark.parametrize("kind", ["leg"])
def test_10_skin_that_falls_silent_makes_the_robot_hold(kind: str) -> None:
    _, ticks = felt(kind, "skin-silent", 2.0, lasts=1.0)
    silent = [tick for tick in ticks if tick.sent.state is GateState.HOLD]
    assert silent[0].now - LEARNT == pytest.approx(0.25, abs=0.05)
    assert ticks[-1].sent.state is GateState.RUN


@pytest.mark.parametrize("kind", ["torso"])
def test_27_a_touch_during_a_withdrawal_is_the_same_one_and_the_limits_hold(kind: str) -> None:
    answers, ticks = felt(kind, "duplicates", 6.0, 1.0, 1.3, 4.0)
    assert answers == pytest.approx([1.0, 4.0], abs=0.1)
    robot = wearing(kind)
    for sent in (tick.sent for tick in ticks if tick.sent.servos.size):
        limits = np.array([robot.servos[servo].limits.velocity for servo in sent.servos], dtype=float)
        assert (np.abs(sent.velocity) <= limits).all()
