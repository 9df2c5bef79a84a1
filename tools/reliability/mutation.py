"""Mutation score of gate and loop, and coverage of their branches by the tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from row import Row

ROOT = Path(__file__).parents[2]
MUTANTS = ROOT / "mutants"
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mutmut"]
MEASURED = ("src/tci/gate/*.py", "src/tci/runtime/loop*.py", "src/tci/runtime/watchdogs.py",
            "src/tci/runtime/lease.py")  # fmt: skip

NOTICED = ("killed", "timeout", "segfault", "check_was_interrupted_by_user")
"""Results that count as noticed. The last value results if a mutant raises a KeyboardInterrupt, which ends
pytest."""


def mutation(full: bool) -> Row:
    """Runs mutmut's mutants one at a time. A later call continues with the next mutant. At CI size no mutant
    runs."""
    counts = {"total": 0}
    if full and float(os.environ.get("MINUTES", "inf")):
        subprocess.run([_tool("mutmut"), "run"], cwd=ROOT, check=True, env=_tools_first())
    if full and MUTANTS.exists():
        subprocess.run([_tool("mutmut"), "export-cicd-stats"], cwd=ROOT, check=True, capture_output=True)
        counts = json.loads((MUTANTS / "mutmut-cicd-stats.json").read_text())
    noticed = sum(counts.get(how, 0) for how in NOTICED)
    tried = noticed + counts.get("survived", 0) + counts.get("suspicious", 0) + counts.get("no_tests", 0)
    score = noticed / max(1, tried)
    return Row(
        "mutation score of gate and loop",
        tried,
        max(1, counts["total"]),
        "changes",
        f"the tests detect {score:.1%} of the changes, and miss {tried - noticed}",
        ">= 95 % detected",
        not tried or score >= 0.95,
    )


def branches(full: bool) -> Row:
    """Counts the branches of gate and loop that their tests do not execute. At CI size no test runs.

    Python can't count the lines of compiled loops. Instead, tests/gate/kernels compares these loops with
    NumPy.
    """
    totals = {"num_branches": 0, "covered_branches": 0, "missing_lines": 0}
    if full and float(os.environ.get("MINUTES", "inf")):
        tests = [*SETTINGS["pytest_add_cli_args_test_selection"], "tests/gate/test_self_collision.py"]
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "COVERAGE_FILE": f"{folder}/data"}
            coverage, report = [sys.executable, "-m", "coverage"], f"{folder}/report.json"
            run = [
                *coverage,
                "run",
                "--branch",
                f"--include={','.join(MEASURED)}",
                "-m",
                "pytest",
                "-q",
                *tests,
            ]
            subprocess.run(run, cwd=ROOT, check=True, env=environment)
            subprocess.run([*coverage, "json", "-o", report], cwd=ROOT, check=True, env=environment)
            totals = json.loads(Path(report).read_text())["totals"]
    count, lines = totals["num_branches"], totals["missing_lines"]
    missed = count - totals["covered_branches"]
    return Row(
        "branches of gate and loop that tests execute",
        count,
        max(1, count),
        "branches",
        f"{missed} branches and {lines} lines never executed",
        "all executed",
        not missed and not lines,
    )


def _tool(name: str) -> str:
    return str(Path(sys.executable).with_name(name))


def _tools_first() -> dict[str, str]:
    """Returns an environment with which mutmut finds pytest, which mutmut starts by name."""
    return {**os.environ, "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
