"""How a person's hand follows its plan on a body that moves, in the compiled loop of the simulation.

The person sees the touched link with a delay, expects it to go on at its speed, and moves the hand's base by
a filter of at most 3 Hz. Force is felt with the same delay; what it differs from the command of that moment
is taken off the next ones (internal model control: on a body that rests nothing is left to correct). So a
hand holds its force on what moves evenly, is late on what starts to move, and its blows have peaks.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import from_dtype

from tci.messages.frames import Array
from tci.support.compiled import inlined, reads, returns, writes

PADS = 6
"""Pads of a hand."""
SLOTS, NUMBERS = 12, 7
"""Contacts of a hand at a time, and the values of its sensor for each: found, force (3), position (3)."""
WINDOW = 0.05
"""Time [s] over which the person sees a speed."""
RING = 4096
"""Steps that the person remembers."""
TRACE = 40_000
"""Steps of a hand's record."""
DOFS = 3 + 2 + PADS
"""Joints of a hand, in this order: where it is in the world (3), how far the flesh has given way sideways
(2), and how far each pad is pushed in."""
_F, _I = np.float64, np.int64
HAND = np.dtype([
    *[(name, _I) for name in ("active", "start", "first", "count", "guided", "link", "hit", "traced")],
    *[(name, _I) for name in ("joint", "dof", "actuator", "sensor", "pads", "delay")],
    *[(name, _F) for name in ("stiffness", "damping", "pad", "omega")],
    ("place", _F, (3,)), ("turn", _F, (4,)), ("spin", _F, (3,)), ("drift", _F, (3,)), ("target", _F, (3,)),
    *[(name, _F) for name in ("trim", "trim_rate", "force", "peak", "begun", "lost")],
])  # fmt: skip
"""One hand:

- `active`: 1 while it moves.
- `start`, `first`, `count`: number of the step in which its plan begins, index of the plan's first row, and
  number of its rows.
- `guided`: number of the latest step for which its inputs are known.
- `link`: index of the touched body.
- `hit`, `traced`: 1 after the first contact; number of steps in its record.
- `joint`, `dof`, `actuator`, `sensor`, `pads`: indices of its first joint in `qpos` and `qvel`, its first
  actuator, its first sensor value and its first pad's body, which is after that of the flesh.
- `delay`: of the person, at least 1 [steps].
- `stiffness`, `damping`, `pad`, `omega`: of the arm [N/m] and [N s/m], of a pad and of the flesh [N/m], and
  the frequency of the person's filter [rad/s].
- `place`, `turn`, `spin`, `drift`: the link's pose that the hand follows, and how that moves on: rotation
  [rad/s], and velocity [m/s] at the world's origin.
- `target`: where it was to be in the latest step [m].
- `trim`, `trim_rate`: correction of the force [N], and its change [N/s].
- `force`, `peak`: contact force in the latest step, and the largest one [N].
- `begun`, `lost`: times [s] of the first contact and of the latest loss of contact."""
MOMENT = np.dtype([
    ("base", _F, (3,)), ("ahead", _F, (3,)), ("push", _F, (3,)), ("asked", _F),
    ("place", _F, (PADS, 3)), ("normal", _F, (PADS, 3)), ("turn", _F, (PADS, 4)), ("share", _F, (PADS,)),
])  # fmt: skip
"""What a hand is to do in one step, in the touched link's frame:

- `base`: where it should be [m]: in the middle of its pads in use.
- `ahead`: how far the hand is before that [m], since the flesh of a grip gives way sideways.
- `push`: force [N] that this needs beyond the spring of its arm.
- `asked`: force of all pads [N].
- `place`, `normal`, `turn`, `share`: of each pad, where its tip should be [m], the outward normal, the
  orientation, and the share of the force."""
