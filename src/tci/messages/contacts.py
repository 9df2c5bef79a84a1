"""Contacts on the skin, and single contacts as views of them.

What a contact consists of is declared once, in `ContactColumns`. The records that compiled loops write
(`CONTACT`), the arrays of `Contacts` and the values of a `Contact` follow from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.messages.frames import Array, frozen

Records = NDArray[np.void]
_ARRAY = np.ndarray
_set_writable: Any = np.ndarray.setflags
"""With its keyword, this method takes three times as long."""
Many = TypeVar("Many")
One = TypeVar("One")


class Frozen:
    """Plain data with read-only arrays, also after unpickling and copying."""

    __slots__: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if isinstance(value, _ARRAY):
                _set_writable(value, False)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple([getattr(self, name) for name in self.__slots__])


class Site(NamedTuple):
    """Names that all contacts of a patch share."""

    patch: str
    """Name of the patch."""
    part: str
    """Generic part to which the patch belongs."""
    segment: str
    """Segment of the part: `upper_arm` or `forearm`; empty for skin on another part of the body."""


class _Column(Generic[Many, One]):
    """A property of contacts: an array with a row per contact in `Contacts`, one value in a `Contact`."""

    def __init__(self, dtype: type[np.generic], shape: tuple[int, ...] = ()) -> None:
        self.dtype, self.shape = dtype, shape

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, of: Contacts, owner: type) -> Many: ...
    @overload
    def __get__(self, of: Contact, owner: type) -> One: ...
    @overload
    def __get__(self, of: None, owner: type) -> _Column[Many, One]: ...
    def __get__(self, of: Contacts | Contact | None, owner: type) -> Any:
        return self if of is None else of._column(self.name)


def _integer() -> _Column[NDArray[np.int64], int]:
    return _Column(np.int64)


def _number() -> _Column[Array, float]:
    return _Column(np.float64)


def _vector() -> _Column[Array, Array]:
    return _Column(np.float64, (3,))


class ContactColumns:
    """The properties of contacts: arrays (c,) and (c, 3) in `Contacts`, numbers and vectors (3,) in a
    `Contact`."""

    __slots__ = ()

    site = _integer()
    """Index of the contact's patch in `sites`."""
    identity = _integer()
    """Unique number of the contact, constant from its first to its last frame."""
    onset = _number()
    """Time [s] of the first frame with the contact, on the driver's clock."""
    displacement = _number()
    """Distance [m] by which the centre has moved since the onset, in the frame of the patch's link."""
    force = _number()
    """Force [N] of the touch: the sum of the forces on its taxels, divided by two fractions. The first is the
    fill factor of the skin. The second is the estimated fraction of the force that taxels can measure: at the
    edge of a touch, the pressure is below their threshold."""
    peak = _number()
    """Force [N] on the strongest taxel."""
    area = _number()
    """Total area [m2] of the contact's taxels."""
    p_L = _vector()
    """Centre of pressure [m] on the surface, in the frame of the patch's link."""
    n_L = _vector()
    """Outward unit normal at the centre of pressure, in the frame of the patch's link."""
    p_T = _vector()
    """Centre of pressure [m] in the torso frame, with the joints as they were when a frame of any patch came
    last: a touched part moves on between two frames of a slow patch."""
    n_T = _vector()
    """Outward unit normal in the torso frame."""
    f_T = _vector()
    """Force [N] on the skin, in the torso frame: along the inward normal if the sensor does not measure the
    direction of the force."""
    u = _number()
    """Position along the segment: 0 at the proximal joint, 1 at the distal joint; NaN if the patch is not on
    a limb."""
    theta = _number()
    """Angle [rad] around the segment: 0 flexor, +pi/2 lateral, pi extensor, -pi/2 medial; NaN if the patch is
    not on a limb."""
    limb_point = _vector()
    """Position [limb lengths] on the generic limb (eq. 6); NaN if the patch is not on a limb."""
    certainty = _number()
    """Probability that the true place of the contact is less than 5 cm from the estimated place: 1 if skin
    measured the contact, less if it was estimated from joint torques."""


