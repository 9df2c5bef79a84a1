"""Turns MuJoCo's contact sensors into channel values of all patches, in compiled loops."""

from __future__ import annotations

import math

import numpy as np
from numba import from_dtype, int64

from tci.messages.frames import Array
from tci.simulation.hand_control import FLAT, SENSOR, WIDTH
from tci.simulation.hand_control import NUMBERS as HAND_NUMBERS
from tci.simulation.hand_control import SLOTS as HAND_SLOTS
from tci.simulation.kernel import ACROSS, LOGARITHM, REACH, ROWS, SHARE, UP, share_into, within
from tci.support.compiled import compiled, inlined, reads, returns, writes

SLOTS = 16
"""Largest number of contacts on one patch at a time. Assumed: the simulated finger makes far fewer
contacts."""
FOUND, FORCE, POSITION, NORMAL, TANGENT = 0, 1, 4, 7, 10
"""Indices of the data among the 13 numbers with which MuJoCo's contact sensor describes one contact. The
first number is the number of contacts on the patch. Four vectors follow, with 3 numbers each: force [N]
(along normal, tangent and third axis), position [m], normal and tangent."""
NUMBERS = 13
"""Number of values with which MuJoCo's contact sensor describes one contact."""
WIDE = 0.02
"""If a contact force is distributed over a width [m] above this value, its distribution on the taxels is
computed a second time, which corrects an error of the first result. Assumed: this is far above the width of a
taxel."""
SIDE = 0.2
"""Least cosine of the angle between a contact's outward normal and the mean normal of the taxels near the
contact; the taxels measure no contact with a smaller cosine. Such a contact is on an end of a limb's skin, or
on the rim or the back of a sheet, where there are no taxels. Assumed: on the skin of the included robots,
this cosine is below 0.2 on these ends, and above 0.7 at almost all other places."""
_F, _I = np.float64, np.int64
PATCH = np.dtype([
    *[(name, _I) for name in ("sensor", "floor", "body", "begin", "end", "channel", "node", "nodes", "axes")],
    *[(name, _I) for name in ("count", "due", "taken", "touched", "pressed")],
    *[(name, _F) for name in ("rest", "per_count", "shear_per_count", "rate", "width", "size")],
    ("outward", _F, (3,)),
])  # fmt: skip
"""One patch of skin:

- `sensor`, `floor`: index in MuJoCo's `sensordata` of the first value of the patch's contact sensor and of
  its floor sensor; `floor` is -1 if there is no floor sensor.
- `body`: index of the patch's link in the model.
- `begin`, `end`: index of the patch's first taxel, and of its last taxel + 1, among the taxels of all
  patches.
- `channel`: index of the patch's first channel among the channels of all patches.
- `node`, `nodes`: index of the first point of the sensor's response curve, and of its last point + 1; both
  are equal if there is no curve.
- `axes`: number of values that a taxel measures: 1, or 3 with tangential stress.
- `count`, `due`: sequence number of the latest frame, and number of the simulation step of the next frame.
- `taken`, `touched`, `pressed`: number of the simulation step, number of contacts and number of active taxels
  of the latest frame.
- `rest`: rest value [counts] of the sensor.
- `per_count`, `shear_per_count`: scales [Pa/count] of the sensor, for pressure and for tangential stress.
- `rate`: number of frames per simulation step.
- `width`, `size`: widths [m] over which a contact force and a force of the floor are distributed on the
  taxels. `size` is half of the patch's longest side.
- `outward`: direction of the patch's mean outward normal."""
X, Y, AREA, DENSE = 0, 3, 6, 7
"""First columns of the data in the table of taxels (8 columns): two tangents x and y of the skin at the
taxel with 3 numbers each, the area [m2] on which a force at a point acts, and 1 for a taxel of a dense skin
(`fill_factor.is_surface`)."""
PRESSING, MARK = 2, 3
"""Two of the four rows of the table `load`, which has one column for each taxel. The rows are: force [N] on
the taxel along its tangents x and y and along its normal (`PRESSING`), and 1 for an active taxel or 0 for
another taxel (`MARK`)."""
ALL, NEAR, ACTIVE, LATEST, AROUND = range(5)
"""Rows of the table `lists`. Each row contains a list of taxels for each patch. A taxel is given by its index
within the patch.

- `ALL`: all taxels.
- `NEAR`: the taxels on which the force of the present contact is distributed.
- `ACTIVE`, `LATEST`: the active taxels now, and in the latest frame.
- `AROUND`: first of several rows with the taxels around one contact each. There are `SLOTS` such rows, and a
  last row for contact with the floor."""
