"""`tci run --touch` and `--touches`, `tci touches`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from helpers.command_line import tci
from tci.body.generic_body import GenericBody
from tci.cli.touching import example_touch
from tci.errors import TciError
from tci.lab.experiments.proof import touch_trials
from tci.robot.catalogue import load_robot
from tci.simulation.hand import Hand
from tci.simulation.hand_path import HandPath
from tci.simulation.world import World
from tci.touches import Touch, plan, write_touches

STROKE = "stroke 'left forearm back' 0.3..0.7 3N 8cm/s"


def test_a_line_and_a_file_touch_one_after_another(tmp_path: Path) -> None:
    write_touches(tmp_path / "visit.tsv", [Touch("press", "right forearm outside", 0.5, 0.5, force=6.0)])
    told = json.loads(
        tci("run", "withdrawal", "g1", "--touch", STROKE, "--touches", str(tmp_path / "visit.tsv"), "--json")
    )
    press, stroke = told["touches"]
    assert (press["kind"], press["force_N"], stroke["kind"]) == ("press", 6.0, "stroke")
    assert stroke["onset_s"] > press["end_s"]
    assert told["missed_touches"] == []
    assert set(told["touched_N"]) == {"left_forearm", "right_forearm"}


def test_what_can_not_be_done_is_told() -> None:
    words = tci("run", "withdrawal", "nao", "--touch", "stroke belly", status=1).replace("\n", " ")
    assert "nao has no skin on 'belly'" in words
    assert "back of left hand" in words
    refused = tci("run", "withdrawal", "nao", "--via", "replay:x.mcap", "--touch", STROKE, status=1)
    assert "need a simulated robot" in refused.replace("\n", " ")
    beside = ("run", "withdrawal", "nao", "--touch", "press 'left upper arm inside' 3N 0.3s")
    last = tci(*beside, "--duration", "0.5", status=1).replace("\n", " ")[-120:]
    assert last.rstrip().endswith("inside Torso"), last
    late = "run", "withdrawal", "nao", "--touch", "poke 'left forearm' @5s", "--duration", "0.1"
    told = tci(*late, status=1).replace("\n", " ")
    assert "did not touch at 5.000 s: the run ended before; valid: --duration 7" in told, told


def test_kinds_and_places_are_listed() -> None:
    told = json.loads(tci("touches", "nao-plain", "--json"))
    assert {"stroke", "squeeze", "hug"} < set(told["kinds"])
    assert {"top of head", "back of left hand"} <= set(told["places"])
    assert "torso" in told["parts_without_skin"]
    assert "--measure needs a robot" in tci("touches", "--measure", status=1)


def test_demo_and_check_take_the_same_words() -> None:
    told = json.loads(tci("demo", "nao", "--touch", "press 'left forearm' 3N 0.3s", "--json"))
    assert told["touches"][0]["kind"] == "press"
    assert "left_forearm" in told["touched_N"]
    assert "one ROBOT" in tci("demo", "nao", "icub", "--touch", STROKE, status=1)
    robot = load_robot("nao-plain-h21")
    trials, faults = touch_trials(robot, plan(GenericBody(robot), ["press 'top of head' 4N 0.3s"]))
    assert (trials[0].patch, trials[0].felt_n > 0.0, faults) == ("head", True, [])
    assert "add --simulate" in tci("check", "nao", "--touch", STROKE, status=1)


def test_the_example_is_a_touch_that_has_room(monkeypatch: pytest.MonkeyPatch) -> None:
    world, touch = World(load_robot("nao"), people=1), Hand.touch
    assert example_touch(world) == "stroke 'left forearm' 3N 8cm/s"
    blocked = world.robot.patch("left_forearm").link

    def narrow(hand: Hand, path: HandPath, start: float | None = None) -> None:
        if path.link == blocked:
            raise TciError("no room")
        touch(hand, path, start)

    monkeypatch.setattr(Hand, "touch", narrow)
    words = example_touch(world)
    (planned,) = plan(GenericBody(world.robot), words)
    assert world.robot.patch(planned.patch).link != blocked
    assert not any(hand.busy for hand in world.person().hands)
