"""Contacts: clusters of active taxels with their centre of pressure on the skin (eq. 7).

Active taxels are clustered before eq. 7 is applied to each cluster. If two places of a limb are touched, the
mean of eq. 7 over the whole skin would be on the untouched skin between them, or inside the limb.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import TciError, UnknownNameError
from tci.messages import Contact, Contacts, Site, SkinState
from tci.messages.contacts import CONTACT, TAXEL
from tci.messages.frames import Array
from tci.robot.description import SOLE
from tci.robot.kernels.weighted_force import mean_force
from tci.robot.limb import generic_limb_point
from tci.skin.estimation import SATURATED
from tci.skin.isolated import IsolatedSettings
from tci.skin.kernels.arrays import (
    WAITING,
    ActiveTaxels,
    Clusters,
    ContactArrays,
    Estimates,
    Limits,
    Records,
    room_for,
)
from tci.skin.kernels.contacts import SUMMARY, cluster, describe
from tci.skin.kernels.isolated import reject_isolated
from tci.skin.layout import AXES, SkinLayout
from tci.skin.tracking import Tracker

_NONE = Contacts.of(())
Measure = Literal["total", "weighted", "peak"]
"""Kind of scalar force of a contact: "total" is the force of the whole touch, "weighted" the mean F-bar of
eq. 7, "peak" the force on the strongest taxel."""


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """Thresholds at which active taxels form a contact."""

    touch: float = 0.1
    """Least force [N] on the most strongly pressed taxel of a contact. Assumed: this is 3 counts on an iCub's
    forearm."""
    light: float = 0.05
    """Least force [N] that replaces `touch` if the taxel's noise is known and its value is two counts or more
    above rest. Assumed: on the sleeves of all robots in TCI, two counts mean more force than this, so the two
    counts decide alone."""
    floor: float = 0.01
    """An active taxel belongs to a contact only if the force on this taxel is at least this value [N]. The
    default is low enough to include the weak edge of a touch. Assumed: the default is below one count of an
    iCub's sensor. A sensor that flickers at rest needs a higher value."""
    isolated: IsolatedSettings | None = field(default_factory=IsolatedSettings)
    """Conditions under which a single active taxel is a contact. With None every active taxel can be a
    contact."""
    standing: float = 15.0
    """Force [N] on the pressed taxels of a sole (segment `foot`) from which the floor presses them all, so
    they are one contact. A leg withdraws from less only (`weight` of `BodyWithdrawal`). Before the rest
    values of a real iCub's foot were known, some of its taxels were 10 counts off, in up to 7 more contacts.
    """

    def __post_init__(self) -> None:
        if not self.standing > 0.0:
            raise TciError(f"contact settings standing={self.standing}; valid: above 0 N")
        if not 0.0 < self.floor <= self.light <= self.touch < np.inf:
            values = f"floor={self.floor}, light={self.light}, touch={self.touch}"
            raise TciError(f"contact settings {values}; valid: 0 < floor <= light <= touch, all finite")

    @property
    def limits(self) -> Limits:
        """Returns the forces [N] `touch`, `light` and `floor` in the form that the compiled loops read."""
        return Limits(float(self.floor), float(self.light), float(self.touch))