SEEN = np.dtype([("place", _F, (3,)), ("turn", _F, (4,)), ("felt", _F), ("wanted", _F)])
"""What a person saw and felt in one step: the link's pose, the contact force and the commanded one [N]."""
NOTED = np.dtype([
    ("time", _F), ("asked", _F), ("force", _F), ("drag", _F), ("centre", _F, (3,)), ("place", _F, (3,)),
])  # fmt: skip
"""Record of one step: time [s], asked force, contact force and friction [N], centre of the contact and place
of the hand in the link's frame [m]."""
HANDS = returns(
    writes(1, from_dtype(HAND)), reads(1, from_dtype(MOMENT)), writes(2, from_dtype(SEEN)),
    writes(2, from_dtype(NOTED)), reads(2), reads(2), writes(2), writes(2), writes(1), writes(1),
)  # fmt: skip
"""Numba types of the hands: their states, plans, memories (hands, `RING`) and records (hands, `TRACE`), and
MuJoCo's `xpos`, `xquat`, `body_pos`, `body_quat`, `qpos` and `qvel`."""
SENSOR, WIDTH, FLAT = 0, 1, 2
"""Columns of a table with one row for each hand: index of its first sensor value; width [m] (standard
deviation) over which each of its pads presses on skin, beside what the skin's cover adds; force [N] of the
hand from which its pads lie flat, with all of their width. Below it they are narrower, by the cube root of
the force, as a sphere's contact (Hertz)."""
Arrays = tuple[Any, ...]
FOLLOWS = 0.25
"""Speed [m/s] with which a hand follows the body at most: whoever touches an arm that jerks away is startled
and lets it go. Assumed; slower motion, up to 0.2 m/s at least, is followed with the asked force."""
EASY = 8.0
"""Force [N] above the asked one, up to which the arm pulls the hand to its place and speed, on all axes.
Beyond it the arm gives way. Assumed: people who touch do not push through; a firm hand would need 50 N."""
AWAY = -30.0
"""Height [m] at which hands without work wait."""


