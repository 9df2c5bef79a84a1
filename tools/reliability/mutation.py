"""Mutation score of gate and loop, and coverage of their branches by the tests."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from pool import COMMITS
from report import commit
from row import Row

ROOT = Path(__file__).parents[2]
MUTANTS = ROOT / "mutants"
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mutmut"]
MEASURED = ("src/tci/gate/*.py", "src/tci/runtime/loop*.py", "src/tci/runtime/watchdogs.py",
            "src/tci/drivers/lease.py")  # fmt: skip

NOTICED = ("killed", "timeout", "segfault", "check_was_interrupted_by_user")
"""Results that count as noticed. The last value results if a mutant raises a KeyboardInterrupt, which ends
pytest."""


def mutation(full: bool) -> Row:
    """Judges mutants (see mutants.py) in random order. A later call continues with the others. If only tests
    have changed, it also judges those again that no test has detected; if sources have changed, all. At CI
    size no mutant runs.

    Environment variables: MINUTES is the time after which no other mutant is judged; MINUTES=0 returns the
    last results. JOBS is the number of processes.
    """
    counts = {"total": 0}
    measured = MUTANTS / "measured.json"
    if full and float(os.environ.get("MINUTES", "inf")):
        now = {"sources": _digest("src"), "tests": _digest("tests"), "commit": commit()}
        before = json.loads(measured.read_text()) if measured.exists() else {}
        if before.get("sources") != now["sources"]:
            shutil.rmtree(MUTANTS, ignore_errors=True)
            MUTANTS.mkdir()
            measured.write_text(json.dumps(now))
        again = ["again"] if before.get("tests") != now["tests"] else []
        subprocess.run([sys.executable, Path(__file__).with_name("mutants.py"), *again], cwd=ROOT, check=True)
        measured.write_text(json.dumps(now))
    if full and measured.exists():
        subprocess.run([_tool("mutmut"), "export-cicd-stats"], cwd=ROOT, check=True, capture_output=True)
        counts = json.loads((MUTANTS / "mutmut-cicd-stats.json").read_text())
        COMMITS["mutation"] = json.loads(measured.read_text())["commit"]
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


def _digest(folder: str) -> str:
    """Returns a digest of the Python files in a folder."""
    digest = hashlib.sha256()
    for path in sorted((ROOT / folder).rglob("*.py")):
        digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]
