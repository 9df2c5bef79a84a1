"""The `tci` command. Each subcommand imports large modules only when the subcommand runs, so that --help is
fast."""

from __future__ import annotations

import inspect
import json
import re
import signal
import sys
from typing import Annotated, Any

import typer

import tci
from tci.cli.check import check
from tci.cli.demo import demo
from tci.cli.describe import describe
from tci.cli.doctor import doctor
from tci.cli.fault import app as fault_app
from tci.cli.film import film
from tci.cli.gesture import app as gesture_app
from tci.cli.guide import NEXT, first_steps
from tci.cli.hand import hand
from tci.cli.log import app as log_app
from tci.cli.new_robot import new_robot
from tci.cli.plot import plot
from tci.cli.record import record
from tci.cli.robots import robots
from tci.cli.run import run
from tci.cli.safety import safety
from tci.cli.serve import serve
from tci.cli.skin import app as skin_app
from tci.cli.sweep import sweep
from tci.cli.touch import touch
from tci.cli.touches import touches
from tci.cli.view import view
from tci.cli.words import app as words_app
from tci.cli.zenoh import app as zenoh_app
from tci.errors import DescriptionError, TciError

app = typer.Typer(
    name="tci",
    help="Tactile Capabilities Interface: write a touch behaviour once, run it on any robot with skin.",
    epilog="Try first: tci demo. This is software, not a certified safety function.",
    rich_markup_mode="rich",
)

for command in (
    demo,
    view,
    run,
    record,
    serve,
    plot,
    film,
    robots,
    describe,
    new_robot,
    touch,
    touches,
    check,
    safety,
    sweep,
    doctor,
    hand,
):
    app.command(command.__name__.replace("_", "-"))(command)
app.add_typer(skin_app, name="skin")
app.add_typer(fault_app, name="fault")
app.add_typer(gesture_app, name="gesture")
app.add_typer(log_app, name="log")
app.add_typer(words_app, name="words")
app.add_typer(zenoh_app, name="zenoh")


def _finish_help(commands: typer.Typer, group: str = "") -> None:
    """Joins the lines of help texts into paragraphs, because Typer would print the line breaks of the source.

    Also adds the next command to try at the end of each help text. A list of commands shows the first
    sentence of each.
    """
    for command in commands.registered_commands:
        name = command.name or str(getattr(command.callback, "__name__", ""))
        words = inspect.getdoc(command.callback) or ""
        command.help = re.sub(r"(?<!\n)\n(?!\n)", " ", words)
        command.short_help = re.split(r"(?<=\.)\s", command.help, maxsplit=1)[0]
        command.epilog = f"Next:  {NEXT[group + name]}"
    for registered in commands.registered_groups:
        if registered.typer_instance is not None:
            _finish_help(registered.typer_instance, f"{registered.name} ")


_finish_help(app)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"tci {tci.__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def main_options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print TCI's version.")
    ] = False,
) -> None:
    """Defines the options that a user writes before the subcommand. Without a subcommand, prints the commands
    to try first."""
    if context.invoked_subcommand is None:
        print(first_steps())


INTERRUPTED = 130
"""Exit status of a command that Ctrl-C ended: 128 + SIGINT, the value that shells use."""


def _message(error: TciError | OSError) -> str:
    """Returns the message of an error as text. For an error of a file (OSError), the message consists of the
    file's name and the system's message."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def _printable(text: str) -> str:
    """Replaces control characters by escape sequences, because control characters in a file name or a
    received text could control the terminal."""
    return "".join(one if one.isprintable() or one == "\n" else ascii(one)[1:-1] for one in text)


def main() -> None:
    """Runs the command line. If an error of TCI or of a file occurs, prints one message and exits with status
    1. The signal SIGTERM has the effect of Ctrl-C.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    as_json = "--json" in sys.argv
    try:
        # with False, Typer raises usage errors instead of printing them
        status = app(standalone_mode=not as_json)
        if status == INTERRUPTED:
            _print_fields({"error": "interrupted"})
        raise SystemExit(status)
    except typer.TyperException as error:
        _print_fields({"error": error.format_message()})
        raise SystemExit(error.exit_code) from None
    except (TciError, OSError) as error:
        if as_json and isinstance(error, DescriptionError):
            faults = [{"line": fault.line, "message": fault.message} for fault in error.faults]
            _print_fields({"error": str(error).splitlines()[0], "faults": faults})
        elif as_json:
            _print_fields({"error": _message(error)})
        else:
            print(f"tci: {_printable(_message(error))}", file=sys.stderr)
        raise SystemExit(1) from None


def _print_fields(fields: dict[str, Any]) -> None:
    """Prints `fields` as JSON. If this fails, for example because the disk is full, prints the entry `error`
    as text to the standard error output."""
    try:
        print(json.dumps(fields, indent=2), flush=True)
    except OSError:
        print(f"tci: {fields['error']}", file=sys.stderr)


if __name__ == "__main__":
    main()
