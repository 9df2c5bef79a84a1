"""Picture of what a three-axis sleeve tells of one touch: pressure image, shape, shear, and events."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.body.tactile import FRICTION, contact_shape, pressure_image, shear_force, touch_events
from tci.messages import Reading
from tci.pictures.pressure_png import pressure_pixels
from tci.simulation.world import World

PATCH, TAXEL = "left_forearm", 130
PRESS, PULL, RELEASE, END = 0.2, 0.5, 0.9, 1.1
"""Times [s] at which the finger has arrived, the arm begins to move below it, and it is taken away."""
SHOWN = 0.7
"""Time [s] of the pressure image."""
SHOULDER = "LShoulderPitch"
STEP = 0.01


def three_axes() -> tci.Robot:
    """Returns a NAO with one sleeve, whose taxels measure three axes in 16 bits."""
    nao = tci.load_robot("nao")
    patch = nao.patch(PATCH)
    sensor = patch.sensor.model_copy(
        update={"axes": 3, "rest": 30000.0, "lowest": 0.0, "highest": 65535.0, "pascal_per_count": 4.0}
    )
    skin = patch.model_copy(update={"sensor": sensor, "channels": 3 * patch.channels})
    return nao.model_copy(update={"patches": (skin,)})


def draw(path: Path) -> None:
    """Writes the picture: left the pressure image with shape and shear, right forces and events over time."""
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
    _draw(path, body, shown, rows, events)


def _draw(path, body, shown, rows, events) -> None:  # type: ignore[no-untyped-def]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.4), layout="constrained")
    image = pressure_image(shown, body, PATCH, pixel=0.001)
    height, width = image.pressure.shape
    x, y = (1e3 * edge for edge in image.corner)
    extent = (x, x + width * 1e3 * image.pixel, y, y + height * 1e3 * image.pixel)
    left.imshow(pressure_pixels(image), extent=extent)
    contact = shown.contacts[0]
    shape = contact_shape(contact, body)
    centre = contact.taxel_forces @ image.places[contact.taxels] / contact.taxel_forces.sum()
    flat = _in_image(body, image, contact, shape.directions)
    angle = np.degrees(np.arctan2(*flat[0][::-1]))
    left.add_patch(Ellipse(1e3 * centre, *(2e3 * shape.axes), angle=angle, fill=False, color="white"))
    left.set(xlabel="around the forearm [mm]", ylabel="from the wrist [mm]")
    left.set_title(f"{contact.force:.1f} N on {1e6 * shape.area:.0f} mm$^2$", fontsize=10)
    times = [row[0] for row in rows]
    felt = np.array([row[1] if len(row) > 1 else (0.0, 0.0) for row in rows])
    right.plot(times, felt[:, 0], label="pressing")
    right.plot(times, felt[:, 1], label="shear")
    right.plot(times, FRICTION * felt[:, 0], "--", color="0.6", label=f"{FRICTION:g} of the pressing force")
    for event in events:
        right.axvline(event.stamp, color="0.4", linewidth=0.8)
        right.text(event.stamp, right.get_ylim()[1], f" {event.kind}", fontsize=9, va="top")
    right.set(xlabel="time [s]", ylabel="force [N]")
    right.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def _in_image(body, image, contact, directions):  # type: ignore[no-untyped-def]
    """Returns unit vectors (k, 2) in the image's plane of `directions` (k, 3) in the link, by a fit to the
    taxels of the contact."""
    points = body.skin.surfaces[PATCH].positions[contact.taxels]
    flat = image.places[contact.taxels]
    points, flat = points - points.mean(axis=0), flat - flat.mean(axis=0)
    fit = np.linalg.lstsq(points, flat, rcond=1e-3)[0]
    found = directions @ fit
    return found / np.linalg.norm(found, axis=1, keepdims=True)
