"""Imports logs of the contact lists that an iCub's skinManager sends."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tci.errors import FrameError, RecordingError
from tci.messages import SkinFrame
from tci.messages.frames import read_only
from tci.recording.contact_tables import TableFit, compare_tables, read_tables
from tci.recording.importing import import_frames
from tci.recording.skin_manager import SKIN_PARTS, SkinContact, read_skin_events
from tci.recording.yarp_log import log_file
from tci.robot.description import Patch, Robot
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True)
class ImportedContacts:
    """Result of an import."""

    periods: int
    """Number of contact lists."""
    left_out: int
    """Number of contacts that were left out. A contact is left out if the robot has no patch with the name of
    the contact's part, or if none of the contact's taxels is on this patch."""
    parts: tuple[TableFit, ...]
    """Comparison of the recorded contacts with the robot's taxels, for each part with contacts. Each
    comparison also contains the names of the skin files in the folder `tables` that agree with the contacts.
    """


def import_contact_list(
    log: Path, out: Path, robot: Robot, *, tables: Path | None = None
) -> ImportedContacts:
    """Converts a log of contact lists to a recording.

    `robot` must be the robot on which the log was recorded. A contact list contains, for each contact, the
    taxels and the mean of their values. The recording contains this mean as the raw value of each of these
    taxels. The log contains no joint angles, so the joints are set to the robot's initial posture. A contact
    is left out if the robot has no patch with the name of the contact's part, or if none of the contact's
    taxels is on this patch. The log also contains the centre of each contact. To find the skin file with
    which the log was made, the centres are compared with the taxels of the robot's skin, and with the taxels
    of each skin file in the folder `tables`. Raises RecordingError if the log can't be read or does not fit
    the robot.
    """
    patches = {patch.name: patch for patch in robot.patches if patch.surface.kind != "truncated_cone"}
    surfaces = {name: surface for name, surface in Skin(robot).surfaces.items() if name in patches}
    live = {name: set(surface.channels.tolist()) for name, surface in surfaces.items()}
    if not patches:
        raise RecordingError(f"{robot.name} has no skin with places; valid: the robot of the contact list")
    try:
        lists = list(read_skin_events(log_file(log)))
    except FrameError as error:
        raise RecordingError(str(error)) from error
    contacts = [contact for _, found in lists for contact in found]
    parts = compare_tables(contacts, robot, surfaces, {} if tables is None else read_tables(tables))
    source = f"contact list of yarpdatadumper {log.name}: taxels have their contact's mean value"
    for part in parts:
        source += f", {part.part} was recorded with another table" if part.verdict == "wrong" else ""
    left_out: list[SkinContact] = []
    items = (_frames(number, *one, patches, live, left_out) for number, one in enumerate(lists))
    periods = import_frames(items, out, robot, middleware="yarp", source=source, twice=True)
    return ImportedContacts(periods, len(left_out), tuple(parts))


def _frames(
    number: int, stamp: float, found: tuple[SkinContact, ...], patches: dict[str, Patch],
    live: dict[str, set[int]], left_out: list[SkinContact],
) -> tuple[SkinFrame, ...]:  # fmt: skip
    """Converts the contacts `found` to one raw skin frame for each of the `patches`, with the time `stamp`
    [s] and the sequence number `number`.

    `live` contains, by patch, the channels that are taxels. A contact with none of these taxels is appended
    to `left_out`.
    """
    values = {name: np.full(patch.channels, patch.sensor.rest) for name, patch in patches.items()}
    for contact in found:
        patch = patches.get(SKIN_PARTS[contact.skin_part])
        if patch is None or live[patch.name].isdisjoint(contact.taxels.tolist()):
            left_out.append(contact)
            continue
        raw = patch.sensor.rest + np.sign(patch.sensor.pascal_per_count) * contact.pressure
        raw = np.clip(raw, patch.sensor.lowest, patch.sensor.highest)
        values[patch.name][contact.taxels[contact.taxels < patch.channels]] = raw
    return tuple(SkinFrame(name, stamp, number, read_only(raw)) for name, raw in values.items())
