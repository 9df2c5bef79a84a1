"""Receptive fields on the page: finds the field at a point, and returns the colours and the legend of the
fields."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.capabilities.arbiter import Arbiter
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.capabilities.wrapper import unwrapped
from tci.lab.pictures.paint import FIELD_COLOURS
from tci.messages import Contact
from tci.messages.frames import Array
from tci.robot.limb import generic_limb_distance

OUTSIDE = "touched outside all fields"
"""Text for a touch that is outside all fields."""
REST = np.array([0.42, 0.45, 0.50])
"""Colour of taxels at rest outside all fields."""
TINT = 0.6
"""Fraction (0 to 1) of a field's colour in the colour of a resting taxel in this field. The remaining
fraction is the colour of taxels outside all fields."""


def fields_of(capability: Capability[Any]) -> tuple[ReceptiveField, ...]:
    """Returns the receptive fields of a behaviour, or an empty tuple if the behaviour has no fields on
    limbs."""
    inner = unwrapped(capability)
    if isinstance(inner, Arbiter):
        return next(filter(None, map(fields_of, inner.layers)), ())
    return tuple(inner.fields) if isinstance(inner, WithdrawalReflex) else ()


def nearest_field(
    fields: Sequence[ReceptiveField], segment: str, u: ArrayLike, theta: ArrayLike
) -> NDArray[np.intp]:
    """Returns, for each point (...) of a segment, the index of the nearest field that contains the point. The
    index is -1 if no field contains the point."""
    u = np.asarray(u, dtype=float)
    found, least = np.full(u.shape, -1), np.full(u.shape, np.inf)
    for index, field in enumerate(fields):
        if field.segment == segment:
            away = generic_limb_distance(u, theta, field.u, field.theta)
            inside = (away < field.radius) & (away < least)
            found[inside], least[inside] = index, away[inside]
    return found


def is_outside(fields: Sequence[ReceptiveField], contact: Contact) -> bool:
    """Returns True if the behaviour has fields, and the contact is outside all fields."""
    return bool(fields) and bool(nearest_field(fields, contact.segment, contact.u, contact.theta) < 0)


def tints(fields: NDArray[np.intp]) -> Array:
    """Returns the colours (n, 3), 0 to 1, of taxels at rest. `fields` (n,) has the index of each taxel's
    field, or -1 for a taxel outside all fields."""
    colours = REST + TINT * (np.array(FIELD_COLOURS)[fields % len(FIELD_COLOURS)] - REST)
    return np.where(fields[:, None] < 0, REST, colours)


def legend(fields: Sequence[ReceptiveField]) -> str:
    """Returns each field's colour and name as HTML."""
    names = [*(field.name.replace("_", " ") for field in fields), "outside all fields"]
    colours = np.rint(255.0 * tints(np.array([*range(len(fields)), -1]))).astype(int)
    rows = [
        f'<span style="white-space:nowrap;margin-right:10px"><span style="display:inline-block;width:10px;'
        f'height:10px;border-radius:5px;background:rgb{tuple(colour)}"></span> {escape(name)}</span>'
        for name, colour in zip(names, colours.tolist(), strict=True)
    ]
    return f'<div style="font-size:12px;line-height:1.6;padding:3px 12px">{" ".join(rows)}</div>'
