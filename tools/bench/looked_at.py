"""Benchmark of the viewer with an open page: two robots of a thousand taxels each, simulated and drawn."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from measured import Measured, row

import tci
from tci.body.places import find_place
from tci.cli.view import SIMULATED
from tci.lab.authoring.dense_skin import with_dense_skin
from tci.lab.viewer.app import RATE, Viewer
from tci.lab.viewer.session import Session

TAXELS = 1010
"""Number of taxels of the NAO, rounded to whole rings of taxels. The NAO of the catalogue has 720 taxels, the
iCub has 1180."""
CORE, USABLE = 0.25, 5.0
"""Targets: fraction of a core, and time [s] until the page can be used."""
WINDOW, WINDOWS = 3.0, 5
SETTLE = 4.0
"""Time [s] for which the benchmark waits before it measures, so that the page and the loops have started."""
PATIENCE = 60.0


def viewer() -> list[Measured]:
    reflex = tci.WithdrawalReflex()
    robots = [with_dense_skin(tci.load_robot("nao"), TAXELS), tci.load_robot("icub")]
    sessions = [Session(tci.connect(robot, "sim", **SIMULATED), reflex, about={}) for robot in robots]
    shown = Viewer(sessions, port=0, folder=Path(tempfile.mkdtemp()))
    for session in sessions:
        session.start()
    thread = threading.Thread(target=shown.run)
    thread.start()
    try:
        alone = [_window(shown) for _ in range(WINDOWS)]
        return _with_page(shown, alone)
    finally:
        shown.stop()
        thread.join()
        shown.close()


def _with_page(shown: Viewer, alone: list[tuple[float, float]]) -> list[Measured]:
    command = [sys.executable, str(Path(__file__).with_name("browser_page.py")), shown.address]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as page:
        assert page.stdin is not None
        assert page.stdout is not None
        opened, *box = map(float, page.stdout.readline().split())
        clicked = _click(shown, page, box)
        time.sleep(SETTLE)
        idle = [_window(shown) for _ in range(WINDOWS)]
        poked = [_window(shown, poke=True) for _ in range(WINDOWS)]
        page.stdin.close()
    counts = [sum(len(s.positions) for s in f.skin.surfaces.values()) for f in shown.figures.values()]
    name = f"processor use of the viewer, robots of {' and '.join(map(str, counts))} taxels, "
    return [
        _share(name + "no page open", alone),
        _share(name + "a page open", idle, most=CORE),
        _share(name + "both robots poked", poked, most=CORE),
        row("time until the page of both robots accepts clicks", "none: the target",
            [(opened + clicked, USABLE)], unit="s",
            most=USABLE, note=f"{opened:.2f} s until the page shows the robots, {clicked:.2f} s for a click"),
    ]  # fmt: skip


def _share(name: str, windows: list[tuple[float, float]], *, most: float | None = None) -> Measured:
    pictures = ", ".join(f"{rate:.1f}" for _, rate in windows)
    return row(
        name, "one core", [(share, 1.0) for share, _ in windows], unit="cores", most=most,
        note=f"pictures per second (wanted: {RATE:g}): {pictures}",
    )  # fmt: skip


def _window(shown: Viewer, *, poke: bool = False) -> tuple[float, float]:
    """Returns the fraction of a core that this process used in an interval, and the number of pictures per
    second."""
    pokes = [session.pokes for session in shown.sessions.values()]
    begin, pictures, used = time.perf_counter(), shown.pictures, time.process_time()
    if poke:
        key, session = next(iter(shown.sessions.items()))
        assert session.view is not None
        field = tci.WithdrawalReflex().fields[0]
        place = find_place(
            shown.figures[key].skin, "left_arm", field.segment, field.u, field.theta, session.view.joints
        )
        shown.poke(key, place)
    time.sleep(WINDOW)
    used, took = time.process_time() - used, time.perf_counter() - begin
    now = [session.pokes for session in shown.sessions.values()]
    assert now == [count + poke for count in pokes], "not every robot was poked"
    return used / took, (shown.pictures - pictures) / took


def _click(shown: Viewer, page: subprocess.Popen[str], box: list[float]) -> float:
    """Returns the time [s] from a click on the page to the beginning of the poke that the click causes."""
    from helpers.browser import skin_on_screen  # a module of the tests

    key, session = next(iter(shown.sessions.items()))
    x, y, _ = skin_on_screen(shown, key, "left_forearm", box)
    begin = time.perf_counter()
    assert page.stdin is not None
    page.stdin.write(f"click {x} {y}\n")
    page.stdin.flush()
    while not session.pokes:
        assert time.perf_counter() - begin < PATIENCE, "the click never arrived"
        time.sleep(0.005)
    return time.perf_counter() - begin
