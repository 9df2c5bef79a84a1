"""The field of the task reach: sticks whose ends stand in the straight way of an arm's skin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.gate.self_collision import SelfCollision
from tci.learn.task import Scene
from tci.messages.frames import Array, apply, invert
from tci.robot.joint_map import joint_map
from tci.simulation.obstacle import PREFIX, Obstacle
from tci.support.engine import mujoco

RADIUS, HALF, STIFFNESS = 0.01, 0.1, 1500.0
"""Poles: radius [m], half length [m], and stiffness [N/m], like a bamboo stick. Assumed."""
POLES = tuple(Obstacle(name=f"pole {n}", stiffness=STIFFNESS, radius=RADIUS, half=HALF) for n in range(6))
FEWEST = 2
"""Poles in a field, at least."""
FAR = 0.5
"""Distance [arm lengths] of the place from the hand, at least."""
SPREAD = 1.0
"""Largest angle [rad] of each servo between the initial posture and that at the place."""
EXACT = 0.02
"""Distance [arm lengths] from the place at which the straight way ends, at most."""
SHARES = np.linspace(0.0, 1.0, 17)
"""Postures of the straight way that are examined, from 0 at the start to 1 at the place."""
LEAST, MOST = 0.008, 0.015
"""Depth [m] to which the straight way presses a pole into the skin: 12 to 23 N on `STIFFNESS`."""
CLEAR = 0.008
"""Distance [m] from each pole to all links at the start and at the place, and always to what the part does
not move."""
BARE = 0.015
"""Distance [m] of each pole from the straight way of links without skin."""
APART = 0.08
"""Distance [m] between poles: an arm's thickness."""
SIDE = 0.5
"""Cosine of the least angle between the motion of a taxel and its normal, along which a pole stands."""
TILT = 0.3
"""Standard deviation [rad] of a pole from the normal."""
TRIES, DRAWS = 3000, 40
"""Places that are drawn, and poles for each of them, at most."""
FELT = 0.012
"""Distance [m] from a taxel, at most, at which the skin meets a pole: rims of patches have none."""
FACED = 0.5
"""Least cosine of the angle between a taxel's normal and the direction in which skin comes near a pole."""
NEAR = 0.004
"""Distance [m] below which a pole is met."""

_SKIN, _WORN, _BARE, _REST = range(4)
_collisions = lru_cache(maxsize=8)(SelfCollision)
Pole = tuple[Array, Array]
"""Middle (3,) [m] and direction (3,), in the torso frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """The way on which all joints go evenly from the posture at the start to that at the place, as s
    postures."""

    taxels: Array
    """Taxels (s, t, 3) [m] that the part moves, in the torso frame."""
    normals: Array
    """Of these taxels (s, t, 3)."""
    geoms: NDArray[np.intp]
    """Solids (g,) of the robot, in MuJoCo's numbers."""
    kinds: NDArray[np.intp]
    """Of these solids (g,): skin of the part, a link that wears it, a link without skin, or the rest."""
    places: Array
    """Of these solids (s, g, 3) [m], in the world frame."""
    turns: Array
    """Of these solids (s, g, 9), in the world frame."""


def field(scene: Scene) -> Array:
    """Draws a place (3,) for the hand, in the unit of Cartesian commands, and poles on the way there."""
    position = scene.world.joints().position
    reach, own = scene.body.reach(scene.part), joint_map(scene.robot, scene.part)
    start = reach.place(position)
    for pole in POLES:
        scene.world.obstacle(pole.name).remove()
    for _ in range(TRIES):
        goal = reach.place(_drawn(scene, position))
        if np.linalg.norm(goal - start) < FAR:
            continue
        there = np.array(position)
        there[own.servos] = own.to_robot(own.to_generic(reach.solve(goal, position)[0]), position)
        if np.linalg.norm(reach.place(there) - goal) > EXACT:
            continue
        postures = position + SHARES[:, None] * (there - position)
        if _collisions(scene.robot).fault(postures) is not None:
            continue
        found = _poles(scene, way(scene, postures))
        if len(found) >= FEWEST:
            for pole, (at, along) in zip(POLES, found, strict=False):
                scene.world.obstacle(pole.name).place(at, along)
            return goal
    raise TciError(f"reach: no room for poles on the way of {scene.part} of {scene.robot.name}")


