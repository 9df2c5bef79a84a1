"""What a person's hand is to do, as functions of time, and the motion that does it.

A plan is made before the hand moves, as people do: the hand flies to the skin, presses its pads by force /
stiffness, and lifts between two pulses. What the arm, the hand's mass and the skin make of it is physics;
what differs from the plan is felt and corrected, slow and late (`hand_control`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import CommandError, UnknownNameError
from tci.messages.frames import Array, read_only
from tci.simulation.hand_control import MOMENT
from tci.support.engine import mujoco

PADS = ("palm", "thumb", "index", "middle", "ring", "little")
"""Parts of a hand that touch: the palm lies flat, fingers touch with their tips."""
APPROACH = 0.25
"""Time [s] in which a pad flies to the skin, and away from it."""
GAP = 0.02
"""Least distance [m] from which a pad comes, and to which it goes."""
FASTEST = 3.0
"""Largest speed [m/s] of a blow; about that of a firm slap."""
RISE = 0.1
"""Time [s] in which a force that is asked for at once grows, and in which it ends."""
SOFTENED = 0.016
"""Length [s] of the window that rounds the plan's corners."""
BEHIND = 0.06
"""Distance [m] from the skin of the pads that do not touch."""
Moments = NDArray[np.void]
"""What a hand is to do, a `hand_control.MOMENT` for every step."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HandPath:
    """Where the pads of one hand touch a robot, and how firmly, over time.

    Between the given times places and forces are interpolated linearly: give as many as a curve needs, such
    as one every 5 ms for blows. The speed along the skin follows from points and times. For a single pad the
    axis of the pads may be left out, and one place or normal holds for all times. Raises CommandError for
    arrays that do not fit, UnknownNameError for an unknown pad.
    """

    link: str
    """Body of the robot's model on which the path lies: a patch's `link`, or a link without skin."""
    times: ArrayLike
    """(n,) [s], rising, from 0 on. The hand is at the skin at time 0; it starts `APPROACH` before."""
    points: ArrayLike
    """(n, k, 3) [m] on the surface, in the link's frame: of each of k pads."""
    normals: ArrayLike
    """(n, k, 3): outward there, of any length."""
    forces: ArrayLike
    """(n, k) [N] of each pad along its inward normal; 0 lifts it."""
    pads: Sequence[str] = ("palm",)
    """Names (k,) of `PADS`. Pads on opposite sides of a limb grip it."""
    spread: float = 0.0
    """Width [m] (standard deviation) over which each pad presses on skin, which feels a point through its own
    cover only."""

    def __post_init__(self) -> None:
        times, k = np.array(self.times, dtype=float), len(self.pads)
        if times.ndim != 1 or len(times) < 2 or times[0] != 0.0 or not (np.diff(times) > 0.0).all():
            raise CommandError("times; valid: at least two, rising, the first one 0 s")
        for pad in self.pads:
            if pad not in PADS:
                raise UnknownNameError("pad of a hand", pad, PADS)
        if not 0.0 <= self.spread <= 0.1:
            raise CommandError(f"spread {self.spread}; valid: 0 to 0.1 m")
        if not k or len(set(self.pads)) < k:
            raise CommandError(f"pads {tuple(self.pads)}; valid: some of {', '.join(PADS)}, each once")
        for name, shape in (("points", (len(times), k, 3)), ("normals", (len(times), k, 3)),
                            ("forces", (len(times), k))):  # fmt: skip
            values = np.array(getattr(self, name), dtype=float)
            if k == 1 and values.ndim == len(shape) - 1 and len(values) == len(times):
                values = values[:, None]
            try:
                full = np.array(np.broadcast_to(values, shape))
            except ValueError:
                raise CommandError(f"{name} of shape {values.shape}; valid: {shape}") from None
            if not np.isfinite(full).all():
                raise CommandError(f"{name}: values that are not finite")
            object.__setattr__(self, name, read_only(full))
        forces, length = np.array(self.forces), np.linalg.norm(self.normals, axis=2, keepdims=True)
        if (forces < 0.0).any() or not (forces > 0.0).any():
            raise CommandError("forces; valid: at least 0 N, one of them above")
        if not (length > 0.0).all():
            raise CommandError("normals without a direction; valid: a length above 0")
        object.__setattr__(self, "times", read_only(times))
        object.__setattr__(self, "normals", read_only(np.array(self.normals) / length))
        object.__setattr__(self, "pads", tuple(self.pads))

    @property
    def duration(self) -> float:
        """From time 0 to the last one [s], without the flights."""
        return float(np.array(self.times)[-1])


