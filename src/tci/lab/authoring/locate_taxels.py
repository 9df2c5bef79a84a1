"""Estimates taxel positions from touches at known places, for skin whose positions were not measured.

A probe, or the robot's own finger, touches the skin at places that are known from kinematics. The taxel
positions follow from two facts by least squares. First, the response of a taxel decreases with its distance
from the touch, so that responses measure distances. Second, the centre of pressure of each touch is at the
probe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from tci.errors import TciError
from tci.messages.frames import Array, read_only

# All values below are assumed; lengths are in [m].
START_WIDTH = 0.005
"""Initial width [m] of a taxel's response. `locate_taxels` estimates the width together with the
positions."""
FAINT = 0.04
"""A taxel's response counts as noise below this fraction of the strongest response to the same touch."""
PRIOR = 0.010
"""Expected standard deviation [m] of the errors in the taxels' initial positions."""
CENTRE, SHIFT, SURFACE = 0.0005, 0.002, 0.0015
"""Standard deviations [m] of three distances.

- CENTRE: distance of the centre of pressure from the probe.
- SHIFT: distance of the peak of the responses from the probe, since skin has edges and gaps.
- SURFACE: distance of taxels from the tangent plane of a touch.
"""
LOGARITHM = 0.15
"""Standard deviation of the errors in log(response), for the taxel that responds most strongly to a touch.
The standard deviation is larger for taxels that respond more weakly to that touch."""
ROUNDS = 40
LONGEST_STEP = 0.004
"""Largest displacement [m] of a taxel in one iteration."""
SETTLED = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ProbeTouch:
    """One touch at a known place."""

    point: Array
    """Position (3,) [m] of the probe's contact, in the patch's link."""
    normal: Array
    """Outward unit normal (3,) of the skin at `point`, in the frame of the patch's link: opposite to the
    probe's force."""
    answers: Array
    """Pressure (n,) on each taxel, in any unit; 0 without response."""


@dataclass(frozen=True, slots=True, eq=False)
class LocatedTaxels:
    """Taxel positions and normals estimated from touches."""

    positions: Array
    """Positions (n, 3) [m] in the link; for a taxel that never responded, its initial position."""
    normals: Array
    """Outward unit normals (n, 3): for each taxel the mean over the touches to which it responded. The value
    is zero for a taxel that never responded.
    """
    touches: NDArray[np.intp]
    """Number (n,) of touches to which each taxel responded."""
    width: float
    """Width [m] of a taxel's response, as the standard deviation of a Gaussian."""


def locate_taxels(touches: Sequence[ProbeTouch], initial: Array) -> LocatedTaxels:
    """Estimates the positions of n taxels from touches and `initial` positions (n, 3) [m].

    The initial positions may have errors of about 10 mm. The response of taxel i at x_i to touch t is
    modelled as A_t exp(-|x_i - c_t|^2 / 2 w^2), with peak c_t and width w. The Gauss-Newton method finds all
    x_i, A_t, c_t and w at once. Raises TciError if a touch does not have n responses, or if fewer than 3
    touches were felt.
    """
    initial = np.asarray(initial, dtype=float)
    count = len(initial)
    if initial.ndim != 2 or initial.shape[1] != 3 or not np.isfinite(initial).all():
        raise TciError(f"initial positions of shape {initial.shape}; valid: (taxels, 3), finite")
    used = [touch for touch in touches if touch.answers.shape == (count,) and touch.answers.max() > 0.0]
    if len(used) < len(touches) and any(touch.answers.shape != (count,) for touch in touches):
        raise TciError(f"a touch with another number of answers than the {count} taxels")
    if len(used) < 3:
        raise TciError(f"{len(used)} touches were felt; valid: 3 or more, better as many as taxels")
    answers = np.array([touch.answers for touch in used])
    points = np.array([touch.point for touch in used])
    normals = np.array([touch.normal for touch in used])
    share = answers / answers.max(axis=1, keepdims=True)
    rows, taxels = np.nonzero(share >= FAINT)
    weights = answers[rows, taxels]
    seen = np.bincount(taxels, minlength=count)
    felt = np.bincount(taxels, weights, minlength=count)
    places = initial.copy()
    found = seen > 0
    for axis in range(3):
        sums = np.bincount(taxels, weights * points[rows, axis], minlength=count)
        places[found, axis] = sums[found] / felt[found]
    problem = _Problem(
        rows, taxels, weights, points, normals, np.where(found[:, None], places, initial), initial
    )
    places, width = problem.solve()
    places[~found] = initial[~found]
    mean = np.stack(
        [np.bincount(taxels, weights * normals[rows, axis], minlength=count) for axis in range(3)], axis=1
    )
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    mean = np.divide(mean, length, out=np.zeros_like(mean), where=length > 0.0)
    return LocatedTaxels(read_only(places), read_only(mean), read_only(seen, np.intp), width)


