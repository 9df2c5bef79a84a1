"""Many worlds of one robot, stepped together: what every engine offers."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.batch.scene import BatchScene
from tci.errors import CommandError, UnknownNameError
from tci.messages import JointReading, Perception, SkinState
from tci.messages.contacts import Contacts
from tci.messages.frames import Array, frozen
from tci.skin.kernels.arrays import ContactArrays
from tci.skin.tracking import Tracker

Engine = Literal["mujoco", "warp"]
Ids = NDArray[np.intp]


class Worlds(ABC):
    """N worlds of one robot with servos, skin and a finger each. Make them with `make_worlds`.

    All worlds share time. A frame of skin is taken in the step of the physics that begins at its stamp, and
    is there one step later.
    """

    def __init__(self, scene: BatchScene, count: int) -> None:
        if count < 1:
            raise CommandError(f"{count} worlds; valid: 1 or more")
        self.scene, self.count = scene, count
        self.steps = 0
        """Steps of the physics since the start."""
        self.frames = 0
        """Frames of skin so far, of whichever patches."""
        self._trackers: list[Tracker] = []
        self.phase = min(1, int(scene.world.servos.ramp_steps) - 1)
        """Set-points move on this many steps after the beginning of each control period: a frame that is
        taken at its beginning is there then, so a target can answer it, and does not yet show the target."""
        starts = scene.body.layout.starts
        self.places: dict[str, slice] = {
            name: slice(int(starts[p]), int(starts[p + 1])) for name, p in scene.body.layout.places.items()
        }
        """Columns of each patch in arrays of taxels."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.scene.step

    @abstractmethod
    def advance(self, duration: float) -> None:
        """Steps all worlds by `duration` [s], rounded up to whole steps. Raises CommandError for a duration
        below 0 or not finite, and TciError if a patch has more contacts at a time than its sensor can
        report."""

    @abstractmethod
    def send(self, targets: ArrayLike) -> None:
        """Sets the targets (N, n) [rad] of all servos; the limiter goes there. NaN keeps the last one."""

    @property
    @abstractmethod
    def joints(self) -> Array:
        """Present angles (N, n) [rad] of all servos."""

    @property
    @abstractmethod
    def force(self) -> Array:
        """Normal force (N, taxels) [N] on each taxel in the latest frames."""

    @property
    @abstractmethod
    def touched(self) -> NDArray[np.bool_]:
        """True (N,) for each world with a contact in its latest frames."""

    @abstractmethod
    def _contacts_of(self, world: int) -> ContactArrays:
        """Contacts of one world in its latest frames; writable, and the same until the next frame."""

    @abstractmethod
    def _active_of(self, world: int) -> tuple[NDArray[np.int64], NDArray[np.int32], Array]:
        """Numbers of active taxels (p,) of each patch, these taxels, and the pressures [Pa] on them."""

    @abstractmethod
    def _latest(self) -> tuple[Array, NDArray[np.int64]]:
        """Times (p,) [s] and sequence numbers (p,) of the latest frames, for all worlds; read-only."""

    @abstractmethod
    def _then(self, world: int) -> tuple[Array, Array]:
        """Angles (n,) [rad] and speeds (n,) [rad/s] of all servos at the time of the latest frame."""

    def track(self) -> None:
        """From now on contacts have identities, which takes time in Python."""
        self._trackers = [Tracker() for _ in range(self.count)]

    def _follow(self) -> None:
        """Gives the contacts of new frames their identities."""
        for w in np.flatnonzero(self.touched).tolist() if self._trackers else ():
            self._trackers[w].follow(self._contacts_of(w), self._latest()[0])

    def contacts(self, world: int) -> Contacts:
        """Contacts of one world in its latest frames, as a perceiver finds them; identified after `track`."""
        made, sites = self._contacts_of(world), self.scene.body.layout.sites
        return Contacts(sites, *self._latest(), made.rows.copy(), made.begin.copy(), made.taxels.copy())

    def perceive(self, world: int) -> Perception:
        """What a perceiver would say of one world at the time of the latest frame."""
        (stamps, sequence), layout = self._latest(), self.scene.body.layout
        time, (angles, velocity) = float(stamps.max(initial=0.0)), self._then(world)
        joints = JointReading(time, self.frames, frozen(angles), frozen(velocity))
        numbers, active, pressure = self._active_of(world)
        begin = np.concatenate([[0], np.cumsum(numbers)])
        skin = SkinState(layout.starts, stamps, sequence, frozen(begin), frozen(active), frozen(pressure))
        return Perception(
            time, self.scene.body.posture(joints), self.contacts(world), joints=joints, skin=skin
        )

    @abstractmethod
    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Puts some worlds, or all, back at their start, without a finger."""

    @abstractmethod
    def _place_fingers(
        self, worlds: Ids, at: Array, way: Array, speed: Array, depth: Array, gap: float
    ) -> None:
        """Starts pokes at points (k, 3) [m] along directions (k, 3), both in the world frame."""

    @abstractmethod
    def _link_poses(self, bodies: Ids, worlds: Ids) -> tuple[Array, Array]:
        """Present positions (k, 3) [m] and orientations (k, 3, 3) of one body in each of some worlds."""

    def poke(
        self,
        patches: str | Sequence[str],
        taxels: ArrayLike,
        *,
        speed: ArrayLike = 0.25,
        depth: ArrayLike = 0.01,
        gap: float = 0.004,
        worlds: ArrayLike | None = None,
    ) -> None:
        """Starts a poke in each of some worlds, or in all: `Finger.poke` without its look whether there is
        room. See there for `speed` [m/s], `depth` [m] and `gap` [m]; one value, or one per world.

        Raises UnknownNameError for an unknown patch, and CommandError for an invalid number.
        """
        ids = self.ids(worlds)
        names = [patches] * len(ids) if isinstance(patches, str) else [*patches]
        index = np.broadcast_to(np.asarray(taxels, dtype=np.intp), ids.shape)
        if len(names) != len(ids):
            raise CommandError(
                f"{len(names)} patches for {len(ids)} worlds; valid: one for each, or one name"
            )
        surfaces = self.scene.world.surfaces
        points, normals, bodies = (
            np.empty((len(ids), 3)),
            np.empty((len(ids), 3)),
            np.empty(len(ids), np.intp),
        )
        for k, (name, taxel) in enumerate(zip(names, index.tolist(), strict=True)):
            if name not in surfaces:
                raise UnknownNameError("skin patch", name, surfaces)
            surface = surfaces[name]
            if not 0 <= taxel < len(surface.positions):
                raise CommandError(f"taxel {taxel} of {name}; valid: 0 to {len(surface.positions) - 1}")
            points[k], normals[k] = surface.positions[taxel], surface.normals[taxel]
            bodies[k] = self.scene.model.body(surface.link).id
        fast, deep = (np.broadcast_to(np.asarray(one, dtype=float), ids.shape) for one in (speed, depth))
        if not (np.isfinite(fast) & (fast > 0.0) & np.isfinite(deep) & (deep >= 0.0)).all() or not gap >= 0.0:
            raise CommandError("speeds, depths and gap of pokes; valid: finite, at least 0, a speed above 0")
        p, R = self._link_poses(bodies, ids)
        at = p + np.einsum("kij,kj->ki", R, points)
        out = np.einsum("kij,kj->ki", R, normals)
        radius = self.scene.world.finger.radius
        self._place_fingers(ids, at + (radius + gap) * out, -out, fast, deep, gap)

    def _steps_in(self, duration: float) -> int:
        if not 0.0 <= duration < np.inf:
            raise CommandError(f"worlds advanced by {duration} s; valid: 0 or more, finite")
        return math.ceil(duration / self.scene.step - 1e-6)

    def ids(self, worlds: ArrayLike | None) -> Ids:
        """Indices (k,) of some worlds, or of all. Raises CommandError for one that is not there."""
        if worlds is None:
            return np.arange(self.count)
        ids = np.atleast_1d(np.asarray(worlds, dtype=np.intp))
        if len(ids) and not (ids.min() >= 0 and ids.max() < self.count):
            raise CommandError(f"worlds {ids.tolist()}; valid: 0 to {self.count - 1}")
        return ids
