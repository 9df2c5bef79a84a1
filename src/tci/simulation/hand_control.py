"""How a person's hand follows its plan on a body that moves, in the compiled loop of the simulation.

The person sees the touched link with a delay, expects it to go on at its speed, and moves the hand's base by
a filter of at most 3 Hz. Force is felt with the same delay; what it differs from the command of that moment
is taken off the next ones (internal model control: on a body that rests nothing is left to correct). So a
hand holds its force on what moves evenly, is late on what starts to move, and its blows have peaks.
"""

from __future__ import annotations

import math

from numba import int64

from tci.messages.frames import Array
from tci.support.compiled import inlined, reads, returns, writes

PADS = 6
"""Pads of a hand."""
BASE, PUSH, ASKED, PAD_BEGIN = 0, 3, 6, 7
"""First columns of a plan, which has a row for every step; vectors are in the touched link's frame. Where the
hand should be (3) [m]: in the middle of its pads in use; the force that this needs beyond its arm's spring
(3) [N]; the asked force of all pads [N]; and the first pad's values (`EACH`)."""
PLACE, NORMAL, TURN, SHARE, EACH = 0, 3, 6, 10, 11
"""First values of each pad: where it should be (3) [m], the outward normal (3), its orientation (4), its
share of the force, and the number of these values."""
ACTIVE, START, FIRST, COUNT, LINK, QPOS, DOF, CTRL, FELT, BODY, TRACED, HIT, DELAY = range(13)
"""Columns of the integers, a row for every hand: 1 while it moves; the step of the plan's first row; this row
and their number; the touched body; the hand's first joint in `qpos` and `qvel`, first actuator, first sensor
value and first pad's body; steps in its record; 1 after the first contact; delay [steps]."""
WHOLE = 13
POSE, TWIST, LAST, TRIM, TRIM_RATE, FORCE, PEAK, BEGUN, LOST = 0, 7, 14, 17, 18, 19, 20, 21, 22
"""Columns of the state, a row for every hand: the link's pose that the hand follows (7), its twist (rotation,
and velocity at the world's origin), the last target (3) [m], the correction [N] and its change, the contact
force and its peak [N], the times of the first contact and of the latest loss of contact [s]."""
STIFFNESS, DAMPING, PAD, OMEGA = 23, 24, 25, 26
"""Constants in the same rows: the arm's stiffness [N/m] and damping [N s/m], the pads' stiffness [N/m], and
the filter's frequency [rad/s]."""
STATE = 27
SLOTS, NUMBERS = 12, 7
"""Contacts of a hand at a time, and the values of its sensor for each: found, force (3), position (3)."""
WINDOW = 0.05
"""Time [s] over which the person sees a speed."""
RING = 4096
"""Steps that the person remembers."""
TRACE, NOTED = 40_000, 10
"""Steps of a hand's record, and their values: time [s], asked force, contact force and friction [N], place of
the contact (3) and of the hand (3) in the link's frame [m]."""
HANDS = returns(
    writes(2, int64), writes(2), reads(2), writes(2), writes(2), reads(2), reads(2), writes(2), writes(2),
    writes(1), writes(1),
)  # fmt: skip
"""Numba types of the hands: integers (see `ACTIVE`), state (see `POSE`), plans (see `BASE`), memory of link
poses, felt and commanded forces (`RING` rows a hand, 9), record (`TRACE` rows a hand), MuJoCo's `xpos`,
`xquat`, `body_pos`, `body_quat`, `qpos` and `qvel`."""
Arrays = tuple[Array, ...]
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
def _see(hand: int, number: int, step: float, hands: Arrays) -> None:
    """Moves the pose that a hand follows to where the person expects the link: the screw motion that was seen
    goes on, and what was expected wrongly is corrected at the filter's pace."""
    wholes, states, _, memory, _, xpos, xquat, _, _, _, _ = hands
    whole, state = wholes[hand], states[hand]
    own = memory[hand * RING : (hand + 1) * RING]
    now, link, before = own[number % RING], whole[LINK], own[(number - 1) % RING]
    same = 0.0
    for i in range(4):
        same += xquat[link, i] * before[3 + i]
    for i in range(3):
        now[i] = xpos[link, i]
    for i in range(4):
        now[3 + i] = xquat[link, i] if same >= 0.0 else -xquat[link, i]
    window = max(1, round(WINDOW / step))
    seen = own[(number - whole[DELAY]) % RING]
    older = own[(number - whole[DELAY] - window) % RING]
    passed, share = window * step, min(1.0, state[OMEGA] * step)
    turn = _times((seen[3], seen[4], seen[5], seen[6]), (older[3], -older[4], -older[5], -older[6]))
    sine = (turn[1] ** 2 + turn[2] ** 2 + turn[3] ** 2) ** 0.5
    rate = 2.0 / passed if sine < 1e-9 else 2.0 * math.atan2(sine, turn[0]) / sine / passed
    w = rate * turn[1], rate * turn[2], rate * turn[3]
    half = 0.5 * (seen[0] + older[0]), 0.5 * (seen[1] + older[1]), 0.5 * (seen[2] + older[2])
    u = _cross(w, half)
    for i in range(3):
        state[TWIST + i] += share * (w[i] - state[TWIST + i])
        state[TWIST + 3 + i] += share * ((seen[i] - older[i]) / passed - u[i] - state[TWIST + 3 + i])
    w = state[TWIST], state[TWIST + 1], state[TWIST + 2]
    u = _cross(w, (state[POSE], state[POSE + 1], state[POSE + 2]))
    for i in range(3):
        state[POSE + i] += step * (u[i] + state[TWIST + 3 + i])
    q = _spun(state[POSE + 3 : POSE + 7], step * w[0], step * w[1], step * w[2])
    delay = whole[DELAY] * step
    e = _spun(seen[3:7], delay * w[0], delay * w[1], delay * w[2])
    u = _cross(w, (seen[0], seen[1], seen[2]))
    v = u[0] + state[TWIST + 3], u[1] + state[TWIST + 4], u[2] + state[TWIST + 5]
    a = _cross(w, v)
    j = _cross(w, a)
    for i in range(3):
        expected = seen[i] + delay * (v[i] + delay / 2.0 * (a[i] + delay / 3.0 * j[i]))
        state[POSE + i] += share * (expected - state[POSE + i])
    for i in range(4):
        state[POSE + 3 + i] = q[i] + share * (e[i] - q[i])


