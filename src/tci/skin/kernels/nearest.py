"""Nearest point of a patch's surface, by a search over grid cells."""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array
from tci.robot.kernels.limb import Vector
from tci.skin import formulas
from tci.skin.kernels.arrays import LayoutArrays, Records
from tci.support.compiled import inlined
from tci.support.one_source import made_with

ALIKE = 1e-11
"""Relative difference of squared distances up to which faces count as equally near. Ties of double precision
differ by less than 1e-12, other faces by more than 1e-2."""
_f = made_with(inlined, formulas)
_corner_weights, _wins = _f.corner_weights, _f.wins


@inlined
def nearest(point: Vector, p: int, layout: LayoutArrays, p_L: Array, n_L: Array) -> None:
    """Finds the point of the surface of patch `p` that is nearest to `point` [m]. Writes this point into
    `p_L` (3,) [m], and the normal there into `n_L` (3,).

    All coordinates are in the frame of the patch's link. For a surface without faces, the result is the
    nearest taxel. The result equals the result of `Surface.project`.
    """
    best, chosen = np.inf, -1
    patch, taxels, faces, cells = layout.patches[p], layout.taxels, layout.faces, layout.cells
    nx, ny, nz = patch.cells[0], patch.cells[1], patch.cells[2]
    low, scale, first_cell = patch.corner, patch.cells_per_metre, patch.cell
    if nx * ny * nz == 0:
        for i in range(patch.taxel, patch.taxel_end):
            at, normal = taxels[i].position, taxels[i].normal
            distance2 = _square(at[0] - point[0], at[1] - point[1], at[2] - point[2])
            if distance2 < best:
                best = distance2
                for axis in range(3):
                    p_L[axis], n_L[axis] = at[axis], normal[axis]
        return
    x, y, z = (point[0] - low[0]) * scale, (point[1] - low[1]) * scale, (point[2] - low[2]) * scale
    cx, cy, cz = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    last = max(max(cx, nx - cx), max(cy, ny - cy), max(cz, nz - cz)) + 1
    first = max(0, -cx, cx - nx + 1, -cy, cy - ny + 1, -cz, cz - nz + 1)
    for shell in range(first, last + 1):
        # Lower bound on the distance of this shell from any point in the middle cell.
        margin = min(x - cx, cx + 1 - x, y - cy, cy + 1 - y, z - cz, cz + 1 - z)
        least = (shell - 1 + margin) / scale
        if shell > 0 and best <= least * least:
            break
        for i in range(max(cx - shell, 0), min(cx + shell, nx - 1) + 1):
            side_x = abs(i - cx) == shell
            for j in range(max(cy - shell, 0), min(cy + shell, ny - 1) + 1):
                step = 1 if side_x or abs(j - cy) == shell else max(2 * shell, 1)
                begin = cz - shell
                if step == 1:
                    begin = max(begin, 0)
                for k in range(begin, min(cz + shell, nz - 1) + 1, step):
                    if k < 0:
                        continue
                    cell = first_cell + (i * ny + j) * nz + k
                    for entry in range(cells[cell], cells[cell + 1]):
                        f = cells[entry]
                        a, b, c = taxels[faces[f, 0]], taxels[faces[f, 1]], taxels[faces[f, 2]]
                        s, t, distance2 = _nearest_of(point, a, b, c)
                        if _wins(distance2, f, best, chosen, ALIKE):
                            best, chosen = distance2, f
                            rest = 1.0 - s - t
                            for axis in range(3):
                                p_L[axis] = (
                                    rest * a.position[axis] + s * b.position[axis] + t * c.position[axis]
                                )
                                n_L[axis] = rest * a.normal[axis] + s * b.normal[axis] + t * c.normal[axis]
    length = np.sqrt(_square(n_L[0], n_L[1], n_L[2]))
    n_L[0] /= length
    n_L[1] /= length
    n_L[2] /= length


@inlined
def _nearest_of(point: Vector, a: Records, b: Records, c: Records) -> tuple[float, float, float]:
    """Weights of the second and the third corner for the point of a triangle that is nearest to `point` [m],
    and its squared distance [m2]. The corners are the taxels `a`, `b` and `c`."""
    p, q, r = a.position, b.position, c.position
    ax, ay, az = p[0], p[1], p[2]
    ux, uy, uz = q[0] - ax, q[1] - ay, q[2] - az
    vx, vy, vz = r[0] - ax, r[1] - ay, r[2] - az
    wx, wy, wz = point[0] - ax, point[1] - ay, point[2] - az
    s, t = _corner_weights(
        ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz,
        wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz,
    )  # fmt: skip
    return s, t, _square(wx - s * ux - t * vx, wy - s * uy - t * vy, wz - s * uz - t * vz)


@inlined
def _square(x: float, y: float, z: float) -> float:
    return x * x + y * y + z * z
