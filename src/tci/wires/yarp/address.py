"""Address of a robot on YARP, the text after `yarp:` on the command line: `[HOST[:PORT]][,OPTION]...`."""

from __future__ import annotations

from dataclasses import dataclass, fields

from tci.errors import DriverError
from tci.robot.description import Patch, Robot, wire_name
from tci.wires.yarp.driver_errors import raises_driver_errors
from yarpwire.bindings.network import Bindings
from yarpwire.carrier import CARRIERS, FAST_TCP, TEXT, TEXT_ACK
from yarpwire.dialect import DIALECTS, Dialect
from yarpwire.names import parse_address
from yarpwire.network import Network
from yarpwire.wire import Wire

BINDINGS = "bindings"
EVENTS = "/skinManager/skin_events:o"


@dataclass(frozen=True, slots=True)
class YarpAddress:
    """Address of the name server, and options of the protocol."""

    server: tuple[str, int] | None = None
    """Host and port of the name server; None for the name server in YARP's file yarp.conf."""
    bindings: bool = False
    """True to send and receive messages with YARP's own Python bindings."""
    dialect: Dialect | None = None
    """Dialect of the protocol: YARP 3 or YARP 4. With None, a driver detects the dialect, and a server uses
    YARP 3."""
    robot: str = ""
    """First part of the port names, such as `icubSim`. If the text is empty, the name in the robot's
    description is used."""
    carrier: str = FAST_TCP.name
    """Name of YARP's carrier (transport protocol) for skin data and joint states."""
    skin: str = ""
    """`comp` to read drift-compensated skin values, empty to read raw skin values."""
    without: tuple[str, ...] = ()
    """Names of the patches that are not read. In the address, the names are separated by `+`."""
    events: str = EVENTS
    """Name of the port with skinManager's list of contacts. If it is empty, `tci serve` opens no such port,
    so that iCub's own skinManager can have the name."""

    def patches(self, robot: Robot) -> tuple[Patch, ...]:
        """Returns the patches that are read. Raises UnknownNameError if the option `without` names a patch
        that the robot lacks."""
        left_out = {robot.patch(name).name for name in self.without}
        return tuple(patch for patch in robot.skin if patch.name not in left_out)

    @raises_driver_errors
    def network(self) -> Network:
        """Returns an object that sends and receives messages, with YARP's Python bindings or with the package
        `yarpwire` alone.

        Raises DriverError if no name server is found, or if YARP's bindings are requested and do not support
        the chosen dialect. Raises MissingExtraError if YARP's bindings are requested and not installed.
        """
        network = Bindings(self.server) if self.bindings else Wire(self.server)
        if network.dialect not in (None, self.dialect or network.dialect):
            raise DriverError(f"{network.title}, support no other; valid: no `bindings`, then both")
        return network


@raises_driver_errors
def parse(text: str) -> YarpAddress:
    """Parses an address. Raises DriverError if the address is invalid; the error lists the valid options."""
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
        elif name == "events" and (value == "none" or value.startswith("/")):
            found[name] = value.removeprefix("none")
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
        f"carrier={'|'.join(CARRIERS)} (with {BINDINGS} any carrier of YARP but text), "
        "skin=raw|comp, without=PATCH+PATCH, events=/PORT|none, separated by commas"
    )


def patch_port(robot: Robot, prefix: str, patch: str) -> str:
    """Returns the name of the port with a patch's raw values.

    This is the name in the robot's binding to YARP or, without a name there, `/PREFIX/skin/PATCH`.
    """
    return f"/{prefix}/{robot.binding('yarp').address(patch, f'skin/{wire_name(patch)}')}"


def board_ports(robot: Robot, prefix: str) -> dict[str, str]:
    """Returns for each robot part the beginning of the port names of its control board.

    This is the name in the robot's binding to YARP or, without a name there, `/PREFIX/PART`.
    """
    binding = robot.binding("yarp")
    parts = dict.fromkeys(servo.robot_part for servo in robot.servos)
    return {part: f"/{prefix}/{binding.address(part, wire_name(part))}" for part in parts}
