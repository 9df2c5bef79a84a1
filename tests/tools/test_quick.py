"""`make quick` finds the tests of changed files, and fails if it can't determine which files have changed."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import ModuleType

import pytest

from helpers.peers import needs_program
from helpers.programs import program


@pytest.fixture
def quick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Returns the tool in a folder with two modules and a test that uses one module through the other."""
    module = program("quick")
    for path, text in {
        "src/inner.py": "ONE = 1\n",
        "src/outer.py": "from inner import ONE\n",
        "tests/test_outer.py": "import outer\n",
        "tests/test_other.py": "import os\n",
    }.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    return module


def commit(folder: Path, branch: str) -> None:
    git = [needs_program("git", "git"), "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run([*git, "init", "--quiet", "--initial-branch", branch], check=True)
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "--quiet", "--message", "one"], check=True)


@pytest.mark.parametrize("branch", ["main", "work"])
def test_a_change_brings_the_tests_that_use_it(quick: ModuleType, tmp_path: Path, branch: str) -> None:
    commit(tmp_path, branch)
    assert quick.changed() == set()
    (tmp_path / "src" / "inner.py").write_text("ONE = 2\n")
    (tmp_path / "tests" / "test_new.py").touch()
    assert quick.changed() == {tmp_path / "src" / "inner.py", tmp_path / "tests" / "test_new.py"}
    assert [path.name for path in quick.tests_of(quick.changed())] == ["test_new.py", "test_outer.py"]


def test_where_git_knows_nothing_it_ends_with_what_git_says(quick: ModuleType) -> None:
    with pytest.raises(SystemExit, match=r"make quick: git branch: fatal: not a git repo.*valid: make test"):
        quick.changed()
