"""`tci zenoh`: writes configuration files for secure networks and runs a router between networks."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson
from tci.errors import DriverError
from tci.support.installed import needs

app = typer.Typer(
    help="Make keys, passwords and access rights for Zenoh, and run a router.", no_args_is_help=True
)

Users = Annotated[
    list[str] | None,
    typer.Option(help="NAME=ROBOT or NAME=ROBOT,ROBOT. Repeat the option for several users."),
]


@app.command()
def secure(
    folder: Annotated[Path, typer.Argument(help="New folder for the files.")],
    robot: Annotated[list[str], typer.Argument(help="Names of the robots on the network.")],
    endpoint: Annotated[
        str, typer.Option(help="Address at which other programs connect to the router: tls/HOST:PORT.")
    ],
    commander: Users = None,
    watcher: Users = None,
    as_json: AsJson = False,
) -> None:
    """Write certificates, passwords and configuration files. The configuration files define which users may
    command or read each robot.

    Example:  tci zenoh secure keys kitchen --endpoint tls/10.0.0.1:7447 --commander reflex=kitchen
    """
    _needs_zenoh()
    from tci.wires.zenoh.secure import write_files

    files = write_files(
        folder, endpoint=endpoint, robots=robot, commanders=_users(commander), watchers=_users(watcher)
    )
    if as_json:
        print_json({"files": [str(file) for file in files]})
        return
    console.print(f"{folder}: certificates, users.txt for the router, and", highlight=False, markup=False)
    for file in files:
        console.print(f"  {file.name}", highlight=False)
    console.print(
        f"start the router:  tci zenoh router {files[0]}\n"
        f"serve a robot:     tci serve nao --via zenoh:{robot[0]}@{files[1]}\n"
        "copy to each machine only its own file, ca.pem and its own two .pem files, to the same path",
        highlight=False, markup=False,
    )  # fmt: skip


@app.command()
def router(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="Configuration file of Zenoh.")],
) -> None:
    """Run a Zenoh router until Ctrl-C. Use this command on machines without Zenoh's own router, zenohd."""
    _needs_zenoh()
    from tci.drivers.remote.address import RemoteAddress
    from tci.wires.zenoh.session import close_session, open_session

    session = open_session(RemoteAddress("zenoh", "router", str(file)), "listen")
    console.print(f"router {session.zid()}; end with Ctrl-C", highlight=False)
    signal.sigwait({signal.SIGINT, signal.SIGTERM})
    close_session(session)


def _users(texts: Sequence[str] | None) -> dict[str, list[str]]:
    users = {}
    for text in texts or ():
        name, equals, robots = text.partition("=")
        if not equals or not robots:
            raise DriverError(f"user {text!r}; valid: NAME=ROBOT or NAME=ROBOT,ROBOT")
        users[name] = robots.split(",")
    return users


def _needs_zenoh() -> None:
    with needs("tci zenoh", "zenoh"):
        import zenoh  # noqa: F401 - only to see that it is there
