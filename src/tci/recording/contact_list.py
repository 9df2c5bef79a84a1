"""Imports logs of the contact lists that an iCub's skinManager sends."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tci.errors import FrameError, RecordingError
from tci.frames import read_only
from tci.messages import JointReading, Reading, SkinFrame
from tci.recording.contact_tables import TableFit, compare_tables, read_tables
from tci.recording.importing import importing
from tci.recording.skin_manager import SKIN_PARTS, read_skin_events
from tci.recording.yarp_log import log_file
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.skin.skin import Skin

PERIOD = 0.02
"""Time [s] between two contact lists: skinManager runs at 50 Hz."""


@dataclass(frozen=True, slots=True)
class ImportedContacts:
    """Result of an import."""

    periods: int
    """Number of contact lists."""
    left_out: int
    """Number of contacts on parts without a patch of that name, or with none of its taxels."""
    parts: tuple[TableFit, ...]
    """For each part with contacts: if the robot's taxels are at the recorded places, and tables that are."""


def import_contact_list(
    log: Path, out: Path, robot: Robot, *, tables: Path | None = None
) -> ImportedContacts:
    """Converts a log of contact lists to a recording for the `robot` with that skin.

    A list gives the taxels of each contact and their mean value; each of these taxels gets the mean as its
    raw value. It contains no joint angles: they are set to the robot's initial posture. Contacts on parts
    without a patch of that name and size on the robot are left out. The recorded centres are compared with
    the robot's skin, and with each skin file in the folder `tables`. Raises RecordingError.
    """
    patches = {patch.name: patch for patch in robot.patches if patch.surface.kind != "truncated_cone"}
    surfaces = {name: surface for name, surface in Skin(robot).surfaces.items() if name in patches}
    live = {name: set(surface.channels.tolist()) for name, surface in surfaces.items()}
    try:
        lists = list(read_skin_events(log_file(log)))
    except FrameError as error:
        raise RecordingError(str(error)) from error
    contacts = [contact for _, found in lists for contact in found]
    parts = compare_tables(contacts, robot, surfaces, {} if tables is None else read_tables(tables))
    source = f"contact list of yarpdatadumper {log.name}: taxels have their contact's mean value, "
    source += "joints are the initial posture"
    for part in parts:
        source += f", {part.part} was recorded with another table" if part.verdict == "wrong" else ""
    still = read_only(np.zeros(len(robot.servos)))
    left_out = 0
    with importing(out, robot, middleware="yarp", source=source, period=PERIOD) as recorder:
        for number, (stamp, found) in enumerate(lists):
            values = {name: np.full(patch.channels, patch.sensor.rest) for name, patch in patches.items()}
            for contact in found:
                patch = patches.get(SKIN_PARTS[contact.skin_part])
                if patch is None or not live[patch.name] & set(contact.taxels.tolist()):
                    left_out += 1
                    continue
                taxels = contact.taxels[contact.taxels < patch.channels]
                sign = np.sign(patch.sensor.pascal_per_count)
                raw = patch.sensor.rest + sign * contact.pressure
                values[patch.name][taxels] = np.clip(raw, patch.sensor.lowest, patch.sensor.highest)
            frames = tuple(SkinFrame(name, stamp, number, read_only(raw)) for name, raw in values.items())
            recorder.tick(stamp, Reading(JointReading(stamp, number, initial_position(robot), still), frames))
    return ImportedContacts(len(lists), left_out, tuple(parts))
