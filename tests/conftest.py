"""Settings of all tests. At the end of a run, tests that did not run are listed with advice on how to run
them."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

from made_recordings import write_recordings
from made_skins import write_skins
from skin_data import SkinData

TESTS = Path(__file__).parent

LIVE = [
    "cli",
    "commissioning",
    "drivers",
    "exports/test_facts.py",
    "faults/test_processes.py",
    "recording/test_recorder.py",
    "runtime",
    "test_examples.py",
    "experiments/test_remote_trial.py",
    "viewer",
    "yarpwire",
]
"""Tests with other processes, in real time. A busy machine makes a robot hold, rightly: few of them run at
once."""

FIRST = ["test_wheel.py", "viewer"]
"""Longest groups of each half, which start first: at the end, other processors would wait for them."""

# No test measures time: on a shared machine hypothesis' own deadline would fail correct code.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--data", type=Path, help="folder of genuine skin files and recordings (make test-real)")


def pytest_configure(config: pytest.Config) -> None:
    data = config.getoption("--data")
    if data is not None and not (data / "recordings").is_dir():
        raise pytest.UsageError(
            f"--data {data} has no folder `recordings`; valid: a folder as tests/skin_data.py says"
        )


def is_live(path: Path) -> bool:
    """Returns True if the tests of a file are live."""
    return any(path.is_relative_to(TESTS / place) for place in LIVE)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leaves out files of the other half of `make test`, which would be imported only to be deselected."""
    half = config.getoption("markexpr")
    if collection_path.is_dir() or half not in ("live", "not live"):
        return None
    return is_live(collection_path) != (half == "live") or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Marks live tests, which `make test` runs separately, and tests that read skin files or recordings.

    Tests of genuine files only are collected if there is a folder with these.
    """
    for item in items:
        if is_live(item.path):
            item.add_marker(pytest.mark.live)
        if {"skin_data", "genuine_data"} & {*getattr(item, "fixturenames", ())}:
            item.add_marker(pytest.mark.data)
    items.sort(key=lambda item: not any(item.path.is_relative_to(TESTS / place) for place in FIRST))
    if config.getoption("--data") is None:
        items[:] = [item for item in items if "genuine_data" not in getattr(item, "fixturenames", ())]


def pytest_collection_finish() -> None:
    """Excludes libraries and collected tests from garbage collection, which otherwise takes a twentieth of
    the time."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Removes the group from a test's name where reports are collected: --last-failed knows only the name."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        report.nodeid = without_group(report.nodeid)


def without_group(name: str) -> str:
    """Returns the name of a test without the group that pytest-xdist appends to it."""
    plain, _, group = name.rpartition("@")
    return plain if plain and "]" not in group else name


LEFT_OPEN = 100
"""Files and sockets that a module of tests may leave open: a browser and a library keep theirs for longer."""


@pytest.fixture(scope="module", autouse=True)
def nothing_stays_open() -> Iterator[None]:
    """Fails where a module leaves files or sockets open: `select` of others fails beyond a thousand."""
    opened = Path("/proc/self/fd")
    before = len([*opened.iterdir()]) if opened.exists() else 0
    yield
    after = len([*opened.iterdir()]) if opened.exists() else 0
    if after - before >= LEFT_OPEN:
        gc.collect()  # rospy leaves reference cycles, each with a file
        after = len([*opened.iterdir()])
    assert after - before < LEFT_OPEN, f"{after - before} files and sockets stay open"


@pytest.fixture(scope="session")
def made_data(tmp_path_factory: pytest.TempPathFactory) -> SkinData:
    """Skin files and recordings made for the tests."""
    folder = tmp_path_factory.mktemp("made")
    write_skins(folder)
    write_recordings(folder / "recordings")
    return SkinData(folder, genuine=False)


@pytest.fixture(scope="session")
def genuine_data(pytestconfig: pytest.Config) -> SkinData:
    """The folder of --data."""
    return SkinData(pytestconfig.getoption("--data"), genuine=True)


@pytest.fixture(scope="session")
def skin_data(request: pytest.FixtureRequest, pytestconfig: pytest.Config) -> SkinData:
    """The folder of --data, or made files under the same names."""
    made = pytestconfig.getoption("--data") is None
    data: SkinData = request.getfixturevalue("made_data" if made else "genuine_data")
    return data


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Lists the tests that were left out; prints nothing if all ran."""
    left_out = terminalreporter.stats.get("skipped", [])
    if not left_out:
        return
    terminalreporter.section("did not run here")
    for report in left_out:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
        terminalreporter.line(f"{report.nodeid}: {reason.removeprefix('Skipped: ')}")
