"""`tci demo --show touch`: people touch robots, in the browser or without it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box

from tci.cli.console import console, print_json, told_here
from tci.errors import CommandError, UnknownNameError

if TYPE_CHECKING:
    from rich.table import Table

    from tci.lab.show.touch_show import Scene
    from tci.robot.description import Robot

SHOWS = ("touch",)


def play_show(name: str, robots: Sequence[str], out: Path, *, headless: bool, as_json: bool) -> None:
    """Plays a show on the robots `robots`; without names on those of the show.

    Raises UnknownNameError for another show. Raises CommandError if `out` is a file, or for a robot without
    skin where the show touches it.
    """
    if name not in SHOWS:
        raise UnknownNameError("show", name, SHOWS)
    if out.exists() and not out.is_dir():
        raise CommandError(f"{out} is a file; valid: --out FOLDER, for what the robot is taught")
    from tci.cli.robots import load_robots
    from tci.lab.show.acts import CAST
    from tci.lab.show.touch_show import check_cast

    loaded = load_robots(robots or CAST)
    check_cast(loaded)
    out.mkdir(parents=True, exist_ok=True)
    lesson = out / "lesson.csv"
    if headless or as_json:
        _tell(loaded, out, lesson, as_json=as_json)
    else:
        _in_the_browser(loaded, out, lesson)


def _tell(robots: Sequence[Robot], out: Path, lesson: Path, *, as_json: bool) -> None:
    from rich.progress import Progress

    from tci.lab.show.acts import ACTS
    from tci.lab.show.touch_show import TouchShow

    played = TouchShow(robots, lesson)
    count = sum(1 if act.teaches else len(robots) for act in ACTS)
    with told_here(), Progress(console=console, transient=True, disable=as_json) as progress:
        task = progress.add_task("the people come", total=count)
        played.play(progress=lambda words: progress.update(task, advance=1, description=words))
    report = {"lesson": str(lesson), "scenes": [asdict(scene) for scene in played.scenes]}
    (out / "show.json").write_text(json.dumps(report, indent=2, allow_nan=False) + "\n")
    if as_json:
        print_json(report)
        return
    for act in ACTS:
        console.print(_table(act.words, [scene for scene in played.scenes if scene.act == act.name]))
    words = f"taught {lesson}\nreport {out / 'show.json'}\nNext: see it in the browser: tci demo --show touch"
    console.print(words, highlight=False, markup=False)


def _table(title: str, scenes: Sequence[Scene]) -> Table:
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("robot", "felt", "moved", "it says"):
        table.add_column(head, no_wrap=head in ("robot", "felt"))
    for scene in scenes:
        moved = ", ".join(f"{part} {way:.0f}\N{DEGREE SIGN}" for part, way in scene.moved.items())
        said = "\n".join(f"{at:.1f} s  {note}" for at, note in scene.said if " holds " not in note)
        table.add_row(scene.robot, f"{scene.felt:.1f} N", moved, said)
    return table


def _in_the_browser(robots: Sequence[Robot], out: Path, lesson: Path) -> None:
    from tci.capabilities.companion import Companion
    from tci.cli.view import needs_viewer, serve_page

    needs_viewer()
    from tci.drivers.registry import connect
    from tci.lab.show.live import NAME, LiveShow
    from tci.lab.show.touch_show import WORLD
    from tci.lab.viewer.app import Viewer
    from tci.lab.viewer.session import Session

    about = {"middleware": "sim", "capability": NAME}
    sessions = [Session(connect(robot, "sim", **WORLD), Companion(), about=about) for robot in robots]
    live = LiveShow(sessions, lesson)
    viewer = Viewer(sessions, port=0, folder=out / "recordings", told=lambda: live.words, again=live.start)
    try:
        serve_page(viewer, sessions, opened=live.start)
    finally:
        live.close()
