"""What follows `yarp:` on the command line: `[HOST[:PORT]][,dialect=3][,robot=NAME]...`."""

from __future__ import annotations

from dataclasses import dataclass, fields

from tci.errors import LinkError
from tci.middleware.yarp.carrier import CARRIERS, FAST_TCP
from tci.middleware.yarp.dialect import DIALECTS, Dialect
from tci.middleware.yarp.names import parse_address
from tci.model.description import Robot


@dataclass(frozen=True, slots=True)
class YarpAddress:
    """Where the name server is, and what is spoken."""

    server: tuple[str, int] | None = None
    """The name server; None: the one of yarp.conf."""
    dialect: Dialect | None = None
    """`3` or `4`; None: probed by a link, 3 for a server."""
    robot: str = ""
    """First word of the port names, instead of the description's name: `icubSim`."""
    carrier: str = FAST_TCP.name
    """How skin and state come in."""
    skin: str = ""
    """`comp` to read the drift-compensated copies; raw otherwise."""
    without: tuple[str, ...] = ()
    """Patches that are left out, joined by +."""


def parse(text: str) -> YarpAddress:
    """Raises LinkError that says what is valid."""
    server = None
    found: dict[str, object] = {}
    for number, word in enumerate(part.strip() for part in text.split(",") if part.strip()):
        name, equals, value = word.partition("=")
        if not equals:
            if number:
                raise LinkError(f"{word!r} in yarp:{text}; valid: {_valid()}")
            server = parse_address(word)
        elif name == "dialect" and value in DIALECTS:
            found[name] = DIALECTS[value]
        elif name == "carrier" and value in CARRIERS:
            found[name] = value
        elif name == "skin" and value in ("raw", "comp"):
            found[name] = value.removeprefix("raw")
        elif name == "robot" and value.strip("/"):
            found[name] = value.strip("/")
        elif name == "without" and value:
            found[name] = tuple(value.split("+"))
        else:
            raise LinkError(f"{word!r} in yarp:{text}; valid: {_valid()}")
    assert found.keys() <= {field.name for field in fields(YarpAddress)}
    return YarpAddress(server=server, **found)  # type: ignore[arg-type]


def _valid() -> str:
    return (
        f"HOST:PORT first, then dialect={'|'.join(DIALECTS)}, robot=NAME, carrier={'|'.join(CARRIERS)}, "
        "skin=raw|comp, without=PATCH+PATCH, separated by commas"
    )


def patch_port(robot: Robot, prefix: str, patch: str) -> str:
    """The port of a patch's raw skin; the binding may say which."""
    usual = f"skin/{patch}"
    bindings = {binding.middleware: binding for binding in robot.bindings}
    return f"/{prefix}/{bindings['yarp'].address(patch, usual) if 'yarp' in bindings else usual}"
