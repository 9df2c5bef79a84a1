"""Sphinx configuration. Warnings are errors (`make docs`); nothing is fetched while building."""

import importlib
import sys
from pathlib import Path
from typing import Any

import typer
from sphinx.application import Sphinx
from sphinx.ext import autosummary
from sphinx.ext.napoleon import GoogleDocstring
from sphinx.util import logging
from typer.cli import get_docs_for_click

import tci
from tci.cli.main import app

project = "TCI"
author = "The TCI developers"
release = tci.__version__
copyright = f"The TCI developers. Checked with TCI {release} by its tests"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"TCI {release}"
exclude_patterns = ["_build", "_templates", "tables"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["tci.css"]
toc_object_entries = False  # the tables at the head of a page are its way through; half the time of a build
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_type_aliases = {"Array": "Array", "ArrayLike": "ArrayLike", "Indices": "Indices"}
autodoc_default_options = {"members": True, "undoc-members": False}
sys.path.append(str(Path(__file__).parents[1] / "tests"))
PUBLIC = importlib.import_module("helpers.public_names").public_objects()
"""All public names; some have two, such as `tci.run` and `tci.runtime.run`."""
LIVES: dict[str, dict[str, str]] = {}
"""The public names of each module, by their shortest address."""
for address, thing in sorted(PUBLIC.items(), key=lambda item: -item[0].count(".")):
    LIVES.setdefault(getattr(thing, "__module__", ""), {})[address.rpartition(".")[2]] = address
autosummary_context = {"public": {module: sorted(names.values()) for module, names in LIVES.items()}}
# the first sentence of a docstring does not end at these
autosummary.WELL_KNOWN_ABBREVIATIONS = (*autosummary.WELL_KNOWN_ABBREVIATIONS, "eq.", "eqs.", "Fig.")


def write_commands() -> None:
    """Writes the page of all commands, taken from the program itself."""
    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="tci")
    page = get_docs_for_click(obj=command, ctx=context, name="tci", title="Commands").replace("\\[", "[")
    path = Path(__file__).parent / "_generated" / "commands.md"
    path.parent.mkdir(exist_ok=True)
    if not path.exists() or path.read_text() != page:
        path.write_text(page)


def skip(_: Sphinx, what: str, __: str, member: Any, ___: bool, ____: Any) -> bool | None:
    """Leaves constants out of the modules' pages, and public names, which have one page of their own."""
    return (
        True
        if what == "module" and (not callable(member) or id(member) in map(id, PUBLIC.values()))
        else None
    )


def show_args(_: Sphinx, what: str, __: str, ___: Any, ____: Any, lines: list[str]) -> None:
    """Makes a list of `Args:`. Not of attributes, where napoleon takes what is before a colon for a type."""
    if what in ("class", "function", "method"):
        lines[:] = GoogleDocstring(lines, what=what).lines()


def check_index(sphinx: Sphinx, _: Exception | None) -> None:
    """Warns about public names that the index and the search would not find."""
    found = sphinx.env.domains.python_domain.objects
    for name in sorted({name for names in LIVES.values() for name in names.values()}):
        if name not in found:
            logging.getLogger(__name__).warning("%s is missing from docs/reference.md", name)


def setup(sphinx: Sphinx) -> None:
    """Connects the functions above to the build."""
    sphinx.connect("autodoc-skip-member", skip)
    sphinx.connect("autodoc-process-docstring", show_args)
    sphinx.connect("build-finished", check_index)


write_commands()