class ContactFinder:
    """Finds the contacts in each state of one skin and assigns identities to them."""

    def __init__(self, layout: SkinLayout, settings: ContactSettings = ContactSettings()) -> None:
        self.layout, self.settings = layout, settings
        self._tracker, self._limits = Tracker(), settings.limits
        self._parts = {site.part for site in layout.sites}
        self._soles = [p for p, site in enumerate(layout.sites) if site.segment == SOLE]
        taxels, patches = len(layout.arrays.taxels), len(layout.sites)
        self._clusters = Clusters(
            force=np.zeros(taxels),
            label=np.zeros(taxels, np.int32),
            queue=np.zeros(taxels, np.int32),
            counts=np.zeros(patches, np.int64),
            bound=np.zeros(taxels + 1, np.int32),
            member=np.zeros(taxels, np.int32),
            member_force=np.zeros(taxels),
        )
        self.contacts = _NONE
        """Contacts in the latest state."""
        self._waiting: Records = np.zeros(0, WAITING)
        if settings.isolated is not None:
            waits = settings.isolated.waits(layout.arrays.patches["rate"])
            ends = [float(one.response(np.array(SATURATED * one.full))) for one in layout.patches]
            self._rules = np.array([waits, ends])

    def find(
        self, state: SkinState, estimates: Estimates, poses: Callable[[], Array], posture: Mapping[str, Array]
    ) -> Contacts:
        """Returns all contacts of the skin, in the robot's order of patches.

        On each patch the strongest contact is first.

        `estimates` are the estimates with which the state was computed, and `poses` returns the poses of the
        links in `SkinLayout.links`. `posture` contains the generic angles (n,) [rad] of each part with skin.
        Raises UnknownNameError if `posture` does not contain a touched part.
        """
        if not len(state.active):
            self.contacts, self._waiting = _NONE, self._waiting[:0]
            return self.contacts
        layout, clusters, isolated = self.layout, self._clusters, self.settings.isolated
        active = ActiveTaxels(state.stamp, state.begin, state.active, state.pressure)
        count, taxels, single = cluster(active, self._limits, estimates.onset, layout.arrays, clusters)
        waiting: Records = self._waiting[:0]
        if single and isolated is not None:
            count, taxels, waiting = self._reject(active, estimates, isolated, single)
        self._waiting = waiting
        count = self._stand(count)
        if not count:
            self.contacts = _NONE
            return self.contacts
        angles, links = self._angles(posture), poses()
        made = ContactArrays.empty(count, taxels)
        room = room_for(count, SUMMARY)
        describe(layout.arrays, estimates.hidden, clusters, links, angles, room, made)
        if state.vector is not None:
            self._turn(made, state, state.vector, links)
        self._tracker.follow(made, state.stamp)
        self.contacts = Contacts(layout.sites, state.stamp, state.sequence, *made)
        return self.contacts

    def _reject(
        self, active: ActiveTaxels, estimates: Estimates, settings: IsolatedSettings, single: int
    ) -> tuple[int, int, Records]:
        """Removes each cluster that consists of a single taxel and does not count as a touch.

        `single` is the number of clusters with a single taxel. Returns the number of remaining clusters, the
        number of their taxels, and for the next frame the history (w,) of each taxel that is pressed alone on
        a dense skin, as records of type `WAITING`.
        """
        arrays, before = self.layout.arrays, self.contacts
        starts = self.layout.starts[before.site]
        touched = before.taxel + np.repeat(starts, np.diff(before.begin))
        fresh = room_for(single, WAITING)
        count, taxels, waits = reject_isolated(
            active, arrays, estimates, self._clusters, settings.reach, self.settings.floor,
            self._rules, touched, self._waiting, fresh,
        )  # fmt: skip
        return count, taxels, fresh[:waits]

    def _stand(self, count: int) -> int:
        """Joins the clusters of each sole that stands, and returns how many of all `count` are left."""
        clusters = self._clusters
        counts, bound, member, force = clusters.counts, clusters.bound, clusters.member, clusters.member_force
        for p in self._soles:
            own, first = int(counts[p]), int(counts[:p].sum())
            if own < 2 or force[bound[first] : bound[first + own]].sum() < self.settings.standing:
                continue
            whole = slice(bound[first], bound[first + own])
            order = member[whole].argsort()
            member[whole], force[whole] = member[whole][order], force[whole][order]
            bound[first + 1 : count - own + 2] = bound[first + own : count + 1]
            counts[p], count = 1, count - own + 1
        return count

    def _angles(self, posture: Mapping[str, Array]) -> Array:
        """Returns the first four generic angles (parts, 4) [rad] of each part that has skin on a limb. A part
        that is not in `posture` gets zeros. Raises UnknownNameError if `posture` lacks the part of a touched
        patch."""
        if not self._parts <= posture.keys():
            for p in self._clusters.counts.nonzero()[0].tolist():
                if (part := self.layout.sites[p].part) not in posture:
                    raise UnknownNameError("generic part in this posture", part, posture)
        return _limb_angles(self.layout.parts, posture)

    def _turn(self, made: ContactArrays, state: SkinState, vectors: Array, poses: Array) -> None:
        """Computes the force vectors [N] of contacts on three-axis taxels in the torso frame, and writes them
        to `made`. `vectors` (k, 3) [N] are the measured forces on all active taxels, in the frames of
        their links."""
        rows, taxels = made.rows, made.taxels
        for row, p in enumerate(rows["site"].tolist()):
            if self.layout.patches[p].description.sensor.axes == AXES:
                own = slice(*state.begin[p : p + 2])
                own_taxels = slice(*made.begin[row : row + 2].tolist())
                own_vectors = vectors[own][np.searchsorted(state.active[own], taxels["taxel"][own_taxels])]
                sums = own_vectors.sum(axis=0) * rows["force"][row] / taxels["taxel_force"][own_taxels].sum()
                rows["f_T"][row] = poses[self.layout.arrays.patches["link"][p]][:3, :3] @ sums


