"""Imports logs of YARP's yarpdatadumper: one line per message, `sequence stamp values...`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tci.errors import FrameError, RecordingError
from tci.frames import read_only
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.importing import importing
from tci.recording.skin_manager import SKIN_PARTS, read_skin_events
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.skin.skin import Skin

LONGEST = 2**20
"""Longest line [characters] that is read. Assumed: bounds the memory for a damaged or hostile file."""

EVENTS_PERIOD = 0.02
"""Time [s] between two contact lists: skinManager runs at 50 Hz."""


def read_yarp_log(log: Path, *, patch: str) -> Iterator[SkinFrame]:
    """Yields the frames of a log of numbers, `data.log` or the folder with it, at the log's own times [s].

    Raises RecordingError with the line for anything else, such as a contact list.
    """
    path = log / "data.log" if log.is_dir() else log
    with path.open(encoding="utf-8", errors="replace") as file:
        number = 0
        while line := file.readline(LONGEST + 1):
            number += 1
            if len(line) > LONGEST:
                raise RecordingError(f"{path}, line {number}: longer than {LONGEST} characters")
            if line.strip():
                yield _frame(line.split(), patch, f"{path}, line {number}")


def _frame(words: list[str], patch: str, where: str) -> SkinFrame:
    try:
        sequence, stamp = int(words[0]), float(words[1])
        values = read_only([float(word) for word in words[2:]])
    except (ValueError, IndexError):
        text = " ".join(words)[:60]
        raise RecordingError(f"{where}: {text!r}; valid: sequence, stamp [s] and numbers") from None
    if not (np.isfinite(stamp) and len(values) and 0 <= sequence < 2**63):
        valid = "at least one, a finite time"
        raise RecordingError(f"{where}: {len(values)} values at {stamp} s; valid: {valid}")
    return SkinFrame(patch, stamp, sequence, values)


def import_yarp_log(log: Path, out: Path, *, patch: str) -> int:
    """Converts such a log to a recording and returns the number of frames.

    A recording without joints can't be replayed on a robot. Raises RecordingError for a log that can't be
    read.
    """
    frames = read_yarp_log(log, patch=patch)
    first = next(frames, None)
    if first is None:
        raise RecordingError(f"{log} is empty; valid: at least one line")
    none = np.empty(0)
    with importing(out, None, middleware="yarp", source=f"yarpdatadumper {log.name}") as recorder:
        for frame in (first, *frames):
            joints = JointReading(frame.stamp, frame.sequence, none, none)
            recorder.tick(frame.stamp, Reading(joints, (frame,)))
    return recorder.ticks


def import_skin_events(log: Path, out: Path, robot: Robot) -> tuple[int, int]:
    """Converts a log of iCub's contact lists to a recording for the `robot` with that skin.

    A list gives the taxels of each contact and their mean value; each of these taxels gets the mean as its
    raw value. It contains no joint angles: they are set to the robot's initial posture. Contacts on parts
    without a patch of that name and size on the robot are left out. Returns the number of periods and of
    contacts left out. Raises RecordingError.
    """
    path = log / "data.log" if log.is_dir() else log
    patches = {patch.name: patch for patch in robot.patches if patch.surface.kind != "truncated_cone"}
    skin = Skin(robot)
    live = {name: set(skin.surfaces[name].channels.tolist()) for name in patches}
    source = f"contact list of yarpdatadumper {log.name}: taxels have their contact's mean value, "
    source += "joints are the initial posture"
    still = read_only(np.zeros(len(robot.servos)))
    left_out = number = 0
    with importing(out, robot, middleware="yarp", source=source, period=EVENTS_PERIOD) as recorder:
        try:
            for stamp, contacts in read_skin_events(path):
                values = {name: np.full(patch.channels, patch.sensor.rest) for name, patch in patches.items()}
                for contact in contacts:
                    patch = patches.get(SKIN_PARTS[contact.skin_part])
                    if patch is None or not live[patch.name] & set(contact.taxels.tolist()):
                        left_out += 1
                        continue
                    taxels = contact.taxels[contact.taxels < patch.channels]
                    sign = np.sign(patch.sensor.pascal_per_count)
                    raw = patch.sensor.rest + sign * contact.pressure
                    values[patch.name][taxels] = np.clip(raw, patch.sensor.lowest, patch.sensor.highest)
                frames = tuple(SkinFrame(name, stamp, number, read_only(raw)) for name, raw in values.items())
                joints = JointReading(stamp, number, initial_position(robot), still)
                recorder.tick(stamp, Reading(joints, frames))
                number += 1
        except FrameError as error:
            raise RecordingError(str(error)) from error
    return number, left_out
