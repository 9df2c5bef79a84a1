"""Links by name, found through the entry-point group `tci.links`."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from tci.errors import MissingExtraError, UnknownNameError
from tci.middleware.link import Link
from tci.model.description import Robot

GROUP = "tci.links"


def link_names() -> tuple[str, ...]:
    """Names that `connect` takes, without an address."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def connect(robot: Robot, via: str = "sim", *, arm: bool | None = None, **options: Any) -> Link:
    """Open a link to `robot`: "sim", or "NAME:ADDRESS" for those that need an address.

    A simulated robot is armed from the start, a real one only by `arm=True`. `options` go to the
    link. Raises UnknownNameError for a link that is not installed, MissingExtraError when its
    library is not, LinkError when the robot can't be reached.
    """
    name, _, address = via.partition(":")
    points = {point.name: point for point in entry_points(group=GROUP)}
    if name not in points:
        raise UnknownNameError("link", name, sorted(points))
    try:
        factory = points[name].load()
    except ModuleNotFoundError as error:
        if error.name is not None and error.name.split(".")[0] == "tci":
            raise
        raise MissingExtraError(f"the link {name!r}", name) from error
    if arm is not None:
        options["arm"] = arm
    link: Link = factory(robot, address, **options)
    return link
