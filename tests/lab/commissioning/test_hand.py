"""The doctor of a hand, whose stand-in is pressed as it asks: as a person does, or with a fault."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from helpers.serial_devices import Paxini
from helpers.touch_devices import InspireHand
from tci.drivers.diagnosis import Level
from tci.drivers.registry import source_at
from tci.drivers.source_reader import SourceReader
from tci.lab.authoring.hand import write_hand
from tci.lab.commissioning.hand import examine_hand
from tci.lab.commissioning.hand_shapes import shapes_told
from tci.lab.commissioning.hand_turns import pads_as_found
from tci.robot.tactile_devices import in_rows, pads_of

pytestmark = pytest.mark.timeout(60)
Corners = dict[str, int]
PALM: Corners = {"far left": 7, "far right": 111, "near left": 0}
"""Value of the palm at each corner, by Inspire's manual: column by column from the last row."""
FINGER = {
    "top": {"far left": 0, "far right": 7, "near left": 88},
    "tip": {"far left": 0, "far right": 2, "near left": 6},
}
"""The same of pads of a finger, 12 x 8 and 3 x 3: row by row from the first."""


class Person:
    """Presses the hand as it is asked to, and the corners of `pads`; `shows` says on which finger or pad a
    press really appears."""

    def __init__(
        self,
        hand: InspireHand,
        shows: Callable[[str], str] = lambda place: place,
        pads: Sequence[str] = ("palm",),
    ) -> None:
        self.hand, self.shows, self.pads = hand, shows, pads
        self.rest = {pad: list(values) for pad, values in hand.values.items()}
        self.corner = PALM
        self.mirrored = False

    def __call__(self, words: str) -> str:
        now = {pad: list(values) for pad, values in self.rest.items()}
        if found := re.match(
            "press only the (far left|far right|near left) corner of the (.*?)( finger)? with", words
        ):
            corner, pad = found[1], found[2].replace(" ", "_")
            if pad not in self.pads:
                return "s"
            now[self.shows(pad)][self._value(pad, corner)] += 900
        elif "press the " in words:
            finger = words.removeprefix("press the ").split()[0]
            for pad in now:
                if pad.startswith(self.shows(finger)):
                    now[self.shows(pad)] = [value + 500 for value in now[self.shows(pad)]]
        self.hand.values = now
        begun, end = len(self.hand.received), time.monotonic() + 10.0
        while len(self.hand.received) < begun + 40 and time.monotonic() < end:
            time.sleep(0.001)  # what is under way when a person begins: two sweeps
        return ""

    def _value(self, pad: str, corner: str) -> int:
        corners = self.corner if pad == "palm" else FINGER[pad.split("_")[1]]
        if not self.mirrored:
            return corners[corner]
        if corner == "near left":
            return corners["near left"] + corners["far right"] - corners["far left"]
        return corners["far left" if corner == "far right" else "far right"]


@pytest.fixture
def hand() -> Iterator[InspireHand]:
    made = InspireHand()
    made.plug()
    yield made
    made.unplug()


@pytest.fixture
def reader(hand: InspireHand) -> Iterator[SourceReader]:
    time.sleep(0.1)
    source = source_at(hand.via)
    made = SourceReader(hand.via, source, source.pads)
    made.wait(3.0)
    yield made
    made.close()


def told(reader: SourceReader, person: Person) -> list[tuple[str, str]]:
    """What is not right, with its subject."""
    found = examine_hand(reader, person, seconds=0.1)
    return [
        (one.subject, one.what)
        for one in found
        if one.level is not Level.OK and "pads lie is assumed" not in one.what  # of corners left out
    ]


def test_a_good_hand_gets_no_complaint(hand: InspireHand, reader: SourceReader) -> None:
    assert told(reader, Person(hand)) == []


def test_dead_stuck_saturated_and_exchanged_fingers_are_named(
    hand: InspireHand, reader: SourceReader
) -> None:
    exchanged = {"index": "ring", "ring": "index", "little": "nothing"}
    person = Person(hand, lambda finger: exchanged.get(finger, finger))
    person.rest["middle_top"][3] = 4095
    found = told(reader, person)
    assert found == [
        ("middle_top", "1 of 96 taxels are at their largest value, untouched"),
        ("little", "pressing the little finger changes nothing"),
        ("ring", "pressing the ring finger shows on the index finger"),
        ("index", "pressing the index finger shows on the ring finger"),
        ("middle_top", "1 taxels reach their largest value, 4095"),
    ]


def test_the_other_hand_and_a_pad_the_other_way_round_are_told(
    hand: InspireHand, reader: SourceReader
) -> None:
    other = dict(zip(("thumb", "index", "ring", "little"), ("little", "ring", "index", "thumb"), strict=True))
    person = Person(hand, lambda finger: other.get(finger, finger))
    person.corner = {"far left": 111, "far right": 7, "near left": 104}
    found = dict(told(reader, person))
    assert "opposite order" in found["fingers"]
    assert "far left at row 1, column 14, far right at row 1, column 1" in found["palm"]


FEW = ("palm", "index_top", "ring_top", "index_tip", "ring_tip")


@pytest.fixture
def few(hand: InspireHand) -> Iterator[SourceReader]:
    """A reader of some pads: each has three corners to press."""
    time.sleep(0.1)
    source = source_at(hand.via)
    made = SourceReader(hand.via, source, {pad: source.pads[pad] for pad in FEW})
    made.wait(3.0)
    yield made
    made.close()


