"""Servos, finger, skin and contacts of many worlds, in compiled loops over the functions of one world."""

from __future__ import annotations

import math

import numpy as np
from numba import float64, from_dtype, int32, int64, types

from tci.batch.posture import LIMB, limb_angles
from tci.messages.contacts import CONTACT
from tci.messages.contacts import TAXEL as PRESSED
from tci.messages.frames import Array
from tci.simulation import sampling
from tci.simulation.sampling import ACTIVE, AREA, MARK, PRESSING, SLOTS, Arrays, counts_of, press
from tci.simulation.stepping import ASKED, DRIVE, POKE, Records, drive, follow, note_tip, push
from tci.skin.kernels.arrays import (
    CLUSTERS,
    ESTIMATES,
    LAYOUT,
    LIMITS,
    ActiveTaxels,
    Clusters,
    ContactArrays,
    Estimates,
    Indices,
    LayoutArrays,
    Limits,
    Places,
)
from tci.skin.kernels.condition import pressure_of
from tci.skin.kernels.contacts import SUMMARY, describe_clusters, find_clusters
from tci.support.compiled import compiled, inlined, reads, returns, views, writes

NEVER = int(np.iinfo(np.int64).max)
STATE = types.Array(float64, 2, "A")
"""A field of the state of all worlds (N, m), which the engine keeps in one row per world."""
DRIVES, COMMANDS, POKES = from_dtype(DRIVE), from_dtype(ASKED), from_dtype(POKE)


@compiled(int64(float64, views(2), STATE, writes(2, DRIVES), reads(2, COMMANDS), writes(1, POKES)))
def prepare(time: float, qpos: Array, ctrl: Array, drives: Records, asked: Records, pokes: Records) -> int:
    """Writes the inputs `ctrl` (N, m) of the step that begins at `time` [s], as `stepping.march` does."""
    for w in range(len(pokes)):
        follow(drives[w], asked[w])
        drive(qpos[w], ctrl[w], drives[w], asked[w], 0.0)
        if pokes[w].active:
            push(time, ctrl[w], pokes[w])
    return len(pokes)


@compiled(int64(float64, reads(2), writes(1, POKES), writes(2)))
def note(time: float, sensors: Array, pokes: Records, row: Array) -> int:
    """Notes the contacts of all fingers in the step that began at `time` [s]; `row` (1, 3) is work space."""
    for w in range(len(pokes)):
        if pokes[w].active:
            note_tip(time, sensors[w], pokes[w], row)
    return len(pokes)


@compiled(int64(views(2), reads(1), float64, writes(2, DRIVES), writes(2, COMMANDS)))
def aim(angles: Array, top: Array, steps: float, drives: Records, asked: Records) -> int:
    """Sets the targets `angles` (N, n) [rad] of all servos, reached after `steps` steps, or later where the
    joint would be faster than `top` (k,) [rad per step]: `stepping.aim` for many worlds."""
    for w in range(len(drives)):
        for i in range(len(asked[w])):
            asked[w, i].target = angles[w, i]
        for i in range(len(top)):
            one = drives[w, i]
            left = abs(asked[w, one.servo].target * one.ratio + one.shift - one.setpoint)
            one.stride = min(left / steps, top[i])
    return len(drives)


@inlined
def _angles(qpos: Array, asked: Records, drives: Records, out: Array) -> None:
    """Writes the angles (n,) [rad] of all servos at MuJoCo's `qpos`: of one with several joints that of the
    first, of one without a joint its target."""
    for i in range(len(out)):
        out[i] = asked[i].target
    for i in range(len(drives) - 1, -1, -1):
        one = drives[i]
        out[one.servo] = (qpos[one.address] - one.shift) / one.ratio


@compiled(int64(views(2), reads(2, COMMANDS), reads(1, DRIVES), writes(2)))
def servo_angles(qpos: Array, asked: Records, drives: Records, out: Array) -> int:
    """`_angles` for many worlds."""
    for w in range(len(qpos)):
        _angles(qpos[w], asked[w], drives, out[w])
    return len(qpos)


SKINS = returns(
    reads(2), reads(3), reads(3), writes(1, from_dtype(sampling.PATCH)), reads(2), reads(2),
    reads(1, int64), reads(2), writes(2), writes(2, int64), writes(2), writes(2), writes(1), reads(2),
)  # fmt: skip
"""`sampling.SKIN` with sensors, positions and orientations of links of all worlds."""
FELT = returns(writes(2), writes(2, int32), writes(2), writes(2, int64), writes(3, int64))
"""What all worlds feel: force [N] on each taxel (N, n); the active taxels (N, n) of each patch, as indices
within it from its first taxel on, and the pressures [Pa] that are read of them; how many these are (N, p);
and the first loaded taxel of each patch and the end of those (N, p, 2), zeros if none is."""