@inlined
def _correct(hand: int, number: int, step: float, asked: float, hands: Arrays) -> float:
    """Notes the felt force and this step's command, and returns the correction [N] of the latter."""
    wholes, states, memory = hands[0], hands[1], hands[3]
    whole, state = wholes[hand], states[hand]
    own = memory[hand * RING : (hand + 1) * RING]
    seen = own[(number - whole[DELAY]) % RING]
    wrong = seen[7] - seen[8] if whole[HIT] and seen[8] > 0.0 else 0.0
    omega = state[OMEGA]
    state[TRIM_RATE] += step * (omega * omega * (wrong - state[TRIM]) - 2.0 * omega * state[TRIM_RATE])
    state[TRIM] += step * state[TRIM_RATE]
    most = max(1.0, asked)
    trim = min(max(-state[TRIM], -most), most) if asked > 0.0 else 0.0
    now = own[number % RING]
    now[7], now[8] = state[FORCE], asked + trim if asked > 0.0 else 0.0
    return trim


@inlined
def guide(number: int, step: float, ctrl: Array, hands: Arrays) -> None:
    """Moves the bases, and turns the palms and fingers, of all hands at work before a step of the physics."""
    wholes, states, plans, _, _, _, _, body_pos, body_quat, qpos, qvel = hands
    for hand in range(len(wholes)):
        whole, state = wholes[hand], states[hand]
        at = number - whole[START]
        if not whole[ACTIVE] or at < 0:
            continue
        begin, joint, dof = whole[CTRL], whole[QPOS], whole[DOF]
        if at >= whole[COUNT]:
            whole[ACTIVE] = 0
            for i in range(3 + PADS):
                qpos[joint + i] = qvel[dof + i] = 0.0
            for i in range(3):
                ctrl[begin + i] = 0.0
            qpos[joint + 2] = ctrl[begin + 2] = AWAY
            state[FORCE] = 0.0
            continue
        row = plans[whole[FIRST] + at]
        _see(hand, number, step, hands)
        trim = _correct(hand, number, step, row[ASKED], hands)
        pose = state[POSE : POSE + 7]
        size = (pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2) ** 0.5
        for i in range(3, 7):
            pose[i] /= size
        turn = (pose[3], pose[4], pose[5], pose[6])
        bx, by, bz = _turned(turn, row[BASE], row[BASE + 1], row[BASE + 2])
        px, py, pz = row[PUSH], row[PUSH + 1], row[PUSH + 2]
        for k in range(PADS):
            pad = row[PAD_BEGIN + EACH * k : PAD_BEGIN + EACH * (k + 1)]
            more = pad[SHARE] * trim
            deeper = more / state[PAD]
            px, py, pz = px - more * pad[NORMAL], py - more * pad[NORMAL + 1], pz - more * pad[NORMAL + 2]
            x, y, z = _turned(
                turn, pad[PLACE] - deeper * pad[NORMAL], pad[PLACE + 1] - deeper * pad[NORMAL + 1],
                pad[PLACE + 2] - deeper * pad[NORMAL + 2],
            )  # fmt: skip
            body = whole[BODY] + k
            body_pos[body, 0], body_pos[body, 1], body_pos[body, 2] = x - bx, y - by, z - bz
            w, a, b, c = _times(turn, (pad[TURN], pad[TURN + 1], pad[TURN + 2], pad[TURN + 3]))
            body_quat[body, 0], body_quat[body, 1], body_quat[body, 2], body_quat[body, 3] = w, a, b, c
        target, push = (bx + pose[0], by + pose[1], bz + pose[2]), _turned(turn, px, py, pz)
        square = 0.0
        for i in range(3):
            speed = (target[i] - state[LAST + i]) / step if at > 0 else qvel[dof + i]
            state[LAST + i] = target[i]
            # as if the damper pulled too: MuJoCo takes its part at the hand's own speed off
            ctrl[begin + i] = state[STIFFNESS] * (target[i] - qpos[joint + i]) + state[DAMPING] * (
                speed - qvel[dof + i]
            )
            square += ctrl[begin + i] ** 2
        eased = min(1.0, (EASY + row[ASKED]) / max(square**0.5, 1e-9))
        for i in range(3):
            pulled = eased * ctrl[begin + i] + state[DAMPING] * qvel[dof + i] + push[i]
            ctrl[begin + i] = qpos[joint + i] + pulled / state[STIFFNESS]