def _drawn(scene: Scene, position: Array) -> Array:
    """A posture (n_servos,) [rad] of the part, within limits."""
    there, servos = np.array(position), joint_map(scene.robot, scene.part).servos
    drawn = scene.chance.uniform(-SPREAD, SPREAD, len(servos))
    for servo, angle in zip(servos.tolist(), drawn.tolist(), strict=True):
        limits = scene.robot.servos[servo].limits
        low = -np.inf if limits.lower is None else limits.lower + 0.05
        high = np.inf if limits.upper is None else limits.upper - 0.05
        there[servo] = np.clip(there[servo] + angle, low, high)
    return there


def way(scene: Scene, postures: Array) -> Way:
    """The way along these postures (s, n_servos) [rad]."""
    body, world, chain = scene.body, scene.world, scene.body.skin.kinematics
    patches = [one for one in scene.robot.patches if one.name in body.carried(scene.part)]
    surfaces = [body.skin.surfaces[one.name] for one in patches]
    poses = [chain.poses(one, list({patch.link for patch in patches})) for one in postures]
    geoms, kinds = _solids(scene, {one.name for one in patches}, {one.link for one in patches})
    placed = []
    for posture in postures:
        world.show(posture)
        mujoco.mj_kinematics(world.model, world.data)
        placed.append((world.data.geom_xpos[geoms], world.data.geom_xmat[geoms]))
    world.show(postures[0])
    worn = list(zip(patches, surfaces, strict=True))
    return Way(
        np.array([np.vstack([apply(T[o.link], s.positions) for o, s in worn]) for T in poses]),
        np.array([np.vstack([s.normals @ T[o.link][:3, :3].T for o, s in worn]) for T in poses]),
        geoms,
        kinds,
        np.array([at for at, _ in placed]),
        np.array([turned for _, turned in placed]),
    )


