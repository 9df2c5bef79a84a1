"""Contacts of a skin as arrays, and single contacts. A single contact is a view of one row of these
arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array, frozen
from tci.support.records import quick

_ARRAY = np.ndarray
_set_writable: Any = _ARRAY.setflags
"""Function `(array, writable)` that makes an array writable or read-only. Calling `array.setflags` with a
keyword would take three times as long."""


class Frozen:
    """Plain data with read-only arrays. Unpickled arrays are made read-only again."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for value in _values(self):
            if isinstance(value, _ARRAY):
                _set_writable(value, False)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), _values(self)


_GETTERS: dict[type, Callable[[object], tuple[Any, ...]]] = {}
"""For each class of data: a function that returns all fields of an object. One such call is faster than one
call per field."""


def _values(data: Frozen) -> tuple[Any, ...]:
    """Returns the values of all fields of `data`, in the order of the fields."""
    kind: Any = type(data)
    if kind not in _GETTERS:
        first, *others = kind.__slots__
        _GETTERS[kind] = attrgetter(first, *others)
    return _GETTERS[kind](data)


class Site(NamedTuple):
    """Names that all contacts of a patch share."""

    patch: str
    """Name of the patch."""
    part: str
    """Generic part to which the patch belongs."""
    segment: str
    """Segment of the part: `upper_arm` or `forearm`; empty for skin on another part of the body."""


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Contacts(Frozen, Sequence["Contact"]):
    """Contacts in the latest frames of all patches, as arrays with one row per contact. `contacts[i]` is a
    view of row i. Contacts are in the order of patches; the strongest contact of each patch comes first."""

    sites: tuple[Site, ...]
    """Names of patch, part and segment for each of p patches. `site` gives the patch of each contact."""
    stamp: Array
    """Time (p,) [s] of the frame of each patch."""
    sequence: NDArray[np.int64]
    """Sequence number (p,) of the frame of each patch."""
    site: NDArray[np.int64]
    """Index (c,) of each contact's patch in `sites`."""
    identity: NDArray[np.int64]
    """Unique number (c,) of each contact, constant from its first to its last frame."""
    onset: Array
    """Time (c,) [s] of the first frame with the contact, on the driver's clock."""
    displacement: Array
    """Distance (c,) [m] by which the centre of each contact has moved since its onset, measured in the frame
    of the patch's link."""
    force: Array
    """Force (c,) [N] of each touch: the sum of the forces on its taxels, divided by two fractions. The first
    is the fill factor of the skin. The second is the estimated fraction of the force that taxels can measure:
    at the edge of a touch, the pressure is below their threshold."""
    peak: Array
    """Force (c,) [N] on the strongest taxel of each contact."""
    area: Array
    """Total area (c,) [m2] of each contact's taxels."""
    p_L: Array
    """Centre of pressure (c, 3) [m] on the surface, in the frame of the patch's link."""
    n_L: Array
    """Outward unit normal (c, 3) at the centre of pressure, in the frame of the patch's link."""
    p_T: Array
    """Centre of pressure (c, 3) [m] in the torso frame."""
    n_T: Array
    """Outward unit normal (c, 3) in the torso frame."""
    f_T: Array
    """Force (c, 3) [N] on the skin, in the torso frame. If the sensor does not measure the direction of the
    force, the direction is the inward normal."""
    u: Array
    """Position (c,) along the segment: 0 at the proximal joint, 1 at the distal joint; NaN if the patch is
    not on a limb."""
    theta: Array
    """Angle (c,) [rad] around the segment: 0 flexor, +pi/2 lateral, pi extensor, -pi/2 medial; NaN if the
    patch is not on a limb."""
    limb_point: Array
    """Position (c, 3) [limb lengths] on the generic limb (eq. 6); NaN if the patch is not on a limb."""
    begin: NDArray[np.int64]
    """Index (c + 1,) of each contact's first taxel in the arrays of taxels (k,) below; the last element is
    k."""
    taxel: NDArray[np.int64]
    """Taxels (k,) of all contacts, one contact after another, as indices within their patch."""
    taxel_force: Array
    """Force (k,) [N] on each of the k taxels of all contacts."""
    taxel_point: Array
    """Position (k, 3) [limb lengths], on the generic limb, of each of the k taxels of all contacts; NaN if
    the patch is not on a limb."""
    certainty: Array | None = None
    """Probability (c,) that the true place of a contact is less than 5 cm from the estimated place. The value
    is 1 for contacts that skin measured, and lower for touches that were estimated from joint torques. None
    means that skin measured all contacts."""

    def __len__(self) -> int:
        return len(self.site)

    @overload
    def __getitem__(self, index: int) -> Contact: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Contact, ...]: ...
    def __getitem__(self, index: int | slice) -> Contact | tuple[Contact, ...]:
        rows = range(len(self.site))[index]
        return Contact(self, rows) if isinstance(rows, int) else tuple([Contact(self, row) for row in rows])

    def __iter__(self) -> Iterator[Contact]:
        return map(partial(Contact, self), range(len(self.site)))

    @staticmethod
    def of(rows: Iterable[Contact]) -> Contacts:
        """Returns an object with the contacts in `rows`, which may come from several `Contacts`. In the
        result, `sites`, `stamp` and `sequence` have one element per contact, not per patch."""
        if isinstance(rows, Contacts):
            return rows
        rows = tuple(rows)
        tables = [(one.table, one.row, slice(*one.table.begin[one.row : one.row + 2])) for one in rows]

        def joined(name: str, shape: tuple[int, ...] = (0,)) -> NDArray[Any]:
            of_taxels = name.startswith("taxel")
            parts = [getattr(t, name)[own if of_taxels else slice(row, row + 1)] for t, row, own in tables]
            return np.concatenate(parts) if parts else np.zeros(shape, np.float64)

        return Contacts(
            sites=tuple(one.table.sites[one.table.site[one.row]] for one in rows),
            stamp=np.array([one.stamp for one in rows]),
            sequence=np.array([one.sequence for one in rows], np.int64),
            site=np.arange(len(rows)),
            identity=joined("identity").astype(np.int64),
            begin=np.cumsum([0, *(len(one.taxels) for one in rows)]),
            certainty=(
                None
                if all(one.table.certainty is None for one in rows)
                else np.array([one.certainty for one in rows])
            ),
            taxel=joined("taxel").astype(np.int64),
            **{name: joined(name, (0, 3)) for name in _VECTORS},
            **{name: joined(name) for name in _NUMBERS},
        )


