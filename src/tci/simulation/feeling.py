"""What patches feel of the contacts on them, in compiled loops: from MuJoCo's sensors to channels."""

from __future__ import annotations

import math

from numba import int64

from tci.frames import Array
from tci.interface.kernels.arrays import reads, writes
from tci.interface.kernels.compiled import compiled, inlined
from tci.simulation import kernel
from tci.simulation.kernel import spread_into

SLOTS = 16
"""Contacts on one patch at a time. A finger makes one."""
FOUND, FORCE, POSITION, NORMAL, TANGENT = 0, 1, 4, 7, 10
"""Places in a slot: how many contacts there are; 3 each of force (along normal, tangent and the third axis),
position, normal and tangent."""
NUMBERS = 13
"""Numbers per slot."""
WIDE = 0.02
"""[m]; far wider than a taxel. Ours."""
SENSOR, FLOOR, BODY, BEGIN, END, CHANNEL, CHANNELS, NODE, NODES, AXES, COUNT, DUE, TAKEN, TOUCHED = range(14)
"""Columns of a patch's whole numbers: its slots in `sensordata`, what a floor does to it there or -1, its
link; its taxels; its first channel and how many; its response's nodes; axes; of its latest frame: its number,
the step in which the next is due and the step in which it was taken, contacts."""
REST, PER_COUNT, SHEAR_PER_COUNT, RATE, WIDTH, SIZE, OUTWARD = range(7)
"""Columns of a patch's numbers (9): the sensor's [count], [Pa/count]; frames per step; width of the kernel
and half its longest side [m]; the mean of its normals (3)."""
X, Y, AREA = 0, 3, 6
"""Columns of a taxel (7): its tangents, its area [m2]."""


@inlined
def _share(positions: Array, point: Array, normal: Array, sigma: float, shares: Array) -> None:
    """`spread` over the taxels; a wide one is aimed twice, since its softness is in widths."""
    spread_into(positions, point, normal, sigma, shares)
    if sigma > WIDE:
        x, y, z = point[0], point[1], point[2]
        for k in range(len(positions)):
            x -= shares[k] * positions[k, 0]
            y -= shares[k] * positions[k, 1]
            z -= shares[k] * positions[k, 2]
        along = x * normal[0] + y * normal[1] + z * normal[2]
        point[0] += x - along * normal[0]
        point[1] += y - along * normal[1]
        point[2] += z - along * normal[2]
        spread_into(positions, point, normal, sigma, shares)


@inlined
def press(
    patch: int,
    sensors: Array,
    centres: Array,
    turns: Array,
    patches: Array,
    sizes: Array,
    positions: Array,
    taxels: Array,
    total: Array,
    shares: Array,
) -> int:
    """Write the force (3, taxels) [N] on each taxel of a patch, along its x and y axes and pressing.

    Returns how many contacts there are, a floor's only where there is no other; nothing is written where
    there are none, or more than slots.
    """
    words, size = patches[patch], sizes[patch]
    start, begin, end, body = words[SENSOR], words[BEGIN], words[END], words[BODY]
    found, floor = int(sensors[start + FOUND]), words[FLOOR]
    carried = floor >= 0 and sensors[floor + FOUND] > 0.0
    if (found == 0 and not carried) or found > SLOTS:
        return int(found)
    for k in range(end - begin):
        total[0, k] = total[1, k] = total[2, k] = 0.0
    if carried:
        # A floor presses a padded sole all over, not in the corners of its hull.
        x = sensors[floor + POSITION] - centres[body, 0]
        y = sensors[floor + POSITION + 1] - centres[body, 1]
        z = sensors[floor + POSITION + 2] - centres[body, 2]
        point, normal, pressing = shares[1, :3], size[OUTWARD : OUTWARD + 3], 0.0
        for i in range(3):
            a, b, c = turns[body, i], turns[body, 3 + i], turns[body, 6 + i]
            point[i] = a * x + b * y + c * z
            force = (
                a * sensors[floor + FORCE] + b * sensors[floor + FORCE + 1] + c * sensors[floor + FORCE + 2]
            )
            pressing += force * normal[i]
        _share(positions[begin:end], point, normal, size[SIZE], shares[0])
        for k in range(end - begin):
            total[2, k] += abs(pressing) * shares[0, k]
    for number in range(found):
        slot = sensors[start + NUMBERS * number : start + NUMBERS * (number + 1)]
        # Seen from the link: R^T (p - c), for directions R^T d.
        px = slot[POSITION] - centres[body, 0]
        py = slot[POSITION + 1] - centres[body, 1]
        pz = slot[POSITION + 2] - centres[body, 2]
        point, way, tangent = shares[1, :3], shares[1, 3:6], shares[1, 6:9]
        for i in range(3):
            a, b, c = turns[body, i], turns[body, 3 + i], turns[body, 6 + i]
            point[i] = a * px + b * py + c * pz
            way[i] = a * slot[NORMAL] + b * slot[NORMAL + 1] + c * slot[NORMAL + 2]
            tangent[i] = a * slot[TANGENT] + b * slot[TANGENT + 1] + c * slot[TANGENT + 2]
        _share(positions[begin:end], point, way, size[WIDTH], shares[0])
        pressing = slot[FORCE]
        for k in range(end - begin):
            total[2, k] += pressing * shares[0, k]
        if words[AXES] == 3:
            first, second = slot[FORCE + 1], slot[FORCE + 2]
            third_x = way[1] * tangent[2] - way[2] * tangent[1]
            third_y = way[2] * tangent[0] - way[0] * tangent[2]
            third_z = way[0] * tangent[1] - way[1] * tangent[0]
            x = -(first * tangent[0] + second * third_x)
            y = -(first * tangent[1] + second * third_y)
            z = -(first * tangent[2] + second * third_z)
            for k in range(end - begin):
                row, share = taxels[begin + k], shares[0, k]
                total[0, k] += share * (row[X] * x + row[X + 1] * y + row[X + 2] * z)
                total[1, k] += share * (row[Y] * x + row[Y + 1] * y + row[Y + 2] * z)
    return max(int(found), 1)


