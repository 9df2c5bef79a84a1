"""`tci log import`: converts recordings of other programs to recordings of TCI."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tci.cli import completion
from tci.cli.options import AsJson, NewRecording

if TYPE_CHECKING:
    from tci.recording.contact_list import ImportedContacts
    from tci.recording.contact_tables import TableFit
    from tci.recording.importing import Imported
    from tci.robot.description import Robot


def import_(
    log: Annotated[
        Path,
        typer.Argument(
            help="Log of yarpdatadumper (data.log or the folder of data.log), ROS bag, data set of LeRobot "
            "(v3) or Open-X-Tactile (Zarr 2), episodes of Humanoid Everyday or xr_teleoperate, or arrays "
            "(.npz, .mat, .csv)."
        ),
    ],
    out: NewRecording,
    robot: Annotated[
        str | None,
        typer.Argument(
            help="Robot, by name or description file: needed for an iCub's contact list, for a ROS bag, "
            "and to replay, plot or calibrate with the recording.",
            autocompletion=completion.robots,
        ),
    ] = None,
    patch: Annotated[
        str, typer.Option(help="For a log of raw values: name of the patch of skin that sent the values.")
    ] = "skin",
    mapping: Annotated[
        Path | None,
        typer.Option("--map", help="For arrays: file (.toml) with the names of times and values."),
    ] = None,
    tables: Annotated[
        Path | None,
        typer.Option(
            help="For a contact list: folder of skin files. The command prints the skin files that fit "
            "the list.",
            exists=True, file_okay=False,
        ),
    ] = None,
    episode: Annotated[int, typer.Option(help="For a data set: number of the episode, from 0.")] = 0,
    as_json: AsJson = False,
) -> None:  # fmt: skip
    """Convert a log of YARP's yarpdatadumper, a ROS bag (extra ros2), an episode of a data set of LeRobot
    (extra parquet) or Open-X-Tactile (others' sets: extra oxt) or arrays of taxels to a recording.

    Example:  tci log import data.log foot.mcap icub-whole --patch right_sole

    Example:  tci log import skin_events/data.log touches.mcap icub --tables conf/positions

    Example:  tci log import rosbag2_folder touches.mcap nao

    Example:  tci log import pressure.mat touches.mcap nao --map pressure.toml

    Example:  tci log import touch-set touch.mcap nao --episode 3

    Example:  tci log import push_a_cart/episode_0 touch.mcap g1
    """
    from tci.datasets.open_x_tactile import import_oxt, is_oxt
    from tci.datasets.teleoperation import import_teleoperation, is_teleoperation
    from tci.errors import RecordingError
    from tci.recording.arrays import SUFFIXES, import_arrays
    from tci.recording.contact_list import import_contact_list
    from tci.recording.ros_bag import import_ros_bag, is_bag
    from tci.recording.yarp_log import import_yarp_log, is_contact_list, is_text
    from tci.robot.catalogue import load_robot

    words: Robot | None = None if robot is None else load_robot(robot)
    if not log.exists():
        raise RecordingError(f"{log} does not exist; valid: a log, a bag or arrays")
    if is_teleoperation(log):
        _tell(import_teleoperation(log, out, episode, robot=words), out, as_json=as_json)
        return
    if is_oxt(log):
        _tell(import_oxt(log, out, episode, robot=words), out, as_json=as_json)
        return
    if (log / "meta" / "info.json").is_file():
        from tci.datasets.lerobot import import_lerobot

        _tell(import_lerobot(log, out, episode, robot=words), out, as_json=as_json)
        return
    if is_bag(log):
        if words is None:
            raise RecordingError(
                f"{log} is a ROS bag, which does not name its robot; valid: tci log import {log} {out} ROBOT"
            )
        _tell(import_ros_bag(log, out, words), out, as_json=as_json)
        return
    elif log.suffix.lower() in SUFFIXES:
        if mapping is None:
            raise RecordingError(f"{log} holds arrays, whose meaning is unknown; valid: --map FILE.toml")
        _tell(import_arrays(log, out, mapping, robot=words), out, what="frames", as_json=as_json)
        return
    elif not is_text(log):
        raise RecordingError(
            f"{log} is no text; valid: a log of YARP, a ROS bag, or arrays as .npz, .mat or .csv"
        )
    elif is_contact_list(log):
        if words is None:
            raise RecordingError(
                f"{log} is a contact list, which does not name its robot; "
                f"valid: tci log import {log} {out} ROBOT"
            )
        listed = import_contact_list(log, out, words, tables=tables)
        _tell_contacts(listed, out, as_json=as_json)
    else:
        _tell(import_yarp_log(log, out, patch=patch, robot=words), out, what="frames", as_json=as_json)


def _tell_contacts(listed: ImportedContacts, out: Path, *, as_json: bool) -> None:
    from tci.cli.console import console, written

    counts = {"periods": listed.periods, "contacts_left_out": listed.left_out}
    used, assumed = _used(out, joints=False)
    more: dict[str, Any] = {"used": used, "assumed": assumed}
    more |= {"parts": [_facts(fit) for fit in listed.parts]} if listed.parts else {}
    written(out, counts, more, as_json=as_json)
    _tell_lines([] if as_json else used, [] if as_json else assumed)
    for fit in () if as_json else listed.parts:
        colour = {"fits": "green", "wrong": "red"}.get(fit.verdict, "yellow")
        console.print(_sentence(fit), style=colour, highlight=False, markup=False)


def _tell(done: Imported, out: Path, *, what: str = "periods", as_json: bool) -> None:
    from tci.cli.console import console, written

    used, assumed = _used(out, joints=done.joints)
    more = {"used": used, "assumed": assumed, "left_out": done.left_out, "doubts": done.doubts}
    written(out, {what: done.periods}, more, as_json=as_json)
    if as_json:
        return
    _tell_lines(used, assumed)
    for said in (*done.doubts, *(f"left out: {one}" for one in done.left_out)):
        console.print(f"  {said}", style="yellow", highlight=False, markup=False)


def _tell_lines(used: list[str], assumed: list[str]) -> None:
    from tci.cli.console import console

    for said in used:
        console.print(f"  used: {said}", highlight=False, markup=False)
    for said in assumed:
        console.print(f"  assumed: {said}", style="yellow", highlight=False, markup=False)


def _used(out: Path, *, joints: bool) -> tuple[list[str], list[str]]:
    """What a new recording has of the file, and what it has not from there."""
    from tci.recording.index import indexed
    from tci.recording.recording import Recording

    topics, robot = indexed(out), Recording(out).about.get("robot")
    names = [name for name in topics if name.startswith("/skin/") and name != "/skin/points"]
    used = [f"{name.removeprefix('/skin/')}, {topics[name].messages} frames" for name in names]
    if joints:
        return [f"joints of {robot}, {topics['/joint_states'].messages} readings", *used], []
    return used, [f"all joints of {robot} rest at the initial posture"] if robot else []


def _facts(fit: TableFit) -> dict[str, Any]:
    off = 1e3 * fit.off if fit.off == fit.off else None
    return {
        "part": fit.part, "contacts": fit.contacts, "off_mm": off, "verdict": fit.verdict,
        "tables": list(fit.tables),
    }  # fmt: skip


def _sentence(fit: TableFit) -> str:
    """Returns a line of text about the contacts that a log contains for one skin part: if they fit the
    robot's taxels, and which position files they fit."""
    said = {
        "fits": "the robot's taxels are where they were recorded",
        "wrong": f"the robot's taxels are {1e3 * fit.off:.1f} mm from where they were recorded (median): "
        "contacts are on the wrong places",
        "unknown": "the robot has no taxels of these numbers",
        "no patch": "the robot has no such patch of skin",
    }[fit.verdict]
    known = f"; recorded with {' or '.join(fit.tables)}" if fit.tables else ""
    return f"{fit.part}: {fit.contacts} contacts, {said}{known}"
