"""Settings of all tests. At the end of a run, tests that did not run are listed with advice on how to run
them."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

os.environ.setdefault("TCI_CHECK_LOOPS", "1")  # before a loop is loaded

from helpers import TESTS
from helpers.made_recordings import write_recordings
from helpers.made_skins import write_skins
from helpers.skin_data import SkinData

LIVE = [
    "cli",
    "drivers",
    "exports/test_facts.py",
    "recording/test_recorder.py",
    "runtime",
    "sources",
    "test_examples.py",
    "lab/commissioning",
    "lab/experiments/test_remote_trial.py",
    "lab/faults/test_processes.py",
    "lab/viewer",
    "tools/test_exposure.py",
    "wires",
    "yarpwire",
]
"""Folders and files of live tests, which use other processes in real time. On a busy machine the gate
correctly holds the robot, so only few of these tests run at the same time."""

UNTIMED = [
    "cli/test_commands.py",
    "cli/test_log.py",
    "cli/test_missing_extras.py",
    "cli/test_new_robot.py",
    "cli/test_skin.py",
    "cli/test_skin_calibrate.py",
    "cli/test_skin_check.py",
    "drivers/test_remote_cdr.py",
    "drivers/test_replay.py",
    "drivers/test_wrapper.py",
    "lab/commissioning/test_plausibility.py",
    "runtime/test_mistakes.py",
    "runtime/test_result.py",
    "yarpwire/test_bottle.py",
]
"""Files in these folders whose results do not depend on real time, so they need not wait for live tests."""

FIRST = [
    "batch/test_gpu.py",
    "test_wheel.py",
    "lab/viewer",
    "drivers/test_driver.py",
    "wires/zenoh",
    "lab/experiments/test_main_job.py",
]
"""Longest groups of each half of `make test`. They start first, because at the end of the run the other
processors would wait for them."""

# Tests with hypothesis have no deadline: on a slow shared machine a deadline would make correct code fail.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--data", type=Path, help="folder of genuine skin files and recordings (make test-real)")


def pytest_configure(config: pytest.Config) -> None:
    data = config.getoption("--data")
    if data is not None and not (data / "recordings").is_dir():
        raise pytest.UsageError(
            f"--data {data} has no folder `recordings`; valid: a folder as tests/helpers/skin_data.py says"
        )


def is_live(path: Path) -> bool:
    """Returns True if the tests of a file are live."""
    return _in(path, LIVE) and not _in(path, UNTIMED)


def _in(path: Path, places: list[str]) -> bool:
    return any(path.is_relative_to(TESTS / place) for place in places)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Ignores files of the other half of `make test`. Otherwise these files would be imported and then
    deselected."""
    half = config.getoption("markexpr")
    if collection_path.is_dir() or half not in ("live", "not live"):
        return None
    return is_live(collection_path) != (half == "live") or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Marks live tests, which `make test` runs beside others, and tests that read skin files or recordings.

    Tests that need genuine files are collected only if the option --data names a folder with these files.
    """
    for item in items:
        if is_live(item.path):
            item.add_marker(pytest.mark.live)
        if {"skin_data", "genuine_data"} & {*getattr(item, "fixturenames", ())}:
            item.add_marker(pytest.mark.data)
    items.sort(key=lambda item: not _in(item.path, FIRST))
    if config.getoption("--data") is None:
        items[:] = [item for item in items if "genuine_data" not in getattr(item, "fixturenames", ())]


def pytest_collection_finish() -> None:
    """Collects garbage seldom: a test process holds two million objects of libraries and tests, and
    collections took 4 % of the time. They are not frozen, because a run of the loop then counts them."""
    gc.set_threshold(20_000, 10, 10)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Removes the name of the group from a test's name in collected reports, because --last-failed knows the
    test without this name."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        report.nodeid = without_group(report.nodeid)


def without_group(name: str) -> str:
    """Returns the name of a test without the group that pytest-xdist appends to it."""
    plain, _, group = name.rpartition("@")
    return plain if plain and "]" not in group else name


LEFT_OPEN = 100
"""Number of files and sockets that a test module may leave open, because a browser and a library close theirs
late."""


@pytest.fixture(scope="module", autouse=True)
def nothing_stays_open() -> Iterator[None]:
    """Fails if a module leaves files or sockets open. With more than a thousand open files, `select` fails in
    later tests."""
    opened = Path("/proc/self/fd")
    before = len([*opened.iterdir()]) if opened.exists() else 0
    yield
    after = len([*opened.iterdir()]) if opened.exists() else 0
    if after - before >= LEFT_OPEN:
        gc.collect()  # rospy leaves reference cycles, each with an open file
        after = len([*opened.iterdir()])
    assert after - before < LEFT_OPEN, f"{after - before} files and sockets stay open"


@pytest.fixture(scope="session")
def made_data(tmp_path_factory: pytest.TempPathFactory) -> SkinData:
    """Returns skin files and recordings that are made for the tests."""
    folder = tmp_path_factory.mktemp("made")
    write_skins(folder)
    write_recordings(folder / "recordings")
    return SkinData(folder, genuine=False)


@pytest.fixture(scope="session")
def genuine_data(pytestconfig: pytest.Config) -> SkinData:
    """Returns the folder that the option --data names."""
    return SkinData(pytestconfig.getoption("--data"), genuine=True)


@pytest.fixture(scope="session")
def skin_data(request: pytest.FixtureRequest, pytestconfig: pytest.Config) -> SkinData:
    """Returns the folder of the option --data or, without this option, made files with the same names."""
    made = pytestconfig.getoption("--data") is None
    data: SkinData = request.getfixturevalue("made_data" if made else "genuine_data")
    return data


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Lists the tests that did not run. Prints nothing if all tests ran."""
    left_out = terminalreporter.stats.get("skipped", [])
    if not left_out:
        return
    terminalreporter.section("did not run here")
    for report in left_out:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
        terminalreporter.line(f"{report.nodeid}: {reason.removeprefix('Skipped: ')}")
