"""Films the second demo, and takes a picture of its page in a browser. `tools/pictures.py` calls it."""

from __future__ import annotations

import shutil
import threading
import time
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from playwright.sync_api import sync_playwright

import tci
from tci.capabilities import Companion
from tci.drivers.simulated import SimulatedDriver
from tci.lab.pictures.camera import Camera, fit
from tci.lab.pictures.paint import FULL_SCALE
from tci.lab.pictures.portrait import Portrait, keep_moment
from tci.lab.show.acts import ACTS, CAST, Act
from tci.lab.show.live import NAME, LiveShow
from tci.lab.show.touch_show import WORLD, TouchShow
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.session import Session

EVERY = 0.15
"""Time [s] between two pictures: the film shows the show in real time."""
SEEN = {"poke": (1.4, 3.3), "pat": (0.8, 3.6), "guide": (0.5, 6.5), "repeat": (0.6, 3.9)}
"""From when to when each act is shown [s]."""
WIDTH, HEIGHT, HEAD = 250, 330, 26
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


class Filmed:
    """Pictures of each robot, by act."""

    def __init__(self) -> None:
        self.pictures: dict[tuple[str, str], list[Image.Image]] = {}
        self._cameras: dict[str, Camera] = {}
        self._portrait: tuple[SimulatedDriver, Portrait] | None = None
        self._due = 0.0

    def watch(self, robot: tci.Robot, act: Act, tick: tci.Tick, driver: SimulatedDriver) -> None:
        begin, end = SEEN[act.name]
        if self._portrait is None or self._portrait[0] is not driver:
            self._portrait, self._due = (driver, Portrait(driver.world, (), full_scale=FULL_SCALE)), begin
        if not self._due <= tick.now < end:
            return
        self._due += EVERY
        portrait, moment = self._portrait[1], keep_moment(driver.world, tick.reading)
        if robot.name not in self._cameras:
            sides = [portrait.outline(moment, part=arm, lowest=-0.35) for arm in ("left_arm", "right_arm")]
            self._cameras[robot.name] = fit(
                np.concatenate(sides), azimuth=0.45, elevation=0.25, width=WIDTH, height=HEIGHT, margin=0.12,
                frame=portrait.torso(moment),
            )  # fmt: skip
        picture = Image.fromarray(portrait.draw(moment, self._cameras[robot.name]))
        self.pictures.setdefault((robot.name, act.name), []).append(picture)


def film(folder: Path, file: Path) -> None:
    """Writes the film of all acts, the robots side by side."""
    seen = Filmed()
    TouchShow([tci.load_robot(name) for name in CAST], folder / "lesson.csv").play(watch=seen.watch)
    shown, last = list[Image.Image](), {name: seen.pictures[name, ACTS[0].name][0] for name in CAST}
    for act in ACTS:
        longest = max(len(seen.pictures.get((name, act.name), ())) for name in CAST)
        for k in range(longest):
            wide = Image.new("RGB", (WIDTH * len(CAST), HEIGHT + HEAD), "white")
            for number, name in enumerate(CAST):
                own = seen.pictures.get((name, act.name), ())
                if own:
                    last[name] = own[min(k, len(own) - 1)]
                wide.paste(last[name], (WIDTH * number, HEAD))
            ImageDraw.Draw(wide).text((10, 5), act.words, fill=(29, 39, 51), font_size=15)
            shown.append(wide)
    palette = shown[len(shown) // 2].quantize(96)
    frames = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in shown]
    times = [round(1e3 * EVERY)] * (len(frames) - 1) + [1500]
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)


def page(folder: Path, file: Path) -> None:
    """Takes a picture of the page while two fingers guide the first robot's arm."""
    about = {"middleware": "sim", "capability": NAME}
    sessions = [Session(tci.connect(name, "sim", **WORLD), Companion(), about=about) for name in CAST]
    live = LiveShow(sessions, folder / "lesson.csv", acts=[one for one in ACTS if one.teaches])
    viewer = Viewer(sessions, port=0, folder=folder, told=lambda: live.words, again=live.start)
    for session in sessions:
        session.start()
    thread = threading.Thread(target=viewer.run)
    thread.start()
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            seen = browser.new_page(viewport={"width": 1500, "height": 950})
            seen.set_default_timeout(120_000)
            seen.goto(viewer.address)
            seen.wait_for_selector("canvas")
            seen.wait_for_timeout(5000)
            live.start()
            first = sessions[0]
            while first.view is None or np.degrees(first.view.posture["left_arm"][0]) < 45.0:
                time.sleep(0.01)
            for session in sessions:
                session.pace = 0.0
            seen.wait_for_timeout(3000)
            close = seen.locator(".mantine-Notification-closeButton")
            if close.count():  # of a browser that draws without a graphics card
                close.first.click(force=True)
                seen.wait_for_timeout(1000)
            seen.screenshot(path=file)
            browser.close()
    finally:
        live.close()
        viewer.stop()
        thread.join()
        viewer.close()