CENTRE, RADIUS, MEMBERS = 0, 3, 4
"""Columns of a table with one row for each contact of a patch. The row describes the sphere whose taxels are
in the contact's list `AROUND`: its centre [m] (3 columns), its radius [m] and the number of its
taxels."""
SKIN = returns(
    reads(1), reads(2), reads(2), writes(1, from_dtype(PATCH)), reads(2), reads(2), reads(1, int64), reads(2),
    writes(2), writes(2, int64), writes(2), writes(2), writes(1), reads(2),
)  # fmt: skip
"""Numba types of `skin`, the tuple of arrays from which compiled loops compute the frames of all patches. Its
elements, in this order:

- MuJoCo's sensors, and positions and orientations of links.
- Patches (`PATCH`).
- Positions [m] of taxels, their tangents, areas and kinds (see `X`), and their channels.
- Points of response curves, forces on taxels (see `PRESSING`), lists of taxels (see `ALL`), and spheres
  around contacts (see `CENTRE`).
- Work space (see `kernel.SHARE`), and values [counts] of the channels.
- Hands of people, see `hand_control.WIDTH`."""
Arrays = tuple[Array, ...]
_SLACK = 1.0
"""Distance, as a multiple of the width over which a force is distributed, that a contact may move before the
list of taxels around the contact is renewed (Verlet 1967). Assumed: a larger distance makes the lists longer;
with a smaller distance, lists are renewed more often."""


@inlined
def _share(
    positions: Array,
    point: Array,
    normal: Array,
    sigma: float,
    lists: Array,
    row: int,
    spot: Array,
    work: Array,
) -> int:
    """Distributes a contact force on the taxels of a patch: finds the taxels that get a part of the force,
    and the fraction (share) of the force on each of them.

    Writes these taxels into the row `NEAR` of `lists`, and the shares into the row `SHARE` of `work`. Returns
    the number of these taxels. `sigma` [m] is the width over which the force is distributed. `point` (3,) [m]
    may be changed slightly. `row` is the number of the contact, and `spot` (5,) its row in the table with the
    columns `CENTRE`.
    """
    near, around, count = lists[NEAR], lists[AROUND + row], 0
    for _ in range(2 if sigma > WIDE else 1):
        if count > 0:
            x, y, z = point[0], point[1], point[2]
            for j in range(count):
                k, share = near[j], work[SHARE, j]
                x -= share * positions[k, 0]
                y -= share * positions[k, 1]
                z -= share * positions[k, 2]
            along = x * normal[0] + y * normal[1] + z * normal[2]
            point[0] += x - along * normal[0]
            point[1] += y - along * normal[1]
            point[2] += z - along * normal[2]
        x, y, z = point[0] - spot[0], point[1] - spot[1], point[2] - spot[2]
        room = (spot[RADIUS] - (x * x + y * y + z * z) ** 0.5) / sigma - REACH
        least = room
        if room > 0.0:
            known = around[: int(spot[MEMBERS])]
            count, least = within(positions, known, point, sigma, REACH, near, work)
        if least >= room:
            wide = REACH + 2.0 * _SLACK
            members, least = within(positions, lists[ALL], point, sigma, wide, around, work)
            spot[0], spot[1], spot[2] = point[0], point[1], point[2]
            spot[RADIUS], spot[MEMBERS] = (least + wide) * sigma, members
            count, least = within(positions, around[:members], point, sigma, REACH, near, work)
        share_into(positions, near[:count], point, normal, sigma, work)
    return count


@inlined
def _feels(normal: Array, count: int, taxels: Array, lists: Array, work: Array) -> bool:
    """Returns True if the taxels near a contact measure it: if its outward `normal` (3,) is close enough to
    their mean normal. The least cosine of the angle between both is `SIDE`.

    The row `NEAR` of `lists` contains these `count` taxels, and the row `SHARE` of `work` their weights in
    the mean. `taxels` (n, 8) contains the tangents of all taxels of the patch (see `X`)."""
    cosine = 0.0
    for j in range(count):
        row = taxels[lists[NEAR, j]]
        x = row[X + 1] * row[Y + 2] - row[X + 2] * row[Y + 1]
        y = row[X + 2] * row[Y] - row[X] * row[Y + 2]
        z = row[X] * row[Y + 1] - row[X + 1] * row[Y]
        cosine += work[SHARE, j] * (x * normal[0] + y * normal[1] + z * normal[2])
    return cosine >= SIDE


