"""Touches as data: the same words on every robot, files of others, and errors that list what is valid."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tci.body import GenericBody
from tci.errors import CommandError, DescriptionError, TciError, UnknownNameError
from tci.testing import TouchedRobot
from tci.touches import (
    KINDS,
    LaidTouches,
    Touch,
    observe,
    parse_touch,
    place_words,
    plan,
    read_kinds,
    read_touches,
    write_touches,
)
from tci.touches.touch import FORCES

COST = "grab hit massage pat pinch poke press rub scratch slap squeeze stroke tap tickle"
ROBOTS = ("nao", "icub", "g1", "talos", "alex", "icub-whole", "nao-whole")
ABLE = [kind.name for kind in KINDS.values() if kind.generator != "none"]


def body_of(name: str, made: dict[str, GenericBody] = {}) -> GenericBody:  # noqa: B006
    return made.setdefault(name, GenericBody(name))


def test_the_table_has_the_labels_of_the_data_sets() -> None:
    assert " ".join(sorted(kind.cost for kind in KINDS.values() if kind.cost)) == COST
    assert {kind.haart for kind in KINDS.values()} == {
        "",
        "constant",
        "rub",
        "pat",
        "scratch",
        "stroke",
        "tickle",
    }
    vr = {kind.vr for kind in KINDS.values()} - {""}
    assert vr == {"hit", "pat", "poke", "push", "rub", "stroke", "tap", "grab"}
    assert all(kind.definition and kind.source for kind in KINDS.values())


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_place_of_a_robot_feels_a_press_there(robot: str) -> None:
    body, words = body_of(robot), place_words(body_of(robot))
    assert len(words) >= 16
    laid = LaidTouches(body, plan(body, [Touch("press", where, force=10.0) for where in words]))
    shares = dict(zip(words, map(laid.share, range(len(words))), strict=True))
    assert min(shares.values()) > 0.15, shares


def test_words_of_other_robots_are_refused_with_the_places_of_this_one() -> None:
    with pytest.raises(TciError, match=r"nao has no skin on 'belly'; valid: .*left wrist.*left_hand"):
        plan(body_of("nao"), "press belly")
    with pytest.raises(UnknownNameError, match="did you mean 'left wrist'"):
        plan(body_of("nao"), "press 'left wrst'")


def test_a_line_of_words_says_all_of_a_touch() -> None:
    words = "stroke 'left forearm' 0.2..0.8 3N 8cm/s @1.5s gentle by ada with left hand"
    assert parse_touch(words) == Touch(
        "stroke", "left forearm 0.2..0.8", 1.5, None, "left", 3.0, 0.08, "gentle", "ada"
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("strok belly", "did you mean 'stroke'.*valid: rest, poke"),
        ("pull 'left forearm'", "knows the word .*, but can't do it; valid: rest"),
        ("stroke 'left forearm' 400N", f"force 400 N; valid: {FORCES[0]:g} to {FORCES[1]:g} N"),
        ("stroke 'left forearm' 3N 4N", "force given twice"),
        ("stroke 'left forearm' 0.2..1.8", "1.8 along the limb; valid: 0 to 1"),
        ("stroke left_forearm taxel 900", "valid: 0 to 239"),
        ("stroke 3N", "no place"),
        ("stroke 'left forearm' -3N", "touch .*: '-3N'; valid: KIND PLACE"),
        ("stroke 'left forearm' @0.5", "touch .*: '@0.5'; valid: KIND PLACE"),
        ("stroke 'left forearm", "No closing quotation"),
    ],
)
def test_wrong_words_are_told_with_what_is_valid(words: str, told: str) -> None:
    with pytest.raises(TciError, match=told):
        plan(body_of("nao"), words)


BIDS = """onset\tduration\tkind\tplace\thand\tforce_N\tspeed_m_s\tstrength\tperson\tact
0.5\t2\tstroke\tleft forearm 0.2..0.8\tright\t3\t0.08\tn/a\tn/a\tn/a
1.0\t0\tpat\tright upper arm outside\tleft\tn/a\tn/a\tgentle\tada\tgreet
"""
BORIS_TABULAR = """Observation id,Subject,Behavior,Modifier #1,Modifier #2,Behavior type,Time
one,ada,stroke,left forearm 0.2..0.8,gentle,START,0.5
one,No focal subject,pat,right upper arm outside,None,POINT,1.0
one,ada,stroke,left forearm 0.2..0.8,gentle,STOP,2.5
"""
BORIS_AGGREGATED = """Observation id,Subject,Behavior,Modifiers,Behavior type,Start (s),Stop (s)
one,ada,stroke,left forearm 0.2..0.8|gentle,STATE,0.5,2.5
one,No focal subject,pat,right upper arm outside,POINT,1.0,1.0
"""
ELAN_TEXT = """Begin Time - ss.msec\tEnd Time - ss.msec\tDuration - ss.msec\tleft forearm 0.2..0.8\tnotes
0.5\t2.5\t2.0\tstroke\t
1.0\t1.0\t0.0\t\tpat right upper arm outside
"""
ELAN_LONG = """Tier\tParticipant\tBegin Time - ss.msec\tEnd Time - ss.msec\tAnnotation
left_forearm_0.2..0.8\tada\t0.5\t2.5\tstroke
notes\tada\t1.0\t1.0\tpat right upper arm outside
"""
ELAN = """<?xml version="1.0" encoding="UTF-8"?>
<ANNOTATION_DOCUMENT>
  <TIME_ORDER>
    <TIME_SLOT TIME_SLOT_ID="ts1" TIME_VALUE="500"/><TIME_SLOT TIME_SLOT_ID="ts2" TIME_VALUE="2500"/>
    <TIME_SLOT TIME_SLOT_ID="ts3" TIME_VALUE="1000"/><TIME_SLOT TIME_SLOT_ID="ts4" TIME_VALUE="1000"/>
  </TIME_ORDER>
  <TIER TIER_ID="left_forearm_0.2..0.8" PARTICIPANT="ada"><ANNOTATION>
    <ALIGNABLE_ANNOTATION ANNOTATION_ID="a1" TIME_SLOT_REF1="ts1" TIME_SLOT_REF2="ts2">
      <ANNOTATION_VALUE>stroke</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION></TIER>
  <TIER TIER_ID="other"><ANNOTATION>
    <ALIGNABLE_ANNOTATION ANNOTATION_ID="a2" TIME_SLOT_REF1="ts3" TIME_SLOT_REF2="ts4">
      <ANNOTATION_VALUE>pat right upper arm outside</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION>
  </ANNOTATION></TIER>