@inlined
def _counts(pressure: float, begin: int, end: int, nodes: Array, per_count: float) -> float:
    """Deviation from rest [counts] of a pressure [Pa]; see `Sensor.counts`."""
    if begin == end:
        return pressure / abs(per_count)
    pressure = max(pressure, nodes[1, begin])
    k = begin
    while k < end - 2 and pressure > nodes[1, k + 1]:
        k += 1
    slope = (nodes[0, k + 1] - nodes[0, k]) / (nodes[1, k + 1] - nodes[1, k])
    return nodes[0, k] + slope * (pressure - nodes[1, k])  # type: ignore[no-any-return]


@inlined
def feel(
    patch: int,
    step: int,
    sensors: Array,
    centres: Array,
    turns: Array,
    patches: Array,
    sizes: Array,
    positions: Array,
    taxels: Array,
    channels: Array,
    nodes: Array,
    total: Array,
    shares: Array,
    values: Array,
) -> int:
    """Take a patch's next frame, at the end of a step: the values [counts] of its channels, not rounded.

    Returns how many contacts there are; only where there are some are values written."""
    words, size = patches[patch], sizes[patch]
    found = press(patch, sensors, centres, turns, patches, sizes, positions, taxels, total, shares)
    words[COUNT] += 1
    words[DUE] = max(math.ceil((words[COUNT] + 1) / size[RATE] - 1e-6), step + 1)
    words[TAKEN], words[TOUCHED] = step, found
    if found == 0 or found > SLOTS:
        return int(found)
    begin, channel = words[BEGIN], words[CHANNEL]
    for k in range(channel, channel + words[CHANNELS]):
        values[k] = size[REST]
    sign = 1.0 if size[PER_COUNT] > 0.0 else -1.0
    for k in range(words[END] - begin):
        area = taxels[begin + k, AREA]
        pressed = sign * _counts(total[2, k] / area, words[NODE], words[NODES], nodes, size[PER_COUNT])
        place = channels[begin + k]
        if words[AXES] == 3:
            at = channel + 3 * place
            values[at] += total[0, k] / area / size[SHEAR_PER_COUNT]
            values[at + 1] += total[1, k] / area / size[SHEAR_PER_COUNT]
            values[at + 2] += pressed
        else:
            values[channel + place] += pressed
    return int(found)


SKIN = (
    reads(1), reads(2), reads(2), writes(2, int64), reads(2), reads(2), reads(2), reads(1, int64), reads(2),
    writes(2), writes(2), writes(1),
)  # fmt: skip
"""Types of what `feel` takes after patch and step."""


@compiled(int64(int64, *SKIN), calls=(kernel,))
def look(
    patch: int,
    sensors: Array,
    centres: Array,
    turns: Array,
    patches: Array,
    sizes: Array,
    positions: Array,
    taxels: Array,
    channels: Array,
    nodes: Array,
    total: Array,
    shares: Array,
    values: Array,
) -> int:
    """`press`, for those who ask between steps."""
    return press(patch, sensors, centres, turns, patches, sizes, positions, taxels, total, shares)  # type: ignore[no-any-return]


@compiled(int64(int64, int64, *SKIN), calls=(kernel,))
def begin(
    patch: int,
    step: int,
    sensors: Array,
    centres: Array,
    turns: Array,
    patches: Array,
    sizes: Array,
    positions: Array,
    taxels: Array,
    channels: Array,
    nodes: Array,
    total: Array,
    shares: Array,
    values: Array,
) -> int:
    """`feel`, for the first frame."""
    return feel(  # type: ignore[no-any-return]
        patch, step, sensors, centres, turns, patches, sizes, positions, taxels, channels, nodes, total,
        shares, values,
    )  # fmt: skip