@inlined
def _read(
    w: int, p: int, count: int, skin: Arrays, layout: LayoutArrays, estimates: Estimates, felt: Arrays
) -> int:
    """Turns the loads on the `count` loaded taxels of a patch into what its sensor says of them: whole counts
    within its range. Returns the number of taxels that are active then."""
    _, _, _, patches, _, taxels, channels, nodes, load, lists, _, _, values, _ = skin
    force, listed, pressure, _, loaded = felt
    one, sensor, active = patches[p], layout.patches[p], 0
    begin = one.begin
    first, end = one.end, 0
    for j in range(count):
        first, end = min(first, lists[ACTIVE, begin + j]), max(end, lists[ACTIVE, begin + j] + 1)
    loaded[w, p, 0], loaded[w, p, 1] = begin + first, begin + end
    sign = 1.0 if one.per_count > 0.0 else -1.0
    for k in range(first, end):
        if load[MARK, k] == 0.0:
            continue
        at = one.channel + one.axes * channels[begin + k] + one.axes - 1
        values[at] += sign * counts_of(
            load[PRESSING, k] / taxels[begin + k, AREA], one.node, one.nodes, nodes, one.per_count
        )
    for k in range(first, end):
        if load[MARK, k] == 0.0:
            continue
        i = begin + k
        force[w, i] = load[PRESSING, k]
        at = one.channel + one.axes * channels[i] + one.axes - 1
        raw = min(max(np.rint(values[at]), sensor.lowest), sensor.highest)
        deviation = np.float32(sensor.sign * (np.float32(raw) - sensor.rest)) - estimates.offset[i]
        if deviation > 0.0 and deviation >= estimates.threshold[i] and not estimates.muted[i]:
            listed[w, begin + active] = k
            pressure[w, begin + active] = pressure_of(deviation, i, sensor, layout)
            active += 1
    for k in range(first, end):
        if load[MARK, k] != 0.0:
            at = one.channel + one.axes * channels[begin + k]
            for axis in range(one.axes):
                values[at + axis] = one.rest
            load[0, k] = load[1, k] = load[PRESSING, k] = load[MARK, k] = 0.0
    return active


@inlined
def _feel(step: int, skins: Arrays, layout: LayoutArrays, estimates: Estimates, felt: Arrays) -> int:
    """Takes the frames that are due at the step with the number `step`, in all worlds.

    Returns the number of a world with too many contacts on one patch (`SLOTS`), + 1; else 0.
    """
    sensors, centres, turns, patches, a, b, c, d, e, lists, f, g, h, hands = skins
    force, _, _, numbers, loaded = felt
    full = 0
    for p in range(len(patches)):
        one = patches[p]
        if step < one.due:
            continue
        one.count += 1
        one.due = max(math.ceil((one.count + 1) / one.rate - 1e-6), step + 1)
        one.taken = step
        for w in range(len(sensors)):
            if loaded[w, p, 1]:
                for i in range(loaded[w, p, 0], loaded[w, p, 1]):
                    force[w, i] = 0.0
                numbers[w, p] = loaded[w, p, 0] = loaded[w, p, 1] = 0
            if sensors[w, one.sensor] == 0.0 and one.floor < 0:
                continue
            skin = sensors[w], centres[w], turns[w], patches, a, b, c, d, e, lists, f, g, h, hands
            found, active = press(p, skin)
            if found > SLOTS:
                full = w + 1
            if active:
                numbers[w, p] = _read(w, p, active, skin, layout, estimates, felt)
    return full


FOUND = returns(
    writes(2, from_dtype(CONTACT)), writes(2, int64), writes(2, from_dtype(PRESSED)), writes(1, int64)
)
"""Contacts of all worlds: `ContactArrays` with a row per world, and their numbers (N,)."""
ROOM = returns(
    writes(3), writes(1, int64), writes(1, int32), writes(1), writes(1, from_dtype(SUMMARY)), writes(1)
)
"""Work space: poses (l + 1, 4, 4), where each patch begins (p + 1,), active taxels and their pressures (n,),
as many summaries as there is room for contacts, and angles of servos."""
ROBOTS = returns(
    views(2), reads(2, COMMANDS), reads(1, DRIVES), reads(3), reads(1, from_dtype(LIMB)), writes(3),
    int64, reads(2), reads(1, int64), reads(3), reads(3),
)  # fmt: skip
"""Of all worlds: MuJoCo's joint angles (N, m) at the frame, commands to all servos, joints that they move,
tables of `posture.LimbTables`, and output: first four generic angles (N, parts, 4) [rad] of each limb (those
of limbs with tables are there already). Then index of the torso's body, pose (4, 4) of the torso frame in it,
bodies (l,) of `SkinLayout.links`, and positions (N, b, 3) [m] and orientations (N, b, 9) of all bodies in the
world frame."""


