"""Makes the films and portraits of the README and of the gallery (docs/gallery.md). `tools/pictures.py` calls
these functions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageSequence

import tci
from tci.body.places import find_place
from tci.capabilities import FingerReflex, default_fields
from tci.drivers.simulated import SimulatedDriver
from tci.lab.pictures.camera import fit, look_at
from tci.lab.pictures.film import EVERY, LAST, SHOWN, Film
from tci.lab.pictures.paint import FULL_SCALE, field_looks
from tci.lab.pictures.portrait import Portrait, keep_moment
from tci.robot.generic_fingers import FLEXIONS
from tci.simulation.world import World
from tci.skin.skin import Skin

ROBOTS = ("nao", "nao-plain", "nao-whole", "icub", "icub-whole", "g1", "g1-inspire", "talos", "alex",
          "franka", "franka-hand", "ur5", "so101", "allegro")  # fmt: skip
GRASPS = {
    "nao-hands": (0.012, (60.0, 20.0, 20.0)),
    "icub-hands": (0.018, (60.0, 70.0, 70.0)),
    "g1-hands": (0.025, (90.0, 12.0, 58.0)),
}
"""For each robot: radius [m] of a ball that fits the hand, and the initial hand posture: thumb opposition,
thumb flexion and finger flexion [degrees]."""
SCALE = 0.8
"""Factor by which the films are smaller than those of `tci run --film`."""
FACE = "head_skin"
KINDS = ("stroke", "pat", "squeeze", "poke", "rub")
Touch = Callable[[Any, tci.Robot], None]


def touch_forearm(driver: Any, robot: tci.Robot, **motion: float) -> None:
    """Pokes the centre of the first receptive field of the left forearm. This is the same place on every
    robot."""
    site = default_fields()[0]
    place = find_place(Skin(robot), "left_arm", site.segment, site.u, site.theta, driver.read().joints)
    driver.world.finger.poke(place.patch, place.p_L, place.n_L, gap=0.02, **motion)


def push_forearm(driver: Any, robot: tci.Robot) -> None:
    """Pushes the forearm slowly and over a long distance, like a human hand."""
    touch_forearm(driver, robot, speed=0.06, depth=0.03)


def touch_face(driver: Any, robot: tci.Robot) -> None:
    """Pokes the middle one of the head's taxels that face forward."""
    skin, joints = Skin(robot), driver.read().joints
    places = skin.positions(FACE, joints, frame="torso")
    forward = np.flatnonzero(skin.normals(FACE, joints, frame="torso")[:, 0] > 0.7)
    away = np.abs(places - places.mean(axis=0))[:, 1:].sum(axis=1)
    driver.world.finger.poke(FACE, int(forward[away[forward].argmin()]), gap=0.02)


def film(
    folder: Path, name: str, capability: Any, touch: Touch, *, duration: float, release: float = np.inf
) -> list[Image.Image]:
    """Returns the pictures of a run in which `touch` disturbs the robot. The finger is retracted at `release`
    [s]."""
    robot = tci.load_robot(name)
    fields = getattr(capability, "fields", ()) if isinstance(capability, tci.WithdrawalReflex) else ()
    path = folder / f"{name}-{type(capability).__name__}.gif"
    with tci.connect(robot, "sim") as driver:
        touch(driver, robot)
        shown = Film(driver.world, path, fields=fields, part="left_arm")

        def watch(tick: tci.Tick) -> None:
            shown.see(tick)
            if tick.now > release:
                driver.world.finger.retire()

        tci.run(driver, capability, duration=duration, observe=watch)
        shown.save()
    with Image.open(path) as pictures:
        return [picture.convert("RGB") for picture in ImageSequence.Iterator(pictures)]


def side_by_side(films: list[list[Image.Image]]) -> list[Image.Image]:
    """Joins films side by side into one film. A shorter film repeats its last picture."""
    joined = []
    for index in range(max(map(len, films))):
        pictures = [one[min(index, len(one) - 1)] for one in films]
        wide = Image.new("RGB", (sum(p.width for p in pictures), pictures[0].height))
        for number, picture in enumerate(pictures):
            wide.paste(picture, (sum(p.width for p in pictures[:number]), 0))
        joined.append(wide)
    return joined