</ANNOTATION_DOCUMENT>
"""
FILES = {
    "e.tsv": BIDS, "t.csv": BORIS_TABULAR, "a.csv": BORIS_AGGREGATED, "e.txt": ELAN_TEXT, "e.eaf": ELAN,
    "l.txt": ELAN_LONG,
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_files_of_others_become_the_same_touches(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(FILES[name])
    stroke, pat = read_touches(tmp_path / name, body=body_of("g1"))
    assert (stroke.kind, stroke.place) == ("stroke", "left forearm 0.2..0.8")
    assert (stroke.onset, stroke.duration) == (0.5, 2.0)
    assert (pat.kind, pat.place, pat.onset, pat.duration) == ("pat", "right upper arm outside", 1.0, None)
    assert name in ("e.tsv", "e.txt") or stroke.person == "ada"


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    touches = (
        Touch("stroke", "left forearm 0.2..0.8", 0.5, 2.0, "left", 3.25, 0.08, "rough", "ada", "greet"),
        Touch("pat", "belly", 4.0),
    )
    write_touches(tmp_path / "events.tsv", touches)
    assert read_touches(tmp_path / "events.tsv") == touches


def test_all_faults_of_a_file_are_told_at_once_with_their_lines(tmp_path: Path) -> None:
    rows = "1\t1\tstrok\tbelly\t3\n2\t1\tpoke\tbelly\t3\n3\t1\tpoke\tleft forearm\t300\n"
    rows += "x\t1\tpoke\tleft forearm\t1\n"
    path = tmp_path / "bad.tsv"
    path.write_text("onset\tduration\tkind\tplace\tforce_N\n" + rows)
    with pytest.raises(DescriptionError) as told:
        read_touches(path, body=body_of("nao"))
    assert [fault.line for fault in told.value.faults] == [2, 3, 4, 5]
    for words in (str(path), "'stroke'", "left wrist", "0.05 to 100 N", "valid: a number, or n/a"):
        assert words in str(told.value)


def test_a_table_beside_a_file_adds_kinds(tmp_path: Path) -> None:
    (tmp_path / "touches.csv").write_text(
        "name,definition,generator,length_s,radius_mm,force_N\nlean,somebody leans,steady,3..9,30,20..50\n"
    )
    (tmp_path / "events.tsv").write_text("onset\tduration\tkind\tplace\n0\t1\tlean\tleft forearm\n")
    (touch,) = read_touches(tmp_path / "events.tsv")
    (planned,) = plan(body_of("nao"), touch, kinds=read_kinds(tmp_path / "touches.csv"))
    assert planned.peak == pytest.approx((20 * 50) ** 0.5)
    (tmp_path / "touches.csv").write_text("name,generator,radius_mm,force_N\nlean,lift,30,9..2\n")
    with pytest.raises(DescriptionError, match=r"line 2: force_N '9..2'; valid"):
        read_kinds(tmp_path / "touches.csv")


@pytest.mark.parametrize("robot", ["nao", "icub", "g1"])
def test_a_stroke_is_felt_where_how_fast_and_how_strongly_it_is_asked_for(robot: str) -> None:
    """On the middle of the forearm's back, which has skin on every robot."""
    one = TouchedRobot(robot)
    length = one.robot.part("left_arm").segment("forearm").length
    contacts = [
        max(seen.contacts, key=lambda contact: contact.force)
        for seen in one.feel("stroke 'left forearm back' 0.3..0.7 4N 8cm/s")
        if seen.contacts
    ]
    first = [one for one in contacts if one.stamp < contacts[0].stamp + 0.4 * length / 0.08]
    middle = [one for one in first if 0.4 < one.u < 0.6]
    assert len(middle) > 10
    speed = np.polyfit([one.stamp for one in middle], [one.u * length for one in middle], 1)[0]
    assert speed == pytest.approx(0.08, abs=0.02)
    assert np.median([one.force for one in middle]) == pytest.approx(4.0, rel=0.1)
    assert max(abs(np.rad2deg(one.theta)) for one in middle) > 170.0


