"""The documentation's own promises: every command has its place, and pictures that are there."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
import typer

from tci.cli.main import app

DOCS = Path(__file__).parent.parent / "docs"
PAGES = sorted(DOCS.glob("*.md"))


def names(command: object, before: str) -> list[str]:
    """Every command below one, as a user types it."""
    found = []
    for name, inner in getattr(command, "commands", {}).items():
        found += [f"{before} {name}", *names(inner, f"{before} {name}")]
    return found


def test_every_command_is_on_the_page_of_commands() -> None:
    runpy.run_path(str(DOCS / "conf.py"))
    page = (DOCS / "_generated" / "commands.md").read_text()
    commands = names(typer.main.get_command(app), "tci")
    assert len(commands) > 15
    for command in commands:
        assert f"`{command}`" in page
    assert "\\[" not in page


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pictures_of_a_page_exist_and_have_words(page: Path) -> None:
    for words, path in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", page.read_text()):
        assert words
        assert (DOCS / path).is_file(), path


def test_every_page_can_be_found() -> None:
    index = (DOCS / "index.md").read_text().splitlines()
    assert {page.stem for page in PAGES} - {"index"} <= set(index)
