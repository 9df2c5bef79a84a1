"""Compares several robots' skins under equal pressure: the perceived forces, and the gains of the reflex.

The raw counts of each skin's taxels are computed for round touches with a Gaussian pressure distribution.
TCI's usual conditioning and contact detection then process these counts. So the result includes the effects
of the taxels' areas, of the gaps between taxels, and of the resolution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.same_stimulus import initial_joints
from tci.messages import Contact, SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.skin.conditioning import Conditioner
from tci.skin.contacts import ContactFinder, ContactSettings
from tci.skin.layout import normal_channels

PROBES = (0.003, 0.005, 0.010, 0.020)
"""Radii [m] of the touches, from the radius of a blunt pencil to the radius of a palm. Each radius is 3/2 of
the standard deviation of the pressure distribution."""
FORCES = (0.3, 1.0, 3.0, 10.0)
"""Forces [N] of the touches."""
PLACES = 80
"""Number of touched points on each segment."""
FELT = 2.0
"""Least peak pressure [counts] that a touch must cause on each skin, so that all skins can detect the touch.
The value is above one count, since one count may be a rounding error."""
LEARN, RATE = 100, 50.0
"""Number and rate [Hz] of the frames without touch from which the noise of the skin is estimated."""
STEP = 1e-4
"""Time [s] between successive touches. Assumed: short enough that no estimation window ends, so that the
estimates do not change between touches."""
PART = "left_arm"
_TURNS = 2.0 * np.pi * np.concatenate([[0.0], np.arange(6) / 6.0, np.arange(12) / 12.0])
_POINTS = np.repeat([0.0, 0.4, 0.8], (1, 6, 12)) * np.array([np.cos(_TURNS), np.sin(_TURNS)])
"""Points (2, 19) on a taxel: the centre and two rings. The taxel's mean pressure is computed from the
pressures at these points. The rows are x and y, in units of the taxel's radius."""


@dataclass(frozen=True, slots=True)
class SameTouch:
    """Results for one touch that was applied at many points of one robot's arm."""

    robot: str
    probe_mm: float
    """Radius [mm] of the touch."""
    pressed_n: float
    """Force [N] of the touch."""
    force_n: float
    """Median [N] of the perceived forces. The perceived force is 0 for a touch that is not detected."""
    gain: float
    """Median of the reflex's gains. The gain is 0 for a touch to which the reflex does not respond."""
    heavy: bool
    """True if every skin can detect the touch: the peak pressure corresponds to at least 2 counts on every
    skin."""


def same_touch(
    bodies: Sequence[GenericBody], reflex: WithdrawalReflex, *, seed: int = 0
) -> tuple[SameTouch, ...]:
    """Computes how each robot perceives equal touches at corresponding points of its left arm.

    The touched points are anywhere on upper arm and forearm where every compared robot has skin. Robots
    without any skin on the left arm are left out.
    """
    arms, chance = [Arm(body, reflex) for body in bodies if _has_sleeve(body)], np.random.default_rng(seed)
    segments = dict.fromkeys(field.segment for field in reflex.fields)
    places = [place for segment in segments for place in places_on(arms, segment, chance)]
    rows = []
    for radius in PROBES if places and arms else ():
        pressures = [[arm.pressure(place, radius) for place in places] for arm in arms]
        least = max(arm.resolution for arm in arms) * FELT
        for arm, laid in zip(arms, pressures, strict=True):
            for force in FORCES:
                felt = np.median(arm.answers([arm.touch(*one, force) for one in laid]), axis=0)
                peak = force / (2.0 * np.pi * (radius / 1.5) ** 2)
                row = SameTouch(arm.name, radius * 1e3, force, float(felt[0]), float(felt[1]), peak >= least)
                rows.append(row)
    return tuple(rows)


def _has_sleeve(body: GenericBody) -> bool:
    return any(one.part == PART and body.robot.limb_segment(one) is not None for one in body.robot.skin)


Place = tuple[str, float, float]
"""Segment of the limb, u, and theta [rad]."""


def places_on(arms: Sequence[Arm], segment: str, chance: np.random.Generator) -> Iterator[Place]:
    """Yields up to PLACES random points of a segment at which every robot has skin."""
    found = 0
    for u, theta in chance.uniform((0.0, -np.pi), (1.0, np.pi), (40 * PLACES, 2)).tolist():
        if all(arm.has_skin((segment, u, theta)) for arm in arms):
            yield segment, u, theta
            found += 1
        if found == PLACES:
            return