def test_kinds_differ_as_their_table_says_and_persons_differ_from_one_another() -> None:
    body = body_of("g1")
    for name in ABLE:
        ones = [plan(body, f"{name} 'left forearm' by p{k}", seed=k)[0] for k in range(6)]
        asked = np.array([one.peak for one in ones])
        low, high = KINDS[name].force_N
        assert low / 2.0 < np.median(asked) < 2.0 * high, name
        assert asked.max() > 1.2 * asked.min(), name
        assert np.ptp([one.end - one.onset for one in ones]) > 0.0
        again = plan(body, f"{name} 'left forearm' by p3", seed=3)[0]
        np.testing.assert_array_equal(again.force, ones[3].force)


def test_touches_without_onsets_follow_one_another_and_acts_begin_together() -> None:
    first, second, third = plan(
        body_of("nao"),
        [
            "poke 'left forearm'",
            Touch("hold", "left forearm", act="hug"),
            Touch("hold", "right forearm", act="hug"),
        ],
    )
    assert second.onset > first.end
    assert third.onset == second.onset


def test_invalid_numbers_are_all_told() -> None:
    with pytest.raises(CommandError, match=r"onset.*duration.*speed.*hand.*strength.*no place"):
        Touch("poke", " ", -1.0, 0.0, "upper", 3.0, 9.0, "hard")


def test_what_one_robot_felt_is_done_again_on_another(tmp_path: Path) -> None:
    """A stroke and a press on a NAO, observed, written, and felt by a G1 and a second time observed."""
    asked = ["stroke 'left forearm back' 0.3..0.7 4N 8cm/s 0.8s", "press 'right upper arm outside' 6N 1s"]
    nao, g1 = TouchedRobot("nao"), TouchedRobot("g1")
    first = observe(nao.feel(asked), nao.body)
    write_touches(tmp_path / "felt.tsv", first)
    again = observe(g1.feel(read_touches(tmp_path / "felt.tsv", body=g1.body)), g1.body)
    for touches in (first, again):
        assert [touch.kind for touch in touches] == ["stroke", "press"]
        stroke, press = touches
        assert stroke.force == pytest.approx(4.0, rel=0.15)
        assert press.force == pytest.approx(6.0, rel=0.15)
        assert stroke.speed == pytest.approx(0.08, abs=0.02)
        assert re.fullmatch(r"right upper arm (8\d|9\d)deg 0\.\d+", press.place)
    assert again[1].onset == pytest.approx(first[1].onset, abs=0.06)
