"""How a hand does a touch on one robot: where each of its pads is at each time, and with what force.

The laid pressure and the simulated hand follow the same plan.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.errors import CommandError
from tci.messages import JointReading
from tci.messages.frames import Array, read_only
from tci.touches.chart import Chart, chart_of
from tci.touches.kinds import Kind, kind_named
from tci.touches.person import AVERAGE, Person
from tci.touches.places import Spot, find_spot, initial_joints
from tci.touches.touch import FORCES, Touch, parse_touch

DT = 0.005
"""Time [s] between two samples of a plan. Assumed: the shortest blow takes six times as long."""
PAUSE = 0.6
"""Time [s] between two touches whose onsets are not given. A simulated hand needs 0.5 s to go and come."""
APART = 0.018
"""Distance [m] between the middles of two fingers. Assumed: an adult's."""
_SHARP = 0.7
"""Exponent of the half sine that a pulse's force follows. Assumed."""
_GRIPS = {
    3: ((0.0, 0.9 * np.pi, 0.9 * np.pi), (0.0, -0.008, 0.014)),
    4: ((0.0, 1.0, 2.1, -1.0), (0.0, 0.0, 0.0, 0.0)),
}
"""Angles [rad] around a limb and ways [m] along it of the pads of a grip: a thumb against fingers, a hand."""
_OTHER_HAND = 0.08
"""Distance [m] of the second hand from the first on a sheet, where it can't be on the other side."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedTouch:
    """A touch on one robot, sampled every `DT`."""

    touch: Touch
    kind: Kind
    patch: str
    times: Array
    """Times (t,) [s], from the onset on."""
    force: Array
    """Force (t, k) [N] of each of k pads, along the inward normal; 0 while a pad is lifted."""
    centre: Array
    """Middle (t, k, 3) [m] of each pad on the skin, in the frame of the patch's link."""
    normal: Array
    """Outward normal (t, k, 3) of the skin there."""
    radius: Array
    """Radius (k,) [m] of each pad."""

    @property
    def onset(self) -> float:
        return float(self.times[0])

    @property
    def end(self) -> float:
        return float(self.times[-1])

    @property
    def peak(self) -> float:
        """Largest force of all pads together [N]."""
        return float(self.force.sum(axis=1).max())


def plan(
    body: GenericBody,
    touches: Touch | str | Iterable[Touch | str],
    *,
    persons: Mapping[str, Person] | None = None,
    kinds: Mapping[str, Kind] | None = None,
    joints: JointReading | None = None,
    seed: int = 0,
) -> tuple[PlannedTouch, ...]:
    """Plans touches on a robot, in the order in which they are given.

    Args:
        body: the robot.
        touches: touches, or lines of words such as `stroke 'left forearm' 3N`.
        persons: habits of named persons; a person who is not in it is drawn at random from its name.
        kinds: table of kinds, if not that of TCI.
        joints: posture in which places on limbs are looked for; by default the initial one.
        seed: of what varies from touch to touch.

    Raises the errors of `parse_touch` and `find_spot`, and CommandError for a kind that has no generator.
    """
    joints = joints or initial_joints(body)
    planned: list[PlannedTouch] = []
    acts: dict[str, float] = {}
    for number, one in enumerate([touches] if isinstance(touches, Touch | str) else touches):
        touch = parse_touch(one, kinds) if isinstance(one, str) else one
        kind = _able(touch.kind, kinds)
        spot = find_spot(body, touch.place, joints)
        chart = chart_of(body, spot, joints)
        person = _person(touch.person, persons)
        before = max((other.end for other in planned), default=0.0)
        onset = acts.get(touch.act, before + PAUSE) if touch.onset is None else touch.onset
        if touch.act:
            acts.setdefault(touch.act, onset)
        random = np.random.default_rng([seed, number])
        planned.append(_planned(_Hand(touch, kind, person, random), chart, spot, onset))
    return tuple(planned)


def _able(name: str, kinds: Mapping[str, Kind] | None) -> Kind:
    kind = kind_named(name, kinds)
    if kind.generator == "none":
        from tci.touches.kinds import KINDS

        able = [one.name for one in (kinds or KINDS).values() if one.generator != "none"]
        raise CommandError(f"TCI knows the word {name!r}, but can't do it; valid: {', '.join(able)}")
    return kind


def _person(name: str, persons: Mapping[str, Person] | None) -> Person:
    known = {"": AVERAGE, **(persons or {})}
    return known[name] if name in known else Person.drawn(name)