def test_three_corners_of_every_pad_tell_exchanged_pads(hand: InspireHand, few: SourceReader) -> None:
    asked: list[str] = []
    person = Person(hand, pads=FEW)

    def ask(words: str) -> str:
        asked.append(words)
        return person(words)

    found = examine_hand(few, ask, seconds=0.1)
    assert [one.subject for one in found if "three corners show" in one.what] == [*FEW]
    assert sum("corner" in words for words in asked) == 3 * len(FEW)
    exchanged = {"index_top": "ring_top", "ring_top": "index_top"}
    assert told(few, Person(hand, lambda place: exchanged.get(place, place), pads=FEW)) == [
        ("index_top", "pressing the index top shows on the ring top"),
        ("ring_top", "pressing the ring top shows on the index top"),
    ]


def test_left_taken_for_right_is_told(hand: InspireHand, few: SourceReader, tmp_path: Path) -> None:
    person, turns = Person(hand, pads=FEW), tmp_path / "hand.turns.json"
    person.mirrored = True
    found = {one.subject: one for one in examine_hand(few, person, seconds=0.1, turns=turns)}
    assert found["corners"].what == "all 5 pads lie mirrored"
    assert "side=left or side=right" in found["corners"].advice
    kept = pads_as_found(pads_of("inspire-rh56dftp", few.channels), turns)
    assert in_rows(np.arange(9), kept["index_tip"])[0].tolist() == [2, 1, 0]


def test_how_values_lie_is_asked_where_nobody_says_and_kept(tmp_path: Path) -> None:
    board, asked = Paxini(), list[str]()
    board.values = {pad: [20] * size for pad, size in board.pads.items()}
    board.plug()
    source = source_at(board.via)
    reader = SourceReader(board.via, source, source.pads)
    reader.wait(3.0)
    answers = {"12 values": ["three", "4x4", "3x4 0", "3 x 4 2.5"], "31 values": [], "10 values": []}

    def ask(words: str) -> str:
        asked.append(words)
        left = next((left for count, left in answers.items() if count in words), [])
        return left.pop(0) if left else ""

    file = tmp_path / "hands" / "board.shapes.json"
    try:
        examine_hand(reader, ask, seconds=0.02, shapes=file)
        told = [words for words in asked if "palm_3" in words]
        assert [words.split("type")[0] for words in told] == [
            "",
            "'three' is not of this form; ",
            "4 x 4 are 16; ",
            "at a distance of 0 mm all values lie on one place; ",
        ]
        shapes = shapes_told(reader.channels, file)
        path = write_hand(reader, tmp_path / "board", shapes=shapes)
        rows = [line.split(",") for line in (path.parent / "palm_3.csv").read_text().splitlines()[1:]]
        assert [float(rows[k][1]) for k in (0, 1, 4)] == [-3.75, -1.25, -3.75]
        asked.clear()
        examine_hand(reader, ask, seconds=0.02, shapes=file)
        assert not [words for words in asked if "palm_3" in words and "type" in words], "it knows by now"
    finally:
        reader.close()
        board.unplug()
    file.write_text('{"palm_3": "rubbish"}')
    assert shapes_told({"palm_3": 12}, file) == {}


@pytest.mark.parametrize(
    ("corner", "way", "first"),
    [
        ({"far left": 0, "far right": 104, "near left": 7}, "upside down", 0),
        ({"far left": 111, "far right": 7, "near left": 104}, "mirrored", 111),
        ({"far left": 104, "far right": 0, "near left": 111}, "turned by half a turn", 104),
    ],
)
def test_which_way_round_a_pad_lies_is_kept(
    hand: InspireHand, reader: SourceReader, tmp_path: Path, corner: dict[str, int], way: str, first: int
) -> None:
    person, turns = Person(hand), tmp_path / "hand.turns.json"
    person.corner = corner

    def advice() -> list[str]:
        found = examine_hand(reader, person, seconds=0.1, turns=turns)
        return [one.advice for one in found if one.level is Level.WARNING]

    (said,) = advice()
    assert f"the pad lies {way}" in said
    assert advice() == [], "it knows by now"
    assumed = pads_of("inspire-rh56dftp", {"palm": 112})
    palm = pads_as_found(assumed, turns)["palm"]
    assert in_rows(np.arange(112), palm)[0, 0] == first, "the far left corner"
    path = write_hand(reader, tmp_path / "hand", shapes={"palm": palm})
    rows = [line.split(",") for line in (path.parent / "palm.csv").read_text().splitlines()[1:]]
    x, y = zip(*[(float(row[1]), float(row[2])) for row in rows], strict=True)
    assert (x[first], y[first]) == (min(x), max(y))
    turns.write_text("{rubbish")
    assert pads_as_found(assumed, turns) == assumed


def test_a_pad_that_rests_elsewhere_than_in_the_last_session_is_told_and_not_learnt(
    hand: InspireHand, reader: SourceReader, tmp_path: Path
) -> None:
    last, person = tmp_path / "hands" / "mine.json", Person(hand)

    def warned() -> list[str]:
        found = examine_hand(reader, person, seconds=0.1, last=last)
        return [f"{one.subject}: {one.what}" for one in found if one.level is Level.WARNING]

    assert warned() == []
    for pressed in (0, 100):  # warmth, below 5 % of the range
        person.rest["ring_tip"] = [value + pressed for value in person.rest["ring_tip"]]
        assert warned() == []
    person.rest["thumb_pad"][5] += 700
    for _ in range(2):
        (one,) = warned()
        assert re.match(r"thumb_pad: 1 of 96 taxels rest elsewhere than on 20.*\+700 counts", one)
    last.write_text("{rubbish")
    assert warned() == []