@inlined
def note(number: int, step: float, sensors: Array, hands: Arrays) -> None:
    """Records the contacts of all hands at work in the step `number`."""
    wholes, states, plans, _, traces, xpos, xquat, _, _, qpos, _ = hands
    for hand in range(len(wholes)):
        whole, state = wholes[hand], states[hand]
        at = number - whole[START]
        if not whole[ACTIVE] or at < 0:
            continue
        found = min(int(sensors[whole[FELT]]), SLOTS)
        force = drag = x = y = z = 0.0
        for k in range(found):
            slot = sensors[whole[FELT] + NUMBERS * k :]
            force += slot[1]
            drag += (slot[2] ** 2 + slot[3] ** 2) ** 0.5
            x += slot[1] * slot[4]
            y += slot[1] * slot[5]
            z += slot[1] * slot[6]
        time = number * step
        if force > 0.0:
            if not whole[HIT]:
                whole[HIT] = 1
                state[BEGUN] = time
            state[LOST] = float("nan")
            state[PEAK] = max(state[PEAK], force)
        elif state[FORCE] > 0.0:
            state[LOST] = time
        state[FORCE] = force
        link, joint = whole[LINK], whole[QPOS]
        row = traces[hand * TRACE + whole[TRACED] % TRACE]
        row[0], row[1], row[2], row[3] = time, plans[whole[FIRST] + at, ASKED], force, drag
        back = (xquat[link, 0], -xquat[link, 1], -xquat[link, 2], -xquat[link, 3])
        ox, oy, oz = xpos[link, 0], xpos[link, 1], xpos[link, 2]
        size = max(force, 1e-12)
        row[4], row[5], row[6] = _turned(back, x / size - ox, y / size - oy, z / size - oz)
        row[7], row[8], row[9] = _turned(back, qpos[joint] - ox, qpos[joint + 1] - oy, qpos[joint + 2] - oz)
        if not force > 0.0:
            row[4] = row[5] = row[6] = float("nan")
        whole[TRACED] += 1