def _limb_angles(parts: Sequence[str], posture: Mapping[str, Array]) -> Array:
    """Returns the first four generic angles (parts, 4) [rad] of each arm or leg in `parts`.

    The angles of a part that `posture` does not contain are 0.
    """
    result = np.zeros((max(len(parts), 1), 4))
    for row, part in enumerate(parts):
        if part in posture:
            result[row] = posture[part][:4]
    return result


def describe_touches(
    layout: SkinLayout,
    touches: Sequence[tuple[int, int, float]],
    poses: Array,
    posture: Mapping[str, Array],
) -> ContactArrays:
    """Returns a contact for each of `touches` (patch, taxel, force [N]). `touches` must be sorted by patch.

    `poses` (l, 4, 4) are the poses of the links in `SkinLayout.links`, and `posture` contains the generic
    angles (n,) [rad] of each part with skin. The caller must set identity, onset and displacement of the
    contacts.
    """
    count = len(touches)
    patches, taxels, forces = zip(*touches, strict=True)
    none, whole = np.zeros(0, np.int32), np.zeros(len(layout.arrays.taxels))
    clusters = Clusters(
        force=np.zeros_like(whole), label=none, queue=none,
        counts=np.bincount(patches, minlength=len(layout.sites)).astype(np.int64),
        bound=np.arange(count + 1, dtype=np.int32),
        member=(layout.starts[list(patches)] + taxels).astype(np.int32),
        member_force=np.array(forces, np.float64),
    )  # fmt: skip
    made = ContactArrays.empty(count, count)
    angles = _limb_angles(layout.parts, posture)
    describe(layout.arrays, whole, clusters, poses, angles, room_for(count, SUMMARY), made)
    return made


def single_contact(
    site: Site, taxels: ArrayLike, forces: ArrayLike, *, u: float, theta: float, taxel_u: ArrayLike,
    taxel_theta: ArrayLike, stamp: float = 0.0, sequence: int = 0, area: float = 0.0, **vectors: ArrayLike,
) -> Contact:  # fmt: skip
    """Makes a contact without a skin, from given `taxels` (k,) and `forces` (k,) [N].

    `vectors` are p_L, n_L, p_T, n_T and f_T, each (3,): centre of pressure [m] and outward unit normal in the
    frames of the link and of the torso, and force [N] on the skin in the torso frame.
    """
    row, pressed = np.zeros(1, CONTACT), np.zeros(np.shape(forces), TAXEL)
    pressed["taxel"], pressed["taxel_force"] = taxels, forces
    pressed["taxel_point"] = generic_limb_point(taxel_u, taxel_theta)
    force, peak = pressed["taxel_force"].sum(), pressed["taxel_force"].max(initial=0.0)
    values = {"force": force, "peak": peak, "area": area, "u": u, "theta": theta, "certainty": 1.0}
    for name, value in {**values, **vectors}.items():
        row[name] = value
    row["limb_point"] = generic_limb_point([u], [theta])
    begin = np.array([0, len(pressed)])
    return Contacts((site,), np.array([stamp]), np.array([sequence]), row, begin, pressed)[0]


def centre_of_pressure(positions: Array, forces: Array) -> Array:
    """Returns P-bar (3,) [m] of eq. 7, the mean of `positions` (k, 3) [m] weighted by `forces` (k,) [N].

    On a curved limb this point is below the skin. If a grip presses evenly all around the limb, the point
    is on the limb's axis.
    """
    centre: Array = forces @ positions / forces.sum()
    return centre


def weighted_force(contact: Contact, radius: float, *, measure: Measure = "weighted") -> float:
    """Returns F-bar [N] of eq. 7, a weighted mean of the taxel forces.

    The weight of a taxel is 2 r minus the distance [limb lengths] between the taxel and the contact's centre.
    `radius` r [limb lengths] is the radius of the receptive field. Eq. 7 gives negative weights to taxels
    farther than 2 r from the centre. These taxels are left out. If no taxel has a positive weight, the result
    is 0. The weighted mean decreases when weak taxels are added to a strong one, and it is proportional to
    the area of one taxel. The total force (`measure` "total") has neither property. The peak force ("peak")
    is proportional to the area of one taxel. Raises UnknownNameError for another measure.
    """
    if measure == "total":
        return contact.force
    if measure == "peak":
        return contact.peak
    if measure != "weighted":
        raise UnknownNameError("force measure", measure, ("total", "weighted", "peak"))
    force: float = mean_force(
        contact.u, contact.theta, contact.taxel_u, contact.taxel_theta, contact.taxel_forces, radius
    )
    return force
