"""Touches without physics: the pressure of planned touches, laid on the taxels of a robot.

Each pad presses with a Gaussian along the skin. The pressure of a taxel is the mean over its own area; what
falls on gaps and beside the skin is lost, as on a real skin.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from tci.body.generic_body import GenericBody
from tci.messages.frames import Array
from tci.skin.fill_factor import is_surface
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface
from tci.touches.planned_touch import PlannedTouch

SIGMA = 1.0 / 1.5
"""Width of a pad's Gaussian, as a fraction of its radius."""
REACH = 4.0
"""Widths beyond which a pad presses nothing."""
_BLOCK = 512


class LaidTouches:
    """Planned touches as pressure on the taxels of one robot, at any time.

    Args:
        body: the robot.
        planned: the touches.
        flat: force [N] from which a pad lies flat, with its whole radius. Below it the pad is narrower, by
            the cube root of the force, as a sphere's contact (Hertz). With 0 it always lies flat.
        cover: width [m] (standard deviation) over which the skin's cover spreads a point.
    """

    def __init__(
        self, body: GenericBody, planned: Iterable[PlannedTouch], *, flat: float = 0.0, cover: float = 0.0
    ) -> None:
        self.body = body
        self._soft = flat, cover
        self.planned = tuple(planned)
        robot = body.robot
        self.unfelt = tuple(
            dict.fromkeys(one.patch for one in self.planned if robot.patch(one.patch).through_joints)
        )
        """Patches that are touched, but have no taxels: they feel only joint torques, which need physics."""

    @property
    def end(self) -> float:
        """Time [s] at which the last touch ends."""
        return max((one.end for one in self.planned), default=0.0)

    def share(self, number: int) -> float:
        """Fraction of the impulse of the touch with the index `number` that falls on taxels; the rest falls
        on gaps and beside the skin."""
        one = self.planned[number]
        laid = LaidTouches(self.body, [one]).forces(one.times).get(one.patch)
        return 0.0 if laid is None else float(laid.sum() / one.force.sum())

    def forces(self, times: ArrayLike) -> dict[str, Array]:
        """Force (t, n) [N] on each of the n taxels of every touched patch, at `times` (t,) [s]."""
        at = np.asarray(times, dtype=float)
        found: dict[str, Array] = {}
        for one in self.planned:
            if one.patch in self.unfelt:
                continue
            surface, rigid = self.body.skin.surfaces[one.patch], self.body.robot.patch(one.patch).rigid
            if one.patch not in found:
                found[one.patch] = np.zeros((len(at), len(surface.areas)))
            during = np.flatnonzero((at >= one.onset) & (at <= one.end))
            for begin in range(0, len(during), _BLOCK):
                rows = during[begin : begin + _BLOCK]
                found[one.patch][rows] += _lay(surface, one, at[rows], rigid, self._soft)
        return found

    def pressure(self, times: ArrayLike) -> dict[str, Array]:
        """Pressure (t, n) [Pa] of each of the n taxels of every touched patch, at `times` (t,) [s]."""
        return {
            patch: forces / self.body.skin.surfaces[patch].areas
            for patch, forces in self.forces(times).items()
        }

    def frames(self, times: ArrayLike) -> dict[str, Array]:
        """Raw values (t, channels) that the sensors of every touched patch send at `times` (t,) [s]: rounded,
        and limited to the range of the sensor. A pressed switch is on."""
        return {patch: self._raw(patch, pressure) for patch, pressure in self.pressure(times).items()}

    def _raw(self, name: str, pressure: Array) -> Array:
        patch = self.body.robot.patch(name)
        sensor, surface = patch.sensor, self.body.skin.surfaces[name]
        values = np.full((len(pressure), patch.channels), float(sensor.rest))
        counts = np.sign(sensor.pascal_per_count) * sensor.counts(pressure)
        values[:, normal_channels(patch, surface)] += counts
        raw: Array = np.clip(np.rint(values), sensor.lowest, sensor.highest)
        return raw


