"""`tci record`: writes the sensor data of a robot to a file. The command moves no robot."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, Duration, NewRecording, RobotName, Task, Via

if TYPE_CHECKING:
    from tci.recording.recorder import Recorder
    from tci.runtime.loop_report import LoopReport


def record(
    file: NewRecording,
    robot: RobotName,
    via: Via = "sim",
    duration: Duration = None,
    task: Task = None,
    as_json: AsJson = False,
) -> None:
    """Record the raw sensor data of a robot. TCI sends no commands, and does not arm the robot.

    To record a robot while a behaviour runs, use tci run --record. To replay a recording, use --via
    replay:FILE.

    Example:  tci record touch.mcap nao --duration 10
    """
    from tci.body.generic_body import GenericBody
    from tci.cli.session import recorder_for
    from tci.drivers.registry import connect
    from tci.robot.catalogue import load_robot
    from tci.runtime.control import Control
    from tci.runtime.loop_report import LoopReport

    report = LoopReport()
    with (
        connect(load_robot(robot), via, arm=False) as driver,
        recorder_for(file, driver, via, {}, task=task) as recorder,
    ):
        if not as_json:
            words = f"recording {driver.robot.name} to {file}; end with Ctrl-C"
            console.print(words, highlight=False, markup=False)
        with suppress(KeyboardInterrupt):
            body = GenericBody(driver.robot) if driver.robot.model is not None else None
            control = Control(driver, body, write=False, report=report)
            for moment in control.periods(duration=duration):
                recorder.tick(moment.now, moment.reading, perception=moment.perception)
                if recorder.failed:
                    break
    print_recording(recorder, report, as_json=as_json)
    if recorder.failed:
        raise SystemExit(1)


def print_recording(recorder: Recorder, report: LoopReport, *, as_json: bool) -> None:
    """Prints the path, the number of periods, those that the loop missed, and the size of a recording. If
    recording failed, prints the reason."""
    if as_json:
        print_json({**recorder.to_json(), "missed": report.missed})
    elif recorder.failed:
        words = f"{recorder.path}: {recorder.ticks} periods, {recorder.failed}"
        console.print(words, style="red", highlight=False, markup=False)
    else:
        size = recorder.path.stat().st_size
        missed = f"{report.missed} missed, " if report.missed else ""
        words = f"{recorder.path}: {recorder.ticks} periods, {missed}{size / 1e6:.2f} MB"
        console.print(words, highlight=False, markup=False)
