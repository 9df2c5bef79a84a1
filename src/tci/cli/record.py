"""`tci record`: what a robot senses, into a file. Nothing is commanded."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from tci.capabilities.capability import Capability
from tci.cli.console import console, print_json
from tci.drivers.driver import Driver
from tci.drivers.registry import JOIN, connect
from tci.recording.recorder import Recorder
from tci.robot.catalogue import load_robot


def recorder_for(path: Path, driver: Driver, via: str, about: Mapping[str, str]) -> Recorder:
    """A recording of a driver. Raises RecordingError."""
    middleware = via.split(JOIN)[0].partition(":")[0]
    return Recorder(
        path,
        driver.robot,
        middleware=middleware,
        period=driver.period,
        keep_alive=driver.info.keep_alive,
        about={**driver.info.about, **about},
    )


def about_capability(name: str, capability: Capability[object]) -> dict[str, str]:
    """What a recording says of the behaviour that ran."""
    return {"capability": name, "settings": repr(capability)}


def record(path: Path, robot: str, *, via: str, duration: float | None, as_json: bool) -> None:
    """Read, write, and say what was written; exit with status 1 when the disk failed."""
    with (
        connect(load_robot(robot), via, arm=False) as driver,
        recorder_for(path, driver, via, {}) as recorder,
    ):
        if not as_json:
            words = f"recording {driver.robot.name} to {path}; end with Ctrl-C"
            console.print(words, highlight=False, markup=False)
        with suppress(KeyboardInterrupt):
            for now in driver.ticks(duration=duration):
                recorder.tick(now, driver.read())
                if recorder.failed:
                    break
    told(recorder, as_json=as_json)
    if recorder.failed:
        raise SystemExit(1)


def told(recorder: Recorder, *, as_json: bool) -> None:
    """Print what was written."""
    size = recorder.path.stat().st_size
    if as_json:
        print_json(summary(recorder))
    elif recorder.failed:
        words = f"{recorder.path}: {recorder.ticks} periods, {recorder.failed}"
        console.print(words, style="red", highlight=False, markup=False)
    else:
        words = f"{recorder.path}: {recorder.ticks} periods, {size / 1e6:.2f} MB"
        console.print(words, highlight=False, markup=False)


def summary(recorder: Recorder) -> dict[str, object]:
    """The same as plain values."""
    return {
        "file": str(recorder.path),
        "periods": recorder.ticks,
        "bytes": recorder.path.stat().st_size,
        "failed": recorder.failed,
    }
