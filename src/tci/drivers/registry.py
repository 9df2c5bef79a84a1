"""Drivers, servers and sources by name, found through the entry-point groups `tci.drivers`, `tci.servers` and
`tci.sources`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Literal, overload

from tci.drivers.combined import CombinedDriver
from tci.drivers.combined_server import JOIN, CombinedServer
from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.server import Server
from tci.drivers.source import Source
from tci.drivers.source_reader import SourceReader, said
from tci.drivers.sourced import FIRST, Address, SourcedDriver, patches_of
from tci.errors import DriverError, TciError, UnknownNameError
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot
from tci.support.installed import needs

if TYPE_CHECKING:
    from tci.drivers.simulated import SimulatedDriver  # loads MuJoCo

DRIVERS = "tci.drivers"
SERVERS = "tci.servers"
SOURCES = "tci.sources"


def driver_names() -> tuple[str, ...]:
    """Returns the names of the installed drivers, without addresses. These names are valid for the argument
    `via` of `connect`."""
    return tuple(sorted({point.name for point in entry_points(group=DRIVERS)}))


def server_names() -> tuple[str, ...]:
    """Returns the names of the installed servers, without addresses. `open_server` takes these names."""
    return tuple(sorted({point.name for point in entry_points(group=SERVERS)}))


def source_names() -> tuple[str, ...]:
    """Names of the installed sources of touch, which may stand after a driver: `sim + NAME:ADDRESS`."""
    return tuple(sorted({point.name for point in entry_points(group=SOURCES)}))


def load_source(name: str) -> type[Source]:
    """The class of the source `name`. Raises the errors of `load_driver`."""
    source: type[Source] = _load(SOURCES, "source", name)
    return source


def source_at(via: str) -> Source:
    """The source at `NAME:ADDRESS,option=value`, which knows its pads, but is not open.

    Raises the errors of `load_source`, and DriverError, with the address, for a device that must be asked for
    its pads and does not answer.
    """
    address = Address.of(via)
    source = address.make(load_source(address.name))
    try:
        source.find_pads()
    except (OSError, TciError) as error:
        raise DriverError(f"{via}: {said(error)}") from error
    return source


def load_driver(name: str) -> type[Driver]:
    """Returns the class of the driver with the entry point `name`.

    Raises UnknownNameError if the driver is not installed. Raises MissingExtraError if the library that the
    driver needs is not installed.
    """
    driver: type[Driver] = _load(DRIVERS, "driver", name)
    return driver


def load_server(name: str) -> Callable[..., Server]:
    """Returns the class of the server with the entry point `name`. Raises the errors of `load_driver`."""
    factory: Callable[..., Server] = _load(SERVERS, "server", name)
    return factory


@overload
def connect(
    robot: RobotLike, via: Literal["sim"] = "sim", *, arm: bool | None = None, **options: Any
) -> SimulatedDriver: ...
@overload
def connect(robot: RobotLike, via: str, *, arm: bool | None = None, **options: Any) -> Driver: ...
def connect(robot: RobotLike, via: str = "sim", *, arm: bool | None = None, **options: Any) -> Driver:
    """Opens a driver of `robot`, which may also be the name or path of a robot description.

    - `via` is "sim", or "NAME:ADDRESS" for drivers that need an address. With "DRIVER + DRIVER" the first
      driver reads and moves the joints, and the others read the skin. With "DRIVER + SOURCE" the driver does
      all that it does alone, and the source gives the patches that it feels. Without a source here, those
      that the description names for this driver are opened.
    - `arm`: a driver sends commands only if it is armed. By default, a driver of a simulation or a recording
      is armed, and a driver of a real robot is not armed.
    - `options` are passed to the first driver.

    Raises UnknownNameError if the driver is not installed or does not have one of the options. Raises
    MissingExtraError if the driver's library is not installed, DriverError if the robot can't be reached, and
    the errors of `load_robot`.
    """
    robot = as_robot(robot)
    if not isinstance(via, str):
        raise TciError(
            f"connect: a {type(via).__name__} as the name of a driver; valid: {', '.join(driver_names())}"
        )
    first, *others = via.split(JOIN)
    if arm is not None:
        options["arm"] = arm
    sources = _sources_of(robot, via)
    others = [one for one in others if one.partition(":")[0] not in source_names()]
    if sources:
        made = [(via, source_at(via)) for via in sources]
        known = inspect.signature(load_driver(first.partition(":")[0])).parameters
        if "paced" in known:
            options.setdefault("paced", True)  # a real sensor does not wait for a simulation
        if "felt" in known:  # a driver that leaves out the patches that it can't read
            options["felt"] = {
                patch.name
                for via, source in made
                for patch in patches_of(robot, Address.of(via), source).values()
            }
        inner = _join(robot, first, others, options)
        try:
            return SourcedDriver(inner, made)
        except BaseException:
            inner.close()
            raise
    return _join(robot, first, others, options)


def _join(robot: Robot, first: str, others: Sequence[str], options: Mapping[str, Any]) -> Driver:
    """Opens the driver `first`, which is moved, and those of the skin."""
    if not others:
        return _open(robot, first, **options)
    opened: list[Driver] = []
    try:
        opened.append(_open_half(robot, first, without="skin", **options))
        for other in others:
            opened.append(_open_half(robot, other, without="joints"))
        return CombinedDriver(opened[0], opened[1:])
    except BaseException:
        for driver in opened:
            driver.close()
        raise


def _sources_of(robot: Robot, via: str) -> list[str]:
    """The sources in `via`; without one, those that the description names for its first driver."""
    first, *others = via.split(JOIN)
    name = first.partition(":")[0]
    return [one for one in others if one.partition(":")[0] in source_names()] or [
        one for binding in robot.bindings if binding.middleware == name for one in binding.sources
    ]


def examine_sources(robot: Robot, via: str) -> tuple[Finding, ...]:
    """What can be said of each source in `via` alone, for a connection that can't be opened as a whole."""
    found: list[Finding] = []
    for one in _sources_of(robot, via):
        try:
            source = source_at(one)
            pads = patches_of(robot, Address.of(one), source)
            reader = SourceReader(one, source, {pad: patch.channels for pad, patch in pads.items()})
        except TciError as error:
            found.append(Finding(Level.FAULT, one, str(error)))
            continue
        reader.wait(FIRST)
        found += reader.diagnose()
        reader.close()
    return tuple(found)


