"""The documentation is complete: the pages list every command, and every picture exists."""

from __future__ import annotations

import re
import runpy
import shlex
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer

from helpers import ROOT
from helpers.printed import words_of
from helpers.public_names import public_objects
from tci.cli.main import app

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))


def names(command: object, before: str) -> list[str]:
    """Returns the names of all commands below a command, as a user types them."""
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


FIRST_PAGES = [DOCS.parent / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]


@pytest.mark.parametrize("page", [*FIRST_PAGES, *PAGES], ids=lambda page: page.stem)
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    """Links to other sites need a network, so they are not tested. Sphinx reports wrong links within the
    built pages."""
    links = set(re.findall(r"\]\((?!https?:)([^)\s]+)\)", page.read_text()))
    for link in sorted(links):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists() or path.startswith("_generated/"), link
        assert not anchor or anchor in anchors(target), link
    assert page.stem != "README" or "CONTRIBUTING.md" in links


def anchors(page: Path) -> set[str]:
    """Returns the anchors of all headings of a page, in the form that GitHub and MyST create."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}


def test_every_page_can_be_found() -> None:
    index = (DOCS / "index.md").read_text()
    pages = {page.stem for page in PAGES} - {"index"}
    assert pages <= set(index.splitlines())
    assert pages <= set(re.findall(r"\]\(([\w-]+)\.md\)", index.partition("## All pages")[2]))


def test_the_reference_has_each_public_name_once() -> None:
    page = (DOCS / "reference.md").read_text()
    listed = re.findall(r"^\.\. auto(?!summary)\w+:: (tci\.[\w.]+)$", page, re.MULTILINE)
    assert len(listed) == len(set(listed))
    objects = public_objects()
    assert set(listed) <= objects.keys()
    assert {id(objects[name]) for name in listed} == {id(thing) for thing in objects.values()}
    assert {name for name in objects if name.count(".") == 1} <= set(listed)


def test_the_page_of_modules_names_modules() -> None:
    modules = re.findall(r"^   ([a-z][\w.]+)$", (DOCS / "modules.md").read_text(), re.MULTILINE)
    assert len(modules) > 50
    for module in modules:
        assert exists(module), module


NAME = re.compile(r"`(tci(?:\.[A-Za-z_][A-Za-z_0-9]*)+)(?:\([^`]*\))?`")

GROUPS = {"tci.robots", "tci.drivers", "tci.servers", "tci.capabilities"}
"""Entry-point groups, whose names look like modules but are not."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_of_the_code_exist(page: Path) -> None:
    for name in sorted(set(NAME.findall(page.read_text())) - GROUPS):
        assert exists(name), f"{page.name}: {name}"


def exists(name: str) -> bool:
    """Returns True if a dotted name is a module or an attribute of a module."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:length]))
        except ModuleNotFoundError as error:
            if error.name is None or error.name.split(".")[0] != "tci":
                return True  # a middleware that is not installed on this machine
            continue
        for rest in parts[length:]:
            if not hasattr(found, rest):
                return False
            found = getattr(found, rest)
        return True
    return False


USED = re.compile(r"(?:^|`|\$ )(tci [a-z][^`#\n]*)", re.MULTILINE)
"""Pattern of a command in a page: at the start of a line, after a prompt or in back quotes."""


COMMANDS = typer.main.get_command(app)


LAST = "X"
"""An additional argument, used as the value of an option that a page mentions without a value."""


@pytest.mark.parametrize("page", [DOCS.parent / "README.md", *PAGES], ids=lambda page: page.stem)
def test_commands_of_a_page_have_the_options_that_it_gives_them(page: Path) -> None:
    text = re.sub(r"\\\n *", "", page.read_text())
    for used in USED.findall(text):
        command: Any = COMMANDS
        words = shlex.split(used.split("  ")[0])[1:]  # two spaces separate the command from its description
        while words and (inner := getattr(command, "commands", {}).get(words[0])):
            command, words = inner, words[1:]
        assert not hasattr(command, "commands") or not words, f"{page.name}: {used}"
        try:
            _, left, _ = command.make_parser(typer.Context(command)).parse_args([*words, LAST])
        except typer.TyperException as error:
            raise AssertionError(f"{page.name}: {used}: {error}") from error
        assert set(left) <= {LAST}, f"{page.name}: {used}"


PROGRAM = re.compile(
    r"^```python\n((?:import [^\n]*\n)*import tci\n.*?)^```\n(?:\nIt prints\n\n```text\n(.*?)^```)?",
    re.MULTILINE | re.DOTALL,
)
"""Pattern of a complete program in a page and the output below it. A fragment has no import."""

PROGRAMS = [
    pytest.param(program, output, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, (program, output) in enumerate(PROGRAM.findall(page.read_text()))
]


@pytest.mark.parametrize(("program", "output"), PROGRAMS)
def test_programs_of_a_page_run(
    program: str,
    output: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The program runs in this process, which has already loaded TCI. The tests of the examples show that a
    program can load TCI itself."""
    file = tmp_path / "program.py"
    file.write_text(program)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(file), run_name="__main__")
    assert not output or words_of(output) == words_of(capsys.readouterr().out)
