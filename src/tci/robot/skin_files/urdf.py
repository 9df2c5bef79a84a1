"""Tactile sensors of a URDF: the `<sensor><tactile>` elements of ROS' tactile_toolbox.

```xml
<sensor name="palm" update_rate="100">
  <parent link="l_hand"/> <origin xyz="0 0 0.01" rpy="0 0 0"/>
  <tactile channel="hand"> <array rows="4" cols="6" size="0.003 0.003" spacing="0.004 0.004"/> </tactile>
</sensor>
```

Instead of an array, a sensor may have a list of `<taxel idx= xyz= rpy=>`; beside it, an array is ignored. The
z axis of a taxel is its normal. In an array, the row number increases along x, and the column number along y.
The format is documented at github.com/ubi-agni/tactile_toolbox (urdf_tactile).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from tci.errors import DescriptionError
from tci.messages.frames import Array, rotation_rpy, transform
from tci.robot.skin_files.layout import SkinLayout, hexagons, make_layout
from tci.robot.skin_files.text import MAX_BYTES, MAX_DISTANCE, MAX_ROWS
from tci.robot.xml.document import Faults, parse, read_bytes, refuse, shown
from tci.robot.xml.node import nearest

Channels = NDArray[np.intp]
ORDERS = ("row-major", "col-major", "column-major")
_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")


@dataclass(frozen=True, slots=True, eq=False)
class TactileSensor:
    """One tactile sensor of a URDF file."""

    name: str
    link: str
    """Parent link of the sensor. The layout is given in the frame of this link."""
    data: str
    """Name of the data vector (`channel`) to which the indices of the taxels refer."""
    rate: float | None
    """Frame rate [Hz]; None if the file does not give a rate."""
    layout: SkinLayout
    """Taxels of the sensor by channel, which is the index of the taxel. Channels without a taxel have no
    position."""


def read_tactile_sensors(path: str | Path) -> tuple[TactileSensor, ...]:
    """Reads all tactile sensors of a URDF file, and ignores other sensors.

    Raises DescriptionError with all faults, each with its line. Also raises it if the file has no tactile
    sensor.
    """
    source = str(path)
    try:
        root = parse(read_bytes(Path(path), limit=MAX_BYTES), source)
    except DescriptionError as error:
        fault = error.faults[0]
        message = fault.message.replace("an .xml file", "a .urdf file").replace("<generic_robot>", "<robot>")
        raise refuse(source, max(fault.line, 1), message) from error
    faults = Faults(source)
    links = {link.get("name", "") for link in _children(root, "link")}
    found = []
    for element in _children(root, "sensor"):
        if _children(element, "tactile"):
            sensor = _sensor(element, source, links, faults)
            if sensor is not None:
                found.append(sensor)
    if not found and not faults:
        faults.add(root.sourceline or 1, "no tactile sensor; valid: <sensor> with <tactile> in <robot>")
    faults.check()
    return tuple(found)


def read_skin_urdf(path: str | Path, *, sensor: str | None = None) -> SkinLayout:
    """Reads the taxels of one tactile sensor of a URDF file, in the frame of the sensor's parent link.

    If `sensor` is None, the file must contain only one sensor. Raises DescriptionError if the file has
    faults, or if it has no sensor with this name.
    """
    sensors = read_tactile_sensors(path)
    names = [one.name for one in sensors]
    if sensor is None and len(sensors) == 1:
        return sensors[0].layout
    if sensor not in names:
        what = "several tactile sensors" if sensor is None else f"no tactile sensor {shown(sensor)}"
        raise refuse(str(path), 1, f"{what}{nearest(sensor or '', names)}")
    return sensors[names.index(sensor)].layout


def _sensor(element: etree._Element, source: str, links: set[str], faults: Faults) -> TactileSensor | None:
    line = element.sourceline or 0
    name = element.get("name", "")
    parents = _children(element, "parent")
    link = parents[0].get("link", "") if parents else ""
    fine = True
    if not name or not link:
        faults.add(line, f"sensor {shown(name)} needs a name and a <parent link=...>")
        fine = False
    elif link not in links:
        faults.add(line, f"sensor {shown(name)}: no link {shown(link)}{nearest(link, links)}")
        fine = False
    origins = _children(element, "origin")
    pose = _pose(origins[0], faults) if origins else np.eye(4)
    tactile = _children(element, "tactile")[0]
    taxels, arrays = _children(tactile, "taxel"), _children(tactile, "array")
    rate = _numbers(element, "update_rate", 1, faults, most=1e5) if element.get("update_rate") else None
    if not taxels and len(arrays) != 1:
        faults.add(line, f"sensor {shown(name)} has no <taxel> and {len(arrays)} <array>; valid: taxels or "
                   "one array")  # fmt: skip
        return None
    found = _taxels(taxels, faults) if taxels else _array(arrays[0], faults)
    if found is None or pose is None or not fine:
        return None
    index, poses, area = found
    poses = pose @ poses
    n = 1 + int(index.max())
    rows = np.tile(np.zeros((4, 4)), (n, 1, 1))
    valid = np.zeros(n, dtype=bool)
    rows[index], valid[index] = poses, True
    positions = rows[:, :3, 3]
    layout = make_layout(
        source, positions, rows[:, :3, 2], valid, name=name, tangents=rows[:, :3, 0],
        areas=hexagons(positions, valid) if area is None else np.where(valid, area, 0.0),
    )  # fmt: skip
    channel = tactile.get("channel", name)
    return TactileSensor(name, link, channel, None if rate is None else float(rate[0]), layout)


def _array(element: etree._Element, faults: Faults) -> tuple[Channels, Array, float] | None:
    """Reads an element `<array>`, which describes a grid of equal taxels. Returns the channels (n,) of the
    taxels, their poses (n, 4, 4) in the sensor's frame, and the area [m2] of one taxel. Returns None for an
    invalid array."""
    line = element.sourceline or 0
    counts = [_count(element, key, faults, least=1, most=1024) for key in ("rows", "cols")]
    size = _numbers(element, "size", 2, faults)
    spacing = _numbers(element, "spacing", 2, faults) if element.get("spacing") is not None else size
    offset = _numbers(element, "offset", 2, faults) if element.get("offset") is not None else np.zeros(2)
    order = element.get("order", ORDERS[0])
    if order not in ORDERS:
        faults.add(line, f"order is {shown(order)}; valid: {', '.join(ORDERS)}")
        return None
    if None in counts or size is None or spacing is None or offset is None:
        return None
    rows, columns = (count or 0 for count in counts)
    if rows * columns > MAX_ROWS or not (size > 0.0).all() or not spacing.all():
        faults.add(
            line, f"array of {rows} x {columns}, size {size}, spacing {spacing}; valid: up to {MAX_ROWS} "
            "taxels, a size above 0 and a spacing that is not 0")  # fmt: skip
        return None
    index = np.arange(rows * columns)
    row, column = np.divmod(index, columns) if order == ORDERS[0] else np.divmod(index, rows)[::-1]
    places = np.column_stack([row, column]) * spacing - offset
    poses = np.tile(np.eye(4), (len(index), 1, 1))
    poses[:, :2, 3] = places
    return index, poses, float(size[0] * size[1])


def _taxels(elements: list[etree._Element], faults: Faults) -> tuple[Channels, Array, None] | None:
    """Returns the channels (n,) and poses (n, 4, 4) of taxels that a file lists one by one, in the sensor's
    frame, and None as their unknown area. Returns None if a taxel is invalid."""
    index, poses = [], []
    lines: dict[int, int] = {}
    for element in elements:
        line = element.sourceline or 0
        at = _count(element, "idx", faults, least=0, most=MAX_ROWS - 1)
        pose = _pose(element, faults)
        if at is None or pose is None:
            continue
        if at in lines:
            faults.add(line, f"taxel idx {at} is on line {lines[at]} already")
        lines[at] = line
        index.append(at)
        poses.append(pose)
    if len(index) < len(elements):
        return None
    return np.array(index), np.array(poses), None


def _pose(element: etree._Element, faults: Faults) -> Array | None:
    xyz = _numbers(element, "xyz", 3, faults) if element.get("xyz") is not None else np.zeros(3)
    rpy = _numbers(element, "rpy", 3, faults, most=12.6) if element.get("rpy") is not None else np.zeros(3)
    return None if xyz is None or rpy is None else transform(rotation_rpy(*rpy), xyz)


def _numbers(
    element: etree._Element, key: str, count: int, faults: Faults, *, most: float = MAX_DISTANCE
) -> Array | None:
    text = element.get(key, "")
    words = text.split()
    values = [float(word) if _NUMBER.fullmatch(word) else np.nan for word in words]
    if len(values) != count or not all(abs(value) <= most for value in values):
        what = f"{key} of <{_local(element)}> is {shown(text)}"
        faults.add(element.sourceline or 0, f"{what}; valid: {count} numbers from {-most:g} to {most:g}")
        return None
    return np.array(values)


def _count(element: etree._Element, key: str, faults: Faults, *, least: int, most: int) -> int | None:
    text = element.get(key, "")
    if not re.fullmatch(r"[0-9]{1,6}", text) or not least <= int(text) <= most:
        what = f"{key} of <{_local(element)}> is {shown(text)}"
        faults.add(element.sourceline or 0, f"{what}; valid: a whole number from {least} to {most}")
        return None
    return int(text)


def _local(element: etree._Element) -> str:
    return str(etree.QName(element).localname)


def _children(element: etree._Element, tag: str) -> list[etree._Element]:
    """Returns the child elements named `tag`, with or without an XML namespace."""
    return [child for child in element if isinstance(child.tag, str) and _local(child) == tag]
