"""The CI command makes a clean copy of the commit that CI has checked out, and runs the tests in this
copy."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from helpers import ROOT, TESTS
from helpers.peers import needs_program

CONFTEST = str(TESTS / "conftest.py")
MAKE = """#!/bin/sh
test "$3" = clean && exec /bin/rm -rf "$2/.venv"
cd "$2" && echo "make $3 $4: $(ls -A | tr '\\n' ' ')"
"""
"""Program that replaces make. It prints its goal and the content of the folder. The goal `clean` removes
built files."""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Returns a checkout of one commit, with a built file and a file that is not committed."""
    git = needs_program("git", "git")
    there = tmp_path / "there"
    (there / ".ci").mkdir(parents=True)
    shutil.copy(ROOT / ".ci" / "run", there / ".ci")
    (there / ".gitignore").write_text(".venv/\n")
    for words in (
        ["init", "--quiet"],
        ["add", "."],
        ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "--quiet", "--message", "one"],
    ):
        subprocess.run([git, *words], cwd=there, check=True)
    (there / ".venv").mkdir()
    (there / "forgotten").touch()
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "make").write_text(MAKE)
    (tmp_path / "bin" / "make").chmod(0o755)
    return there


def said(checkout: Path, **settings: str) -> list[str]:
    """Returns each goal of `make` together with the content of the folder in which the goal ran."""
    path = f"{checkout.parent / 'bin'}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "HOME": str(checkout.parent), **settings}
    ran = subprocess.run(
        [checkout / ".ci" / "run"], env=environment, check=True, capture_output=True, text=True,
        cwd=checkout.parent,
    )  # fmt: skip
    return [line.rstrip() for line in ran.stdout.splitlines() if line.startswith("make")]


CLEAN = "make test : .ci .git .gitignore"


def test_a_checkout_is_tested_without_what_nobody_committed(checkout: Path) -> None:
    assert said(checkout) == [CLEAN]


def test_a_checkout_of_another_user(checkout: Path) -> None:
    assert said(checkout, GIT_TEST_ASSUME_DIFFERENT_OWNER="1") == [CLEAN]


def test_a_checkout_that_is_shallow_and_of_no_branch(checkout: Path, tmp_path: Path) -> None:
    shallow = tmp_path / "shallow"
    subprocess.run(["git", "clone", "--quiet", "--depth", "1", checkout.as_uri(), shallow], check=True)
    subprocess.run(["git", "checkout", "--quiet", "--detach"], cwd=shallow, check=True)
    assert said(shallow) == [CLEAN]


def test_a_folder_without_a_repository_is_tested_as_it_is_but_for_what_was_built(checkout: Path) -> None:
    shutil.rmtree(checkout / ".git")
    assert said(checkout) == ["make test : .ci .gitignore forgotten"]


def test_genuine_data_is_found_from_where_ci_was_started(checkout: Path) -> None:
    told = said(checkout, DATA="skins")
    assert told == [CLEAN, f"make test-real DATA={checkout.parent / 'skins'}{CLEAN[len('make test ') :]}"]


@pytest.mark.xdist_group("together")
def test_a_group_of_tests_runs_in_one_process_and_is_found_again(request: pytest.FixtureRequest) -> None:
    """If the versions of pytest and pytest-xdist are not compatible, they ignore groups without a message.
    If a report contained the group, a failed live test would not be repeated, and its failure would not
    count."""
    config = request.config
    if hasattr(config, "workerinput") and config.getoption("loadgroup", default=False):
        assert request.node.nodeid.endswith("@together")
    conftest = config.pluginmanager.get_plugin(CONFTEST)
    for name in ("a.py::b", "a.py::b[c@d]"):
        assert conftest.without_group(name) == conftest.without_group(f"{name}@together") == name


def test_each_file_is_in_one_half(pytestconfig: pytest.Config) -> None:
    conftest = pytestconfig.pluginmanager.get_plugin(CONFTEST)

    def halves(path: Path) -> list[str]:
        """Returns the halves of `make test` (live or not live) that collect a file."""
        found = []
        for half in ("live", "not live"):
            config = SimpleNamespace(getoption={"markexpr": half}.get)
            if not conftest.pytest_ignore_collect(path, config):
                found.append(half)
        return found

    for file in TESTS.rglob("test_*.py"):
        assert halves(file) == ["live" if conftest.is_live(file) else "not live"]
    assert halves(TESTS / "drivers") == ["live", "not live"]
