"""`tci view`: robots in the browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.cli.console import console
from tci.cli.demo import load_robots
from tci.cli.record import about_capability
from tci.cli.run import HARMLESS, load_capability
from tci.errors import CommandError, MissingExtraError
from tci.runtime.registry import connect

if TYPE_CHECKING:
    from tci.viewer.session import Session

STEP = 0.002
"""Physics step [s] of robots that are simulated to be looked at."""


def needs_viewer() -> None:
    """Raises MissingExtraError without the extra."""
    if find_spec("viser") is None:
        raise MissingExtraError("tci view", "viewer")


def view(
    names: Sequence[str],
    vias: Sequence[str],
    *,
    capability: str = "withdrawal",
    arm: bool = False,
    host: str = "127.0.0.1",
    port: int = 8080,
    folder: Path = Path("recordings"),
    duration: float | None = None,
    browser: bool = True,
) -> None:
    """Open the page, and show the robots until interrupted.

    Raises MissingExtraError without the extra, CommandError for vias that do not fit the robots, and what
    links raise.
    """
    needs_viewer()
    from tci.viewer.app import Viewer

    sessions = _sessions(names, vias, capability, arm=arm)
    behaviour = sessions[0].capability
    fields = behaviour.fields if isinstance(behaviour, WithdrawalReflex) else ()
    viewer = Viewer(sessions, fields=fields, host=host, port=port, folder=folder)
    console.print(f"open {viewer.address}   (end with Ctrl-C)", highlight=False, markup=False, soft_wrap=True)
    try:
        for session in sessions:
            session.start()
        if browser and sys.stdout.isatty() and (os.environ.get("DISPLAY") or sys.platform != "linux"):
            webbrowser.open(viewer.address)
        with suppress(KeyboardInterrupt):
            viewer.run(duration=duration)
    finally:
        viewer.close()


def _sessions(names: Sequence[str], vias: Sequence[str], capability: str, *, arm: bool) -> list[Session]:
    """A session for each robot."""
    from tci.viewer.session import Session

    behaviour = load_capability(capability)
    robots = load_robots(names)
    sessions = []
    for robot, via in zip(robots, _one_each(vias or ["sim"], len(robots)), strict=True):
        name = via.partition(":")[0]
        options = {"step": STEP} if name == "sim" else {}
        link = connect(robot, via, arm=arm or name in HARMLESS, **options)
        about = {"middleware": name, **about_capability(capability, behaviour)}
        sessions.append(Session(link, behaviour, about=about))
    return sessions


def _one_each(vias: Sequence[str], robots: int) -> list[str]:
    """A via for each robot."""
    if len(vias) == 1:
        return list(vias) * robots
    if len(vias) != robots:
        raise CommandError(f"{robots} robots and {len(vias)} --via; valid: one, or one for each robot")
    return list(vias)