@dataclass(frozen=True)
class Ballistics:
    """What a plan needs to know of the hand that follows it."""

    mass: float
    """[kg]."""
    pad: float
    """Stiffness [N/m] of each pad."""
    damping: float
    """Of each pad [N s/m]."""
    friction: float
    """Coefficient on the skin."""


def plan_of(
    path: HandPath, heights: Array, turns: Array, step: float, hand: Ballistics, run_up: float = 1.0
) -> tuple[Moments, int]:
    """The plan of a path, and its steps before time 0.

    Args:
        path: what the hand is to do.
        heights: (n, k) [m] above the path's points at which each pad first touches.
        turns: (n, k, 4) orientations of the pads in the link's frame, as quaternions.
        step: [s].
        hand: mass and pads.
        run_up: fraction of `APPROACH` in which the hand gains its speed; less needs less room.
    """
    known, flight = np.array(path.times), max(2, round(APPROACH / step))
    count = int(np.ceil(known[-1] / step - 1e-9)) + 1
    times = (np.arange(count + 2 * flight) - flight) * step

    def along(values: Array) -> Array:
        flat = values.reshape(len(known), -1)
        columns = [np.interp(times, known, column) for column in flat.T]
        return np.column_stack(columns).reshape(len(times), *values.shape[1:])

    points, normals = _rounded(along(np.array(path.points)), step), along(np.array(path.normals))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    turns = along(turns)
    turns /= np.linalg.norm(turns, axis=2, keepdims=True)
    asked = along(np.array(path.forces))[flight : flight + count]
    depth, force = np.empty((2, len(times), len(path.pads)))
    for k, forces in enumerate(asked.T):
        depth[:, k], force[:, k] = depth_of(forces, flight, step, hand, run_up)
    places = points + (_rounded(along(heights), step) - depth)[:, :, None] * normals
    base = places.mean(axis=1)
    speed = np.gradient(points, step, axis=0)
    drag = speed / (np.linalg.norm(speed, axis=2, keepdims=True) + 5e-3)
    damper = np.where(depth > 0.0, hand.damping * np.gradient(depth, step, axis=0), 0.0)
    pressed = np.where(depth > 0.0, hand.pad * depth + damper, 0.0)
    pushed = hand.friction * force[:, :, None] * drag - pressed[:, :, None] * normals
    total = force.sum(axis=1)
    plan = np.zeros(len(times), MOMENT)
    plan["base"], plan["asked"] = base, total
    plan["push"] = pushed.sum(axis=1) + hand.mass * np.gradient(np.gradient(base, step, axis=0), step, axis=0)
    for number, name in enumerate(PADS):
        k = path.pads.index(name) if name in path.pads else 0
        plan["place"][:, number], plan["normal"][:, number] = places[:, k], normals[:, k]
        plan["turn"][:, number] = turns[:, k]
        if name in path.pads:
            plan["share"][:, number] = force[:, k] / np.maximum(total, 1e-9)
        else:
            plan["place"][:, number] += BEHIND * normals[:, k]
    presses, out = -(force[:, :, None] * normals).sum(axis=1), plan["normal"][:, 0]
    plan["ahead"] = (presses - (presses * out).sum(axis=1, keepdims=True) * out) / hand.pad
    return plan, flight