def _solids(scene: Scene, skin: set[str], worn: set[str]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers (g,) and kinds (g,) of all solids that can meet a pole."""
    model, chain = scene.world.model, scene.body.skin.kinematics
    own = set(joint_map(scene.robot, scene.part).servos.tolist())
    moved = {link for link in chain.links if own & {*chain.chain(link)}}
    geoms, kinds = list[int](), list[int]()
    for geom in range(model.ngeom):
        name, link = model.geom(geom).name, model.body(int(model.geom_bodyid[geom])).name
        patch = name.removeprefix("tci_skin_")
        if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue
        if name.startswith("tci_") and patch == name:
            continue  # poles, finger, floor
        kind = _WORN if link in worn else _BARE if link in moved else _REST
        if patch != name:
            kind = _SKIN if patch in skin else _REST
        geoms.append(geom)
        kinds.append(kind)
    return np.array(geoms), np.array(kinds)


def _poles(scene: Scene, way: Way) -> list[Pole]:
    """Poles that the skin meets first, one after the other."""
    chance, found, spans = scene.chance, list[Pole](), list[NDArray[np.bool_]]()
    motion = way.taxels[2:] - way.taxels[:-2]
    head_on = np.abs(np.einsum("stk,stk->st", motion, way.normals[1:-1]))
    across = head_on < SIDE * np.linalg.norm(motion, axis=2)
    beside = np.argwhere(np.pad(across, ((1, 1), (0, 0))))
    ends = np.concatenate([way.taxels[0], way.taxels[-1]])
    if not len(beside):
        return found
    for _ in range(DRAWS):
        now, taxel = chance.choice(beside)
        along = way.normals[now, taxel] + chance.normal(0.0, TILT, 3)
        along /= np.linalg.norm(along)
        at = way.taxels[now, taxel] + along * (HALF + RADIUS - chance.uniform(LEAST, MOST))
        close = any(_between((at, along), one) < APART for one in found)
        if close or _apart(ends, at, along) < RADIUS + CLEAR:
            continue
        span = met_by(scene, way, (at, along))
        around = span | np.roll(span, 1) | np.roll(span, -1)
        if span.any() and not any((around & other).any() for other in spans):
            found.append((at, along))
            spans.append(span)
        if len(found) == len(POLES):
            break
    return found


def met_by(scene: Scene, way: Way, pole: Pole) -> NDArray[np.bool_]:
    """In which postures (s,) the skin meets the pole; in none if the pole is not one of this field."""
    model, data, torso = scene.world.model, mujoco.MjData(scene.world.model), scene.world.torso
    stick, quat = model.geom(PREFIX + POLES[0].name).id, np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, np.ascontiguousarray(torso[:3, :3] @ pole[1]))
    mujoco.mju_quat2Mat(data.geom_xmat[stick], quat)
    at = data.geom_xpos[stick] = apply(torso, pole[0])
    reach = model.geom_rbound[way.geoms] + model.geom_rbound[stick] + BARE
    away = np.full((len(way.places), len(way.geoms)), np.inf)
    span, ends = np.zeros(len(away), bool), np.zeros((len(way.geoms), 6))
    for now, (places, turns) in enumerate(zip(way.places, way.turns, strict=True)):
        data.geom_xpos[way.geoms], data.geom_xmat[way.geoms] = places, turns
        for one in np.flatnonzero(np.linalg.norm(places - at, axis=1) < reach):
            away[now, one] = mujoco.mj_geomDistance(model, data, int(way.geoms[one]), stick, BARE, ends[one])
        skin, worn, bare, rest = (away[now, way.kinds == kind].min(initial=np.inf) for kind in range(4))
        at_an_end = now in (0, len(away) - 1) and min(skin, worn) < CLEAR
        link_first = not span.any() and worn < min(skin, NEAR)
        if at_an_end or link_first or bare < BARE or rest < CLEAR or skin < -MOST:
            return np.zeros_like(span)
        span[now] = skin < NEAR
        if skin < BARE and not _felt(way, now, torso, ends, away[now]):
            return np.zeros_like(span)
    return span if away[:, way.kinds == _SKIN].min(initial=np.inf) <= -LEAST else np.zeros_like(span)


def _felt(way: Way, now: int, torso: Array, ends: Array, away: Array) -> bool:
    """Whether taxels measure what presses the skin where it is nearest to a pole: none measures what presses
    the rim of a sleeve along the arm.

    `away` (g,) [m] are the distances of all solids, `ends` (g, 6) [m] their nearest points and those of the
    pole, in the world frame.
    """
    one = np.where(way.kinds == _SKIN, away, np.inf).argmin()
    met, other = apply(invert(torso), ends[one].reshape(2, 3))
    outward = (other - met) * np.sign(away[one])
    distance = np.linalg.norm(way.taxels[now] - met, axis=1)
    near = distance.argmin()
    cosine = outward @ way.normals[now, near] / max(float(np.linalg.norm(outward)), 1e-9)
    return bool(distance[near] < FELT and cosine > FACED)


def _apart(points: Array, at: Array, along: Array) -> float:
    """Distance [m] of the axis of a pole from points (k, 3)."""
    away = points - at
    away -= np.outer(np.clip(away @ along, -HALF, HALF), along)
    return float(np.linalg.norm(away, axis=1).min(initial=np.inf))


def _between(one: Pole, other: Pole) -> float:
    """Distance [m] between the axes of two poles, to a centimetre."""
    points = one[0] + np.linspace(-HALF, HALF, 21)[:, None] * one[1]
    return _apart(points, *other)
