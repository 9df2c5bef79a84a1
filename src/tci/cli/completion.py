"""Words that a shell completes. They are looked up without loading what they name, so that Tab is quick."""

from __future__ import annotations

from importlib.metadata import entry_points


def robots(incomplete: str) -> list[str]:
    """Names of robots; where none fits, the shell offers files."""
    from tci.robot.catalogue import robot_names

    return _beginning(incomplete, robot_names())


def drivers(incomplete: str) -> list[str]:
    """Names of drivers, without an address."""
    return _entries("tci.drivers", incomplete)


def servers(incomplete: str) -> list[str]:
    """Names of servers, without an address."""
    return _entries("tci.servers", incomplete)


def capabilities(incomplete: str) -> list[str]:
    """Names of capabilities."""
    return _entries("tci.capabilities", incomplete)


def _entries(group: str, incomplete: str) -> list[str]:
    return _beginning(incomplete, {point.name for point in entry_points(group=group)})


def _beginning(incomplete: str, names: tuple[str, ...] | set[str]) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete))
