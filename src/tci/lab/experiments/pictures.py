"""Draws the figure of the demo: two pokes of each robot's left forearm, or of the skin that it has.

Each poke is shown at the instant of the largest force and at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.body.touchable import Touchable, touchable
from tci.capabilities.capability import Capability
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.figure import Panel, draw_figure
from tci.lab.experiments.poke import Stimulus, Trace, poke_place
from tci.lab.experiments.trial_places import posture_of, trial_places
from tci.lab.pictures.camera import Camera, fit, look_at, project
from tci.lab.pictures.paint import FULL_SCALE, FieldLook, field_looks
from tci.lab.pictures.portrait import Moment, Portrait, keep_moment, lowest_shown
from tci.messages.frames import Array, apply
from tci.robot.description import Robot
from tci.runtime.loop import Tick
from tci.simulation.poke_first import poke_first
from tci.simulation.world import World
from tci.skin.skin import Skin

# Views, sizes and the caption are assumed. They change only the figure.
PART = "left_arm"
VIEWS = {"forearm_extensor": (0.95, 0.0), "forearm_medial": (-0.30, 0.30)}
"""Poked sites with the view of each: azimuth and elevation [rad] of the camera. The sites and views are those
of Figure 6 in the paper: the forearm is poked from below, and from the side that faces the body."""
VIEW = (0.5, 0.3)
"""View of every other place."""
NEAR = {"speed": 1.0, "depth": 0.0}
"""A poke that only tries whether the finger has room."""
WIDTH, HEIGHT = 440, 480
CLOSE_UP = 170
"""Size of a close-up [pixels]."""
TILT = np.deg2rad(55.0)
"""Angle [rad] between the camera's direction in a close-up and the skin's normal. With this angle the finger
does not hide the skin."""


def draw_demo(robots: Sequence[Robot], reflex: WithdrawalReflex, path: Path, *, seed: int) -> bool:
    """Writes the figure with one row for each robot that has skin; False if none has.

    Each row shows two pokes, and each poke at the instant of the largest force and at the end.
    """
    looks = field_looks(reflex.fields)
    panels = [panel for robot in robots for panel in _row(robot, reflex, looks, seed)]
    if not panels:
        return False
    names = [field.name.replace("_", " ") for field in reflex.fields]
    draw_figure(
        panels,
        path,
        fields=list(zip(names, looks, strict=True)),
        full_scale=FULL_SCALE,
        caption="The same reflex, with the same code, on each robot. Left of each pair: the moment of the "
        "largest force. Right: the end.\nReceptive fields and base motions: not published; our choice.",
    )
    return True


def _row(
    robot: Robot,
    reflex: WithdrawalReflex,
    looks: Sequence[FieldLook],
    seed: int,
) -> list[Panel]:
    world = World(robot, seed=seed, posture=posture_of(robot))
    portrait = Portrait(world, looks, full_scale=FULL_SCALE)
    name = (robot.title or robot.name).split()[0]
    panels = []
    for one, answer in _shown(world, reflex, seed):
        site = one.place.patch if one.site is None else reflex.fields[one.site].name
        worst, last, trace = _moments(world, answer, one, seed)
        camera = _camera(portrait, (worst, last), robot, one.part, *VIEWS.get(site, VIEW))
        start, end = _spot(portrait, camera, worst, trace), _spot(portrait, camera, last, trace)
        for moment in (worst, last):
            index = trace.time.index(moment.time)
            moved = 1e3 * (trace.point[0] - trace.point[index]) @ trace.normal
            after = 1e3 * (moment.time - (trace.first_contact or 0.0))
            force = f"{trace.force[index]:.1f} N" if trace.force[index] > 0.0 else "no contact"
            panels.append(
                Panel(
                    image=portrait.draw(moment, camera),
                    title=f"{name}: {site.replace('_', ', ')}{' side' if one.site is not None else ''}",
                    detail=f"{after:.0f} ms: {force}, withdrawn {moved:.0f} mm",
                    spot=start if moment is worst else None,
                    close_up=_close_up(portrait, worst, trace, camera) if moment is worst else None,
                    arrow=(start, end) if moment is last else None,
                )
            )
    return panels


def _shown(world: World, reflex: WithdrawalReflex, seed: int) -> list[tuple[Touchable, Capability[Any]]]:
    """Two places, and what answers there: those of the paper's Figure 6, else the first two patches that the
    trials poke; one place twice, none without skin."""
    world.reset()
    names = [field.name for field in reflex.fields]
    sites = [field.place for field in reflex.fields]
    places = touchable(Skin(world.robot), world.joints(), sites, parts=("arm",))
    found = [one for one in places if one.part == PART and one.site is not None and names[one.site] in VIEWS]
    best = [one for one in found if poke_first(world, [one], **NEAR)]
    if best:
        return [(one, reflex) for one in best[:2]]
    tried = {one.place.patch: one for one in trial_places(world, reflex, seed=seed)}
    others = [(Touchable(one.part, one.place), one.answer.capability) for one in tried.values()]
    return (others * 2)[:2]


def _moments(
    world: World, capability: Capability[Any], one: Touchable, seed: int
) -> tuple[Moment, Moment, Trace]:
    """Pokes a place, and returns the moment at which the skin measured the largest force, the last
    moment, and the trace of the poke."""
    strongest = 0.0
    moments: list[Moment] = []

    def watch(tick: Tick) -> None:
        nonlocal strongest
        force = max((contact.force for contact in tick.perception.contacts), default=0.0)
        if force > strongest or tick.now + world.model.opt.timestep * 3 > stimulus.duration:
            strongest = max(force, strongest)
            moments.append(keep_moment(world, tick.reading))

    stimulus = Stimulus()
    trace = poke_place(world, one.place, stimulus, reflex=capability, seed=seed, watch=watch)
    # If the skin measured no force, both instants are the last one.
    return moments[-2:][0], moments[-1], trace


def _camera(
    portrait: Portrait,
    moments: Sequence[Moment],
    robot: Robot,
    part: str,
    azimuth: float,
    elevation: float,
) -> Camera:
    """Returns a camera whose picture contains the upper body and the poked part at all instants `moments`."""
    lowest = lowest_shown(robot, part, 0.5)
    points = np.concatenate([portrait.outline(moment, part=part, lowest=lowest) for moment in moments])
    return fit(
        points,
        azimuth=azimuth,
        elevation=elevation,
        width=WIDTH,
        height=HEIGHT,
        frame=portrait.torso(moments[0]),
    )


def _spot(portrait: Portrait, camera: Camera, moment: Moment, trace: Trace) -> tuple[float, float]:
    """Returns the pixel (x, y) at which `camera` shows the poked point of the skin."""
    point_T = trace.point[trace.time.index(moment.time)]
    pixels, _ = project(camera, apply(portrait.torso(moment), point_T[None]))
    return float(pixels[0, 0]), float(pixels[0, 1])


def _close_up(portrait: Portrait, moment: Moment, trace: Trace, camera: Camera) -> NDArray[np.uint8]:
    """Draws the poked point from a short distance, obliquely, from the side on which the `camera` of the
    panel is."""
    T_WT = portrait.torso(moment)
    towards: Array = -T_WT[:3, :3].T @ camera.T_WC[:3, 2]
    aside = towards - (towards @ trace.normal) * trace.normal
    outward = np.cos(TILT) * trace.normal + np.sin(TILT) * aside / np.linalg.norm(aside)
    view = look_at(
        trace.point[trace.time.index(moment.time)],
        azimuth=float(np.arctan2(outward[1], outward[0])),
        elevation=float(np.arcsin(outward[2])),
        distance=0.2,
        fov=0.32,
        width=CLOSE_UP,
        height=CLOSE_UP,
        frame=T_WT,
    )
    return portrait.draw(moment, view)
