"""The second demo: what the robots did, judged from what their joints and their skin measured."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.command_line import tci as told_by
from helpers.taught import hands_apart
from tci.capabilities import ArbiterMemory, Companion
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.gestures import read_csv
from tci.lab.show.acts import ACTS, CAST, Act
from tci.lab.show.live import NAME, LiveShow
from tci.lab.show.touch_show import WORLD, TouchShow
from tci.lab.viewer.session import Session
from tci.messages.frames import Array

PATIENCE = 120.0


@pytest.mark.parametrize("way", ["--headless", "--json"])
def test_a_robot_without_skin_where_it_is_touched_is_not_in_the_show(way: str, tmp_path: Path) -> None:
    out = tmp_path / "show"
    told = told_by("demo", "ur5", "--show", "touch", "--out", str(out), way, status=1).replace("\n", " ")
    assert "ur5 can't be in the show: it has no skin on 'right forearm', where people touch it" in told
    assert all(name in told.partition("valid: ")[2] for name in CAST)
    assert not out.exists()


class Seen:
    """Time, forces by part, and generic angles [deg] of one robot in one act."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.forces: list[dict[str, float]] = []
        self.postures: dict[str, list[Array]] = defaultdict(list)
        self.states: set[str] = set()

    def add(self, tick: tci.Tick) -> None:
        forces: dict[str, float] = defaultdict(float)
        for one in tick.perception.contacts:
            forces[one.part] = max(forces[one.part], one.force)
        self.times.append(tick.now)
        self.forces.append(forces)
        self.states.add(tick.sent.state.name)
        for part, angles in tick.perception.posture.items():
            self.postures[part].append(np.degrees(angles))

    def touched(self, part: str) -> list[int]:
        return [k for k, forces in enumerate(self.forces) if forces.get(part, 0.0) > 0.0]

    def way(self, part: str, begin: int, seconds: float) -> Array:
        """How each joint moved [deg] within some seconds."""
        end = int(np.searchsorted(self.times, self.times[begin] + seconds))
        rows = self.postures[part]
        return rows[min(end, len(rows) - 1)] - rows[begin]


def test_a_poke_a_pat_a_lesson_and_one_file_for_three_robots(tmp_path: Path) -> None:
    file, seen = tmp_path / "lesson.csv", dict[tuple[str, str], Seen]()

    def watch(robot: tci.Robot, act: Act, tick: tci.Tick, driver: SimulatedDriver) -> None:
        seen.setdefault((robot.name, act.name), Seen()).add(tick)

    show = TouchShow([tci.load_robot(name) for name in CAST], file)
    show.play(watch=watch, progress=lambda words: None)
    assert {state for one in seen.values() for state in one.states} == {"RUN"}
    for name in CAST:
        hand = "left_fingers" if name == "g1-inspire" else "left_arm"
        poke = seen[name, "poke"]
        first = poke.touched(hand)[0]
        flinch = poke.way(hand, first, 0.4)
        assert np.abs(flinch).max() > 8.0
        if name == "g1-inspire":
            assert flinch.min() < -8.0, "the fingers opened"
        after = int(np.searchsorted(poke.times, poke.times[first] + 0.6))
        assert all(k < after for k in poke.touched(hand)), "the finger was left behind"
        pat, part = seen[name, "pat"], "torso" if name == "g1-inspire" else "head"
        arm = "right_fingers" if name == "g1-inspire" else "right_arm"
        begin, end = pat.touched(arm)[0], pat.touched(arm)[-1]
        yaw = np.array(pat.postures[part])[:, 2]
        assert abs(yaw[begin]) < 2.0
        assert yaw[end:].min() < -25.0, "it looked to the right"
        assert np.abs(pat.way("right_arm", begin, 1.0)).max() < 5.0, "nobody flinches from a pat"
        again = seen[name, "repeat"]
        assert again.touched(arm)
        assert np.ptp(again.postures["left_arm"], axis=0).max() > 40.0
    lesson = seen[CAST[0], "guide"]
    held, tap = lesson.touched("left_arm"), lesson.touched("right_arm")[0]
    led = [k for k in held if lesson.times[held[0]] + 0.3 < lesson.times[k] < lesson.times[tap]]
    assert np.median([lesson.forces[k]["left_arm"] for k in led]) <= 5.0
    arm_path = np.array(lesson.postures["left_arm"])
    top = arm_path[tap]
    assert np.abs(top - arm_path[held[0]]).max() > 40.0, "it was led"
    behind = tap + 100
    start = behind + int(np.abs(arm_path[behind:] - arm_path[held[0]]).max(axis=1).argmin())
    assert np.abs(arm_path[start] - arm_path[held[0]]).max() < 3.0, "it went back to the begin"
    assert np.abs(arm_path[-1] - top).max() < 2.0, "and repeated it"
    gesture = read_csv(file)[0]
    for name in CAST:
        assert hands_apart(gesture, CAST[0], name) <= 10.0
        own = tci.gestures.fit(name, gesture).gesture
        ends = np.degrees(own.at(own.duration)["left_arm"])
        assert np.abs(seen[name, "repeat"].postures["left_arm"][-1] - ends).max() < 3.0


