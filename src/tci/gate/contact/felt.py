"""Forces on the skin of the gate's groups of servos, and whether the robot's own motion made them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tci.messages import Contacts
from tci.messages.frames import Array

RAISED = 5.0
"""Force [N] by which a contact of a resting part grows while the part moves, from which on the part counts as
having made it: more than a hand's own trembling."""
ALIKE = 0.5
"""Cosine of the angle between the normals of two contacts from which on the same person presses: a contact
that moves to the next patch, or parts in two, is a new one. A second person, whom a way back meets, is on the
other side."""


class FeltContact(NamedTuple):
    """One contact, in the torso frame."""

    force: float
    """[N]."""
    normal: Array
    """Outward (3,)."""
    point: Array
    """Its centre (3,) [m]."""


@dataclass(frozen=True, slots=True)
class Felt:
    """What the skin of one group feels."""

    force: float = 0.0
    """Largest force [N]."""
    made: float = 0.0
    """Largest force [N] of contacts that the group's own motion made or raised."""
    since: float = np.inf
    """When the first of these was felt or raised [s]."""
    contacts: Mapping[int, FeltContact] = field(default_factory=dict)
    """By their identities."""
    own: frozenset[int] = frozenset()
    """Those that the group's own motion made or raised."""

    def of(self, identities: Collection[int]) -> dict[int, Array]:
        """Normals of these contacts, or of all if there are none of these."""
        return {
            one: felt.normal for one, felt in self.contacts.items() if not identities or one in identities
        }

    @property
    def sides(self) -> tuple[float, float]:
        """Largest force [N], and the largest on another side of the group."""
        most = max(self.contacts.items(), key=lambda one: one[1].force, default=None)
        return (0.0, 0.0) if most is None else self.other_than({most[0]: most[1].normal})

    def other_than(self, first: Mapping[int, Array]) -> tuple[float, float]:
        """Largest force [N] of the contacts in `first` (with their normals) and of those like them, and of
        all others."""
        forces = [0.0], [0.0]
        for identity, felt in self.contacts.items():
            alike = identity in first or any(float(felt.normal @ way) > ALIKE for way in first.values())
            forces[not alike].append(felt.force)
        return max(forces[0]), max(forces[1])


@dataclass(frozen=True, slots=True)
class _Known:
    made_by: frozenset[int]
    rest: Mapping[int, float]
    """Force [N] when the group last rested."""
    since: float
    """When it was felt, or raised by another group, first [s]."""


class FeltForces:
    """Remembers for each contact which groups made it."""

    def __init__(self, parts: Mapping[str, Collection[int]], moves: Callable[[int], bool]) -> None:
        """`parts` names the groups of each generic part; `moves` tells whether a group moves, or did a
        moment ago."""
        self._parts, self._moves = parts, moves
        self._known: dict[int, _Known] = {}

    def step(self, contacts: Contacts | None, now: float) -> dict[int, Felt]:
        """What each group feels at `now` [s]; empty if that is unknown, because frames did not fit."""
        if contacts is None:
            return {}
        known, found = self._known, dict[int, Felt]()
        self._known = {}
        parts = [contacts.sites[site].part for site in contacts.site.tolist()]
        rows = zip(
            parts,
            contacts.identity.tolist(),
            contacts.force.tolist(),
            contacts.n_T,
            contacts.p_T,
            strict=True,
        )
        for part, identity, force, normal, point in rows:
            groups = self._parts.get(part, ())
            now_known = self._known[identity] = self._look_at(known.get(identity), force, groups, now)
            for group in groups:
                before, own = found.get(group, Felt()), group in now_known.made_by
                made = force if own else 0.0
                all_of_it = {**before.contacts, identity: FeltContact(force, normal, point)}
                mine = before.own | {identity} if own else before.own
                since = min(before.since, now_known.since) if own else before.since
                found[group] = Felt(max(before.force, force), max(before.made, made), since, all_of_it, mine)
        return found

    def settle(self, contacts: Mapping[int, FeltContact]) -> None:
        """No motion counts as having made these contacts (by identity) any more, until one raises them."""
        for identity, felt in contacts.items():
            known = self._known[identity]
            self._known[identity] = _Known(frozenset(), dict.fromkeys(known.rest, felt.force), known.since)

    def _look_at(self, known: _Known | None, force: float, groups: Collection[int], now: float) -> _Known:
        moving = frozenset([group for group in groups if self._moves(group)])
        if known is None:
            return _Known(moving, dict.fromkeys(groups, force), now)
        raised = {group for group in moving if force > known.rest.get(group, force) + RAISED}
        rest = {group: known.rest.get(group, force) if group in moving else force for group in groups}
        since = known.since if raised <= known.made_by else now
        return _Known(known.made_by | raised, rest, since)