@inlined
def _add(
    push: tuple[float, float, float, float], count: int, axes: int, taxels: Array, lists: Array, active: int,
    load: Array, work: Array,
) -> int:  # fmt: skip
    """Adds a contact force to the forces on the `count` taxels near the contact, and marks these taxels as
    active. `_share` must have found the taxels and their shares of the force.

    `push` is the contact force [N]: its part along the normal, then its tangential part along x, y and z. The
    tangential part is used only if taxels have three `axes`. The forces on the taxels are added to `load` (4,
    n), see `PRESSING`. Returns the patch's number of active taxels after this call; `active` is the number
    before this call.
    """
    force, x, y, z = push
    for j in range(count):
        k, share = lists[NEAR, j], work[SHARE, j]
        if load[MARK, k] == 0.0:
            load[MARK, k] = 1.0
            lists[ACTIVE, active] = k
            active += 1
        load[PRESSING, k] += force * share
        if axes == 3:
            row = taxels[k]
            load[0, k] += share * (row[X] * x + row[X + 1] * y + row[X + 2] * z)
            load[1, k] += share * (row[Y] * x + row[Y + 1] * y + row[Y + 2] * z)
    return active


@inlined
def _lay(sigma: float, count: int, taxels: Array, lists: Array, work: Array) -> None:
    """Gives each of the `count` taxels near a pad, `sigma` [m] wide, the part of a Gaussian that lies on
    it; what lies on gaps and beside the skin is lost. The taxels of a sheet keep their shares: what meets it
    is borne by all of them."""
    nearest = 0
    for j in range(count):
        nearest = j if work[LOGARITHM, j] > work[LOGARITHM, nearest] else nearest
    top = -0.5 * (work[ACROSS, nearest] ** 2 + work[UP, nearest] ** 2)
    for j in range(count):
        row = taxels[lists[NEAR, j]]
        if row[DENSE] > 0.0:
            work[SHARE, j] = row[AREA] * math.exp(top + work[LOGARITHM, j]) / (2.0 * math.pi * sigma * sigma)


@inlined
def _pressing(slot: Array, hand: int, sensors: Array) -> float:
    """Force [N] with which a hand presses if a contact of a patch is one of its contacts, else 0. The hand
    has a sensor of its own, whose first value has the index `hand`: both sensors give one contact the same
    position."""
    own, force = False, 0.0
    for k in range(min(int(sensors[hand]), HAND_SLOTS)):
        at = hand + HAND_NUMBERS * k
        force += abs(sensors[at + FORCE])
        own |= (
            sensors[at + POSITION] == slot[POSITION]
            and sensors[at + POSITION + 1] == slot[POSITION + 1]
            and sensors[at + POSITION + 2] == slot[POSITION + 2]
        )
    return force if own else 0.0


@inlined
def press(patch: int, skin: Arrays) -> tuple[int, int]:
    """Finds the active taxels of a patch and the forces on them.

    `patch` is the index of the patch. Writes the active taxels into the row `ACTIVE` of the lists in `skin`,
    and the forces [N] on them into the loads in `skin` (see `PRESSING`). Returns the number of contacts and
    the number of active taxels.

    A contact on an end of a limb's skin, where there are no taxels, has no effect on taxels (see `SIDE`).
    Contact with the floor counts as one contact, and only if there is no other contact. With more than
    `SLOTS` contacts, forces are not computed, and no taxel is active.
    """
    sensors, centres, turns, patches, positions, taxels, _, _, load, lists, spots, work, _, hands = skin
    one = patches[patch]
    start, begin, end, body = one.sensor, one.begin, one.end, one.body
    found, floor = int(sensors[start + FOUND]), one.floor
    carried = floor >= 0 and sensors[floor + FOUND] > 0.0
    active = 0
    if (found == 0 and not carried) or found > SLOTS:
        return found, active
    point, way, tangent = work[ROWS, :3], work[ROWS, 3:6], work[ROWS, 6:9]
    places, own, spots = positions[begin:end], taxels[begin:end], spots[(SLOTS + 1) * patch :]
    mine = lists[:, begin:end]
    for number in range(-1 if carried else 0, found):
        at = floor if number < 0 else start + NUMBERS * number
        slot = sensors[at : at + NUMBERS]
        # In the link's frame: R^T (p - c), for directions R^T d.
        px = slot[POSITION] - centres[body, 0]
        py = slot[POSITION + 1] - centres[body, 1]
        pz = slot[POSITION + 2] - centres[body, 2]
        for i in range(3):
            a, b, c = turns[body, i], turns[body, 3 + i], turns[body, 6 + i]
            point[i] = a * px + b * py + c * pz
            way[i] = a * slot[NORMAL] + b * slot[NORMAL + 1] + c * slot[NORMAL + 2]
            tangent[i] = a * slot[TANGENT] + b * slot[TANGENT + 1] + c * slot[TANGENT + 2]
        first, second, third = slot[FORCE], slot[FORCE + 1], slot[FORCE + 2]
        if number < 0:
            # A floor loads the whole of a padded sole, not the corners of its hull. The axes of its sensor
            # are those of the world.
            row, sigma, pressing = SLOTS, one.size, 0.0
            x = y = z = 0.0
            for i in range(3):
                way[i] = one.outward[i]
                a, b, c = turns[body, i], turns[body, 3 + i], turns[body, 6 + i]
                pressing += (a * first + b * second + c * third) * way[i]
            pressing = abs(pressing)
        else:
            row, sigma, pressing = number, one.width, first
            for k in range(len(hands)):
                # a rigid plate takes any force to all of its taxels
                if hands[k, WIDTH] > 0.0 and sigma < one.size:
                    whole = _pressing(slot, int(hands[k, SENSOR]), sensors)
                    soft = hands[k, WIDTH] * min(whole / hands[k, FLAT], 1.0) ** (1.0 / 3.0)
                    sigma = (sigma * sigma + soft * soft) ** 0.5
            third_x = way[1] * tangent[2] - way[2] * tangent[1]
            third_y = way[2] * tangent[0] - way[0] * tangent[2]
            third_z = way[0] * tangent[1] - way[1] * tangent[0]
            x = -(second * tangent[0] + third * third_x)
            y = -(second * tangent[1] + third * third_y)
            z = -(second * tangent[2] + third * third_z)
        near = _share(places, point, way, sigma, mine, row, spots[row], work)
        if number >= 0 and not _feels(way, near, own, mine, work):
            continue
        if number >= 0 and sigma != one.width:
            _lay(sigma, near, own, mine, work)
        active = _add((pressing, x, y, z), near, one.axes, own, mine, active, load, work)
    return max(found, 1), active


