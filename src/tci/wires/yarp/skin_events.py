"""Encodes and decodes contacts in the format of iCub's skinManager.

Each contact is a list, with vectors in the frame of the contact's link. CoP is the centre of pressure, F the
force and M the moment: `((id body link skin) (CoP) (F) (M) (centre) (normal) (taxels ..) pressure)`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tci.messages import Contact
from tci.messages.frames import Array, read_only
from yarpwire.errors import WireError

NEWTON = 0.05
"""Force [N] on a taxel divided by its pressure in the sensor's own unit, from skinManager's formula."""
BODY_PARTS = {"torso": 1, "head": 2, "left_arm": 3, "right_arm": 4, "left_leg": 5, "right_leg": 6}
SEGMENTS = {"hand": (6, 1), "forearm": (4, 2), "upper_arm": (2, 3)}
"""Numbers of the link and of the left skin part for each segment. The number of a right skin part is higher
by three."""
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
    right side; 7 chest."""
    cop: Array
    """Centre of pressure (3,) [m] in the frame of the link."""
    force: Array
    """Force (3,) [N] in the frame of the link, computed with skinManager's formula."""
    normal: Array
    """Mean normal (3,) in the frame of the link, weighted by pressure. The vector's length may differ from
    1."""
    taxels: tuple[int, ...]
    """Index, within the skin part, of each taxel of the contact."""
    pressure: float
    """Mean pressure of the taxels, in the sensor's own unit."""


def encode_events(contacts: Sequence[Contact]) -> list[Any]:
    """Returns contacts as a Bottle of YARP. Leaves out contacts on parts for which skinManager has no
    number."""
    return [_encode(number, contact) for number, contact in enumerate(contacts) if contact.part in BODY_PARTS]


def _encode(number: int, contact: Contact) -> list[Any]:
    link, skin = SEGMENTS.get(contact.segment, (0, 7 if contact.part == "torso" else 0))
    skin += 3 * contact.part.startswith("right") if skin in (1, 2, 3) else 0
    where, push = contact.p_L.tolist(), (-contact.force * contact.n_L).tolist()
    pressure = contact.taxel_forces.sum() / (NEWTON * max(len(contact.taxels), 1))
    return [
        [number, BODY_PARTS[contact.part], link, skin], where, push, [0.0, 0.0, 0.0], where,
        contact.n_L.tolist(), contact.taxels.tolist(), pressure,
    ]  # fmt: skip


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