_COLUMNS = [one for one in vars(ContactColumns).values() if isinstance(one, _Column)]
CONTACT = np.dtype([(one.name, one.dtype, one.shape) for one in _COLUMNS], align=True)
"""Record of one contact."""
TAXEL = np.dtype(
    [("taxel", np.int64), ("taxel_force", np.float64), ("taxel_point", np.float64, (3,))], align=True
)
"""Record of one pressed taxel: index within its patch, force [N], position on the generic limb [limb
lengths]."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts(ContactColumns, Frozen, Sequence["Contact"]):
    """Contacts in the latest frames of all patches. `contacts[i]` is a view of row i. Contacts are in the
    order of patches; the strongest contact of each patch comes first."""

    sites: tuple[Site, ...]
    """Names of patch, part and segment for each of p patches. `site` gives the patch of each contact."""
    stamp: Array
    """Time (p,) [s] of the frame of each patch."""
    sequence: NDArray[np.int64]
    """Sequence number (p,) of the frame of each patch."""
    rows: Records
    """The contacts (c,) as records of type `CONTACT`. Each column is also an attribute, for example
    `contacts.force`."""
    begin: NDArray[np.int64]
    """Index (c + 1,) of each contact's first taxel in `taxel_rows`; the last element is k."""
    taxel_rows: Records
    """Taxels (k,) of all contacts as records of type `TAXEL`, one contact after another."""

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> Contact: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Contact, ...]: ...
    def __getitem__(self, index: int | slice) -> Contact | tuple[Contact, ...]:
        rows = range(len(self.rows))[index]
        return Contact(self, rows) if isinstance(rows, int) else tuple([Contact(self, row) for row in rows])

    def __iter__(self) -> Iterator[Contact]:
        return iter([Contact(self, row) for row in range(len(self.rows))])

    @property
    def taxel(self) -> NDArray[np.int64]:
        """Index (k,) of each taxel within its patch."""
        return self.taxel_rows["taxel"]

    @property
    def taxel_force(self) -> Array:
        """Force (k,) [N] on each taxel."""
        return self.taxel_rows["taxel_force"]

    @property
    def taxel_point(self) -> Array:
        """Position (k, 3) [limb lengths] of each taxel on the generic limb; NaN if the patch is not on a
        limb."""
        return self.taxel_rows["taxel_point"]

    def changed(self, **columns: ArrayLike) -> Contacts:
        """A copy in which these columns have other values, for example `force` (c,) [N] or `taxel_force` (k,)
        [N]."""
        rows, taxels = self.rows.copy(), self.taxel_rows.copy()
        for name, values in columns.items():
            (taxels if name in (TAXEL.names or ()) else rows)[name] = values
        return replace(self, rows=rows, taxel_rows=taxels)

    @staticmethod
    def of(rows: Iterable[Contact]) -> Contacts:
        """Puts contacts together, also those of several `Contacts`. In the result, `sites`, `stamp` and
        `sequence` have one element per contact, not per patch."""
        if isinstance(rows, Contacts):
            return rows
        chosen = tuple(rows)
        made = np.zeros(len(chosen), CONTACT)
        for row, one in enumerate(chosen):
            made[row] = one.table.rows[one.row]
        made["site"] = np.arange(len(chosen))
        taxels = [one.table.taxel_rows[one._own] for one in chosen]
        return Contacts(
            sites=tuple([one._site for one in chosen]),
            stamp=np.array([one.stamp for one in chosen], np.float64),
            sequence=np.array([one.sequence for one in chosen], np.int64),
            rows=made,
            begin=np.cumsum([0, *map(len, taxels)]),
            taxel_rows=np.concatenate([np.zeros(0, TAXEL), *taxels]),
        )

    def _column(self, name: str) -> NDArray[Any]:
        return self.rows[name]


@dataclass(frozen=True, slots=True)
class Contact(ContactColumns):
    """A cluster of active taxels (eq. 7): a view of one row of `Contacts`."""

    table: Contacts
    row: int

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
        return float(self.table.stamp[self.site])

    @property
    def sequence(self) -> int:
        """Sequence number of the frame that contains the contact."""
        return int(self.table.sequence[self.site])

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
        return self.table.sites[self.site]

    @property
    def _own(self) -> slice:
        return slice(*self.table.begin[self.row : self.row + 2].tolist())

    def _column(self, name: str) -> Any:
        value = self.table.rows[name][self.row]
        return value if value.ndim else value.item()