def _lay(
    surface: Surface, planned: PlannedTouch, times: Array, rigid: bool, soft: tuple[float, float]
) -> Array:
    """Forces (t, n) [N] of one touch on the taxels of its patch."""
    flat, cover = soft
    at = (times - planned.onset) / (planned.times[1] - planned.times[0])
    low = np.clip(at.astype(np.int64), 0, len(planned.times) - 2)
    part = (at - low)[:, None]
    total = np.zeros((len(times), len(surface.areas)))
    for pad, radius in enumerate(planned.radius.tolist()):
        force = (1.0 - part[:, 0]) * planned.force[low, pad] + part[:, 0] * planned.force[low + 1, pad]
        pressed = np.flatnonzero(force > 0.0)
        if not len(pressed):
            continue
        nodes, share = low[pressed], part[pressed]
        centre = (1.0 - share) * planned.centre[nodes, pad] + share * planned.centre[nodes + 1, pad]
        normal = planned.normal[nodes, pad]
        grown = np.minimum(force[pressed] / max(flat, 1e-9), 1.0) ** (1.0 / 3.0)
        sigma = np.hypot(SIGMA * radius * grown, cover)
        shares = _on_plate(surface, centre) if rigid else _shares(surface, centre, normal, sigma)
        total[pressed] += force[pressed, None] * shares
    return total


def _shares(surface: Surface, centre: Array, normal: Array, sigma: Array) -> Array:
    """Fraction (t, n) of a pad's force on each taxel, for pads at `centre` (t, 3) [m] with widths `sigma`
    (t,) [m]."""
    moved = np.linalg.norm(centre - centre[0], axis=1).max()
    reach = REACH * np.sqrt(sigma.max() ** 2 + surface.areas.max() / (4.0 * np.pi)) + moved
    near = np.flatnonzero(np.linalg.norm(surface.positions - centre[0], axis=1) < reach)
    shares = np.zeros((len(centre), len(surface.areas)))
    if not len(near):
        return shares
    positions, areas = surface.positions[near], surface.areas[near]
    middle = positions.mean(axis=0)
    p, c = positions - middle, centre - middle
    square = (c * c).sum(axis=1)[:, None] + (p * p).sum(axis=1) - 2.0 * c @ p.T
    # The way along the skin between two points, from the chord and the angle between the normals:
    # (arcsin sqrt(q))^2 / q as a series, where q is the squared sine of half the angle.
    q = 0.5 - 0.5 * normal @ surface.normals[near].T
    square *= 1.0 + q * (1.0 / 3.0 + q * (8.0 / 45.0 + q * (4.0 / 35.0 + q * 0.2)))
    variance = sigma[:, None] ** 2 + areas / (4.0 * np.pi)
    dense = is_surface(surface)[near]
    shares_near = np.exp(-square / (2.0 * variance)) * (areas / (2.0 * np.pi * variance))
    if not dense.all():
        shares_near = np.where(dense, shares_near, _plates(square, areas, sigma))
    shares[:, near] = shares_near
    return shares


def _on_plate(surface: Surface, centre: Array) -> Array:
    """Fractions (t, n) on the taxels under a rigid plate, which takes the whole force to all of them."""
    size = 0.5 * float(np.ptp(surface.positions, axis=0).max())
    square = ((centre[:, None] - surface.positions) ** 2).sum(axis=2)
    weights = np.exp(-(square - square.min(axis=1)[:, None]) / (2.0 * size**2))
    result: Array = weights / weights.sum(axis=1)[:, None]
    return result


def _plates(square: Array, areas: Array, sigma: Array) -> Array:
    """Fractions on the taxels of a sheet, whose plates and rims take all of the force that meets them."""
    beside = np.maximum(np.sqrt(np.maximum(square, 0.0)) - np.sqrt(areas / np.pi), 0.0)
    twice = 2.0 * sigma**2
    weights = areas * np.exp((square.min(axis=1)[:, None] - square) / twice[:, None])
    met = np.exp(-(beside.min(axis=1) ** 2) / twice)
    result: Array = weights / weights.sum(axis=1)[:, None] * met[:, None]
    return result
