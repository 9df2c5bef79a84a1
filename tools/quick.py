"""Runs lint, type checks and the tests of the files changed since main, within a minute.

python tools/quick.py

A test file is run if the file itself has changed, or if it imports a changed module or a changed test helper.
If no test imports a changed module, the tests of the modules that import it are run. Live tests are not run,
and neither are tests for which no time is left. `make test` runs all tests.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
BUDGET = 40.0
"""Time [s] after which no further test starts. Assumed: the type checks, which run at the same time, need as
long."""


def changed() -> set[Path]:
    """Returns the files that differ from the commit at which the branch left main, and new files."""
    (base, *_) = _git("merge-base", "HEAD", "main" if _git("branch", "--list", "main") else "HEAD")
    names = _git("diff", "--name-only", base) + _git("ls-files", "--others", "--exclude-standard")
    return {ROOT / name for name in names}


def _git(*words: str) -> list[str]:
    """Returns the lines that git prints. Ends the program if git fails, so that no changed file is missed."""
    told = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    if told.returncode:
        sys.exit(f"make quick: git {words[0]}: {told.stderr.strip()}; valid: make test")
    return told.stdout.splitlines()


def imports(path: Path) -> set[str]:
    """Returns the dotted names that a file imports; `from a import b` may mean the module `a.b`."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def module(path: Path) -> str:
    """Returns the name under which tests import a file of src or tests; empty for other files."""
    for root in (ROOT / "src", ROOT / "tests"):
        if path.is_relative_to(root) and path.suffix == ".py":
            return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
    return ""


def tests_of(files: set[Path]) -> list[Path]:
    uses = {path: imports(path) for folder in ("src", "tests") for path in (ROOT / folder).rglob("*.py")}
    found = {path for path in files if path in uses and _is_test(path)}
    for path in files:
        names, seen = {module(path)} - {""}, set[str]()
        while names and not (tests := {path for path in uses if _is_test(path) and uses[path] & names}):
            seen |= names
            names = {module(path) for path in uses if uses[path] & names} - seen
        found |= tests if names else set()
    return sorted(found)


def _is_test(path: Path) -> bool:
    return path.name.startswith("test_")


class Budget:
    """Runs tests until the time has passed, and reports the number of tests that were not run."""

    def __init__(self) -> None:
        self.end, self.left = time.monotonic() + BUDGET, 0

    def pytest_runtest_protocol(self) -> bool | None:
        if time.monotonic() < self.end:
            return None
        self.left += 1
        return True

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self.left:
            terminalreporter.line(f"{self.left} tests are left to make test: {BUDGET:.0f} s are over")


def main() -> int:
    tools = [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]]
    started = [subprocess.Popen([sys.executable, "-m", *words], cwd=ROOT) for words in tools]
    files = [str(path) for path in tests_of(changed())]
    print(f"{len(files)} test files import changed files", flush=True)
    status = 0
    if files:
        words = ["-q", "-x", "-m", "not live", "--rootdir", str(ROOT), *files]
        status = int(pytest.main(words, plugins=[Budget()]))
    if status == pytest.ExitCode.NO_TESTS_COLLECTED:
        status = 0
    return max([status, *(tool.wait() for tool in started)])


if __name__ == "__main__":
    sys.exit(main())