def save(pictures: list[Image.Image], path: Path, *, scale: float = SCALE, every: int = 1) -> None:
    """Writes an animated GIF with one palette. The GIF has the speed of `tci run --film`, also with one of
    `every` pictures."""
    small = [p.resize((round(scale * p.width), round(scale * p.height))) for p in pictures]
    palette = small[len(small) // 2].quantize(128)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in small]
    times = [round(1e3 * every * SHOWN)] * (len(frames) - 1) + [round(1e3 * LAST)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)


def pokes(folder: Path, images: Path) -> None:
    """Film of the README: two robots with the withdrawal reflex are poked at the same place."""
    reflex = tci.WithdrawalReflex()
    both = [film(folder, name, reflex, touch_forearm, duration=0.7) for name in ("nao", "icub")]
    save(side_by_side(both), images / "pokes.gif")


class Still(tci.Capability[None]):
    """Moves nothing."""

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(self, memory: None, perception: tci.Perception, body: tci.GenericBody) -> tuple[tuple[()], None]:
        return (), None


def kinds(folder: Path, images: Path) -> None:
    """Five kinds of touch on a NAO that holds still, each with the hand that does it. One of two pictures."""
    shown = []
    for kind in KINDS:
        path = folder / f"{kind}.gif"
        with tci.connect("nao", "sim", people=1) as driver:
            driver.world.touch(f"{kind} 'left forearm'")
            made, due = Film(driver.world, path, fields=(), part="left_arm"), [0.2]

            def watch(tick: tci.Tick, made: Film = made, due: list[float] = due) -> None:
                if tick.now >= due[0]:
                    due[0] = tick.now + 2.0 * EVERY
                    made.see(tick)

            tci.run(driver, Still(), duration=1.2, observe=watch)
            made.save()
        with Image.open(path) as pictures:
            shown.append([picture.convert("RGB") for picture in ImageSequence.Iterator(pictures)])
    save(side_by_side(shown), images / "kinds.gif", scale=0.5, every=2)


def attend(folder: Path, images: Path) -> None:
    """Film of two robots that withdraw from a poke and then look at it, one of them without a neck."""
    both = tci.Arbiter([tci.WithdrawalReflex(), tci.Attend()])
    films = [film(folder, name, both, touch_forearm, duration=1.0) for name in ("nao", "g1")]
    save(side_by_side(films), images / "attend.gif", scale=0.6, every=2)


def soft(folder: Path, images: Path) -> None:
    """Film of the soft reaction: the arm yields to a push."""
    save(
        film(folder, "nao", tci.SoftReaction(), push_forearm, duration=1.0),
        images / "soft-reaction.gif",
    )


def body(folder: Path, images: Path) -> None:
    """Film of a nod: the head nods after a touch of the face."""
    save(
        film(folder, "icub-whole", tci.BodyWithdrawal(stance="supported"), touch_face, duration=0.7),
        images / "body-withdrawal.gif",
    )


def hands(_: Path, images: Path) -> None:
    """Film of the light grasp: each robot with fingers holds a ball in its left hand with 1 N."""
    shown = []
    for name, (radius, angles) in GRASPS.items():
        robot = tci.load_robot(name)
        posture = np.array(robot.part("left_fingers").initial_posture)
        posture[[0, *FLEXIONS]] = np.deg2rad([*angles[:2], *[angles[2]] * 4])
        skin = [patch.name for patch in robot.patches if patch.part == "left_fingers"]
        world = World(robot, skin=skin, tip=radius, posture={"left_fingers": posture})
        world.finger.poke(
            "left_palm", len(world.surfaces["left_palm"].positions) // 2, depth=0.004, speed=0.1
        )
        driver = SimulatedDriver(robot, world=world)
        tci.run(driver, tci.LightGrasp(), duration=1.5)
        moment = keep_moment(world, driver.read())
        portrait = Portrait(world, (), full_scale=FULL_SCALE)
        links = [segment.link for segment in robot.part("left_fingers").segments]
        torso = portrait.torso(moment)
        middle = np.mean([moment.data.body(link).xpos for link in links], axis=0)
        camera = look_at(
            (np.linalg.inv(torso) @ [*middle, 1.0])[:3], azimuth=-0.9, elevation=0.35,
            distance=12 * radius + 0.15, width=300, height=300, frame=torso,
        )  # fmt: skip
        shown.append(Image.fromarray(portrait.draw(moment, camera)))
    side_by_side([[picture] for picture in shown])[0].quantize(128).save(
        images / "light-grasp.png", optimize=True
    )


def fingers(_: Path, images: Path) -> None:
    """The finger reflex of a G1 with Inspire hands: the hand hangs, a finger presses its ring finger, it lets
    go."""
    robot, reflex = tci.load_robot("g1-inspire"), FingerReflex()
    body = tci.GenericBody(robot)
    world = World(robot, posture={"left_fingers": reflex.relaxed("left_fingers", body)})
    portrait, moments = Portrait(world, (), full_scale=FULL_SCALE), []
    world.finger.poke("left_ring_top", 44, depth=0.01, speed=0.25, gap=0.02)
    driver = SimulatedDriver(robot, world=world)
    for duration in (0.01, 0.085, 0.6):
        tci.run(driver, reflex, duration=duration)
        moments.append(keep_moment(world, driver.read()))
    links = [segment.link for segment in robot.part("left_fingers").segments]
    middle = np.mean([moments[0].data.body(link).xpos for link in links], axis=0)
    torso = portrait.torso(moments[0])
    camera = look_at(
        (np.linalg.inv(torso) @ [*middle, 1.0])[:3], azimuth=-1.0, elevation=-0.35, distance=0.42, width=300,
        height=300, frame=torso,
    )  # fmt: skip
    shown = [Image.fromarray(portrait.draw(moment, camera)) for moment in moments]
    side_by_side([[picture] for picture in shown])[0].quantize(128).save(
        images / "finger-reflex.png", optimize=True
    )


def robots(_: Path, images: Path) -> None:
    """Portrait of each robot at the start of its simulation, with its receptive fields."""
    looks = field_looks(default_fields())
    for name in ROBOTS:
        with tci.connect(tci.load_robot(name), "sim") as driver:
            world = driver.world
            moment = keep_moment(world, driver.read())
            portrait = Portrait(world, looks, full_scale=FULL_SCALE)
            parts = world.robot.parts
            arms = [part.name for part in parts if part.kind == "arm"] or [parts[0].name]
            sides = [portrait.outline(moment, part=arm, lowest=-np.inf) for arm in arms]
            camera = fit(
                np.concatenate(sides), azimuth=0.5, elevation=0.15, width=300, height=420, margin=0.05,
                frame=portrait.torso(moment),
            )  # fmt: skip
            picture = Image.fromarray(portrait.draw(moment, camera))
            picture.quantize(128).save(images / f"robot-{name}.png", optimize=True)
