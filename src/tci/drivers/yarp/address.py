"""What follows `yarp:` on the command line: `[HOST[:PORT]][,bindings][,dialect=3][,robot=NAME]...`."""

from __future__ import annotations

from dataclasses import dataclass, fields

from tci.drivers.yarp.driver_errors import raises_driver_errors
from tci.errors import DriverError
from tci.robot.description import Robot
from yarpwire.bindings.network import Bindings
from yarpwire.carrier import CARRIERS, FAST_TCP, TEXT, TEXT_ACK
from yarpwire.dialect import DIALECTS, Dialect
from yarpwire.names import parse_address
from yarpwire.network import Network
from yarpwire.wire import Wire

BINDINGS = "bindings"


@dataclass(frozen=True, slots=True)
class YarpAddress:
    """Where the name server is, and what is spoken."""

    server: tuple[str, int] | None = None
    """The name server; None: the one of yarp.conf."""
    bindings: bool = False
    """Whether YARP's own bindings carry the messages."""
    dialect: Dialect | None = None
    """`3` or `4`; None: probed by a driver, 3 for a server."""
    robot: str = ""
    """First word of the port names, instead of the description's name: `icubSim`."""
    carrier: str = FAST_TCP.name
    """How skin and state come in."""
    skin: str = ""
    """`comp` to read the drift-compensated copies; raw otherwise."""
    without: tuple[str, ...] = ()
    """Patches that are left out, joined by +."""

    @raises_driver_errors
    def network(self) -> Network:
        """Returns the network that carries the messages. Raises DriverError, MissingExtraError."""
        network = Bindings(self.server) if self.bindings else Wire(self.server)
        if network.dialect not in (None, self.dialect or network.dialect):
            raise DriverError(f"{network.title}, speak no other; without `bindings` TCI speaks both")
        return network


@raises_driver_errors
def parse(text: str) -> YarpAddress:
    """Raises DriverError that says what is valid."""
    server = None
    found: dict[str, object] = {}
    for number, word in enumerate(part.strip() for part in text.split(",") if part.strip()):
        name, equals, value = word.partition("=")
        if word == BINDINGS:
            found[BINDINGS] = True
        elif not equals:
            if number:
                raise DriverError(f"{word!r} in yarp:{text}; valid: {_valid()}")
            server = parse_address(word)
        elif name == "dialect" and value in DIALECTS:
            found[name] = DIALECTS[value]
        elif name == "carrier" and value:
            found[name] = value
        elif name == "skin" and value in ("raw", "comp"):
            found[name] = value.removeprefix("raw")
        elif name == "robot" and value.strip("/"):
            found[name] = value.strip("/")
        elif name == "without" and value:
            found[name] = tuple(value.split("+"))
        else:
            raise DriverError(f"{word!r} in yarp:{text}; valid: {_valid()}")
    carrier = str(found.get("carrier", FAST_TCP.name))
    if carrier in (TEXT.name, TEXT_ACK.name) if BINDINGS in found else carrier not in CARRIERS:
        raise DriverError(f"carrier={carrier} in yarp:{text}; valid: {_valid()}")
    assert found.keys() <= {field.name for field in fields(YarpAddress)}
    return YarpAddress(server=server, **found)  # type: ignore[arg-type] # each as parsed above


def _valid() -> str:
    return (
        f"HOST:PORT first, then {BINDINGS}, dialect={'|'.join(DIALECTS)}, robot=NAME, "
        f"carrier={'|'.join(CARRIERS)} (with {BINDINGS} whatever YARP has but text), "
        "skin=raw|comp, without=PATCH+PATCH, separated by commas"
    )


def patch_port(robot: Robot, prefix: str, patch: str) -> str:
    """The port of a patch's raw skin; the binding may say which."""
    usual = f"skin/{patch}"
    bindings = {binding.middleware: binding for binding in robot.bindings}
    return f"/{prefix}/{bindings['yarp'].address(patch, usual) if 'yarp' in bindings else usual}"
