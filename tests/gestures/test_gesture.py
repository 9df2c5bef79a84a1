"""Gesture files, and the adaptation of gestures to another robot."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers.motion_capture import CONVENTIONS, Convention, bvh
from tci.body.posture import to_platform
from tci.cli.main import app
from tci.errors import CommandError, DescriptionError, TciError
from tci.gestures.bvh import read_bvh
from tci.gestures.files import read_csv, write_csv
from tci.gestures.gesture import Gesture, TorsoView, fit, record
from tci.messages import GenericCommand, Mode
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.generic_arm import JOINTS
from tci.robot.joint_map import initial_position

TIMES = np.linspace(0.0, 2.0, 41)
RIGHT = "JOINT mixamorig:RightShoulder"


def waving() -> Array:
    t = TIMES
    columns = (
        40 + 25 * np.sin(t),
        30 + 10 * np.sin(2 * t),
        10 * np.sin(t),
        55 + 20 * np.sin(2 * t),
        25 * np.sin(2 * t),
    )
    return np.deg2rad(np.column_stack(columns))


def test_csv_comes_back(tmp_path: Path) -> None:
    gesture = Gesture(TIMES, {"left_arm": waving(), "head": np.zeros((41, 3))})
    names = {"left_arm": list(JOINTS), "head": ["pitch", "roll", "yaw"]}
    write_csv(gesture, tmp_path / "g.csv", names)
    back, told = read_csv(tmp_path / "g.csv")
    assert told == names
    with pytest.raises(FileExistsError):
        write_csv(gesture, tmp_path / "g.csv", names)
    np.testing.assert_allclose(back.times, TIMES, atol=1e-6)
    np.testing.assert_allclose(back.postures["left_arm"], waving(), atol=1e-6)


def test_times_of_a_long_gesture_come_back_too(tmp_path: Path) -> None:
    times = np.arange(3000.0, step=1.0 / 90.0)
    write_csv(Gesture(times, {"head": np.zeros((len(times), 1))}), tmp_path / "g.csv", {"head": ["yaw"]})
    np.testing.assert_allclose(read_csv(tmp_path / "g.csv")[0].times, times, atol=1e-5)


def test_empty_lines_and_spaces_in_a_csv_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "g.csv").write_bytes(b"\xef\xbb\xbf\r\ntime_s, head.yaw_deg\r\n\r\n0, 1\r\n 1 ,2 \r\n\r\n")
    assert read_csv(tmp_path / "g.csv")[0].times.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("mark", [";", "\t"])
def test_a_csv_of_a_spreadsheet_with_decimal_commas_is_read(tmp_path: Path, mark: str) -> None:
    text = "time_s;head.yaw_deg;head.pitch_deg\n0;1,5;-2\n0,5;2;3,25e1\n".replace(";", mark)
    (tmp_path / "g.csv").write_text(text)
    gesture, names = read_csv(tmp_path / "g.csv")
    assert gesture.times.tolist() == [0.0, 0.5]
    assert names == {"head": ["yaw", "pitch"]}
    np.testing.assert_allclose(np.rad2deg(gesture.postures["head"]), [[1.5, -2.0], [2.0, 32.5]])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "line 1: not the columns of a gesture; valid: time_s"),
        ("time_s,left_arm\n0,1\n", "column 'left_arm'; valid: part.joint_deg"),
        ("time_s,a.b_deg\n0,1\n1\n", "line 3: 1 values; valid: 2 numbers"),
        ("time_s,a.b_deg\n0,1\n1,x\n", "line 3: 2 values; valid: 2 numbers such as -12.5 or 1e-3, not 'x'"),
        ("time_s,a.b_deg\n0,1\n1, 2 3\n", "line 3: 2 values; valid: 2 numbers such as .*, not '2 3'"),
        ("time_s,a.b_deg\n0,1\n0,1\n", "rising from 0"),
        ("time_s,a.b_deg\n0,1\n1,1e999\n", "finite"),
        ("time_s,a.b_deg\n\n0,1\n\n1\n", "line 5: 1 values"),
        ("time_s,a." + "b" * 200_000 + "_deg\n0,1\n1,1\n", "is no CSV: field larger"),
        ("time_s,a.b_deg,a.b_deg\n0,1,1\n1,2,2\n", "line 1: second column 'a.b_deg'; valid: each joint once"),
        ("time_s,a.b_deg,c.d_deg,a.e_deg\n0,1,1,1\n", "'a.e_deg'; valid: the columns of a part together"),
        ("time_s,\x1b[2Ja.b_deg\n0,1\n1,2\n", r"column '\\x1b\[2Ja.b_deg'; valid: part.joint_deg"),
        ("time_s" + ",a.b_deg" * 1000 + "\n0,1\n", "at most 1000 columns"),
    ],
)
def test_a_damaged_csv_is_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "g.csv").write_text(text)
    with pytest.raises(DescriptionError, match=told):
        read_csv(tmp_path / "g.csv")


@pytest.mark.parametrize(
    "word",
    ["1_0", "\u0661", "\uff11", "0x1", "nan", "inf", '"1"', "1e", ".", "+-1", "1\u2028", "1\x1c"],
)
def test_numbers_of_a_gesture_are_read_as_strictly_as_those_of_a_robot(tmp_path: Path, word: str) -> None:
    (tmp_path / "g.csv").write_text(f"time_s,a.b_deg\n0,1\n1,{word}\n")
    with pytest.raises(DescriptionError, match=r"line 3: \d values; valid: 2 numbers"):
        read_csv(tmp_path / "g.csv")
    text = bvh(waving()[:3], rest=0.0)
    for place in ("0.000000000", "90.000000000", "0.05", "Frames: 3") if word == word.strip() else ():
        at = text.rindex(place)
        damaged = text[:at] + text[at:].replace(place.split()[-1], word, 1)
        (tmp_path / "g.bvh").write_text(damaged)
        with pytest.raises(DescriptionError, match=r"line \d+: .*valid: "):
            read_bvh(tmp_path / "g.bvh")


def repeated(rows: list[str], size: int) -> str:
    """Returns the rows, repeated until they have `size` [bytes]."""
    block = "\n".join(rows) + "\n"
    return block * (size // len(block))


@pytest.mark.timeout(200)
def test_a_large_gesture_is_read_or_refused_soon(tmp_path: Path) -> None:
    begin = process_time()
    joints = [f"part{number // 5}.joint{number % 5}_deg" for number in range(25)]
    rows = [f"{number * 0.016:.3f}" + ",-12.34567" * 25 for number in range(56_000_000 // 258)]
    (tmp_path / "wide.csv").write_text("\n".join([",".join(["time_s", *joints]), *rows]))
    gesture, names = read_csv(tmp_path / "wide.csv")
    write_csv(gesture, tmp_path / "again.csv", names)
    assert gesture.postures["part4"].shape == (len(rows), 5)
    (tmp_path / "narrow.csv").write_text("time_s,a.b_deg\n" + repeated(["0.001,-12.34567"], 56_000_000))
    with pytest.raises(DescriptionError, match="line 500002: too large; valid: at most 500000 rows"):
        read_csv(tmp_path / "narrow.csv")
    assert process_time() - begin < 20.0


@pytest.mark.timeout(200)
def test_large_motion_capture_is_read_or_refused_soon(tmp_path: Path) -> None:
    head, mark, rows = bvh(np.tile(waving(), (5, 1)), rest=0.0).partition("Frame Time: 0.05\n")
    (tmp_path / "long.bvh").write_text(head + mark + repeated(rows.split("\n"), 18_000_000))
    begin = process_time()
    assert read_bvh(tmp_path / "long.bvh").gesture.duration == pytest.approx(2111.0, abs=10.0)
    assert process_time() - begin < 10.0
    many = "JOINT x{}\n{{\nOFFSET 0 0 0\n"
    (tmp_path / "deep.bvh").write_text("HIERARCHY\n" + "".join(many.format(n) for n in range(400_000)))
    with pytest.raises(DescriptionError, match="line 752: too large; valid: at most 250 joints"):
        read_bvh(tmp_path / "deep.bvh")
    begin = process_time()
    (tmp_path / "wide.bvh").write_text(head + mark + "1 " * 3_000_000)
    with pytest.raises(DescriptionError, match="3000000 values; valid: 33 numbers"):
        read_bvh(tmp_path / "wide.bvh")
    assert process_time() - begin < 1.5


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("Frames: 3", "Frames: -1", "-1 frames, of which 3 are there; valid: a whole file"),
        ("Frames: 3", "Frames: 4", "4 frames, of which 3 are there; valid: a whole file"),
        ("90.000000000", "1e999", "row 3 has too large a number; valid: finite ones"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_motion_capture_that_is_not_whole_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    before, found, after = bvh(waving()[:3], rest=0.0).rpartition(old)
    (tmp_path / "g.bvh").write_text(before + new + after)
    assert found
    with pytest.raises(DescriptionError, match=told):
        read_bvh(tmp_path / "g.bvh")


def test_a_recording_is_in_the_torso_frame() -> None:
    """The gesture was recorded on iCub, whose shoulders are yawed by 15 degrees. Both arms must move along
    equal paths in space."""
    icub, nao = load_robot("icub"), load_robot("nao")
    gesture = Gesture(TIMES, {"left_arm": waving(), "right_arm": waving()})
    fitted = fit(icub, gesture)
    positions = np.array([initial_position(icub)] * len(fitted.gesture.times))
    for row, time in zip(positions, fitted.gesture.times, strict=True):
        for part, angles in fitted.gesture.at(time).items():
            command = to_platform(icub, GenericCommand(part, Mode.POSITION, angles), position=row)
            row[command.servos] = command.values
    back = record(icub, fitted.gesture.times, positions)
    for part in gesture.postures:
        np.testing.assert_allclose(back.postures[part][0], waving()[0], atol=1e-6)
        np.testing.assert_allclose(back.postures[part][-1], waving()[-1], atol=1e-6)
    again = fit(nao, back)
    np.testing.assert_allclose(again.gesture.postures["left_arm"][-1], waving()[-1], atol=1e-6)
    assert set(again.missed) == {"left_fingers.thumb_spread", "right_fingers.thumb_spread"}, "NAO has none"


def test_what_limits_take_off_is_told() -> None:
    """An iCub's elbow can't extend beyond a flexion of 15 degrees."""
    angles = waving()
    angles[:, 3] = np.deg2rad(5.0)
    fitted = fit(load_robot("icub"), Gesture(TIMES, {"left_arm": angles}))
    assert fitted.missed["left_arm.elbow_pitch"] == pytest.approx(np.deg2rad(10.0), abs=1e-6)
    assert "left_arm.upper_arm" not in fitted.missed
    assert fitted.gesture.postures["left_arm"][:, 3].min() == pytest.approx(np.deg2rad(15.0), abs=1e-6)


def test_a_fast_gesture_is_slowed_down_to_the_limits() -> None:
    icub = load_robot("icub")
    quick = Gesture(TIMES / 20.0, {"left_arm": waving()})
    fitted = fit(icub, quick)
    assert fitted.slower > 3.0
    speed = np.abs(np.gradient(fitted.gesture.postures["left_arm"], fitted.gesture.times, axis=0)).max()
    assert 0.5 * np.deg2rad(120.0) < speed < np.deg2rad(120.0)


def test_plain_keeps_generic_angles() -> None:
    fitted = fit(load_robot("icub"), Gesture(TIMES, {"left_arm": waving()}), exact=False)
    np.testing.assert_allclose(fitted.gesture.postures["left_arm"][0], waving()[0], atol=1e-9)
    exact = fit(load_robot("icub"), Gesture(TIMES, {"left_arm": waving()}))
    assert np.abs(exact.gesture.postures["left_arm"][0] - waving()[0]).max() > np.deg2rad(3.0)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(CommandError, match="has none of tail"):
        fit(load_robot("nao"), Gesture(TIMES, {"tail": np.zeros((41, 1))}))
    with pytest.raises(CommandError, match="has 2 joints, the robot's 5"):
        fit(load_robot("nao"), Gesture(TIMES, {"left_arm": np.zeros((41, 2))}))
    with pytest.raises(TciError, match="rising from 0"):
        Gesture(TIMES + 1.0, {"left_arm": waving()})


@pytest.mark.parametrize("rest", [0.0, np.pi / 2], ids=["arms hanging", "T-pose"])
@pytest.mark.parametrize("convention", CONVENTIONS)
def test_motion_capture_becomes_a_gesture(tmp_path: Path, rest: float, convention: str) -> None:
    """The person leans and turns while waving. Only the motion of the arms relative to the chest is used."""
    angles = waving()
    (tmp_path / "wave.bvh").write_text(bvh(angles, rest=rest, convention=CONVENTIONS[convention]))
    gesture = read_bvh(tmp_path / "wave.bvh").gesture
    assert gesture.duration == pytest.approx(2.0)
    for part in ("left_arm", "right_arm"):
        np.testing.assert_allclose(gesture.postures[part], angles, atol=1e-6)


def test_it_does_not_matter_how_the_text_is_laid_out(tmp_path: Path) -> None:
    text = bvh(waving(), rest=0.0)
    (tmp_path / "plain.bvh").write_text(text)
    head, motion, rows = text.partition("MOTION")
    head = head.replace("\n{", " {").replace("ROOT Hips", "root Hips").replace("OFFSET", "\tOffset")
    head = head.replace("JOINT", "Joint").replace("End Site", "End site").replace("rotation", "Rotation")
    spread = f"{head}{motion}{rows}".replace("\n", " \r\n\r\n").replace("Frames: ", "frames :  ")
    (tmp_path / "spread.bvh").write_bytes(b"\xef\xbb\xbf\r\n" + spread.encode() + b"\r\n")
    plain, other = read_bvh(tmp_path / "plain.bvh"), read_bvh(tmp_path / "spread.bvh")
    for part, angles in plain.gesture.postures.items():
        np.testing.assert_array_equal(other.gesture.postures[part], angles)


ALONG_X = Convention("{side}Shoulder", ("{side}Arm", "{side}ForeArm", "{side}Hand"), along_x=True)


@pytest.mark.parametrize(("at", "raised", "places"), [(0, 90.0, ""), (3, 0.0, "alone"), (3, 45.0, "")])
def test_a_rest_pose_is_found_among_the_frames(tmp_path: Path, at: int, raised: float, places: str) -> None:
    """Zero angles give a straight line of bones. In one frame the person stands, and leans by 10 degrees."""
    angles = waving()[:21]
    angles[at] = np.deg2rad([0.0, raised, 0.0, 15.0, 0.0])
    text = bvh(angles, rest=0.4, convention=replace(ALONG_X, places=places))
    (tmp_path / "wave.bvh").write_text(text.replace("Frame Time: 0.05", "Frame Time: 5"))
    imported = read_bvh(tmp_path / "wave.bvh")
    assert any(f"frame {at + 1} as the rest pose" in words for words in imported.used)
    for part in ("left_arm", "right_arm"):
        np.testing.assert_allclose(imported.gesture.postures[part], angles, atol=1e-6)


def test_motion_capture_in_which_nobody_stands_is_refused(tmp_path: Path) -> None:
    (tmp_path / "wave.bvh").write_text(bvh(waving(), rest=0.4, convention=ALONG_X))
    with pytest.raises(DescriptionError, match=r"zero pose of the skeleton is no person .*at best, frame \d"):
        read_bvh(tmp_path / "wave.bvh")


def test_an_import_tells_what_it_used_and_left_out(tmp_path: Path) -> None:
    (tmp_path / "wave.bvh").write_text(bvh(waving(), rest=0.0, convention=CONVENTIONS["Unreal"]))
    words = ["gesture", "convert", str(tmp_path / "wave.bvh"), str(tmp_path / "wave.csv"), "--json"]
    told = json.loads(CliRunner().invoke(app, words).stdout)
    arms = ", ".join(f"'{name}_{s}'" for s in "lr" for name in ("clavicle", "upperarm", "lowerarm", "hand"))
    assert told["used"] == [
        f"8 joints: {arms}, as 'Spine' sees them",
        "the zero pose of the skeleton as the rest pose",
        "position channels of 9 joints, in place of OFFSET",
    ]
    assert told["left_out"] == ["bending of the wrists", "motion of 2 other joints: 'Hips', 'Spine'"]
    fingers = "".join(f"JOINT finger{n}\n{{\nOFFSET 0 1 0\n}}\n" for n in range(40))
    text = (tmp_path / "wave.bvh").read_text().replace("End Site", f"{fingers}End Site", 1)
    (tmp_path / "wave.bvh").write_text(text)
    (tmp_path / "wave.csv").unlink()
    said = " ".join(CliRunner().invoke(app, words[:-1]).stdout.split())
    assert "used: the zero pose of the skeleton as the rest pose" in said
    assert "left out: motion of 42 other joints: 'Hips', 'Spine', 'finger0'," in said
    assert "... (all: --json)" in said
    assert "'finger39'" not in said


def test_a_rest_pose_before_the_motion_is_left_out(tmp_path: Path) -> None:
    """CMU's recordings begin with a T-pose. No person could move from this pose to the next frame within 50
    ms."""
    angles = waving()
    angles[0] = [0.0, np.deg2rad(140.0), 0.0, 0.0, 0.0]
    (tmp_path / "wave.bvh").write_text(bvh(angles, rest=np.pi / 2))
    gesture = read_bvh(tmp_path / "wave.bvh").gesture
    assert gesture.duration == pytest.approx(1.95)
    np.testing.assert_allclose(gesture.postures["left_arm"], angles[1:], atol=1e-6)


def test_a_motion_that_begins_with_straight_arms_to_the_sides(tmp_path: Path) -> None:
    """Straight elbows do not show the rotation of the upper arms, so the thumbs are assumed to point
    forward."""
    angles = np.zeros((21, 5))
    angles[:, 1] = np.linspace(np.pi / 2, 0.0, 21)
    (tmp_path / "lower.bvh").write_text(bvh(angles, rest=np.pi / 2))
    gesture = read_bvh(tmp_path / "lower.bvh").gesture
    for part in ("left_arm", "right_arm"):
        np.testing.assert_allclose(gesture.postures[part], angles, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("HIERARCHY", "<html>"), "line 1: '<html>'; valid: ROOT"),
        ((":LeftArm", ":Tail"), "no left upper arm among the joints"),
        (("Frame Time: 0.05", "Frame Time: 0"), "valid: 2 or more, each above 0 s"),
        (("Frames: 3", "Frames: 300"), "300 frames, of which 3 are there; valid: a whole file"),
        (("OFFSET 0.000000000 -25.000000000", "OFFSET 0 0"), "of the (left|right) arm are at one place"),
        (
            (RIGHT, f"}}\n}}\nROOT x\n{{\nOFFSET 0 0 0\nJOINT y\n{{\nOFFSET 0 0 0\n{RIGHT}"),
            "hang on nothing in common",
        ),
        (("Xrotation", "Wrotation"), "valid: Xposition"),
        (("Xrotation", "Zrotation"), "valid: Xposition, .*, each once, after their number"),
        (("CHANNELS 3", "CHANNELS 2"), "valid: Xposition, .*, each once, after their number"),
        ((":LeftArm", ":LeftHand"), "second joint 'mixamorig:LeftHand'; valid: .* each of its own name"),
        (("HIERARCHY", "MOTION"), "no HIERARCHY with CHANNELS and a MOTION"),
        (("OFFSET 0.000000000 40", "OFFSET nan 40"), "line 8: 'nan'; valid: a finite decimal number"),
    ],
)
def test_damaged_motion_capture_is_refused(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    text = bvh(waving()[:3], rest=0.0)
    (tmp_path / "wave.bvh").write_text(text.replace(*change))
    with pytest.raises(DescriptionError, match=told):
        read_bvh(tmp_path / "wave.bvh")


def test_the_view_from_the_torso_of_a_robot_without_mount_is_its_generic_posture() -> None:
    nao = load_robot("nao")
    view = TorsoView(nao).posture(initial_position(nao))
    np.testing.assert_allclose(view["left_arm"], nao.part("left_arm").initial_posture, atol=1e-12)
