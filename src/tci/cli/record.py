"""`tci record`: writes the sensor data of a robot to a file. Nothing is commanded."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, Duration, NewRecording, RobotName, Via

if TYPE_CHECKING:
    from tci.capabilities.capability import Capability
    from tci.drivers.driver import Driver
    from tci.recording.recorder import Recorder


def recorder_for(path: Path, driver: Driver, via: str, about: Mapping[str, str]) -> Recorder:
    """Opens a recorder for the readings of a driver. Raises RecordingError as `Recorder` does.

    Args:
        path: File to write.
        driver: Driver whose robot, period and facts are recorded.
        via: NAME or NAME:ADDRESS by which the driver was opened.
        about: Further facts about the recording, by key.
    """
    from tci.drivers.registry import JOIN
    from tci.recording.recorder import Recorder

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
    """Returns the metadata of a recording that name the behaviour that ran, and its settings."""
    return {"capability": name, "settings": repr(capability)}


def record(
    file: NewRecording,
    robot: RobotName,
    via: Via = "sim",
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Record the raw sensor data of a robot. Nothing is commanded and the robot stays unarmed.

    To record a behaviour too, use tci run --record. Replay a recording with --via replay:FILE.

    Example:  tci record touch.mcap nao --duration 10
    """
    from tci.drivers.registry import connect
    from tci.robot.catalogue import load_robot

    with (
        connect(load_robot(robot), via, arm=False) as driver,
        recorder_for(file, driver, via, {}) as recorder,
    ):
        if not as_json:
            words = f"recording {driver.robot.name} to {file}; end with Ctrl-C"
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
    """Prints the file that was written, its number of periods and its size, or why recording failed."""
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
    """Returns the facts that `told` prints, as JSON values."""
    return {
        "file": str(recorder.path),
        "periods": recorder.ticks,
        "bytes": recorder.path.stat().st_size,
        "failed": recorder.failed,
    }