@inlined
def _turned(q: tuple[float, float, float, float], x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector after the rotation of a unit quaternion."""
    w, a, b, c = q
    u, v, t = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return x + w * u + b * t - c * v, y + w * v + c * u - a * t, z + w * t + a * v - b * u


@inlined
def _times(
    p: tuple[float, float, float, float], q: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@inlined
def _spun(q: Array, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """A quaternion (4,) after a rotation by the vector (x, y, z) [rad]."""
    angle = (x * x + y * y + z * z) ** 0.5
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    w, a, b, c = _times((math.cos(0.5 * angle), s * x, s * y, s * z), (q[0], q[1], q[2], q[3]))
    return w, a, b, c


@inlined
def _cross(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _normalize(q: Array) -> None:
    size = (q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2) ** 0.5
    for i in range(4):
        q[i] /= size


@inlined
def _see(number: int, step: float, base: Array, hand: Any, own: Any) -> None:
    """Moves the pose that a hand follows to where the person expects the link: the screw motion that was seen
    goes on, and what was expected wrongly is corrected at the filter's pace. The hand at `base` (3,) [m] in
    this pose is no faster than `FOLLOWS`."""
    window = max(1, round(WINDOW / step))
    seen = own[(number - hand.delay) % RING]
    older = own[(number - hand.delay - window) % RING]
    passed, share = window * step, min(1.0, hand.omega * step)
    turn = _times(
        (seen.turn[0], seen.turn[1], seen.turn[2], seen.turn[3]),
        (older.turn[0], -older.turn[1], -older.turn[2], -older.turn[3]),
    )
    sine = (turn[1] ** 2 + turn[2] ** 2 + turn[3] ** 2) ** 0.5
    rate = 2.0 / passed if sine < 1e-9 else 2.0 * math.atan2(sine, turn[0]) / sine / passed
    w = rate * turn[1], rate * turn[2], rate * turn[3]
    p, before = seen.place, older.place
    u = _cross(w, (0.5 * (p[0] + before[0]), 0.5 * (p[1] + before[1]), 0.5 * (p[2] + before[2])))
    for i in range(3):
        hand.spin[i] += share * (w[i] - hand.spin[i])
        hand.drift[i] += share * ((p[i] - before[i]) / passed - u[i] - hand.drift[i])
    w = hand.spin[0], hand.spin[1], hand.spin[2]
    u = _cross(w, (hand.place[0], hand.place[1], hand.place[2]))
    x, y, z = hand.place[0], hand.place[1], hand.place[2]
    t = hand.turn[0], hand.turn[1], hand.turn[2], hand.turn[3]
    for i in range(3):
        hand.place[i] += step * (u[i] + hand.drift[i])
    q = _spun(hand.turn, step * w[0], step * w[1], step * w[2])
    delay = hand.delay * step
    e = _spun(seen.turn, delay * w[0], delay * w[1], delay * w[2])
    u = _cross(w, (p[0], p[1], p[2]))
    v = u[0] + hand.drift[0], u[1] + hand.drift[1], u[2] + hand.drift[2]
    a = _cross(w, v)
    j = _cross(w, a)
    for i in range(3):
        expected = p[i] + delay * (v[i] + delay / 2.0 * (a[i] + delay / 3.0 * j[i]))
        hand.place[i] += share * (expected - hand.place[i])
    for i in range(4):
        hand.turn[i] = q[i] + share * (e[i] - q[i])
    _normalize(hand.turn)
    from_ = _turned(t, base[0], base[1], base[2])
    to = _turned((hand.turn[0], hand.turn[1], hand.turn[2], hand.turn[3]), base[0], base[1], base[2])
    way = (
        (to[0] - from_[0] + hand.place[0] - x) ** 2
        + (to[1] - from_[1] + hand.place[1] - y) ** 2
        + (to[2] - from_[2] + hand.place[2] - z) ** 2
    ) ** 0.5
    if way > FOLLOWS * step:
        part = FOLLOWS * step / way
        hand.place[0] = x + part * (hand.place[0] - x)
        hand.place[1] = y + part * (hand.place[1] - y)
        hand.place[2] = z + part * (hand.place[2] - z)
        for i in range(4):
            hand.turn[i] = t[i] + part * (hand.turn[i] - t[i])
        _normalize(hand.turn)


@inlined
def _correct(number: int, step: float, asked: float, hand: Any, own: Any) -> float:
    """Notes this step's command, and returns its correction [N]."""
    seen = own[(number - hand.delay) % RING]
    wrong = seen.felt - seen.wanted if hand.hit and seen.wanted > 0.0 else 0.0
    omega = hand.omega
    hand.trim_rate += step * (omega * omega * (wrong - hand.trim) - 2.0 * omega * hand.trim_rate)
    hand.trim += step * hand.trim_rate
    most = max(1.0, asked)
    trim = min(max(-hand.trim, -most), most) if asked > 0.0 else 0.0
    own[number % RING].wanted = asked + trim if asked > 0.0 else 0.0
    return trim


@inlined
def guide(number: int, step: float, ctrl: Array, hands: Arrays) -> None:
    """Moves the bases, and turns the palms and fingers, of all hands at work, before the step `number` of the
    physics. A second call for the same step changes nothing."""
    states, plans, memories, _, _, _, body_pos, body_quat, qpos, qvel = hands
    for number_of in range(len(states)):
        hand = states[number_of]
        at = number - hand.start
        if not hand.active or at < 0 or hand.guided >= number:
            continue
        hand.guided = number
        begin, joint, dof = hand.actuator, hand.joint, hand.dof
        if at >= hand.count:
            hand.active = 0
            for i in range(DOFS):
                qpos[joint + i] = qvel[dof + i] = 0.0
            for i in range(3):
                ctrl[begin + i] = 0.0
            qpos[joint + 2] = ctrl[begin + 2] = AWAY
            hand.force = 0.0
            continue
        row, own = plans[hand.first + at], memories[number_of]
        _see(number, step, row.base, hand, own)
        trim = _correct(number, step, row.asked, hand, own)
        turn = (hand.turn[0], hand.turn[1], hand.turn[2], hand.turn[3])
        bx, by, bz = _turned(turn, row.base[0], row.base[1], row.base[2])
        px, py, pz = row.push[0], row.push[1], row.push[2]
        flesh = _times(turn, (row.turn[0, 0], row.turn[0, 1], row.turn[0, 2], row.turn[0, 3]))
        back = (flesh[0], -flesh[1], -flesh[2], -flesh[3])
        for i in range(4):
            body_quat[hand.pads - 1, i] = flesh[i]
        for k in range(PADS):
            more = row.share[k] * trim
            deeper = more / hand.pad
            nx, ny, nz = row.normal[k, 0], row.normal[k, 1], row.normal[k, 2]
            px, py, pz = px - more * nx, py - more * ny, pz - more * nz
            x, y, z = _turned(
                turn, row.place[k, 0] - deeper * nx, row.place[k, 1] - deeper * ny,
                row.place[k, 2] - deeper * nz,
            )  # fmt: skip
            pad = hand.pads + k
            at_pad = _turned(back, x - bx, y - by, z - bz)
            own_turn = _times(turn, (row.turn[k, 0], row.turn[k, 1], row.turn[k, 2], row.turn[k, 3]))
            own_turn = _times(back, own_turn)
            for i in range(3):
                body_pos[pad, i] = at_pad[i]
            for i in range(4):
                body_quat[pad, i] = own_turn[i]
        ahead = _turned(turn, row.ahead[0], row.ahead[1], row.ahead[2])
        target = (bx + hand.place[0] + ahead[0], by + hand.place[1] + ahead[1], bz + hand.place[2] + ahead[2])
        push = _turned(turn, px, py, pz)
        square = 0.0
        for i in range(3):
            speed = (target[i] - hand.target[i]) / step if at > 0 else qvel[dof + i]
            hand.target[i] = target[i]
            # as if the damper pulled too: MuJoCo takes its part at the hand's own speed off
            ctrl[begin + i] = hand.stiffness * (target[i] - qpos[joint + i]) + hand.damping * (
                speed - qvel[dof + i]
            )
            square += ctrl[begin + i] ** 2
        eased = min(1.0, (EASY + row.asked) / max(square**0.5, 1e-9))
        for i in range(3):
            pulled = eased * ctrl[begin + i] + hand.damping * qvel[dof + i] + push[i]
            ctrl[begin + i] = qpos[joint + i] + pulled / hand.stiffness


@inlined
def note(number: int, step: float, sensors: Array, hands: Arrays) -> None:
    """Records what the physics did with all hands at work in the step `number`, and what the person sees and
    feels of it. Poses are then still those before the step."""
    states, plans, memories, traces, xpos, xquat, _, _, qpos, _ = hands
    for number_of in range(len(states)):
        hand = states[number_of]
        at = number - hand.start
        if not hand.active or at < 0:
            continue
        found = min(int(sensors[hand.sensor]), SLOTS)
        force = drag = x = y = z = 0.0
        for k in range(found):
            slot = sensors[hand.sensor + NUMBERS * k :]
            force += slot[1]
            drag += (slot[2] ** 2 + slot[3] ** 2) ** 0.5
            x += slot[1] * slot[4]
            y += slot[1] * slot[5]
            z += slot[1] * slot[6]
        time = number * step
        if force > 0.0:
            if not hand.hit:
                hand.hit = 1
                hand.begun = time
            hand.lost = float("nan")
            hand.peak = max(hand.peak, force)
        elif hand.force > 0.0:
            hand.lost = time
        hand.force = force
        own, link = memories[number_of], hand.link
        now, before = own[number % RING], own[(number - 1) % RING]
        same = 0.0
        for i in range(4):
            same += xquat[link, i] * before.turn[i]
        for i in range(3):
            now.place[i] = xpos[link, i]
        for i in range(4):
            now.turn[i] = xquat[link, i] if same >= 0.0 else -xquat[link, i]
        now.felt = force
        row = traces[number_of, hand.traced % TRACE]
        row.time, row.asked, row.force, row.drag = time, plans[hand.first + at].asked, force, drag
        back = (xquat[link, 0], -xquat[link, 1], -xquat[link, 2], -xquat[link, 3])
        ox, oy, oz = xpos[link, 0], xpos[link, 1], xpos[link, 2]
        size, joint = max(force, 1e-12), hand.joint
        centre = _turned(back, x / size - ox, y / size - oy, z / size - oz)
        place = _turned(back, qpos[joint] - ox, qpos[joint + 1] - oy, qpos[joint + 2] - oz)
        for i in range(3):
            row.centre[i] = centre[i] if force > 0.0 else float("nan")
            row.place[i] = place[i]
        hand.traced += 1
