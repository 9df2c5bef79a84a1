"""Encodes and decodes contacts in the format of iCub's skinManager.

Each contact is a list, with vectors in the frame that iDyn attaches to the contact's link, and taxels by
their places among the values of the patch's port. CoP is the centre of pressure, F the force and M the
moment: `((id body link skin) (CoP) (F) (M) (centre) (normal) (taxels ..) pressure)`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tci.messages import Contact
from tci.messages.frames import Array, read_only
from tci.recording.icub_links import has_icub_joints, link_frame
from tci.robot.description import Patch, Robot
from tci.skin.skin import Skin
from tci.wires.yarp.skin_layout import SkinLayout
from yarpwire.errors import WireError

NEWTON = 0.05
"""Force [N] on a taxel divided by its pressure in the sensor's own unit, from skinManager's formula."""
BODY_PARTS = {"torso": 1, "head": 2, "left_arm": 3, "right_arm": 4, "left_leg": 5, "right_leg": 6}
SEGMENTS = {
    "hand": (6, 1, 3), "forearm": (4, 2, 3), "upper_arm": (2, 3, 3),
    "thigh": (2, 8, 3), "shank": (3, 9, 3), "foot": (5, 10, 3),
}  # fmt: skip
"""For each segment the number of its link, that of the left skin part, and how much higher the number of the
right one is."""
MOST = 1000
"""Largest number of contacts in one event, to bound the used memory. Assumed: an iCub has only a few contacts
at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class SkinEvent:
    """One contact that skinManager published."""

    id: int
    body_part: int
    """Number of the body part: 1 torso, 2 head, 3 left arm, 4 right arm, 5 left leg, 6 right leg."""
    link: int
    """Number of the link within its body part."""
    skin_part: int
    """Number of the skin part: 1 left hand, 2 left forearm, 3 left upper arm; 4 to 6 in this order on the
    right side; 7 chest; 8 to 10 left thigh, shank and foot; 11 to 13 in this order on the right side."""
    cop: Array
    """Centre of pressure (3,) [m] in the frame of the link."""
    force: Array
    """Force (3,) [N] in the frame of the link, computed with skinManager's formula."""
    normal: Array
    """Mean normal (3,) in the frame of the link, weighted by pressure. The vector's length may differ from
    1."""
    taxels: tuple[int, ...]
    """Place of each taxel of the contact among the values of the skin part's port."""
    pressure: float
    """Mean pressure of the taxels, in the sensor's own unit."""
    frame: str = ""
    """The robot's link in whose frame the vectors are; empty: the frame that iDyn attaches to its link."""


class EventForm:
    """Converts the contacts of one robot to skinManager's form, and events to the frames of its links."""

    def __init__(self, robot: Robot) -> None:
        """Raises DriverError if the modules in the robot's binding don't fit a patch."""
        self._icub = has_icub_joints(robot)
        self._patches = {patch.name: patch for patch in robot.patches}
        self._surfaces = Skin(robot).surfaces
        self._frames = {name: link_frame(robot, name) for name in self._patches}
        self._layouts = {name: SkinLayout.of(robot, patch) for name, patch in self._patches.items()}

    def encode(self, contacts: Sequence[Contact]) -> list[Any]:
        """Contacts as a Bottle of YARP. Leaves out contacts on parts for which skinManager has no number, and
        on an iCub those on links whose frame in iDyn is unknown: torso, head and shanks."""
        known = (contact for contact in contacts if _numbers(self._patches[contact.patch]) is not None)
        return [
            self._encode(contact)
            for contact in known
            if not self._icub or self._frames[contact.patch] is not None
        ]

    def _encode(self, contact: Contact) -> list[Any]:
        surface, frame = self._surfaces[contact.patch], self._frames[contact.patch]
        T_DL = np.eye(4) if frame is None else np.linalg.inv(frame)
        centre = surface.positions[contact.taxels].mean(axis=0)
        where, middle = (T_DL[:3, :3] @ point + T_DL[:3, 3] for point in (contact.p_L, centre))
        normal = T_DL[:3, :3] @ contact.n_L
        places, taxels = self._layouts[contact.patch].places, surface.channels[contact.taxels]
        pressure = contact.taxel_forces.sum() / (NEWTON * max(len(contact.taxels), 1))
        return [
            [contact.identity, *(_numbers(self._patches[contact.patch]) or ())],
            where.tolist(), (-contact.force * normal).tolist(), [0.0, 0.0, 0.0], middle.tolist(),
            normal.tolist(), (taxels if places is None else places[taxels]).tolist(), pressure,
        ]  # fmt: skip

    def in_links(self, events: Sequence[SkinEvent]) -> tuple[SkinEvent, ...]:
        """Events of skinManager with vectors in the frames of the robot's links, where these are known."""
        by_part = {_numbers(patch): patch for patch in self._patches.values()}
        return tuple(
            self._in_link(event, by_part.get((event.body_part, event.link, event.skin_part)))
            for event in events
        )

    def _in_link(self, event: SkinEvent, patch: Patch | None) -> SkinEvent:
        T_LD = None if patch is None else self._frames[patch.name]
        if patch is None or (T_LD is None and self._icub):
            return event
        T = np.eye(4) if T_LD is None else T_LD
        return replace(
            event, frame=patch.link, cop=read_only(T[:3, :3] @ event.cop + T[:3, 3]),
            force=read_only(T[:3, :3] @ event.force), normal=read_only(T[:3, :3] @ event.normal),
        )  # fmt: skip


def _numbers(patch: Patch) -> tuple[int, int, int] | None:
    """Numbers of the body part, of the link and of the skin part of a patch; None if it has none."""
    arm = patch.part.replace("_hand", "_arm")
    segment = patch.segment or ("hand" if arm != patch.part else "")
    if arm not in BODY_PARTS:
        return None
    link, skin, right = SEGMENTS.get(segment, (2, 7, 0) if arm == "torso" else (0, 0, 0))
    return BODY_PARTS[arm], link, skin + right * arm.startswith("right")


def decode_events(items: Sequence[Any]) -> tuple[SkinEvent, ...]:
    """Returns the contacts in a Bottle from skinManager. Raises WireError if the Bottle is invalid."""
    if len(items) > MOST:
        raise WireError(f"{len(items)} contacts at once; valid: up to {MOST}")
    return tuple(_decode(item) for item in items)


def _decode(item: Any) -> SkinEvent:
    if not isinstance(item, list) or len(item) != 8 or not all(isinstance(part, list) for part in item[:7]):
        raise WireError(f"{str(item)[:60]} is no contact; valid: seven lists and a number")
    ids, cop, force, _, _, normal, taxels, pressure = item
    vectors = [np.array([_number(value) for value in vector]) for vector in (cop, force, normal)]
    if len(ids) != 4 or any(len(vector) != 3 for vector in vectors):
        raise WireError(f"{str(item)[:60]} is no contact; valid: 4 numbers, then vectors of 3 numbers")
    whole = [int(_number(value)) for value in (*ids, *taxels)]
    return SkinEvent(
        id=whole[0], body_part=whole[1], link=whole[2], skin_part=whole[3],
        cop=read_only(vectors[0]), force=read_only(vectors[1]), normal=read_only(vectors[2]),
        taxels=tuple(whole[4:]), pressure=_number(pressure),
    )  # fmt: skip


def _number(value: Any) -> float:
    if not isinstance(value, int | float) or not np.isfinite(value):
        raise WireError(f"{value!r} in a contact; valid: finite numbers")
    return float(value)
