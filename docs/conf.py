"""Sphinx configuration. Warnings are errors (`make docs`); nothing is fetched while building."""

from pathlib import Path

import typer
from typer.cli import get_docs_for_click

import tci
from tci.cli.main import app

project = "TCI"
author = "The TCI developers"
release = tci.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"TCI {release}"
exclude_patterns = ["_build", "tables"]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_default_options = {"members": True, "undoc-members": False}


def write_commands() -> None:
    """The page of every command, from the program itself."""
    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="tci")
    page = get_docs_for_click(obj=command, ctx=context, name="tci", title="Commands").replace("\\[", "[")
    path = Path(__file__).parent / "_generated" / "commands.md"
    path.parent.mkdir(exist_ok=True)
    if not path.exists() or path.read_text() != page:
        path.write_text(page)


write_commands()
