"""What the demo draws: two pokes of each robot's left forearm, when it hurts most and at the end."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from tci.capabilities.fields import ReceptiveField
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.frames import Array, apply, invert
from tci.interface.part import generic_posture
from tci.interface.skin import Skin
from tci.messages import Reading
from tci.model.description import Robot
from tci.model.generic_arm import SEGMENTS
from tci.runtime.loop import Tick
from tci.simulation.camera import Camera, look_at
from tci.simulation.paint import FieldLook, FieldPaint, TaxelPaint
from tci.simulation.render import render
from tci.simulation.world import World
from tci.trials.figure import Panel, draw_figure
from tci.trials.poke import Stimulus, Trace, poke

# All looks are ours.
PART = "left_arm"
VIEWS = {"forearm_extensor": (0.95, -0.10), "forearm_medial": (-0.30, 0.42)}
"""Sites that are poked, as in the paper's Figure 6 (below, and inside), and from where [rad] we look."""
COLOURS = ((0.20, 0.63, 0.88), (0.45, 0.80, 0.35), (0.98, 0.75, 0.20), (0.86, 0.47, 0.85), (0.95, 0.45, 0.30))
FULL_SCALE = 60e3
"""Pressure [Pa] at the end of the colour bar."""
WIDTH, HEIGHT = 440, 480


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The world at one instant."""

    time: float
    """[s]"""
    reading: Reading
    """What the robot sent."""
    data: mujoco.MjData
    """A copy of the physics."""


def draw_demo(robots: Sequence[Robot], fields: Sequence[ReceptiveField], path: Path, *, seed: int) -> None:
    """Write the figure: a row for each robot, before and after each of two pokes."""
    looks = {
        field.name: FieldLook(field.u, field.theta, field.radius, COLOURS[index % len(COLOURS)])
        for index, field in enumerate(fields)
    }
    panels = [
        panel
        for robot in robots
        for panel in _row(robot, [field for field in fields if field.name in VIEWS], fields, looks, seed)
    ]
    draw_figure(
        panels,
        path,
        fields=[(name.replace("_", " "), look) for name, look in looks.items()],
        full_scale=FULL_SCALE,
        caption="The same reflex, from the same source, on each robot. Left of a pair: the largest force "
        "that the skin felt. Right: withdrawn.\nReceptive fields and base motions are ours.",
    )


def _row(
    robot: Robot,
    sites: Sequence[ReceptiveField],
    fields: Sequence[ReceptiveField],
    looks: dict[str, FieldLook],
    seed: int,
) -> list[Panel]:
    world, skin = World(robot, seed=seed), Skin(robot)
    panels = []
    for site in sites:
        worst, last, trace = _moments(world, site, seed)
        camera = _camera(world, skin, worst, *VIEWS[site.name])
        start = trace.first_contact or 0.0
        for moment in (worst, last):
            force = trace.force[trace.time.index(moment.time)]
            moved = (trace.point[0] - trace.point[trace.time.index(moment.time)]) @ trace.normal
            panels.append(
                Panel(
                    image=_picture(world, skin, moment, camera, fields, looks),
                    title=f"{robot.name}: {site.name.replace('_', ', ')} side",
                    detail=f"{1e3 * (moment.time - start):.0f} ms: {force:.1f} N, "
                    f"withdrawn {1e3 * moved:.0f} mm",
                )
            )
    return panels


def _moments(world: World, site: ReceptiveField, seed: int) -> tuple[Moment, Moment, Trace]:
    """The moment of the largest force that the skin reported, the last one, and the whole poke."""
    strongest = 0.0
    moments: list[Moment] = []

    def watch(tick: Tick) -> None:
        nonlocal strongest
        force = max((contact.force for contact in tick.perception.contacts), default=0.0)
        if force > strongest or tick.now + world.model.opt.timestep * 3 > stimulus.duration:
            strongest = max(force, strongest)
            world.refresh()
            moments.append(Moment(tick.now, tick.reading, copy.copy(world.data)))

    stimulus = Stimulus()
    trace = poke(world, PART, site, stimulus, reflex=WithdrawalReflex(), seed=seed, watch=watch)
    return moments[-2], moments[-1], trace


def _torso(world: World, moment: Moment) -> Array:
    """`T_WT` (4, 4) of the torso at that moment."""
    assert world.robot.model is not None
    body = moment.data.body(world.robot.model.torso_link)
    T_WL = np.eye(4)
    T_WL[:3, :3], T_WL[:3, 3] = body.xmat.reshape(3, 3), body.xpos
    T_WT: Array = T_WL @ world.robot.model.T_LT
    return T_WT


def _camera(world: World, skin: Skin, moment: Moment, azimuth: float, elevation: float) -> Camera:
    """Upper body and arm: the distance follows from the arm's length."""
    part = world.robot.part(PART)
    posture = generic_posture(world.robot, moment.reading.joints)[PART]
    elbow = skin.segment_pose(PART, "forearm", moment.reading.joints, posture)[:3, 3]
    reach = sum(segment.length for segment in part.segments)
    return look_at(
        elbow + np.array([0.15, -0.15, 0.25]) * reach,
        azimuth=azimuth,
        elevation=elevation,
        distance=4.2 * reach,
        fov=0.42,
        width=WIDTH,
        height=HEIGHT,
        frame=_torso(world, moment),
    )


def _picture(
    world: World,
    skin: Skin,
    moment: Moment,
    camera: Camera,
    fields: Sequence[ReceptiveField],
    looks: dict[str, FieldLook],
) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    robot, joints = world.robot, moment.reading.joints
    T_WT = _torso(world, moment)
    posture = generic_posture(robot, joints)
    state = Skin(robot).update(moment.reading)
    positions = {p.name: apply(T_WT, skin.positions(p.name, joints, frame="torso")) for p in robot.patches}
    normals = {p.name: skin.normals(p.name, joints, frame="torso") @ T_WT[:3, :3].T for p in robot.patches}
    paint: list[FieldPaint | TaxelPaint] = []
    for part in robot.parts:
        for segment in SEGMENTS:
            mine = [positions[p.name] for p in robot.patches if (p.part, p.segment) == (part.name, segment)]
            if mine and part.side is not None:
                T_TS = skin.segment_pose(part.name, segment, joints, posture[part.name])
                there = [looks[field.name] for field in fields if field.segment == segment]
                length = part.segment(segment).length
                paint.append(FieldPaint(np.concatenate(mine), invert(T_WT @ T_TS), length, part.side, there))
    pressure = np.concatenate([state.patches[name].pressure for name in positions])
    paint.append(
        TaxelPaint(
            np.concatenate(list(positions.values())),
            np.concatenate(list(normals.values())),
            pressure,
            full_scale=FULL_SCALE,
        )
    )
    return render(world.model, moment.data, camera, paint=paint)