class Arm:
    """Unrolled skin of one robot's arm, with the perception of touches on this skin."""

    def __init__(self, body: GenericBody, reflex: WithdrawalReflex) -> None:
        robot: Robot = body.robot
        self.name = robot.name
        self._reflex, self._count, self._now, joints = reflex, 0, 0.0, initial_joints(robot)
        self._conditioner = Conditioner(body.layout)
        # Contacts of an isolated taxel are accepted at once. By default such contacts are accepted after 0.2
        # s.
        self._finder = ContactFinder(body.layout, ContactSettings(isolated=None))
        self._posture = body.posture(joints)
        self._poses = body.skin.kinematics.pose_array(joints.position, body.layout.links)
        self._pressed: set[str] = set()
        self._rest = {one.name: np.full(one.channels, one.sensor.rest) for one in robot.skin}
        part = robot.part(PART)
        self._sleeves = {}
        for patch in robot.skin:
            if patch.part == PART and (segment := robot.limb_segment(patch)) is not None:
                u, theta, radius = body.skin.limb(patch.name, joints)
                areas = body.skin.surfaces[patch.name].areas
                length = part.segment(segment.name).length
                self._sleeves[segment.name] = patch, u * length, theta, radius, areas, length
        self._channels = {
            patch.name: normal_channels(patch, body.skin.surfaces[patch.name]) for patch in robot.skin
        }
        self.resolution = max(abs(sleeve[0].sensor.pascal_per_count) for sleeve in self._sleeves.values())
        """Largest pressure [Pa] that corresponds to one count on any patch of the arm."""
        for _ in range(LEARN):
            self._perceive(self._rest, 1.0 / RATE)

    def _offsets(self, place: Place) -> tuple[Array, Array]:
        """Returns the signed distances (taxels,) [m] of each taxel from the point `place`: along the limb,
        and around the limb."""
        segment, u, theta = place
        _, x, angle, radius, _, length = self._sleeves[segment]
        around = (angle - theta + np.pi) % (2.0 * np.pi) - np.pi
        along = x - u * length
        near = radius[np.hypot(along, around * radius).argmin()]
        return along, around * (radius + near) / 2.0

    def has_skin(self, place: Place) -> bool:
        """Returns True if there is skin at a point.

        There is skin if the distance of the point from the nearest taxel is at most 0.75 times the square
        root of this taxel's area. All points inside a square lattice of taxels fulfil this condition.
        """
        if place[0] not in self._sleeves:
            return False
        apart = np.hypot(*self._offsets(place))
        nearest = int(apart.argmin())
        return bool(apart[nearest] <= 0.75 * np.sqrt(self._sleeves[place[0]][4][nearest]))

    def pressure(self, place: Place, radius: float) -> tuple[Place, Array]:
        """Returns two arguments for `touch`: `place`, and the mean pressure (taxels,) [Pa per N] that a touch
        at `place` causes on each taxel. `radius` [m] is the radius of the touch."""
        along, across = self._offsets(place)
        sizes, sigma = np.sqrt(self._sleeves[place[0]][4] / np.pi), radius / 1.5
        result = np.zeros(len(along))
        near = np.hypot(along, across) < sizes + 5.0 * sigma
        x = along[near, None] + sizes[near, None] * _POINTS[0]
        y = across[near, None] + sizes[near, None] * _POINTS[1]
        result[near] = np.exp(-(x * x + y * y) / (2.0 * sigma**2)).mean(axis=1) / (2.0 * np.pi * sigma**2)
        return place, result

    def touch(self, place: Place, pressure: Array, force: float) -> Contact | None:
        """Returns the strongest contact that TCI detects for a touch, or None if TCI detects no contact."""
        patch = self._sleeves[place[0]][0]
        sensor = patch.sensor
        counts = np.sign(sensor.pascal_per_count) * np.round(sensor.counts(force * pressure))
        raw = self._rest[patch.name].copy()
        raw[self._channels[patch.name]] += counts
        released = {name: self._rest[name] for name in self._pressed}
        self._pressed = {patch.name}
        return self._perceive(released | {patch.name: np.clip(raw, sensor.lowest, sensor.highest)})

    def answers(self, contacts: Sequence[Contact | None]) -> Array:
        """Returns the force [N] and the gain of the reflex for each contact, as an array (contacts, 2).

        The row is zero if the contact is None, which means that the touch was not detected.
        """
        result = np.zeros((len(contacts), 2))
        felt = [(row, contact) for row, contact in enumerate(contacts) if contact is not None]
        answers = self._reflex.answers([contact for _, contact in felt])
        for (row, contact), answer in zip(felt, answers, strict=True):
            result[row] = contact.force, 0.0 if answer is None else answer.gain
        return result

    def _perceive(self, values: dict[str, Array], step: float = STEP) -> Contact | None:
        self._count += 1
        self._now = now = self._now + step
        self._conditioner.step(
            [SkinFrame(name, now, self._count, read_only(raw)) for name, raw in values.items()]
        )
        state, estimates = self._conditioner.state, self._conditioner.estimates
        contacts = self._finder.find(state, estimates, lambda: self._poses, self._posture)
        return max(contacts, key=lambda one: one.force, default=None)
