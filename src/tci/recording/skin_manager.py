"""The iCub's conventions for contacts. TCI uses these conventions to compare its results with the results of
skinManager.

A contact is a set of taxels linked by distances of up to skinManager's maxNeighborDist (single-link
clusters). The geometric centre of a contact is the mean of its taxels' positions. The pressure of a contact
is the mean of its taxels' values. The force of a contact is -0.05 N times the number of taxels times the
pressure, along the mean normal. The code was written from these conventions, without any code of skinManager.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tci.errors import FrameError
from tci.messages.frames import Array, read_only

NEIGHBOUR = 0.012
"""Default of the largest distance [m] between neighbouring taxels (skinManager's maxNeighborDist). Some
robots use other values."""
FORCE = 0.05
"""Factor for the force [N] of a contact in skinManager: force = FORCE * number of taxels * mean of the
taxels' values."""
SKIN_PARTS = (
    "unknown", "left_hand", "left_forearm", "left_arm", "right_hand", "right_forearm", "right_arm", "torso",
    "left_leg_upper", "left_leg_lower", "left_foot", "right_leg_upper", "right_leg_lower", "right_foot",
)  # fmt: skip
"""Names of the skin parts in the order of their numbers."""
LONGEST_LINE = 1_000_000
"""Longest line [characters] that is read. Assumed: a line with 30 contacts has 20 000 characters."""
_TOKEN = re.compile(r"\s*(\(|\)|[^\s()]+)")
_DEEPEST = 8


@dataclass(frozen=True, slots=True, eq=False)
class SkinContact:
    """One contact as skinManager describes it.

    Positions and vectors are in the frame of the skin part's position file.
    """

    id: int
    """Number of the contact, constant from its beginning to its end. Each new contact gets a higher
    number."""
    body_part: int
    """Body part: 1 torso, 2 head, 3 and 4 arms, 5 and 6 legs."""
    link: int
    """Number of the link in the body part."""
    skin_part: int
    """Number of the skin part: the index of its name in SKIN_PARTS."""
    centre: Array
    """Centre of pressure (3,) [m]."""
    force: Array
    """Force (3,) [N]."""
    moment: Array
    """Moment (3,) [N m]."""
    geometric_centre: Array
    """Mean of the taxels' positions (3,) [m]."""
    normal: Array
    """Mean of the taxels' normals (3,), not normalised."""
    taxels: NDArray[np.intp]
    """Indices (n,) of the contact's taxels in the skin part."""
    pressure: float
    """Mean of the taxels' values."""


def contact_force(taxels: int, pressure: float, normal: Array) -> Array:
    """Returns the force (3,) [N] of a contact: F = -0.05 n p normal.

    In this formula, n is `taxels` (the number of taxels) and p is `pressure`.
    """
    force: Array = -FORCE * taxels * pressure * normal
    return force


def partition(
    positions: Array, taxels: NDArray[np.intp], *, neighbour: float = NEIGHBOUR
) -> list[NDArray[np.intp]]:
    """Divides active taxels into contacts (single-link clusters).

    `taxels` (k,) are the active taxels, and `positions` (n, 3) [m] the positions of all taxels. Taxels are
    linked if their distance is at most `neighbour` [m]. Each contact lists its taxels in ascending order. The
    contacts are ordered by the lowest index of a taxel.
    """
    active = np.unique(taxels)
    pairs = cKDTree(positions[active]).query_pairs(neighbour, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(active), len(active)))
    count, labels = connected_components(graph, directed=False)
    found = [active[labels == label] for label in range(count)]
    return sorted(found, key=lambda cluster: int(cluster[0]))


def read_skin_events(path: Path) -> Iterator[tuple[float, tuple[SkinContact, ...]]]:
    """Yields the contacts of each line in a log of /skinManager/skin_events:o from yarpdatadumper.

    Each item consists of the stamp [s] and the contacts. If a line contains anything else, raises FrameError
    with the line's number.
    """
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), start=1):
            if line.isspace():
                continue
            try:
                yield _parse_line(line)
            except (ValueError, IndexError, TypeError, OverflowError) as error:
                raise FrameError(
                    f"{path}, line {number}: {error}; valid: index, stamp, and contacts "
                    "((id body link skin) (CoP) (F) (M) (centre) (normal) (taxels) pressure)"
                ) from error


def _parse_line(line: str) -> tuple[float, tuple[SkinContact, ...]]:
    if len(line) > LONGEST_LINE:
        raise ValueError(f"longer than {LONGEST_LINE} characters")
    _, stamp, *contacts = _parse(line)
    if not np.isfinite(float(stamp)):
        raise ValueError(f"stamp {stamp}")
    return float(stamp), tuple(_contact(contact) for contact in contacts)


def _contact(fields: list[Any]) -> SkinContact:
    (id, body, link, skin), *vectors, taxels, pressure = fields
    if len(vectors) != 5 or not all(isinstance(field, list) for field in (*vectors, taxels)):
        raise ValueError(f"a contact of {len(fields)} fields, or a number where a list belongs")
    numbers = [read_only([float(value) for value in vector]) for vector in vectors]
    if any(vector.shape != (3,) or not np.isfinite(vector).all() for vector in numbers):
        raise ValueError("a vector that has not 3 finite numbers")
    if not np.isfinite(float(pressure)):
        raise ValueError(f"pressure {pressure}")
    if not 0 <= int(skin) < len(SKIN_PARTS):
        raise ValueError(f"skin part {skin}")
    indices = read_only([int(taxel) for taxel in taxels], np.intp)
    if (indices < 0).any():
        raise ValueError("a taxel below 0")
    centre, force, moment, geometric_centre, normal = numbers
    return SkinContact(
        id=int(id), body_part=int(body), link=int(link), skin_part=int(skin), centre=centre, force=force,
        moment=moment, geometric_centre=geometric_centre, normal=normal, taxels=indices,
        pressure=float(pressure),
    )  # fmt: skip


def _parse(text: str) -> list[Any]:
    """Parses a YARP bottle (a message that consists of nested lists) in text form into strings and nested
    lists."""
    stack: list[list[Any]] = [[]]
    for token in _TOKEN.findall(text):
        if token == "(":
            stack.append([])
            if len(stack) > _DEEPEST:
                raise ValueError("lists nested too deep")
        elif token == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token)
    if len(stack) != 1:
        raise ValueError("a list that is not closed")
    return stack[0]