def test_the_page_directs_its_robots_through_the_acts(tmp_path: Path) -> None:
    driver = tci.connect("nao", "sim", **WORLD)
    session = Session(driver, tci.Attend(), about={"middleware": "sim", "capability": "attend"})
    session.pace = math.inf
    show = LiveShow([session], tmp_path / "lesson.csv", acts=[one for one in ACTS if one.teaches])
    session.start()
    try:
        end = time.monotonic() + PATIENCE
        show.start()
        while "Now you" not in show.words:
            assert "ended" not in show.words, show.words
            assert time.monotonic() < end
            time.sleep(0.02)
        assert session.runs == NAME
        assert str(tmp_path / "lesson.csv") in show.words
        assert read_csv(tmp_path / "lesson.csv")[0].duration > 1.0
    finally:
        show.close()
        session.close()


def test_a_robot_without_the_skin_of_the_show_is_told(tmp_path: Path) -> None:
    show = TouchShow([tci.load_robot("nao-plain")], tmp_path / "lesson.csv")
    with pytest.raises(TciError, match=r"no skin|no place named"):
        show.play(progress=lambda words: None)
    with pytest.raises(TciError, match=r"lightly|most 40"):
        Companion(lightly=40.0)


def test_reflex_above_gentle_above_attention_above_a_gesture() -> None:
    """A gesture that gives way is interrupted by a poke, and then goes on to its end; the head looks."""
    home = np.array(tci.load_robot("nao").part("left_arm").initial_posture)
    there = home + np.array([0.3, 0.1, 0.0, 0.2, 0.0])
    wave = tci.gestures.Gesture([0.0, 1.0], {"left_arm": [home, there]})
    task = tci.PlayGesture(tci.gestures.fit("nao", wave))
    layers = tci.Arbiter([tci.Teach(most=8.0), tci.WithdrawalReflex(), tci.Gentle(task), tci.Attend()])
    seen, said = Seen(), dict[str, None]()
    with tci.connect("nao", "sim", **WORLD) as driver:
        driver.world.touch("poke 'left forearm' 20N @1s")

        def listen(memory: ArbiterMemory) -> bool:
            said.update(dict.fromkeys(layers.notes(memory)))
            return False

        tci.run(driver, layers, duration=7.0, observe=seen.add, until=listen)
    assert seen.states == {"RUN"}
    holds = [note for note in said if note.endswith("holds left_arm")]
    assert holds[0] == "PlayGesture holds left_arm"
    assert "WithdrawalReflex holds left_arm" in holds
    first = seen.touched("left_arm")[0]
    assert np.abs(seen.way("left_arm", first, 0.4)).max() > 8.0
    assert np.ptp(seen.postures["head"], axis=0).max() > 25.0
    end = np.degrees(wave.postures["left_arm"][-1])
    assert np.abs(seen.postures["left_arm"][-1] - end).max() < 2.0