def _open_half(robot: Robot, via: str, *, without: str, **options: Any) -> Driver:
    """Opens a driver for only the joints (`without` is "skin") or only the skin (`without` is "joints")."""
    if without not in inspect.signature(load_driver(via.partition(":")[0])).parameters:
        beside = f"; beside any driver: {', '.join(source_names())}" if without == "joints" else ""
        raise DriverError(
            f"{via} can't leave out its {without}; valid in a combined driver: naoqi, yarp{beside}"
        )
    return _open(robot, via, **{without: False}, **options)


def _open(robot: Robot, via: str, **options: Any) -> Driver:
    name, _, address = via.partition(":")
    factory: Any = load_driver(name)
    _check(options, factory, f"option of the driver {name!r}")
    driver: Driver = factory(robot, address, **options)
    return driver


def open_server(driver: Driver, via: str, **options: Any) -> Server:
    """Opens a server that makes the robot of `driver` available to other programs.

    `via` is "NAME" or "NAME:ADDRESS"; several servers are joined by " + ". `options` are passed to the first
    server. After this, run the server with `tci.runtime.serve`.

    Raises UnknownNameError if the server is not installed or does not have one of the options. Raises
    MissingExtraError if the library that the server needs is not installed, and DriverError if the server
    can't listen at the address.
    """
    opened: list[Server] = []
    try:
        for one in via.split(JOIN):
            name, _, address = one.partition(":")
            factory = load_server(name)
            _check(options, factory, f"option of the server {name!r}")
            opened.append(factory(driver, address, **options))
            options = {}
    except BaseException:
        for server in opened:
            server.close()
        raise
    return opened[0] if len(opened) == 1 else CombinedServer(opened)


def _check(options: Iterable[str], factory: Any, what: str) -> None:
    """Raises UnknownNameError if the class `factory` of a driver or server lacks one of the options. `what`
    describes the options in the message."""
    parameters = inspect.signature(factory).parameters.values()
    if any(one.kind is one.VAR_KEYWORD for one in parameters):
        return  # the factory accepts any option and checks the options itself
    valid = [one.name for one in parameters if one.kind is one.KEYWORD_ONLY]
    for name in options:
        if name not in valid:
            raise UnknownNameError(what, name, valid)


def _load(group: str, what: str, name: str) -> Any:
    points = {point.name: point for point in entry_points(group=group)}
    if name not in points:
        valid = sorted(points)
        if "." in name or "/" in name:
            valid.append(f"and behind one of them an address: naoqi://{name}, yarp:{name}")
        raise UnknownNameError(what, name, valid)
    point = points[name]
    with needs(f"the {what} {name!r}", name, of=point.dist):
        return point.load()
