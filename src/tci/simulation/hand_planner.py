"""How a hand gets to the skin: how high above it each pad first touches, and on which way it has room."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import TciError
from tci.messages.frames import Array, read_only
from tci.robot.collisions import PERSON
from tci.simulation.hand_model import MARGIN, PAD_DAMPING, PAD_MASS, PersonModel
from tci.simulation.hand_path import PADS, Ballistics, HandPath, Moments, plan_of, turns_of
from tci.simulation.physics import Physics
from tci.simulation.touch import FRICTION, skin_geom
from tci.skin.surfaces import Surface
from tci.support.engine import mujoco

SKIN_GEOM = skin_geom("")
_ON_SKIN = 0.02
"""Distance [m] from a taxel up to which a place counts as on skin, or the width of a taxel if that is more:
sleeves of 64 taxels have one each 30 to 70 mm. Assumed: above the pitch of other skins."""
_RUN_UPS = 1.0, 0.5, 0.25
"""Run-ups that are tried, as fractions of the usual one: between arm and trunk there is little room."""
_INSIDE = 5e-4
"""Depth [m] in a body at which a hand may not start."""


class HandPlanner:
    """Plans the ways of one hand, on paper: nothing moves, but a plan decides which geoms each pad meets."""

    def __init__(
        self, physics: Physics, name: str, person: PersonModel, surfaces: Mapping[str, Surface]
    ) -> None:
        self._physics, self._name, model = physics, name, physics.model
        self._geoms = [model.geom(f"{name}_{pad}").id for pad in PADS]
        self._scratch, self._bit = mujoco.MjData(model), int(model.geom_contype[self._geoms[0]])
        solid = np.flatnonzero(model.geom_conaffinity & PERSON).tolist()
        names = {geom: str(model.geom(geom).name) for geom in solid}
        self._hard = [geom for geom in solid if not names[geom].startswith(SKIN_GEOM)]
        self._skins = [
            (geom, surfaces[name.removeprefix(SKIN_GEOM)])
            for geom, name in names.items() if name.startswith(SKIN_GEOM)
        ]  # fmt: skip
        damping = 2.0 * PAD_DAMPING * float(np.sqrt(person.pad * PAD_MASS))
        self._ballistics = Ballistics(person.mass, person.pad, damping, FRICTION)

    def plan(self, path: HandPath, link: int) -> Moments:
        """What the hand does from moment to moment on a path. A palm that has no room, as between the
        fingers of a small robot hand, leaves the touch to a fingertip. Raises TciError if that has none
        either."""
        try:
            return self._plan(path, link)
        except TciError as error:
            if tuple(path.pads) != ("palm",):
                raise
            with suppress(TciError):
                return self._plan(replace(path, pads=("index",)), link)
            raise error

    def _plan(self, path: HandPath, link: int) -> Moments:
        self._open(path, link)
        turns = turns_of(np.array(path.normals), _long_axis(self._physics.model, link))
        heights = self._heights(path, turns, link)
        for run_up in _RUN_UPS:
            plan, flight = plan_of(path, heights, turns, self._physics.step, self._ballistics, run_up)
            blocked = self._blocked(path, plan, flight, link)
            if not blocked:
                return plan
        raise TciError(f"no room for {self._name}: {blocked}")

    def height(self, link: str, pad: str, point: ArrayLike, normal: ArrayLike) -> float:
        """Height [m] above a point of a link at which a pad first touches it; all in the link's frame."""
        model, data, source = self._physics.model, self._scratch, self._physics.data
        data.geom_xpos[:], data.geom_xmat[:] = source.geom_xpos, source.geom_xmat
        body = model.body(link).id
        R, p, local = source.xmat[body].reshape(3, 3), source.xpos[body], np.empty(9)
        out = np.asarray(normal) / np.linalg.norm(normal)
        mujoco.mju_quat2Mat(local, self.turn(link, out))
        geom = self._geoms[PADS.index(pad)]
        near = [other for other in self._met_by(geom) if model.geom_bodyid[other] == body]
        return self._height(geom, near, p + R @ np.asarray(point), R @ out, R @ local.reshape(3, 3))

    def turn(self, link: str, normal: ArrayLike) -> Array:
        """Orientation (4,) of a pad that touches against an outward normal, in the link's frame."""
        model = self._physics.model
        unit = np.reshape(normal, (1, 1, 3)) / np.linalg.norm(normal)
        turn: Array = turns_of(unit, _long_axis(model, model.body(link).id))[0, 0]
        return turn

    def _open(self, path: HandPath, link: int) -> None:
        """A hand on skin passes through the bare hulls of its link and of those beside it. They are rough,
        and stick out of the skin of some robots by up to two centimetres, where the robot itself has none; a
        pad that slides into the notch between skin and hull is wedged with thousands of newtons. Only the
        pads of a grip that press from a bare side meet the hulls there."""
        model, bit = self._physics.model, self._bit
        model.geom_conaffinity[self._hard] |= bit
        parent = model.body_parentid
        bodies = {geom: model.geom_bodyid[geom] for geom in self._hard}
        near = [geom for geom, body in bodies.items() if link in (body, parent[body]) or body == parent[link]]
        model.geom_conaffinity[near] &= ~bit
        points = np.array(path.points)
        on_skin = self._on_skin(points[:: max(1, len(points) // 20)], link).mean(axis=0) > 0.5
        out = np.array(path.normals).mean(axis=0)
        through = (on_skin & (out @ out.T > 0.0)).any(axis=1)
        bits = dict(zip(path.pads, np.where(through, bit, PERSON), strict=True))
        model.geom_contype[self._geoms] = [bits.get(pad, bit if on_skin.any() else PERSON) for pad in PADS]

    def _on_skin(self, points: Array, link: int) -> NDArray[np.bool_]:
        """Which points (..., 3) [m] in a link's frame have a taxel of this link near."""
        skins = [skin for geom, skin in self._skins if self._physics.model.geom_bodyid[geom] == link]
        if not skins:
            return np.zeros(points.shape[:-1], bool)
        taxels = np.concatenate([skin.positions for skin in skins])
        widths = np.maximum(np.sqrt(np.concatenate([skin.areas for skin in skins])), _ON_SKIN)
        apart = np.linalg.norm(points[..., None, :] - taxels, axis=-1)
        return np.asarray((apart < widths).any(axis=-1))

    def _met_by(self, pad: int) -> list[int]:
        """The geoms that a pad (a geom) touches."""
        model = self._physics.model
        return np.flatnonzero(model.geom_conaffinity & model.geom_contype[pad]).tolist()

    def _heights(self, path: HandPath, turns: Array, link: int) -> Array:
        """Heights (n, k) [m] above a path's points at which each pad first touches a body, of those that lie
        near: a person sees where the surface is."""
        model, data = self._physics.model, self._scratch
        source = self._physics.data
        data.geom_xpos[:], data.geom_xmat[:] = source.geom_xpos, source.geom_xmat
        data.xpos[:], data.xmat[:] = source.xpos, source.xmat
        R, p = source.xmat[link].reshape(3, 3), source.xpos[link]
        points, normals = np.array(path.points), np.array(path.normals)
        heights, local = np.zeros(points.shape[:2]), np.empty(9)
        rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), 40)).round().astype(int))
        for k, name in enumerate(path.pads):
            geom = self._geoms[PADS.index(name)]
            near = [other for other in self._met_by(geom) if model.geom_bodyid[other] == link]
            if not near:
                raise TciError(f"{path.link} has no surface that can be touched")
            found = {}
            for n in rows.tolist():
                key = (*points[n, k], *normals[n, k])
                if key not in found:
                    mujoco.mju_quat2Mat(local, turns[n, k])
                    place, normal = p + R @ points[n, k], R @ normals[n, k]
                    turn = R @ local.reshape(3, 3)
                    found[key] = self._height(geom, near, place, normal, turn)
                heights[n, k] = found[key]
            heights[:, k] = np.interp(np.arange(len(points)), rows, heights[rows, k])
        return heights

    def _height(self, geom: int, near: list[int], point: Array, normal: Array, turn: Array) -> float:
        model, data = self._physics.model, self._scratch
        height = 0.05
        for _ in range(8):
            self._put(geom, point + height * normal, turn)
            room = min(mujoco.mj_geomDistance(model, data, geom, other, 0.06, None) for other in near)
            height -= room - MARGIN
            if abs(room - MARGIN) < 2e-5:
                break
        return height

    def _put(self, geom: int, place: Array, turn: Array) -> None:
        """Places a pad (a geom) and turns it (3, 3), on paper."""
        model, data, own = self._physics.model, self._scratch, np.empty(9)
        mujoco.mju_quat2Mat(own, model.geom_quat[geom])
        data.geom_xmat[geom] = (turn @ own.reshape(3, 3)).ravel()
        data.geom_xpos[geom] = place + turn @ model.geom_pos[geom]

    def _blocked(self, path: HandPath, plan: Moments, flight: int, link: int) -> str:
        """Says which pad would meet a body on its way to the skin, or another body than the link later: the
        hand would start in it, or touch what it should not."""
        model, source, turn = self._physics.model, self._physics.data, np.empty(9)
        R, p = source.xmat[link].reshape(3, 3), source.xpos[link]
        used = [self._geoms[PADS.index(name)] for name in path.pads]
        solids = [np.array(self._met_by(geom)) for geom in self._geoms]
        way = np.linspace(0, flight, 4).astype(int).tolist()
        for row in (*way, *np.linspace(flight, len(plan) - 1 - flight, 5).astype(int).tolist()[1:]):
            for k, (geom, solid) in enumerate(zip(self._geoms, solids, strict=True)):
                mujoco.mju_quat2Mat(turn, plan["turn"][row, k])
                self._put(geom, p + R @ plan["place"][row, k], R @ turn.reshape(3, 3))
                apart = self._scratch.geom_xpos[solid] - self._scratch.geom_xpos[geom]
                reach = model.geom_rbound[solid] + model.geom_rbound[geom]
                near = np.einsum("ij,ij->i", apart, apart) < reach**2
                if row > flight and geom in used:
                    near &= model.geom_bodyid[solid] != link
                for other in solid[near].tolist():
                    room = mujoco.mj_geomDistance(model, self._scratch, geom, other, 1e-3, None)
                    if room < -_INSIDE:
                        return f"its {PADS[k]} would be {-room:.4f} m inside {_of(model, other)}"
        return ""


def _of(model: mujoco.MjModel, geom: int) -> str:
    """Name of a geom, or of its body."""
    return str(model.geom(geom).name or model.body(int(model.geom_bodyid[geom])).name)


def _long_axis(model: mujoco.MjModel, body: int) -> Array:
    """Direction (3,) of a link's length, in its frame: the axis of its least moment of inertia."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axis: Array = rotation.reshape(3, 3)[:, int(np.argmin(model.body_inertia[body]))]
    return read_only(axis)