@dataclass(slots=True, eq=False)
class _Hand:
    """One hand and its habits."""

    touch: Touch
    kind: Kind
    person: Person
    random: np.random.Generator

    def value(self, name: str, factor: float = 1.0) -> float:
        """A value from a range of the kind: its middle, as far as the person does not vary."""
        low, high = getattr(self.kind, name)
        share = 0.5 + self.person.varies * float(self.random.uniform(-0.5, 0.5))
        return float(low * (high / low) ** share) * factor

    def count(self, name: str, factor: float = 1.0) -> int:
        return max(1, round(self.value(name, factor)))

    def force(self) -> float:
        if self.touch.force is not None:
            return self.touch.force
        varied = self.person.varies * float(self.random.uniform(-0.5, 0.5))
        asked = self.kind.force(self.touch.strength) * self.person.force * float(np.exp(varied))
        return float(np.clip(asked, *FORCES))


def _planned(hand: _Hand, chart: Chart, spot: Spot, onset: float) -> PlannedTouch:
    kind, size = hand.kind, hand.person.size
    x0, y0, height = chart.coordinates(spot.place.p_L)
    across, along, around = _pads(hand, chart)
    if spot.along is not None:
        x0 = chart.begin + chart.length * sum(spot.along) / 2.0
    motion = _MOTIONS[kind.generator](hand, chart, spot, len(across))
    ways, sideways, shares = motion  # (t, k) each
    x = x0 + along + ways
    step = across + sideways
    y = y0 + around + step / max(height, 0.01) if chart.tube else y0 + step + around * _OTHER_HAND / np.pi
    points, normals = chart.points(x.ravel(), y.ravel())
    shape = (*x.shape, 3)
    return PlannedTouch(
        touch=hand.touch,
        kind=kind,
        patch=chart.surface.patch,
        times=read_only(onset + DT * np.arange(len(x))),
        force=read_only(hand.force() * shares),
        centre=read_only(points.reshape(shape)),
        normal=read_only(normals.reshape(shape)),
        radius=read_only(np.full(x.shape[1], 1e-3 * hand.value("radius_mm", size))),
    )


def _pads(hand: _Hand, chart: Chart) -> tuple[Array, Array, Array]:
    """Ways across and along [m], and angles around [rad], (k,) of the pads of one hand or both."""
    count, apart = hand.count("fingers"), APART * hand.person.size
    across: Array = np.zeros(count)
    along: Array = np.zeros(count)
    around: Array = np.zeros(count)
    if hand.kind.hand == "grip" and chart.tube:
        angles, ways = _GRIPS[min(max(count, 3), 4)]
        around, along = np.array(angles), np.array(ways)
        across = np.zeros(len(around))
    elif count > 1:
        across = read_only(apart * (np.arange(count) - (count - 1) / 2.0))
    if hand.touch.hand == "both":
        across, along = np.tile(across, 2), np.tile(along, 2)
        around = np.concatenate([around, around + np.pi])
    return across, along, around


Motion = tuple[Array, Array, Array]
"""Ways along and across [m] of each pad, and its share of the force, (t, k) each."""


def _pulses(hand: _Hand, chart: Chart, spot: Spot, pads: int) -> Motion:
    length, gap = hand.value("length_s", hand.person.pace), hand.value("gap_s", hand.person.pace)
    count = hand.count("pulses", hand.person.repeats)
    if (duration := hand.touch.duration) is not None:
        length = min(length, duration) if count > 1 or hand.kind.pulses[1] > 1 else duration
        count = 1 + int((duration - length + 1e-9) / (length + gap)) if hand.kind.pulses[1] > 1 else 1
    pulse = np.sin(np.pi * (np.arange(max(3, round(length / DT))) + 0.5) * DT / max(length, 3 * DT))
    one = np.clip(pulse, 0.0, 1.0) ** _SHARP
    pause = np.zeros(round(gap / DT))
    force = np.concatenate([one, *(part for _ in range(count - 1) for part in (pause, one)), [0.0]])
    return _still(force, pads, hand)


def _steady(hand: _Hand, chart: Chart, spot: Spot, pads: int) -> Motion:
    length = hand.touch.duration or hand.value("length_s", hand.person.pace)
    return _still(_ramped(length, 0.05 if hand.kind.name == "grab" else 0.2), pads, hand)


def _passes(hand: _Hand, chart: Chart, spot: Spot, pads: int) -> Motion:
    begin, end = _ends(hand, chart, spot)
    way, duration = abs(end - begin), hand.touch.duration
    speed = hand.touch.speed
    gap = hand.value("gap_s", hand.person.pace)
    count = hand.count("pulses", hand.person.repeats)
    if speed is None:
        speed = way / duration if duration else hand.value("speed_m_s", 1.0 / hand.person.pace)
    length = max(way / speed, 4 * DT)
    if duration:
        count = max(1, round((duration + gap) / (length + gap)))
    share = (np.arange(round(length / DT)) + 0.5) / round(length / DT)
    rise = min(0.125, 0.1 / length)
    force = np.minimum(1.0, np.minimum(share, 1.0 - share) / rise)
    pause = np.zeros(round(gap / DT))
    forces = np.concatenate([force, *(part for _ in range(count - 1) for part in (pause, force)), [0.0]])
    back = np.linspace(end, begin, len(pause))
    ways = begin + (end - begin) * share
    path = np.concatenate([ways, *(part for _ in range(count - 1) for part in (back, ways)), [end]])
    _, zero, shares = _still(forces, pads, hand)
    return np.repeat(path[:, None], shares.shape[1], axis=1), zero, shares


