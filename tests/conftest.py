"""Settings of all tests; at the end of a run, those that did not run and how to get them stand together."""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest

TESTS = Path(__file__).parent

LIVE = [
    "cli",
    "faults/test_processes.py",
    "middleware",
    "recording/test_recorder.py",
    "runtime",
    "test_examples.py",
    "trials/test_elsewhere.py",
    "viewer",
]
"""Tests with other processes, in real time. On a busy machine a robot holds, rightly: few run at once."""

# No test times anything: on a shared machine hypothesis' own deadline would fail sound code.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is live; `make test` runs that apart from the rest."""
    live = [TESTS / place for place in LIVE]
    for item in items:
        if any(item.path.is_relative_to(place) for place in live):
            item.add_marker(pytest.mark.live)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name what was left out; a run in which everything ran says nothing."""
    left_out = terminalreporter.stats.get("skipped", [])
    if not left_out:
        return
    terminalreporter.section("did not run here")
    for report in left_out:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
        terminalreporter.line(f"{report.nodeid}: {reason.removeprefix('Skipped: ')}")