_VECTORS = ("p_L", "n_L", "p_T", "n_T", "f_T", "limb_point", "taxel_point")
_NUMBERS = ("onset", "displacement", "force", "peak", "area", "u", "theta", "taxel_force")


class _Number:
    """Attribute of a `Contact` whose value is a number: the element of this contact in the array with the
    same name in `Contacts`."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, contact: Contact, owner: type) -> float:
        return float(getattr(contact.table, self.name)[contact.row])


class _Vector(_Number):
    """Attribute of a `Contact` whose value is a vector (3,): the row of this contact in the array with the
    same name in `Contacts`."""

    def __get__(self, contact: Contact, owner: type) -> Array:  # type: ignore[override]  # no number
        vector: Array = getattr(contact.table, self.name)[contact.row]
        return vector


@quick
@dataclass(frozen=True, slots=True)
class Contact:
    """A cluster of active taxels (eq. 7): a view of one row of `Contacts`. The fields of `Contacts` explain
    the numbers and their units."""

    table: Contacts
    row: int

    onset, displacement = _Number(), _Number()
    force, peak, area, u, theta = _Number(), _Number(), _Number(), _Number(), _Number()
    p_L, n_L, p_T, n_T, f_T = _Vector(), _Vector(), _Vector(), _Vector(), _Vector()
    limb_point = _Vector()

    def __repr__(self) -> str:
        place = f", {self.segment} u={self.u:.2f} theta={self.theta:.2f} rad" if self.segment else ""
        return (
            f"Contact({self.identity} on {self.patch}: {self.force:.2f} N, {1e4 * self.area:.1f} cm2{place})"
        )

    @property
    def patch(self) -> str:
        """Name of the patch."""
        return self._site.patch

    @property
    def part(self) -> str:
        """Generic part to which the patch belongs."""
        return self._site.part

    @property
    def segment(self) -> str:
        """Segment of the part: `upper_arm` or `forearm`; empty for skin on another part of the body."""
        return self._site.segment

    @property
    def stamp(self) -> float:
        """Time [s] of the frame that contains the contact."""
        return float(self.table.stamp[self.table.site[self.row]])

    @property
    def sequence(self) -> int:
        """Sequence number of the frame that contains the contact."""
        return int(self.table.sequence[self.table.site[self.row]])

    @property
    def identity(self) -> int:
        """Unique number of the contact, constant from its first to its last frame."""
        return int(self.table.identity[self.row])

    @property
    def certainty(self) -> float:
        """Probability (0..1) that the contact's true place is within 5 cm of the estimated place: 1 if skin
        measured the contact, lower if it was estimated from joint torques."""
        return 1.0 if self.table.certainty is None else float(self.table.certainty[self.row])

    @property
    def taxels(self) -> NDArray[np.int64]:
        """Indices (k,) of the contact's taxels within the patch."""
        return self.table.taxel[self._own]

    @property
    def taxel_forces(self) -> Array:
        """Force (k,) [N] on each taxel."""
        return self.table.taxel_force[self._own]

    @property
    def taxel_u(self) -> Array:
        """Position (k,) of each taxel along the segment, from 0 (proximal) to 1 (distal); NaN if the patch is
        not on a limb."""
        return self.table.taxel_point[self._own, 0]

    @property
    def taxel_theta(self) -> Array:
        """Angle (k,) [rad] of each taxel around the segment; NaN if the patch is not on a limb."""
        points = self.table.taxel_point[self._own]
        return frozen(np.arctan2(points[:, 1], points[:, 2]))

    @property
    def _site(self) -> Site:
        site: Site = self.table.sites[int(self.table.site[self.row])]
        return site

    @property
    def _own(self) -> slice:
        return slice(*self.table.begin[self.row : self.row + 2].tolist())