class _Problem:
    """Estimates taxel positions from touches at known places, by least squares.

    The response of a taxel is modelled as a Gaussian function of its distance from the centre of the touch.
    Unknowns are the positions (n, 3) [m] of the taxels, the centre and the largest response of each touch,
    and one width for all touches.
    """

    def __init__(
        self, rows: NDArray[np.intp], taxels: NDArray[np.intp], weights: Array, points: Array, normals: Array,
        start: Array, prior: Array,
    ) -> None:  # fmt: skip
        self.rows, self.taxels, self.weights = rows, taxels, weights
        self.points, self.normals, self.prior = points, normals, prior
        self.x, self.c = start.copy(), points.copy()
        self.k = 0.5 / START_WIDTH**2
        self.logs = np.log(weights)
        far = np.einsum("ij,ij->i", start[taxels] - points[rows], start[taxels] - points[rows])
        held = np.bincount(rows, minlength=len(points))
        self.a = np.bincount(rows, self.logs + self.k * far, minlength=len(points)) / held
        total = np.bincount(rows, weights, minlength=len(points))
        self.shares = weights / total[rows]

    def solve(self) -> tuple[Array, float]:
        """Returns the positions (n, 3) [m] of the taxels, and the width [m] of the responses to a touch, as
        the standard deviation of a Gaussian."""
        n, t = len(self.x), len(self.points)
        for _ in range(ROUNDS):
            jacobian, residual = self._linear()
            normal = (jacobian.T @ jacobian).tocsc()
            normal.setdiag(normal.diagonal() * (1.0 + 1e-6) + 1e-9)
            step = spsolve(normal, -jacobian.T @ residual)
            moves = step[: 3 * n].reshape(n, 3)
            longest = float(np.linalg.norm(moves, axis=1).max())
            shrink = min(1.0, LONGEST_STEP / max(longest, 1e-12))
            self.x += shrink * moves
            self.c += shrink * step[3 * n : 3 * n + 3 * t].reshape(t, 3)
            self.a += shrink * step[3 * n + 3 * t : -1]
            self.k = float(np.clip(self.k + shrink * step[-1] * 1e4, 0.3 * self.k, 3.0 * self.k))
            if longest < SETTLED:
                break
        return self.x, float(np.sqrt(0.5 / self.k))

    def _linear(self) -> tuple[coo_array, Array]:
        n, t, m = len(self.x), len(self.points), len(self.rows)
        row_of, column_of, value_of, residuals = [], [], [], []
        height = 0

        def add(residual: Array, *blocks: tuple[NDArray[np.intp], NDArray[np.intp], Array]) -> None:
            nonlocal height
            for rows, columns, values in blocks:
                row_of.append(np.broadcast_to(rows, values.shape).ravel() + height)
                column_of.append(np.broadcast_to(columns, values.shape).ravel())
                value_of.append(values.ravel())
            residuals.append(residual)
            height += len(residual)

        each, three = np.arange(m), np.arange(3)
        x_at, c_at = 3 * self.taxels[:, None] + three, 3 * n + 3 * self.rows[:, None] + three
        away = self.x[self.taxels] - self.c[self.rows]
        square = np.einsum("ij,ij->i", away, away)
        # Weak responses have a smaller weight, since the error of a logarithm increases as the response
        # decreases.
        trust = (
            np.sqrt(self.weights / np.maximum.reduceat(self.weights, self._firsts())[self.rows]) / LOGARITHM
        )
        add(
            trust * (self.a[self.rows] - self.k * square - self.logs),
            (each[:, None], x_at, -2.0 * self.k * trust[:, None] * away),
            (each[:, None], c_at, 2.0 * self.k * trust[:, None] * away),
            (each, 3 * n + 3 * t + self.rows, trust),
            (each, np.full(m, 3 * n + 4 * t), -trust * square * 1e4),
        )
        centre = np.zeros((t, 3))
        np.add.at(centre, self.rows, self.shares[:, None] * self.x[self.taxels])
        flat = np.eye(3) - self.normals[:, :, None] * self.normals[:, None, :]
        residual = np.einsum("tij,tj->ti", flat, centre - self.points) / CENTRE
        index = 3 * self.rows[:, None, None] + three[None, :, None]
        add(
            residual.ravel(),
            (index, x_at[:, None, :], flat[self.rows] * self.shares[:, None, None] / CENTRE),
        )
        steps = np.arange(3 * t)
        add((self.c - self.points).ravel() / SHIFT, (steps, 3 * n + steps, np.full(3 * t, 1.0 / SHIFT)))
        height_over = np.einsum(
            "ij,ij->i", self.x[self.taxels] - self.points[self.rows], self.normals[self.rows]
        )
        add(height_over / SURFACE, (each[:, None], x_at, self.normals[self.rows] / SURFACE))
        steps = np.arange(3 * n)
        add((self.x - self.prior).ravel() / PRIOR, (steps, steps, np.full(3 * n, 1.0 / PRIOR)))
        entries = (np.concatenate(value_of), (np.concatenate(row_of), np.concatenate(column_of)))
        return coo_array(entries, shape=(height, 3 * n + 4 * t + 1)).tocsr(), np.concatenate(residuals)

    def _firsts(self) -> NDArray[np.intp]:
        """Returns, for each touch, the index of its first response in the arrays of all responses, which are
        sorted by touch."""
        return np.searchsorted(self.rows, np.arange(len(self.points)))
