"""Creates the pictures of docs/images again, with the code that they show. `make pictures` runs this program.
It needs Chromium.

python tools/pictures.py [NAME...] names: see MAKERS
"""

from __future__ import annotations

import os
import re
import runpy
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import clamped
import control_modes
import gallery
import generic_arm
import gentle
import numpy as np
import teach
import touch_show
import touch_to_motion
import touch_to_policy
import touch_words
import without_skin
from even_response import draw as draw_even_response
from foot import draw as draw_foot
from same_touch import draw as draw_same_touch
from tactile import draw as draw_tactile

import tci
from tci.body.places import find_place
from tci.cli.main import app
from tci.cli.view import SIMULATED
from tci.lab.pictures.film import Film
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.session import Session
from touches import draw as draw_touches

ROOT = Path(__file__).resolve().parent.parent
IMAGES = ROOT / "docs" / "images"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def command(*words: str) -> None:
    """Runs a command of TCI in this process."""
    app(list(words), standalone_mode=False)


def demo(folder: Path) -> None:
    """Creates the figure of the demo."""
    command("demo", "--out", str(folder), "--headless")
    shutil.copy(folder / "demo.png", IMAGES / "demo.png")


def plot(folder: Path) -> None:
    """Creates the figure of a recording."""
    file = str(folder / "poke.mcap")
    command("run", "withdrawal", "nao", "--poke", "--duration", "1.5", "--record", file)
    command("plot", file, "--out", str(IMAGES / "plot.png"))


def foot(_: Path) -> None:
    """Creates the picture of a real iCub's foot. Needs genuine recordings: set DATA=FOLDER."""
    if "DATA" not in os.environ:
        raise SystemExit("the foot's picture needs genuine recordings; valid: DATA=FOLDER make pictures")
    draw_foot(Path(os.environ["DATA"]), IMAGES / "foot.png")


def shrug(folder: Path) -> None:
    """Films the example of an own capability."""
    shrugging = runpy.run_path(str(ROOT / "examples" / "07_own_capability.py"))["Shrug"]()
    with tci.connect(tci.load_robot("nao"), "sim") as driver:
        driver.world.finger.poke("left_forearm", 100)
        film = Film(driver.world, folder / "shrug.gif", fields=(), part="left_arm")

        def watch(tick: tci.Tick) -> None:
            film.see(tick)
            if tick.now > 0.08:
                driver.world.finger.retire()

        tci.run(driver, shrugging, duration=1.0, observe=watch)
        film.save()
    shutil.copy(folder / "shrug.gif", IMAGES / "shrug.gif")


def notebook(folder: Path) -> None:
    """Creates the figure at the end of the notebook."""
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "notebook.md").read_text(), re.DOTALL):
        exec(block, names)
    shutil.copy(names["path"].with_name("notebook.png"), IMAGES / "notebook.png")


def viewer(folder: Path) -> None:
    """Takes a picture of the viewer in a real browser while both robots are poked."""
    from playwright.sync_api import sync_playwright

    reflex = tci.WithdrawalReflex()
    sessions = [
        Session(tci.connect(tci.load_robot(name), "sim", **SIMULATED), reflex, about={})
        for name in ("nao", "icub")
    ]
    page_of = Viewer(sessions, port=0, folder=folder)
    for session in sessions:
        session.start()
    thread = threading.Thread(target=page_of.run)
    thread.start()
    try:
        with sync_playwright() as playwright:
            chromium = shutil.which("chromium")
            browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
            page = browser.new_page(viewport={"width": 1500, "height": 950})
            page.set_default_timeout(120_000)
            page.goto(page_of.address)
            page.wait_for_selector("canvas")
            page.wait_for_timeout(5000)
            close = page.locator(".mantine-Notification-closeButton")
            if close.count():
                close.first.click()
            poke_all(page_of, reflex)
            page.wait_for_timeout(1500)
            page.screenshot(path=IMAGES / "viewer.png")
            come_near(page_of, "icub", "l_forearm")
            page.wait_for_timeout(3000)
            page.screenshot(path=IMAGES / "viewer-touch.png")
            browser.close()
    finally:
        page_of.stop()
        thread.join()
        page_of.close()


