"""Pictures of one touch on a three-axis sleeve: pressure image, shape, shear, and events."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.body.tactile import FRICTION, contact_shape, pressure_image, shear_force, touch_events
from tci.lab.pictures.pressure_png import pressure_pixels
from tci.messages import Reading
from tci.simulation.world import World

PATCH, TAXEL = "left_forearm", 130
PRESS, PULL, RELEASE, END = 0.2, 0.5, 0.9, 1.1
"""Times [s] at which the finger has arrived, the arm begins to move under the finger, the finger is
retracted, and the run ends."""
SHOWN = 0.7
"""Time [s] of the pressure image."""
SHOULDER = "LShoulderPitch"
STEP = 0.01


def three_axes() -> tci.Robot:
    """Returns a NAO with one skin sleeve, whose taxels measure three axes with 16 bits."""
    nao = tci.load_robot("nao")
    patch = nao.patch(PATCH)
    sensor = patch.sensor.model_copy(
        update={"axes": 3, "rest": 30000.0, "lowest": 0.0, "highest": 65535.0, "pascal_per_count": 4.0}
    )
    skin = patch.model_copy(update={"sensor": sensor, "channels": 3 * patch.channels})
    return nao.model_copy(update={"patches": (skin,)})


def draw(folder: Path) -> None:
    """Writes four pictures: pressure image, shape, shear, and events."""
    robot = three_axes()
    world, body = World(robot), GenericBody(robot)
    perceiver = Perceiver(body)
    perceiver.step(Reading(world.joints(), world.frames()), world.time)
    world.finger.poke(PATCH, TAXEL, speed=0.1, depth=0.006)
    servo = [one.name for one in robot.servos].index(SHOULDER)
    start = world.joints().position[servo]
    before, shown, rows, events = None, None, [], []
    for period in range(1, round(END / STEP)):
        now = period * STEP
        if now >= PULL:
            by = 0.12 * min((now - PULL) / (RELEASE - PULL), 1.0)
            world.set_position_targets([servo], [start + by])
        if abs(now - RELEASE) < STEP / 2:
            world.finger.retire()
        world.advance(now)
        seen = perceiver.step(Reading(world.joints(), world.frames()), world.time)
        events += touch_events(before, seen, body)
        before = seen
        shears = [shear_force(contact, body) for contact in seen.contacts[:1]]
        rows.append((now, *((s.normal, np.linalg.norm(s.tangential)) if s else (0.0, 0.0) for s in shears)))
        if abs(now - SHOWN) < STEP / 2:
            shown = seen
    assert shown is not None
    assert shown.contacts
    felt = np.array([row[1] if len(row) > 1 else (0.0, 0.0) for row in rows])
    times = np.array([row[0] for row in rows])
    _draw_image(folder / "tactile-image.png", body, shown)
    _draw_shape(folder / "tactile-shape.png", body, shown)
    _draw_shear(folder / "tactile-shear.png", times, felt)
    _draw_events(folder / "tactile-events.png", times, felt, events)


def _axes(width: float, height: float):
    return plt.subplots(figsize=(width, height), layout="constrained")


def _show(axes, body, seen):
    """Draws the pressure image of the sleeve, and returns it."""
    image = pressure_image(seen, body, PATCH, pixel=0.001)
    height, width = image.pressure.shape
    x, y = (1e3 * edge for edge in image.corner)
    extent = (x, x + width * 1e3 * image.pixel, y, y + height * 1e3 * image.pixel)
    axes.imshow(pressure_pixels(image), extent=extent)
    axes.set(xlabel="around the forearm [mm]", ylabel="from the wrist [mm]")
    return image


def _draw_image(path, body, seen) -> None:
    figure, axes = _axes(6.5, 2.9)
    _show(axes, body, seen)
    axes.set_title("pressure on the unrolled sleeve", fontsize=10)
    figure.savefig(path, dpi=110)


def _draw_shape(path, body, seen) -> None:
    figure, axes = _axes(4.2, 3.4)
    image = _show(axes, body, seen)
    contact = seen.contacts[0]
    shape = contact_shape(contact, body)
    centre = 1e3 * contact.taxel_forces @ image.places[contact.taxels] / contact.taxel_forces.sum()
    flat = _in_image(body, image, contact, shape.directions)
    angle = np.degrees(np.arctan2(*flat[0][::-1]))
    axes.add_patch(Ellipse(centre, *(2e3 * shape.axes), angle=angle, fill=False, color="white"))
    for half, direction in zip(1e3 * shape.axes, flat, strict=True):
        axes.plot(*zip(centre, centre + half * direction, strict=True), color="white")
        beyond = centre + 1.6 * half * direction
        axes.annotate(f"{half:.0f} mm", beyond, color="white", ha="center", fontsize=8)
    reach = 2e3 * shape.axes.max()
    axes.set(xlim=(centre[0] - reach, centre[0] + reach), ylim=(centre[1] - reach, centre[1] + reach))
    axes.set_title(f"{contact.force:.1f} N on {1e6 * shape.area:.0f} mm$^2$", fontsize=10)
    figure.savefig(path, dpi=110)


def _draw_shear(path, times, felt) -> None:
    figure, axes = _axes(6.5, 2.9)
    axes.plot(times, felt[:, 0], label="pressing force")
    axes.plot(times, felt[:, 1], label="shear force")
    axes.set(xlabel="time [s]", ylabel="force [N]")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def _draw_events(path, times, felt, events) -> None:
    figure, axes = _axes(6.5, 2.9)
    pressed = felt[:, 0] > 0.0
    ratio = np.full(len(times), np.nan)
    ratio[pressed] = felt[pressed, 1] / felt[pressed, 0]
    axes.plot(times, ratio, label="shear force / pressing force")
    axes.axhline(FRICTION, color="0.6", linestyle="--", label=f"friction ({FRICTION:g}, assumed)")
    axes.set(xlabel="time [s]", xlim=(0.0, END), ylim=(0.0, 1.15))
    for event in events:
        axes.axvline(event.stamp, color="0.4", linewidth=0.8)
        axes.text(event.stamp, 1.12, f" {event.kind}", fontsize=9, va="top")
    axes.legend(frameon=False, fontsize=8, loc=(0.1, 0.7))
    figure.savefig(path, dpi=110)


def _in_image(body, image, contact, directions):
    """Returns unit vectors (k, 2) in the plane of the image for `directions` (k, 3) in the link, by a fit to
    the taxels of the contact."""
    points = body.skin.surfaces[PATCH].positions[contact.taxels]
    flat = image.places[contact.taxels]
    points, flat = points - points.mean(axis=0), flat - flat.mean(axis=0)
    fit = np.linalg.lstsq(points, flat, rcond=1e-3)[0]
    found = directions @ fit
    return found / np.linalg.norm(found, axis=1, keepdims=True)