def _ends(hand: _Hand, chart: Chart, spot: Spot) -> tuple[float, float]:
    """Ends of a pass [m], from the middle of the place."""
    if spot.along is not None:
        half = chart.length * (spot.along[1] - spot.along[0]) / 2.0
        return -half, half
    x0 = chart.coordinates(spot.place.p_L)[0]
    half = 5e-4 * hand.value("way_mm")
    low, high = float(chart.along.min()) - x0, float(chart.along.max()) - x0
    half = min(half, (high - low) / 2.0)
    middle = float(np.clip(0.0, low + half, high - half))
    return middle - half, middle + half


def _strokes(hand: _Hand, chart: Chart, spot: Spot, pads: int) -> Motion:
    length = hand.touch.duration or hand.value("length_s", hand.person.pace)
    half = (
        chart.length * abs(spot.along[1] - spot.along[0]) / 2.0 if spot.along else 1e-3 * hand.value("way_mm")
    )
    half = min(half, float(np.ptp(chart.along)) / 2.0)
    rate = hand.value("rate_Hz", 1.0 / hand.person.pace)
    if hand.touch.speed is not None:
        rate = hand.touch.speed / max(4.0 * half, 1e-3)  # the mean speed of a sine
    force = _ramped(length, 0.1)
    ways = half * np.sin(2.0 * np.pi * rate * DT * np.arange(len(force)))
    _, zero, shares = _still(force, pads, hand)
    return np.repeat(ways[:, None], shares.shape[1], axis=1), zero, shares


def _knead(hand: _Hand, chart: Chart, spot: Spot, pads: int) -> Motion:
    length = hand.touch.duration or hand.value("length_s", hand.person.pace)
    rate = hand.value("rate_Hz", 1.0 / hand.person.pace)
    force = _ramped(length, 0.2)
    _, _, shares = _still(force, pads, hand)
    phase = 2.0 * np.pi * (rate * DT * np.arange(len(force))[:, None] + np.arange(pads) / pads)
    half = 5e-4 * hand.value("way_mm")
    return half * np.cos(phase), half * np.sin(phase), shares * (1.0 + 0.8 * np.sin(phase)) / 1.0


def _wander(hand: _Hand, chart: Chart, spot: Spot, pads: int) -> Motion:
    length = hand.touch.duration or hand.value("length_s", hand.person.pace)
    force = _ramped(length, 0.1)
    own = np.random.default_rng(hand.random.integers(2**32))
    count, every = len(force), 4
    steps = own.normal(0.0, 0.003, (2, count // every + 2, pads))
    reach = 1e-3 * hand.value("way_mm")
    start = own.normal(0.0, reach / 2.0, (2, 1, pads))
    nodes = np.clip(start + np.cumsum(steps, axis=1), -1.5 * reach, 1.5 * reach)
    at = np.arange(count) / every
    ways = np.stack([
        np.column_stack([np.interp(at, np.arange(nodes.shape[1]), nodes[axis, :, k]) for k in range(pads)])
        for axis in (0, 1)
    ])  # fmt: skip
    rates = [hand.value("rate_Hz", 1.0 / hand.person.pace) * own.uniform(0.7, 1.4) for _ in range(pads)]
    phase = 2.0 * np.pi * (DT * np.arange(count)[:, None] * np.array(rates) + own.uniform(0.0, 1.0, pads))
    lifted = np.maximum(0.0, np.sin(phase))
    _, _, shares = _still(force, pads, hand)
    return ways[0], ways[1], shares * lifted * np.pi  # half a sine is 1 / pi in the mean


_MOTIONS = {
    "pulses": _pulses, "steady": _steady, "passes": _passes, "strokes": _strokes, "knead": _knead,
    "wander": _wander,
}  # fmt: skip


def _ramped(length: float, rise: float) -> Array:
    """A steady force that rises and falls in `rise` [s], at most a third of the `length` [s]."""
    count = max(4, round(length / DT))
    rise = min(rise, length / 3.0)
    at = (np.arange(count) + 0.5) * DT
    force = np.clip(np.minimum(at, count * DT - at) / rise, 0.0, 1.0)
    result: Array = np.append(0.5 - 0.5 * np.cos(np.pi * force), 0.0)
    return result


def _still(force: Array, pads: int, hand: _Hand) -> Motion:
    """Pads that stay where they are, and share the force (t,) of their hand."""
    hands = 2 if hand.touch.hand == "both" else 1
    shares = np.repeat(force[:, None] * hands / pads, pads, axis=1)
    return np.zeros_like(shares), np.zeros_like(shares), shares
