"""Settings of all tests; at the end of a run, those that did not run and how to get them stand together."""

from __future__ import annotations

import hypothesis
import pytest

# No test times anything: on a shared machine hypothesis' own deadline would fail sound code.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name what was left out; a run in which everything ran says nothing."""
    left_out = terminalreporter.stats.get("skipped", [])
    if not left_out:
        return
    terminalreporter.section("did not run here")
    for report in left_out:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
        terminalreporter.line(f"{report.nodeid}: {reason.removeprefix('Skipped: ')}")
