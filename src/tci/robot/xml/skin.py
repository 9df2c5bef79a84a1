"""Reader of the element `skin`: patches, their sensors, and the elements that define the positions of taxels
(eqs 3-4)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np

from tci.robot.description import (
    THROUGH_JOINTS,
    Grid,
    Patch,
    Sensor,
    Table,
    TriangularModules,
    TruncatedCone,
)
from tci.robot.xml.document import Faults
from tci.robot.xml.grammar import SENSORS, SURFACES
from tci.robot.xml.model import beside
from tci.robot.xml.node import Node, listed, nearest
from tci.robot.xml.servos import NAMELESS, once_only

PER_MODULE = 12
"""Channels of a triangular module: ten taxels and two thermal pads."""


def read_skin(root: Node, source: Path, faults: Faults) -> tuple[Patch, ...]:
    """Reads the skin patches of the file `source`."""
    skin = root.first("skin")
    if skin is None:
        return ()
    segments = {
        part.get("name", NAMELESS): [segment.get("name", NAMELESS) for segment in part.all("segment")]
        + [NAMELESS] * part.misspelt
        for part in root.all("generic_robot_part")
    }
    patches = []
    for node in once_only(skin.all("patch"), "name", "patch with", faults):
        _check_place(node, segments, faults)
        sensor = _sensor(node, faults)
        surface = _surface(node, source, _places(node), faults)
        if node.ok and sensor is not None and surface is not None:
            patches.append(Patch(**node.fields, sensor=sensor, surface=surface))
    return tuple(patches)


def _check_place(node: Node, segments: dict[str, list[str]], faults: Faults) -> None:
    part, segment = node.get("part"), node.get("segment")
    if part is not None and part not in segments and NAMELESS not in segments:
        faults.add(node.line, f"no generic_robot_part named {part!r}{nearest(part, segments)}")
    elif segment is not None and not {segment, NAMELESS} & {*segments.get(part, (NAMELESS,))}:
        faults.add(node.line, f"{part!r} has no segment {segment!r}{nearest(segment, segments[part])}")


def _sensor(patch: Node, faults: Faults) -> Sensor | None:
    found = _only_one(patch, SENSORS, "sensor", faults)
    if found is None or not found.ok:
        return None
    return THROUGH_JOINTS if found.tag == "felt_through_joints" else _of_taxels(found, faults)


def _only_one(patch: Node, ways: Iterable[str], what: str, faults: Faults) -> Node | None:
    """Returns the only child of a patch that has one of the tags `ways`. If there is no such child or more
    than one, records a fault and returns None."""
    found = [tag for tag in ways if patch.all(tag)]
    if len(found) == 1:
        return patch.all(found[0])[0]
    if not found and not patch.ok:
        return None  # a misspelt element may be the missing one
    has = " and ".join(f"<{tag}>" for tag in found) or f"no {what}"
    faults.add(patch.line, f"patch {patch.get('name', '?')!r} has {has}; valid: one of {listed(ways)}")
    return None


def _of_taxels(node: Node, faults: Faults) -> Sensor:
    rest, slope, lowest, highest = (node.get(key) for key in ("rest", "pascal_per_count", "min", "max"))
    if lowest >= highest:
        faults.add(node.line, f"sensor: min {lowest:g} must be below max {highest:g}")
    elif not lowest <= rest <= highest:
        faults.add(node.line, f"sensor: rest {rest:g} is outside min {lowest:g} to max {highest:g}")
    elif slope == 0.0 or (rest == lowest and slope < 0.0) or (rest == highest and slope > 0.0):
        faults.add(
            node.line,
            f"sensor: with pascal_per_count {slope:g} and rest {rest:g} no raw value from {lowest:g} to "
            f"{highest:g} is a pressure above 0",
        )
    return Sensor(**node.fields | {"axes": _axes(node, faults)}, response=_response(node, faults))


def _axes(sensor: Node, faults: Faults) -> Literal[1, 3]:
    axes = sensor.get("axes", 1)
    if axes == 2 or (axes == 1 and sensor.get("shear_pascal_per_count") is not None):
        faults.add(sensor.line, f"sensor: axes {axes}; valid: 1, or 3 with or without shear_pascal_per_count")
    return 3 if axes == 3 else 1


def _response(sensor: Node, faults: Faults) -> tuple[tuple[float, float], ...]:
    """Returns the points of a sensor's response curve: deviation from rest [counts] and pressure [Pa] of each
    point. The result is empty if there is no valid curve."""
    node = sensor.first("response")
    if node is None:
        return ()
    points = [(point.get("counts"), point.get("pressure")) for point in node.all("point") if point.ok]
    steps = np.diff(points, axis=0) if len(points) > 1 else np.zeros((0, 2))
    if len(points) < 2 or points[0] != (0.0, 0.0) or not np.all(steps > 0.0):
        faults.add(node.line, "response: valid are 2 points or more, from 0 counts and 0 Pa, both rising")
        return ()
    return tuple(points)


def _places(patch: Node) -> int | None:
    """Returns the number of taxels for which a patch has channels: the number of channels divided by the
    number of channels per taxel. Returns None if one of these numbers is missing or invalid."""
    channels, sensor = patch.get("channels"), patch.first("sensor")
    axes = 1 if sensor is None else sensor.get("axes", 1)
    return None if channels is None or axes is None else channels // axes


def _surface(
    patch: Node, source: Path, channels: int | None, faults: Faults
) -> TruncatedCone | Grid | TriangularModules | Table | None:
    node = _only_one(patch, SURFACES, "surface", faults)
    if node is None:
        return None
    if node.tag == "truncated_cone":
        _check_count(node, "rings", "per_ring", channels, faults)
        return TruncatedCone(**node.fields) if node.ok else None
    if node.tag == "grid":
        _check_count(node, "rows", "columns", channels, faults)
        return Grid(**node.fields) if node.ok else None
    if node.tag == "triangular_modules":
        return _modules(node, channels, faults)
    path = beside(node, source, "table", faults)
    if path is None or not node.ok:
        return None
    return Table(**node.fields | {"file": str(path)})


def _check_count(node: Node, outer: str, inner: str, channels: int | None, faults: Faults) -> None:
    lines, each = node.get(outer), node.get(inner)
    if None not in (lines, each, channels) and lines * each != channels:
        faults.add(
            node.line,
            f"{lines} {outer} of {each} are {lines * each} taxels, the patch has {channels} channels",
        )


def _modules(node: Node, channels: int | None, faults: Faults) -> TriangularModules | None:
    modules = once_only(node.all("module"), "port", "module with", faults)
    once_only(modules, "frame", "module with", faults)
    for module in modules:
        port = module.get("port")
        if port is not None and channels is not None and PER_MODULE * (port + 1) > channels:
            valid = f"0 to {channels // PER_MODULE - 1}" if channels >= PER_MODULE else "none"
            faults.add(
                module.line,
                f"port {port} takes channels {PER_MODULE * port} to {PER_MODULE * port + PER_MODULE - 1}, "
                f"but the patch has {channels}; valid ports: {valid}",
            )
    if not node.ok:
        return None
    return TriangularModules(
        frames=tuple(module.get("frame") for module in modules),
        ports=tuple(module.get("port") for module in modules),
        turns=tuple(module.get("turn", 0.0) for module in modules),
    )