def depth_of(
    forces: Array, flight: int, step: float, hand: Ballistics, run_up: float = 1.0
) -> tuple[Array, Array]:
    """Depth (m,) [m] of a pad at every step, from rest to rest, and the force (m,) [N] that it means.

    `forces` (c,) [N] are asked at every step; m = c + 2 `flight`. Negative depths are flights.
    """
    force = np.pad(_softened_ends(forces, step), flight)
    touching = np.concatenate([[False], force > 0.0, [False]])
    begins, ends = (np.flatnonzero(np.diff(touching.astype(int)) == sign).tolist() for sign in (1, -1))
    depth = force / hand.pad
    if not len(begins):
        return np.full(len(depth), -GAP), force
    least = float(np.clip(0.3 * force.max() / np.sqrt(hand.pad * hand.mass), 0.01, 0.05))

    def speed(values: Array) -> float:
        # the first value lies one step after 0
        slope = values[0] if len(values) < 3 else max(values[0], values[1] - values[0])
        return float(np.clip(slope / step, least, FASTEST))

    comes = [speed(depth[b:e]) for b, e in zip(begins, ends, strict=True)]
    leaves = [speed(depth[b:e][::-1]) for b, e in zip(begins, ends, strict=True)]
    for e, b, away, back in zip(ends[:-1], begins[1:], leaves[:-1], comes[1:], strict=True):
        depth[e:b] = _arc(0.0, -away, 0.0, back, b - e + 2, step)[1:-1]
    first, last = begins[0], ends[-1]
    run = max(2, round(run_up * flight))
    far = [-max(run_up * GAP, 0.5 * speed * run * step) for speed in (comes[0], leaves[-1])]
    depth[first - run : first] = _arc(far[0], 0.0, 0.0, comes[0], run + 1, step)[:-1]
    depth[: first - run] = far[0]
    depth[last : last + run] = _arc(0.0, -leaves[-1], far[1], 0.0, run + 1, step)[1:]
    depth[last + run :] = far[1]
    return _rounded(depth, step), force


def turns_of(normals: Array, along: Array) -> Array:
    """Orientations (n, k, 4) of pads that touch against outward unit normals (n, k, 3), as quaternions: z
    into the skin, x along the limb, whose direction is `along` (3,)."""
    flat = normals.reshape(-1, 3)
    x = along - (flat @ along)[:, None] * flat
    across = np.linalg.norm(x, axis=1) < 0.1
    if across.any():  # any direction in the skin
        x[across] = np.linalg.svd(flat[across, None])[2][:, 1]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    rotations = np.stack([x, np.cross(-flat, x), -flat], axis=2).reshape(-1, 9)
    found = np.empty((len(flat), 4))
    for turn, rotation in zip(found, rotations, strict=True):
        mujoco.mju_mat2Quat(turn, rotation)
    found = found.reshape(*normals.shape[:2], 4)
    turned = (found[1:] * found[:-1]).sum(axis=2) < 0.0
    found[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)[:, :, None]
    return found


def _softened_ends(force: Array, step: float) -> Array:
    """A force that begins or ends at once grows and falls in a quarter of a sine."""
    result = force.copy()
    touching = np.concatenate([[False], force > 0.0, [False]])
    begins, ends = (np.flatnonzero(np.diff(touching.astype(int)) == sign).tolist() for sign in (1, -1))
    for b, e in zip(begins, ends, strict=True):
        count = int(min(round(RISE / step), (e - b) // 2))
        ramp = np.sin(0.5 * np.pi * (np.arange(count) + 1) / (count + 1))
        most = force[b:e].max()
        if force[b] > 0.2 * most:
            result[b : b + count] *= ramp
        if force[e - 1] > 0.2 * most:
            result[e - count : e] *= ramp[::-1]
    return result


def _arc(begin: float, leaves: float, end: float, comes: float, count: int, step: float) -> Array:
    """Cubic curve of `count` values from `begin` with the speed `leaves` to `end` with the speed `comes`."""
    s, duration = np.linspace(0.0, 1.0, count), (count - 1) * step
    result: Array = (
        begin * (1.0 - 3.0 * s**2 + 2.0 * s**3) + end * (3.0 * s**2 - 2.0 * s**3)
        + duration * (leaves * (s - 2.0 * s**2 + s**3) + comes * (s**3 - s**2))
    )  # fmt: skip
    return result


def _rounded(values: Array, step: float) -> Array:
    half = max(1, round(0.5 * SOFTENED / step))
    window = np.hanning(2 * half + 3)[1:-1]
    window /= window.sum()
    columns = values.reshape(len(values), -1)
    padded = np.pad(columns, ((half, half), (0, 0)), mode="edge")
    result = np.column_stack([np.convolve(column, window, mode="valid") for column in padded.T])
    return result.reshape(values.shape)