def poke_all(shown: Viewer, reflex: tci.WithdrawalReflex) -> None:
    """Pokes the lateral side of each left forearm, and pauses each simulation when the finger presses the
    skin."""
    key = next(iter(shown.sessions))
    session = shown.sessions[key]
    assert session.view is not None
    site = next(field for field in reflex.fields if field.name == "forearm_lateral")
    skin = shown.figures[key].skin
    place = find_place(skin, "left_arm", site.segment, site.u, site.theta, session.view.joints)
    for other in shown.sessions.values():
        other.pace = 0.05
    shown.poke(key, place)
    while moving := [other for other in shown.sessions.values() if other.pace]:
        for other in moving:
            if other.view is not None and other.view.force > 1.5:
                other.pace = 0.0
        time.sleep(0.001)


def come_near(shown: Viewer, key: str, link: str) -> None:
    """Moves the camera close to a link, as a user does by scrolling."""
    camera = next(iter(shown.server.get_clients().values())).camera
    aim = shown.figures[key].pose(link)[:3, 3]
    camera.position = aim + np.array([0.5, 0.3, 0.15])
    camera.look_at = aim


MAKERS: dict[str, Callable[[Path], None]] = {
    "demo": demo,
    "foot": foot,
    "even_response": lambda _: draw_even_response(IMAGES / "even-response.png"),
    "same_touch": lambda _: draw_same_touch(IMAGES / "same-touch.png"),
    "tactile": lambda _: draw_tactile(IMAGES),
    "plot": plot,
    "shrug": shrug,
    "notebook": notebook,
    "pokes": lambda folder: gallery.pokes(folder, IMAGES),
    "kinds": lambda folder: gallery.kinds(folder, IMAGES),
    "gentle": lambda _: gentle.picture(IMAGES / "gentle.png"),
    "teach": lambda _: teach.picture(IMAGES / "teach.png"),
    "attend": lambda folder: gallery.attend(folder, IMAGES),
    "soft": lambda folder: gallery.soft(folder, IMAGES),
    "body": lambda folder: gallery.body(folder, IMAGES),
    "hands": lambda folder: gallery.hands(folder, IMAGES),
    "fingers": lambda folder: gallery.fingers(folder, IMAGES),
    "robots": lambda folder: gallery.robots(folder, IMAGES),
    "touches": lambda _: draw_touches(IMAGES / "touches.png"),
    "touch_words": lambda _: touch_words.draw(IMAGES / "touch-words.png"),
    "touch": lambda folder: touch_to_motion.draw_path(IMAGES / "touch-to-motion.svg"),
    "policy": lambda folder: touch_to_policy.draw(folder, IMAGES / "touch-to-policy.png"),
    "bad_command": lambda folder: touch_to_motion.draw_bad_command(IMAGES / "bad-command.svg"),
    "control_modes": lambda _: control_modes.draw(IMAGES / "control-modes.png"),
    "clamped": lambda _: clamped.picture(IMAGES / "clamped-person.png"),
    "generic_arm": lambda _: generic_arm.draw(IMAGES / "generic-arm.png"),
    "viewer": viewer,
    "touch_show": lambda folder: touch_show.film(folder, IMAGES / "touch-show.gif"),
    "touch_show_page": lambda folder: touch_show.page(folder, IMAGES / "touch-show.png"),
    "without_skin": lambda folder: without_skin.draw(IMAGES / "touch-without-skin.png"),
}


def main() -> None:
    for name in sys.argv[1:] or MAKERS:
        with tempfile.TemporaryDirectory() as folder:
            print(f"making {name}", flush=True)
            MAKERS[name](Path(folder))


if __name__ == "__main__":
    main()
