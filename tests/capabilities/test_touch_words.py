"""Touches told as words. The judge (`helpers.worded`) lets hands, tables and sleeves touch robots in the
physics, and knows what each was to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.worded import OTHERS, WORDS, judge, macro_f1
from tci.capabilities import TouchWord, TouchWords
from tci.capabilities.touch_words.tactile_gestures import GESTURES, Strokes, follow
from tci.errors import DescriptionError, TciError
from tci.testing import TouchedRobot

STAY_QUIET = "000"


def test_a_hand_is_understood_on_a_robot_that_trained_nothing() -> None:
    """At small size; `make reliability ROWS=words` has the bars."""
    done = [judge("g1", kind, 40) for kind in (*WORDS, *OTHERS)]
    score, _ = macro_f1(done)
    assert score >= 0.75, [(one.true, one.told, one.note) for one in done if one.word != one.true]
    assert max(one.late for one in done if one.told) <= 0.5
    assert np.median([one.slowest for one in done]) < 3e-3  # the slowest step, also on a busy machine


def heard(name: str, *touches: str) -> list[TouchWord]:
    robot, words = TouchedRobot(name), TouchWords()
    memory, found = words.init(robot.body), list[TouchWord]()
    for perception in robot.feel(touches):
        orders, memory = words.step(memory, perception, robot.body)
        assert orders == ()
        assert words.claims(memory) == frozenset()
        found += memory.new
    for _ in range(30):
        _, memory = words.step(memory, robot.perceive(), robot.body)
        found += memory.new
    assert tuple(found) == memory.words
    return found


def test_a_word_says_where_how_firmly_and_how_sure() -> None:
    stroke, press = heard("nao", "stroke 'left forearm' 2N", "press 'right upper arm' 12N")
    assert (stroke.word, stroke.part, press.word, press.part) == ("stroke", "left_arm", "press", "right_arm")
    assert stroke.force == pytest.approx(2.0, rel=0.5)
    assert press.force == pytest.approx(12.0, rel=0.3)
    assert press.strongest.segment == "upper_arm"
    assert 0.5 < press.certainty <= 1.0
    assert press.onset < press.end < press.told <= press.end + 0.5
    assert str(press).startswith("press on right arm upper arm, 1")


def test_skins_with_few_channels_have_fewer_words_and_say_which() -> None:
    words = TouchWords()
    body = tci.GenericBody("g1-inspire")
    many, few = words.words_on("left_palm", body), words.words_on("left_index_tip", body)
    assert set(few) < set(many)
    assert set(few) == {"tap", "poke", "hit", "press", "stroke", "rub"}
    plain = tci.GenericBody("nao-plain")
    assert words.words_on("left_hand", plain) == ("tap", "press")
    assert words.words_on("head", plain) == tuple(GESTURES)


def press(robot: TouchedRobot, patch: str, taxel: int | None, seconds: float) -> list[str]:
    words = TouchWords()
    memory, found = words.init(robot.body), list[str]()
    for number in range(round((seconds + 0.8) / 0.02)):
        on = number < round(seconds / 0.02)
        perception = robot.perceive(patch if on else None, taxel=taxel if on else None)
        _, memory = words.step(memory, perception, robot.body)
        found += [one.word for one in memory.new]
    return found


def test_switches_tell_short_from_long_and_the_head_as_naoqi_does() -> None:
    robot = TouchedRobot("nao-plain")
    assert press(robot, "left_hand", 1, 0.2) == ["tap"]
    assert press(robot, "left_bumper", 0, 1.5) == ["press"]
    assert press(robot, "head", 0, 0.3) == ["SingleFront"]
    assert press(robot, "head", 2, 1.2) == ["SingleRearHold"]


def played(states: list[tuple[str, float]]) -> list[str]:
    """Names that are told while the switches have these states for these times [s]."""
    memory, now, told = Strokes(), 0.0, list[str]()
    for state, seconds in [*states, (STAY_QUIET, 0.5)]:
        end = now + seconds
        while now < end - 1e-9:
            memory, name, _ = follow(memory, state, now)
            told += [name] if name else []
            now += 0.01
    assert memory == Strokes()
    return told


@pytest.mark.parametrize("name", [name for name in GESTURES if not name.endswith("Hold")])
def test_each_gesture_of_the_head_has_its_name(name: str) -> None:
    assert played([(state, 0.12) for state in GESTURES[name][1:-1]]) == [name]


def test_fingers_that_land_one_after_the_other_are_still_a_tap() -> None:
    assert played([("010", 0.02), ("110", 0.02), ("111", 0.1), ("011", 0.02)]) == ["SingleTap"]
    assert played([("010", 0.06), ("110", 0.06), ("111", 0.1)]) == ["SingleTap"]
    assert played([("111", 0.1), ("000", 0.1), ("111", 0.1)]) == ["DoubleTap"]
    assert played([("111", 0.1), ("000", 0.4), ("111", 0.1)]) == ["SingleTap", "SingleTap"]
    assert played([("100", 2.0)]) == ["SingleFrontHold", "SingleFrontHold"]
    assert played([("110", 0.2)]) == []


def test_what_is_wrong_is_said(tmp_path: Path) -> None:
    with pytest.raises(TciError, match=r"touch words: least 2.0; valid: 0 to 1"):
        TouchWords(least=2.0)
    wrong = tmp_path / "wrong.npz"
    with pytest.raises(DescriptionError, match="there is no such file; valid: one from tci words train"):
        TouchWords(str(wrong))
    for content in (b"", b"PK\x03\x04 nothing", b"\x93NUMPY"):
        wrong.write_bytes(content)
        with pytest.raises(DescriptionError, match="no recogniser of touch words"):
            TouchWords(str(wrong))
    np.savez(wrong, version=np.array(1), features=np.array(["length"]))
    with pytest.raises(DescriptionError, match="made for other features"):
        TouchWords(str(wrong))
