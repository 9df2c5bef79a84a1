"""Senders that send frames only on change: the perceptions are equal bit for bit to those of a constant frame
rate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tci
from helpers.felt_skin import FeltSkin, PatchFelt, patches
from tci.errors import FrameError, TciError
from tci.messages import JointReading, Perception, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.runtime.loop import Tick, run
from tci.skin.send_on_delta import HoldLast, SendOnDelta
from tci.skin.skin import Skin

KEEP_ALIVE = 0.5
RATE = 64.0
"""Frames per second. The times of the frames are exact in binary, so the sums in sender and receiver are
equal."""
PACKAGED = load_robot("nao")
NAO = PACKAGED.model_copy(
    update={"patches": tuple(patch.model_copy(update={"rate": RATE}) for patch in PACKAGED.patches)}
)

SKIN = Skin(NAO)
PATCHES = [patch.name for patch in NAO.patches]


def sensor(robot: Robot, seed: int, seconds: float) -> list[tuple[SkinFrame, ...]]:
    """Yields the readings of all patches with long rests, touches, flicker, and values that are NaN."""
    random = np.random.default_rng(seed)
    values = {patch.name: np.full(patch.channels, 240.0) for patch in robot.patches}
    frames = []
    for k in range(int(seconds * RATE)):
        row = []
        for name, now in values.items():
            if random.random() < 0.05:
                now = values[name] = np.full(len(now), 240.0)
                start = random.integers(len(now))
                now[start : start + 12] = random.integers(0, 256)
                if random.random() < 0.2:
                    now[random.integers(len(now))] = np.nan
            row.append(SkinFrame(name, k / RATE, k, read_only(now)))
        frames.append(tuple(row))
    return frames


def same(one: Perception, other: Perception) -> bool:
    words = ("patch", "identity")
    arrays = (
        "force",
        "peak",
        "area",
        "u",
        "theta",
        "onset",
        "displacement",
        "taxels",
        "taxel_forces",
        "p_L",
        "n_L",
        "p_T",
        "n_T",
        "f_T",
        "taxel_u",
        "taxel_theta",
    )
    return len(one.contacts) == len(other.contacts) and all(
        all(getattr(a, f) == getattr(b, f) for f in words)
        and all(np.array_equal(getattr(a, f), getattr(b, f), equal_nan=True) for f in arrays)
        for a, b in zip(one.contacts, other.contacts, strict=True)
    )


def felt(seen: Perception) -> dict[str, PatchFelt]:
    assert seen.skin is not None
    return patches(SKIN, seen.skin)


# each seed simulates 4 s of noise on all patches; further seeds show no further cases
@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_what_is_perceived_is_the_same(seed: int) -> None:
    body = tci.GenericBody(NAO)
    clocked, eventful = tci.Perceiver(body), tci.Perceiver(body, keep_alive=KEEP_ALIVE)
    sender, latest = SendOnDelta(KEEP_ALIVE), {}
    sent = every = 0
    random = np.random.default_rng(seed)
    position = np.array(initial_position(NAO))
    for k, frames in enumerate(sensor(NAO, seed, 4.0)):
        position = position + random.normal(0.0, 0.01, len(position))
        joints = JointReading(k / RATE, k, position, np.zeros(len(position)))
        chosen = sender.select(frames)
        latest.update({frame.patch: frame for frame in chosen})
        sent, every = sent + len(chosen), every + len(frames)
        one = clocked.step(Reading(joints, frames), k / RATE)
        other = eventful.step(Reading(joints, tuple(latest.values())), k / RATE)
        assert same(one, other)
        for name, state in felt(one).items():
            twin = felt(other)[name]
            assert (state.sequence, state.stamp) == (twin.sequence, pytest.approx(twin.stamp))
            np.testing.assert_array_equal(state.pressure, twin.pressure)
            np.testing.assert_array_equal(state.force, twin.force)
            np.testing.assert_array_equal(state.masked, twin.masked)
    assert clocked.health == eventful.health
    assert sent < every / 2


def test_the_reflex_does_the_same_on_an_event_driven_skin() -> None:
    """A simulated poke causes equal commands at equal times."""

    def commands(keep_alive: float | None) -> list[tuple[float, str, list[float]]]:
        seen: list[tuple[float, str, list[float]]] = []

        def note(tick: Tick) -> None:
            seen.extend((tick.now, c.part, c.values.tolist()) for c in tick.commands)
            seen.append((tick.now, "sent", tick.sent.position.tolist()))

        with tci.connect(NAO, "sim", keep_alive=keep_alive) as link:
            link.world.finger.poke("left_forearm", 100)
            run(link, tci.WithdrawalReflex(), duration=0.4, observe=note)
        return seen

    clocked = commands(None)
    assert any(part == "left_arm" for _, part, _ in clocked)
    assert commands(0.2) == clocked


def test_unchanged_patches_are_only_counted() -> None:
    skin = FeltSkin(NAO)
    held = HoldLast(NAO, 60.0)
    frames = tuple(
        SkinFrame(p.name, 0.0, 0, read_only(np.full(p.channels, p.sensor.rest))) for p in NAO.patches
    )
    noted = np.zeros(len(NAO.patches), int)
    for k in range(60):
        skin.conditioner.step(held.fill(frames, k / RATE))
        noted += skin.conditioner._memory.patches["repeats"] <= 0
    # Three frames until the values have settled, and two frames after the shorter first window of some
    # patches.
    assert noted.max() <= 5


def test_a_dead_patch_goes_no_further_than_its_keep_alive() -> None:
    filled = HoldLast(NAO, KEEP_ALIVE)
    frame = SkinFrame("left_forearm", 10.0, 7, read_only(np.zeros(240)))
    for now, expected in ((10.0, 7), (10.015, 7), (10.016, 8), (10.25, 23), (10.5, 39), (99.0, 39)):
        (latest,) = filled.fill((frame,), now)
        assert latest.sequence == expected, now
        assert latest.stamp == pytest.approx(10.0 + (expected - 7) / RATE)
        assert latest.values is frame.values
    assert filled.fill((frame,), 10.1)[0].sequence == 39  # never back in time


@pytest.mark.parametrize("keep_alive", [None, KEEP_ALIVE])
@pytest.mark.parametrize("stamp", [np.nan, np.inf, -np.inf])
def test_a_frame_whose_stamp_is_no_time_is_refused_and_changes_nothing(
    keep_alive: float | None, stamp: float
) -> None:
    perceiver = tci.Perceiver(tci.GenericBody(NAO), keep_alive=keep_alive)
    still = JointReading(0.0, 0, np.array(initial_position(NAO)), np.zeros(len(NAO.servos)))
    values = read_only(np.full(240, 240.0))
    good = SkinFrame("left_forearm", 1.0, 1, values)
    perceiver.step(Reading(still, (good,)), 1.0)
    with pytest.raises(FrameError, match=f"left_forearm: a frame stamped {stamp} s; valid: a finite time"):
        perceiver.step(Reading(still, (SkinFrame("left_forearm", stamp, 2, values),)), 1.01)
    assert perceiver.step(Reading(still, (good,)), 1.01).skin.stamp[0] >= 1.0


def test_a_frame_that_was_refused_is_not_repeated() -> None:
    perceiver = tci.Perceiver(tci.GenericBody(NAO), keep_alive=KEEP_ALIVE)
    joints = JointReading(0.0, 0, np.array(initial_position(NAO)), np.zeros(len(NAO.servos)))
    rest = np.full(240, 240.0)

    def step(stamp: float, sequence: int, values: np.ndarray, now: float) -> tuple[float, int]:
        frame = SkinFrame("left_forearm", stamp, sequence, read_only(values))
        state = perceiver.step(Reading(joints, (frame,)), now).skin
        place = PATCHES.index("left_forearm")
        return float(state.stamp[place]), int(state.sequence[place])

    assert step(0.0, 0, rest, 0.0) == (0.0, 0)
    with pytest.raises(FrameError, match="shape"):
        step(0.25, 16, rest[1:], 0.25)
    assert step(0.25, 16, rest, 0.25) == (0.25, 16)  # this frame is sent again, as required
    with pytest.raises(FrameError, match="shape"):
        step(9.0, 99, rest[1:], 0.3)
    assert step(0.25, 16, rest, 0.375) == (0.375, 24)  # the last valid frame is repeated


def test_a_buffer_that_is_written_again_is_a_new_frame() -> None:
    skin = FeltSkin(NAO)
    buffer = np.full(240, 240.0)
    joints = JointReading(0.0, 0, np.array(initial_position(NAO)), np.zeros(len(NAO.servos)))
    for k in range(6):
        skin.update(Reading(joints, (SkinFrame("left_forearm", k / RATE, k, buffer),)))
    buffer[:20] = 100.0
    state = skin.update(Reading(joints, (SkinFrame("left_forearm", 0.2, 9, buffer),)))
    assert state["left_forearm"].pressure.max() > 0.0


@pytest.mark.parametrize("seconds", [0.0, -1.0, math.inf, math.nan])
def test_a_keep_alive_that_is_none_is_an_error(seconds: float) -> None:
    with pytest.raises(TciError, match="above 0 and finite"):
        SendOnDelta(seconds)
    with pytest.raises(TciError, match="above 0 and finite"):
        tci.Perceiver(tci.GenericBody(NAO), keep_alive=seconds)
