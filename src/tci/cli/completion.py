"""Shell completion of the names of robots, drivers, servers and capabilities. Completion reads only entry
points and file names, and imports no driver, so that the shell responds quickly to the Tab key."""

from __future__ import annotations

from importlib.metadata import entry_points


def robots(incomplete: str) -> list[str]:
    """Returns the names of robots that begin with `incomplete`. If no name begins with `incomplete`, the
    shell offers file names."""
    from tci.robot.catalogue import robot_names

    return _beginning(incomplete, robot_names())


def drivers(incomplete: str) -> list[str]:
    """Returns the names of drivers that begin with `incomplete`, without addresses."""
    return _entries("tci.drivers", incomplete)


def servers(incomplete: str) -> list[str]:
    """Returns the names of servers that begin with `incomplete`, without addresses."""
    return _entries("tci.servers", incomplete)


def capabilities(incomplete: str) -> list[str]:
    """Returns the names of capabilities that begin with `incomplete`."""
    return _entries("tci.capabilities", incomplete)


def _entries(group: str, incomplete: str) -> list[str]:
    return _beginning(incomplete, {point.name for point in entry_points(group=group)})


def _beginning(incomplete: str, names: tuple[str, ...] | set[str]) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete))