@inlined
def _relative(out: Array, torso: Array, p: Array, R: Array) -> None:
    """Writes into `out` (4, 4) the pose of a link at `p` with the orientation `R` (9,), in the frame
    `torso` (4, 4); both are given in the world frame."""
    for i in range(3):
        for j in range(3):
            out[i, j] = torso[0, i] * R[j] + torso[1, i] * R[3 + j] + torso[2, i] * R[6 + j]
        out[i, 3] = 0.0
        for k in range(3):
            out[i, 3] += torso[k, i] * (p[k] - torso[k, 3])


@compiled(int64(int64, SKINS, LAYOUT, ESTIMATES, FELT, ROBOTS, LIMITS, CLUSTERS, FOUND, ROOM))
def take(
    step: int,
    skins: Arrays,
    layout: LayoutArrays,
    estimates: Estimates,
    felt: Arrays,
    robots: tuple[Array, Records, Records, Array, Records, Array, int, Array, Places, Array, Array],
    limits: Limits,
    clusters: Clusters,
    found: tuple[Records, Places, Records, Places],
    room: tuple[Array, Places, Indices, Array, Records, Array],
) -> int:
    """Takes the frames that are due at a step, and finds the contacts of all worlds.

    Returns the number of the step of the next frame; below zero for an error: -1 - w if a patch of the world
    w has too many contacts (`SLOTS`), -1 - w - N if this world has more contacts than there is room for.

    Args:
        step: Number of the step.
        skins: See `SKINS`.
        layout: The skin.
        estimates: What is known of its taxels.
        felt: Output, see `FELT`.
        robots: See `ROBOTS`.
        limits: Least forces of a contact.
        clusters: Work space.
        found: Output, see `FOUND`.
        room: See `ROOM`.
    """
    full: int = _feel(step, skins, layout, estimates, felt)
    if full:
        return -full
    qpos, asked, drives, weights, tables, posture, torso, T_LT, bodies, centres, turns = robots
    poses, begin, active, pressure, summary, angles = room
    _, listed, pressures, numbers, _ = felt
    rows, begins, pressed, counts = found
    frame = poses[len(bodies)]
    for w in range(len(counts)):
        counts[w] = 0
        place = 0
        for p in range(len(layout.patches)):
            begin[p] = place
            place += numbers[w, p]
        begin[len(layout.patches)] = place
        if place == 0:
            continue
        for p in range(len(layout.patches)):
            for k in range(numbers[w, p]):
                active[begin[p] + k] = listed[w, layout.patches[p].taxel + k]
                pressure[begin[p] + k] = pressures[w, layout.patches[p].taxel + k]
        state = ActiveTaxels(pressure, begin, active, pressure)
        count, _, _ = find_clusters(state, limits, estimates.onset, layout, clusters)
        if count > len(summary):
            return -1 - w - len(counts)
        counts[w] = count
        if count == 0:
            continue
        _angles(qpos[w], asked[w], drives, angles)
        limb_angles(angles, weights, tables, posture[w])
        R, c = turns[w, torso], centres[w, torso]
        for i in range(3):
            for j in range(4):
                frame[i, j] = R[3 * i] * T_LT[0, j] + R[3 * i + 1] * T_LT[1, j] + R[3 * i + 2] * T_LT[2, j]
            frame[i, 3] += c[i]
        for p in range(len(layout.patches)):
            if clusters.counts[p]:
                for link in (layout.patches[p].link, layout.patches[p].limb_link):
                    _relative(poses[link], frame, centres[w, bodies[link]], turns[w, bodies[link]])
        out = ContactArrays(rows[w], begins[w], pressed[w])
        describe_clusters(layout, estimates.hidden, clusters, poses, posture[w], summary, out)
    following = NEVER
    for p in range(len(layout.patches)):
        following = min(following, skins[3][p].due)
    return following
