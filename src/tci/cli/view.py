"""`tci view`: shows robots and recordings in the browser."""

from __future__ import annotations

import os
import signal
import sys
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tci.cli import completion
from tci.cli.console import console, told_here
from tci.cli.options import Arm, Duration, SomeRobots
from tci.errors import CommandError, RecordingError
from tci.support.installed import needs

if TYPE_CHECKING:
    from tci.lab.viewer.app import Source, Viewer
    from tci.lab.viewer.player import Player

REPLAY = "replay:"
SIMULATED = {"step": 0.002, "rate": 100.0, "people": 1, "self_touch": False}
"""Physics step [s], control rate [Hz] and people (one, whose hands the page moves) of simulated robots. The
rate equals the frame rate of
NAO's skin, the faster skin of the paper's two robots, so that the loop reads every frame. A faster loop would
leave less time for drawing."""


def needs_viewer() -> None:
    """Raises MissingExtraError if the extra `viewer` is not installed."""
    with needs("tci view", "viewer"):
        import viser  # noqa: F401 - only to see that it is there


def view(
    robot: SomeRobots = None,
    via: Annotated[
        list[str] | None,
        typer.Option(
            help="Driver, NAME or NAME:ADDRESS. Give one driver for all robots, or one driver for each "
            "robot. \\[default: sim]",
            autocompletion=completion.drivers,
        ),
    ] = None,
    capability: Annotated[
        str,
        typer.Option(
            "--run",
            help="Capability to run on every robot: a name, MODULE:CLASS, a policy (.onnx), or "
            "fields of the reflex (.toml).",
            autocompletion=completion.capabilities,
        ),
    ] = "withdrawal",
    arm: Arm = False,
    host: Annotated[
        str,
        typer.Option(
            help="Network address on which the viewer listens. Browsers on other machines need the "
            "printed token."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on which the viewer listens; 0 chooses a free port.")
    ] = 8080,
    out: Annotated[Path, typer.Option(help="Folder for the recordings that you make in the viewer.")] = Path(
        "recordings"
    ),
    duration: Duration = None,
    headless: Annotated[bool, typer.Option("--headless", help="Do not open the browser.")] = False,
) -> None:
    """Show robots in the browser, side by side. In the browser you can poke the skin, move the arms, inject
    faults and record. The command needs the extra viewer. A real robot moves only with --arm. Without --arm,
    TCI only reads the robot's data.

    Example:  tci view nao icub

    Example:  tci view --via replay:touch.mcap
    """
    needs_viewer()
    from tci.lab.viewer.app import Viewer

    sources = _sources(robot or [], via or [], capability, arm=arm)
    viewer = Viewer(sources, host=host, port=port, folder=out)
    serve_page(viewer, sources, duration=duration, headless=headless)


def serve_page(
    viewer: Viewer,
    sources: Sequence[Source],
    *,
    duration: float | None = None,
    headless: bool = False,
    opened: Callable[[], None] = lambda: None,
) -> None:
    """Shows a page until somebody ends it, or for `duration` [s]. Calls `opened` once somebody sees it."""
    from tci.runtime.watchdogs import interruptions

    waiting = [opened]

    def over() -> bool:
        if waiting and viewer.server.get_clients():
            waiting.pop()()
        return interruption.signal is not None

    with suppress(KeyboardInterrupt), told_here(), interruptions() as interruption:
        try:
            for source in sources:
                source.start()
            words = f"open {viewer.address}   (end with Ctrl-C)"
            console.print(words, highlight=False, markup=False, soft_wrap=True)
            if (
                not headless
                and sys.stdout.isatty()
                and (os.environ.get("DISPLAY") or sys.platform != "linux")
            ):
                webbrowser.open(viewer.address)
            viewer.run(duration=duration, until=over)
        finally:
            interruption.rests = True
            viewer.close()
    if interruption.signal == signal.SIGTERM:
        raise SystemExit(128 + signal.SIGTERM)


def _sources(names: Sequence[str], vias: Sequence[str], capability: str, *, arm: bool) -> list[Source]:
    """Opens the sources of the viewer: a session for each robot, and a player for each recording."""
    from tci.cli.robots import load_robots
    from tci.cli.session import about_capability
    from tci.drivers.info import moves_nothing_real
    from tci.drivers.registry import connect
    from tci.runtime.arguments import load_capability

    vias = list(vias) or ["sim"]
    if not names and all(via.startswith(REPLAY) for via in vias):
        return [_player(via.removeprefix(REPLAY), None) for via in vias]
    from tci.lab.viewer.session import Session

    behaviour = load_capability(capability)
    found: list[Source] = []
    robots = load_robots(names)
    for index, via in enumerate(_one_each(vias, len(robots))):
        if via.startswith(REPLAY):
            found.append(_player(via.removeprefix(REPLAY), names[index] if names else None))
            continue
        name = via.split(" + ")[0].partition(":")[0]
        options = SIMULATED if name == "sim" else {}
        driver = connect(robots[index], via, arm=arm or moves_nothing_real(via), **options)
        about = {"middleware": name, **about_capability(capability, behaviour)}
        found.append(Session(driver, behaviour, about=about))
    return found


def _player(file: str, robot: str | None) -> Player:
    """Opens a recording and computes its perceptions. Raises RecordingError if the file is not valid, or if
    the recorded robot is unknown."""
    from rich.progress import Progress

    from tci.lab.viewer.player import Player
    from tci.recording.perceived import recorded_robot
    from tci.recording.recording import Recording

    recording = Recording(file)
    found = recorded_robot(recording, robot)
    if found is None:
        raise RecordingError(
            f"{file} does not name its robot; valid: tci view ROBOT --via replay:{file}; its raw frames: "
            "tci log export"
        )
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"reading {file}", total=None)
        return Player(recording, found, progress=lambda now: progress.advance(task))


def _one_each(vias: Sequence[str], robots: int) -> list[str]:
    """Returns a list with one driver for each robot. Raises CommandError unless the user gave one `--via` for
    all robots, or one `--via` for each robot."""
    if len(vias) == 1:
        return list(vias) * robots
    if len(vias) != robots:
        raise CommandError(
            f"{len(vias)} --via for {robots} robots; valid: one for all robots, or one for each"
        )
    return list(vias)
