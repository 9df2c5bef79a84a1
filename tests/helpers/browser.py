"""Opens the viewer's page in a real browser, for tests."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np
from playwright.sync_api import Locator, Page, sync_playwright

from helpers.peers import needs_program
from tci.body.places import Place
from tci.capabilities.fields import default_fields
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.figure import Figure
from tci.lab.viewer.pick import pick
from tci.messages.frames import Array, apply
from tci.robot.limb import generic_limb_distance

PATIENCE = 120.0
"""Longest time [s] to wait for events. It is long because the page is drawn without a graphics card, and no
test measures time."""
COARSE = 0.25
"""Drawn pixels per pixel of the page's layout. Without a graphics card the page is drawn by the processors
that the robots need, so only a sixteenth of the pixels is drawn."""


def wait_for(what: Callable[[], object], said: str, patience: float = PATIENCE) -> None:
    """Waits until `what()` is true. Fails with the text `said` if this takes too long."""
    end = time.monotonic() + patience
    while not what():
        assert time.monotonic() < end, f"never happened: {said}"
        time.sleep(0.05)


@contextmanager
def running(viewer: Viewer) -> Iterator[Viewer]:
    """Runs the viewer and its sessions within the context."""
    thread = threading.Thread(target=viewer.run, name="viewer")
    for source in viewer.sources.values():
        source.start()
    thread.start()
    try:
        yield viewer
    finally:
        viewer.stop()
        thread.join()
        viewer.close()


@contextmanager
def page_of(viewer: Viewer) -> Iterator[Page]:
    """Opens the viewer's page in headless Chromium and waits until the page can be clicked."""
    chromium = needs_program("chromium", "chromium")
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=flags)
        page = browser.new_page(viewport={"width": 1400, "height": 700}, device_scale_factor=COARSE)
        page.set_default_timeout(PATIENCE * 1000.0)
        page.goto(viewer.address)
        page.wait_for_selector("canvas")
        wait_for(viewer.server.get_clients, "the page says where its camera is")
        wait_for(lambda: _two_pictures(page) < 5.0, "the page has loaded its meshes", 3.0 * PATIENCE)
        yield page
        browser.close()


def _two_pictures(page: Page) -> float:
    """Time [s] in which the page draws two pictures: up to a minute on a busy machine while it loads its
    meshes. A click waits as long."""
    begin = time.monotonic()
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return time.monotonic() - begin


def canvas_of(page: Page) -> tuple[float, float, float, float]:
    """Returns left, top, width and height [pixels] of the scene on the page."""
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    return box["x"], box["y"], box["width"], box["height"]


def on_screen(viewer: Viewer, points: Array, canvas: Sequence[float]) -> Array:
    """Returns the pixels (n, 2) of the page that show the points (n, 3) [m] of the scene."""
    camera = next(iter(viewer.server.get_clients().values())).camera
    left, top, width, height = canvas
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, camera.wxyz)
    seen = (points - camera.position) @ rotation.reshape(3, 3)
    focal = height / 2.0 / np.tan(camera.fov / 2.0)
    middle = np.array([left + width / 2.0, top + height / 2.0])
    return np.asarray(middle + focal * seen[:, :2] / seen[:, 2:])


def skin_on_screen(
    viewer: Viewer, key: str, patch: str, canvas: Sequence[float], *, outside: bool = False
) -> tuple[float, float, Place]:
    """Returns a pixel of the page that shows a receptive field on `patch` (or, with `outside`, skin outside
    all fields), and the place on the skin."""
    camera = next(iter(viewer.server.get_clients().values())).camera
    figure = viewer.figures[key]
    surface = figure.skin.surfaces[patch]
    T_SL = figure.pose(surface.link)
    points, normals = apply(T_SL, surface.positions), surface.normals @ T_SL[:3, :3].T
    view = viewer.sources[key].view
    assert view is not None
    u, theta, _ = figure.skin.limb(patch, view.joints)
    fields = [field for field in default_fields() if field.segment == figure.robot.patch(patch).segment]
    away = np.min([generic_limb_distance(u, theta, f.u, f.theta) / f.radius for f in fields], axis=0)
    wanted = away > 1.15 if outside else away < 0.6
    for taxel in np.argsort(np.einsum("ij,ij->i", normals, points - camera.position)):
        if not wanted[taxel]:
            continue
        ray = (points[taxel] - camera.position) / np.linalg.norm(points[taxel] - camera.position)
        found = pick(figure, np.array(camera.position), ray)
        others = [pick(other, np.array(camera.position), ray) for other in _others(viewer, figure)]
        if found is None or found[0].patch != patch or any(others):
            continue
        x, y = on_screen(viewer, points[taxel][None], canvas)[0]
        return float(x), float(y), found[0]
    raise AssertionError(f"{patch} of {key} is not seen from here")


def _others(viewer: Viewer, figure: Figure) -> list[Figure]:
    return [other for other in viewer.figures.values() if other is not figure]


def field(page: Page, label: str) -> Locator:
    """Returns the input element of the first control with the label `label`; for a slider, its number
    field."""
    row = page.locator(f"xpath=(//label[text()='{label}'])[1]/ancestor::div[.//input][1]")
    return row.locator("input:not([type=hidden])").last


def files(folder: Path) -> list[str]:
    """Returns the names of the recordings in a folder."""
    return sorted(path.name for path in folder.glob("*.mcap"))
