"""The contacts of a frame in arrays. A `Contact` is made when somebody asks for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import chain
from typing import overload

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array, read_only
from tci.messages import Contact, PatchState, SkinFrame
from tci.robot.limb import generic_limb_point
from tci.skin.kernels.contacts import NUMBERS
from tci.skin.kernels.flat_skin import Site, segments_of


class ContactTable(Sequence[Contact]):
    """Contacts (c,) in their order; arrays are read-only, and in the order in which contacts were found."""

    def __init__(
        self,
        sites: Sequence[Site],
        segments: NDArray[np.int64],
        frames: Mapping[str, SkinFrame | PatchState],
        rows: NDArray[np.int64],
        numbers: Array,
        vectors: Array,
        indices: NDArray[np.intp],
        places: Array,
        told: Array,
    ) -> None:
        """`frames` are those that they were found in, by patch; see `describe_all` and `follow_all` for the
        arrays, which become read-only."""
        for array in (rows, numbers, vectors, indices, places, told):
            array.setflags(write=False)
        self.sites = sites
        """The patches (p,) of the skin."""
        self.segments = segments
        """Their places (p,) in SEGMENTS; -1 for none of these."""
        self._frames = frames
        self.bounds = rows[0]
        """Where the taxels of each contact begin (c + 1,)."""
        self.patch = rows[1, :-1]
        """The patch (c,) of each, among `sites`."""
        self.numbers = numbers
        """(c, NUMBERS), see `kernels.contacts`."""
        self.vectors = vectors
        """(c, VECTORS, 3), likewise."""
        self.indices = indices
        """The taxels (k,) of all contacts, in their patches."""
        self.places = places
        """Force [N], and u, y, z on the generic limb (4, k) of each of them."""
        self.told = told
        """Identity, begin [s] and way [m] (c, 3)."""
        self.order: list[int] = rows[2, :-1].tolist()
        """The row of each contact."""
        self._made: dict[int, Contact] = {}
        self.identities: list[float] = told[:, 0].tolist()
        """The number of each."""

    @staticmethod
    def of(contacts: Iterable[Contact]) -> ContactTable:
        """The table of any contacts."""
        if isinstance(contacts, ContactTable):
            return contacts
        made = list(contacts)
        count = len(made)
        rows = np.tile(np.arange(count + 1), (3, 1))
        rows[0, 1:] = np.cumsum([len(one.taxel_forces) for one in made])
        lists = [np.array([c.taxel_forces, *generic_limb_point(c.taxel_u, c.taxel_theta).T]) for c in made]
        table = ContactTable(
            [Site(one.patch, one.part, one.segment) for one in made],
            segments_of([one.segment for one in made]),
            {},
            rows,
            np.array(
                [
                    (c.force, c.peak_force, c.area, c.u, c.theta, *generic_limb_point(c.u, c.theta)[1:])
                    for c in made
                ]
            ).reshape(-1, NUMBERS),
            np.array([(c.p_L, c.n_L, c.p_T, c.n_T, c.f_T) for c in made]).reshape(-1, 5, 3),
            np.array([*chain.from_iterable(one.taxels for one in made)], np.intp),
            np.ascontiguousarray(np.concatenate([np.zeros((4, 0)), *lists], axis=1)),
            np.array([(c.identity, c.began, c.moved) for c in made]).reshape(-1, 3),
        )
        table._made.update(enumerate(made))
        return table

    def __len__(self) -> int:
        return len(self.order)

    @overload
    def __getitem__(self, index: int) -> Contact: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Contact, ...]: ...
    def __getitem__(self, index: int | slice) -> Contact | tuple[Contact, ...]:
        if isinstance(index, slice):
            return tuple(self._make(row) for row in self.order[index])
        return self._make(self.order[index])

    @cached_property
    def _lists(self) -> tuple[list[int], list[int], list[list[float]], list[list[float]], Array]:
        """What all contacts are made of, out of the arrays at once; the angle (k,) [rad] of each taxel."""
        lists = self.patch.tolist(), self.bounds.tolist(), self.numbers.tolist(), self.told.tolist()
        return *lists, read_only(np.arctan2(self.places[2], self.places[3]))

    def _make(self, row: int) -> Contact:
        contact = self._made.get(row)
        if contact is None:
            patches, bounds, numbers, told, taxel_theta = self._lists
            site = self.sites[patches[row]]
            frame = self._frames[site.patch]
            own = slice(bounds[row], bounds[row + 1])
            force, peak, area, u, theta, _, _ = numbers[row]
            identity, began, moved = told[row]
            p_L, n_L, p_T, n_T, f_T = self.vectors[row]
            contact = self._made[row] = Contact(
                patch=site.patch,
                part=site.part,
                segment=site.segment,
                stamp=frame.stamp,
                sequence=frame.sequence,
                taxels=self.indices[own],
                taxel_forces=self.places[0, own],
                force=force,
                peak_force=peak,
                area=area,
                p_L=p_L,
                n_L=n_L,
                p_T=p_T,
                n_T=n_T,
                f_T=f_T,
                u=u,
                theta=theta,
                taxel_u=self.places[1, own],
                taxel_theta=taxel_theta[own],
                identity=int(identity),
                began=began,
                moved=moved,
            )
        return contact


def identities(contacts: Sequence[Contact]) -> list[float]:
    """The numbers (c,) of contacts."""
    if not contacts:
        return []
    if isinstance(contacts, ContactTable):
        return contacts.identities
    return [one.identity for one in contacts]