@inlined
def counts_of(pressure: float, begin: int, end: int, nodes: Array, per_count: float) -> float:
    """Returns the deviation of a raw value from rest [counts] for a pressure [Pa]. The sensor's response
    curve is in the columns `begin` to `end` - 1 of `nodes` (deviations and pressures). Without a curve, the
    deviation is the pressure divided by the absolute value of `per_count` [Pa/count]."""
    if begin == end:
        return pressure / abs(per_count)
    pressure = max(pressure, nodes[1, begin])
    k = begin
    while k < end - 2 and pressure > nodes[1, k + 1]:
        k += 1
    slope = (nodes[0, k + 1] - nodes[0, k]) / (nodes[1, k + 1] - nodes[1, k])
    return nodes[0, k] + slope * (pressure - nodes[1, k])


@inlined
def sample(patch: int, step: int, skin: Arrays) -> int:
    """Computes the next skin frame of a patch, at the end of a step of the simulation.

    `patch` is the index of the patch, and `step` the number of the step. Writes the unrounded values [counts]
    of those channels into `skin` whose taxel is active, or was active in the frame before. With `step` -1,
    computes only the forces on the taxels, and leaves them in the loads in `skin` (see `PRESSING`). Returns
    the number of contacts on the patch.
    """
    _, _, _, patches, _, taxels, channels, nodes, load, lists, _, _, values, _ = skin
    one = patches[patch]
    begin, axes = one.begin, one.axes
    latest = lists[LATEST, begin : one.end]
    found, active = press(patch, skin)
    if step < 0:
        return found
    for j in range(one.pressed):
        at = one.channel + axes * channels[begin + latest[j]]
        for axis in range(axes):
            values[at + axis] = one.rest
    one.count += 1
    one.due = max(math.ceil((one.count + 1) / one.rate - 1e-6), step + 1)
    one.taken, one.touched, one.pressed = step, found, active
    sign = 1.0 if one.per_count > 0.0 else -1.0
    for j in range(active):
        k = lists[ACTIVE, begin + j]
        area = taxels[begin + k, AREA]
        at = one.channel + axes * channels[begin + k]
        if axes == 3:
            values[at] += load[0, k] / area / one.shear_per_count
            values[at + 1] += load[1, k] / area / one.shear_per_count
        pressure = load[PRESSING, k] / area
        values[at + axes - 1] += sign * counts_of(pressure, one.node, one.nodes, nodes, one.per_count)
        latest[j] = k
        load[0, k] = load[1, k] = load[PRESSING, k] = load[MARK, k] = 0.0
    return int(found)


@compiled(int64(int64, int64, SKIN))
def sample_now(patch: int, step: int, skin: Arrays) -> int:
    """Computes the next skin frame of a patch, like `sample`, but can be called from Python."""
    return sample(patch, step, skin)
