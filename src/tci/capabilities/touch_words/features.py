"""What tells one touch from another, in units that don't depend on the skin: seconds, newtons, metres.

A touch is a row of moments, one for each frame; `features` sums them up. Sizes are those of the touch, not of
the taxels: what a taxel adds to the size of a point is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.body import GenericBody
from tci.messages import Contact, JointReading
from tci.messages.contacts import Records
from tci.messages.frames import Array, invert

MOMENT = np.dtype([
    ("time", float), ("force", float), ("area", float), ("peak", float), ("centre", float, (3,)),
    ("facing", float), ("spread", float), ("places", float),
])  # fmt: skip
"""One frame of a touch: time [s], force [N], effective area [m2], largest pressure [Pa], centre of pressure
[m] in the frame of the link that was touched first, how far all of it presses in one direction (1; 0 for a
grip from opposite sides), spread [m], number of places at once."""
POINT = 1e-4
"""Effective area [m2] below which a touch is a point: taxels of robots are about as large."""
NARROW = 5e-3
"""The same as a spread [m]: half the pitch of such taxels."""
STILL = 5e-3
"""Way [m] below which a touch stays where it is: pads roll and slip by as much."""
CREEP = 0.03
"""The same as a speed [m/s]."""
INSTANT = 0.03
"""Length [s] below which pulses are equally short, since a slow skin sees them once."""
PULSE = 0.25
"""Fraction of the largest force above which a pulse lasts. Assumed."""
GRID = 0.02
"""Time [s] between the samples that speeds and rhythms are taken from: the slowest skin sends as often."""
SLOWEST_HZ, FASTEST_HZ = 0.6, 12.0
"""Rates [Hz] of rhythms: the hands of people are not quicker, and slower ones are seldom repeated."""


def moment(
    contacts: Sequence[Contact], body: GenericBody, joints: JointReading, now: float, frame: str
) -> bytes:
    """What one frame says of a touch, as a record of type `MOMENT`.

    Args:
        contacts: its contacts, one or more.
        body: the robot's body.
        joints: where its joints are.
        now: time [s] of the frame.
        frame: link in whose frame the centre is given.
    """
    points, normals, forces, areas = [], [], [], []
    to_frame = None
    for one in contacts:
        surface, taxels = body.skin.surfaces[one.patch], one.taxels
        position, normal = surface.positions[taxels], surface.normals[taxels]
        if surface.link != frame:
            if to_frame is None:
                to_frame = invert(body.skin.link_pose(frame, joints))
            pose = to_frame @ body.skin.link_pose(surface.link, joints)
            position, normal = position @ pose[:3, :3].T + pose[:3, 3], normal @ pose[:3, :3].T
        points.append(position)
        normals.append(normal)
        forces.append(one.taxel_forces)
        areas.append(surface.areas[taxels])
    return moment_of(
        now, sum(one.force for one in contacts), np.concatenate(forces), np.concatenate(areas),
        np.concatenate(points), np.concatenate(normals), places=len(contacts),
    )  # fmt: skip


def moment_of(
    now: float, total: float, force: Array, area: Array, point: Array, outward: Array, *, places: int
) -> bytes:
    """What one frame says of a touch, as a record of type `MOMENT`.

    Args:
        now: time [s].
        total: force [N] of the touch, also of what no taxel measures.
        force: of each pressed taxel (k,) [N]; with none of them nothing is felt.
        area: of each of them (k,) [m2].
        point: where they are (k, 3) [m].
        outward: their normals (k, 3).
        places: number of places that are touched at once.
    """
    if not len(force):
        return nothing(now)
    measured = float(force.sum())
    weight = force / measured
    centre = weight @ point
    taxel = float(weight @ area)
    apart = point - centre
    square = float(weight @ (apart * apart).sum(axis=1)) - taxel / (2.0 * np.pi)
    made = np.zeros((), MOMENT)
    made["time"], made["force"], made["places"] = now, total, places
    made["area"] = max(measured**2 / float((force * force / area).sum()) - taxel, POINT)
    made["peak"], made["spread"] = float((force / area).max()), np.sqrt(max(square, NARROW**2))
    made["centre"], made["facing"] = centre, float(np.linalg.norm(weight @ outward))
    return made.tobytes()


def nothing(now: float) -> bytes:
    """A moment without contact."""
    made = np.zeros((), MOMENT)
    made["time"] = now
    return made.tobytes()


class _Rhythm(NamedTuple):
    rate: float
    """[Hz]"""
    share: float
    """Of the power of all rhythms."""


def _rhythm(values: Array) -> _Rhythm:
    """Of the strongest periodic change of values (n,) on the grid."""
    if len(values) < 10:
        return _Rhythm(0.0, 0.0)
    centred = (values - values.mean()) * np.hanning(len(values))
    count = 128 if len(values) <= 128 else 256 if len(values) <= 256 else 1024
    power = np.abs(np.fft.rfft(centred, count)) ** 2
    rates = np.fft.rfftfreq(count, GRID)
    power[(rates < SLOWEST_HZ) | (rates > FASTEST_HZ)] = 0.0
    whole = float(power.sum())
    if whole <= 1e-18:
        return _Rhythm(0.0, 0.0)
    best = int(power.argmax())
    return _Rhythm(float(rates[best]), float(power[max(0, best - 1) : best + 2].sum()) / whole)


def _runs(on: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last index of each run of True."""
    edges = np.diff(np.concatenate([[0], on.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1


NAMES = (
    "length", "pulses", "pulse", "longest_pulse", "gap", "contact_share",
    "force", "mean_force", "force_varies", "rise", "fall", "fullness",
    "area", "mean_area", "area_varies", "width", "mean_width", "pressure",
    "spread", "largest_spread", "spread_varies",
    "facing", "least_facing", "places", "most_places",
    "path", "extent", "straightness", "speed", "largest_speed", "turns", "turn_rate",
    "one_way", "way_in_pulse", "way_between",
    "force_rate", "force_rhythm", "path_rate", "path_rhythm",
    "own_speed",
)  # fmt: skip
"""Names of the features, in their order."""


def features(moments: Records, own_speed: float) -> Array:
    """What tells a touch from others (n,), from all its moments; lengths, sizes and forces as logarithms.

    `moments` has at least one with a force, and begins and ends with such a one. `own_speed` [rad/s] is how
    fast the robot moved the part before it was touched.
    """
    rows, force, felt = _on_grid(moments)
    most = float(moments["force"].max())
    strong = force > PULSE * most
    if not strong.any():
        strong[int(force.argmax())] = True
    values = {
        **_times(strong, felt),
        **_forces(force, felt, most),
        **_sizes(rows, force, felt),
        **_ways(rows, force, felt, strong, most),
        "own_speed": float(np.log(own_speed + 0.02)),
    }
    return np.array([values[name] for name in NAMES])


def _on_grid(moments: Records) -> tuple[Records, Array, NDArray[np.bool_]]:
    """Moments, forces [N], and whether anything is felt, `GRID` apart: a quick skin says the same as a slow
    one."""
    known, known_force = moments["time"], moments["force"]
    begin, end = float(known[0]), float(known[-1])
    time = begin + GRID * np.arange(max(2, round((end - begin) / GRID) + 1))
    force = np.interp(time, known, known_force)
    index = np.clip(np.searchsorted(known, time - 1e-6), 0, len(known) - 1)
    felt = (known_force[index] > 0.0) & (force > 0.0)
    if not felt.any():
        felt[0], force[0] = True, known_force.max()
    return moments[index], force, felt


def _times(strong: NDArray[np.bool_], felt: NDArray[np.bool_]) -> dict[str, float]:
    first, last = _runs(strong)
    widths, gaps = (last - first + 1) * GRID, (first[1:] - last[:-1] - 1) * GRID
    return {
        "length": _log(len(felt) * GRID + INSTANT),
        "pulses": _log(len(first)),
        "pulse": _log(widths.mean() + INSTANT),
        "longest_pulse": _log(widths.max() + INSTANT),
        "gap": _log(0.05 + (gaps.mean() if len(gaps) else 0.0)),
        "contact_share": float(felt.mean()),
    }


def _forces(force: Array, felt: NDArray[np.bool_], most: float) -> dict[str, float]:
    inside, rhythm = force[felt], _rhythm(force)
    slope = np.diff(np.concatenate([[0.0], force, [0.0]])) / GRID
    return {
        "force": _log(most),
        "mean_force": _log(inside.mean()),
        "force_varies": float(inside.std() / inside.mean()),
        "rise": _log(most / max(slope.max(), 1e-6) + INSTANT),
        "fall": _log(most / max(-slope.min(), 1e-6) + INSTANT),
        "fullness": float((inside > 0.5 * most).mean()),
        "force_rate": rhythm.rate,
        "force_rhythm": rhythm.share,
    }


def _sizes(rows: Records, force: Array, felt: NDArray[np.bool_]) -> dict[str, float]:
    inside, rows = force[felt], rows[felt]
    weight = inside / inside.sum()
    area, spread, facing, places = (rows[name] for name in ("area", "spread", "facing", "places"))
    # what a skin does not feel at the rim of a touch makes its area small, and is in the force
    wide = np.sqrt(inside / rows["peak"])
    mean_area, mean_spread = float(weight @ area), float(weight @ spread)
    return {
        "area": _log(area[inside.argmax()]),
        "mean_area": _log(mean_area),
        "area_varies": float(area.std()) / mean_area,
        "width": _log(wide[inside.argmax()] + NARROW),
        "mean_width": _log(weight @ wide + NARROW),
        "pressure": _log(rows["peak"].max()),
        "spread": _log(mean_spread),
        "largest_spread": _log(spread.max()),
        "spread_varies": float(spread.std()) / mean_spread,
        "facing": float(weight @ facing),
        "least_facing": float(facing.min()),
        "places": float(weight @ places),
        "most_places": float(places.max()),
    }


def _ways(
    rows: Records, force: Array, felt: NDArray[np.bool_], strong: NDArray[np.bool_], most: float
) -> dict[str, float]:
    count, known = len(force), np.flatnonzero(felt)
    centre = np.column_stack([np.interp(np.arange(count), known, axis[known]) for axis in rows["centre"].T])
    if count >= 3:
        padded = np.pad(centre, ((1, 1), (0, 0)), mode="edge")
        centre = (padded[:-2] + padded[1:-1] + padded[2:]) / 3.0
    # the first and last frames of a pulse press on few taxels: their centre is not that of the hand
    sure = (force[1:] > PULSE * most) & (force[:-1] > PULSE * most)
    steps = np.where(sure, np.linalg.norm(np.diff(centre, axis=0), axis=1), 0.0)
    path, held = float(steps.sum()), centre[strong]
    extent, net = (float(np.linalg.norm(one)) for one in (np.ptp(held, axis=0), held[-1] - held[0]))
    middle, along = held.mean(axis=0), np.zeros(count)
    if len(held) > 2:
        offset = held - middle
        along = (centre - middle) @ np.linalg.eigh(offset.T @ offset)[1][:, 2]
    stepped = np.where(sure, np.diff(along), 0.0)
    signs = np.sign(stepped[np.abs(stepped) > GRID * CREEP])
    turns = int((np.diff(signs) != 0).sum()) if len(signs) > 1 else 0
    first, last = _runs(strong)
    ways = along[last] - along[first]
    between = np.linalg.norm(centre[first[1:]] - centre[last[:-1]], axis=1) if len(first) > 1 else np.zeros(1)
    rhythm = _rhythm(along) if extent > STILL else _Rhythm(0.0, 0.0)
    return {
        "path": _log(path + 2.0 * STILL),
        "extent": _log(extent + STILL),
        "straightness": net / (path + 2.0 * STILL),
        "speed": _log(path / max(GRID * int(sure.sum()), GRID) + CREEP),
        "largest_speed": _log(steps.max(initial=0.0) / GRID + 2.0 * CREEP),
        "turns": float(np.log1p(turns)),
        "turn_rate": turns / (count * GRID),
        "one_way": abs(float(ways.sum())) / (float(np.abs(ways).sum()) + 2.0 * STILL),
        "way_in_pulse": _log(np.abs(ways).mean() + STILL),
        "way_between": _log(between.mean() + STILL),
        "path_rate": rhythm.rate,
        "path_rhythm": rhythm.share,
    }


def _log(value: float) -> float:
    return float(np.log(value))
