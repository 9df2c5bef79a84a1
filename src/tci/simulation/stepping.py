"""Steps a world in one compiled loop: servos, finger and physics, without Python between the steps.

The loop calls MuJoCo's own `mj_step` by its address in the library that the bindings have loaded.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from llvmlite import binding
from numba import float64, int64, types

from tci.compiled import compiled, inlined, reads, returns, views, writes
from tci.engine import mujoco
from tci.frames import Array
from tci.simulation.sampling import DUE, SKIN, SLOTS, Arrays, sample

SETPOINT, STRIDE, LAG, LEAD, RATIO, SHIFT, ADVANCE = range(7)
"""Rows of the state of moving joints (7, k): set-point [rad], its largest change per step, limit of the error
[rad] that they act on, number of steps by which damping looks ahead; angle of the joint per angle of its
servo, and at its servo's zero [rad]; change [rad] of the set-point in the latest step."""
SERVO, ADDRESS, DOF, ACTUATOR, LOOSE, YIELDING = range(6)
"""Rows of their indices (6, k): servo, place in `qpos`, `qvel` and `ctrl`; 1 in torque mode; 1 in impedance
mode."""
TARGET, TORQUE = range(2)
"""Rows of the commands of all servos (2, n)."""
ACTIVE, BEGIN, SPEED, DEPTH, LEADS, PATH, END, FORCE, FIRST, LOST, PEAK = range(11)
"""Indices of the finger's state: 1 if it is present; start time, speed, depth, ratio of damping to stiffness,
path and end of the path; contact force, times [s] of the first contact and of its latest loss, largest
force."""
TIP, TIP_SENSOR, TRACED, AHEAD = range(4)
"""Indices of the integers: the finger's actuator and sensor, number of steps in its trace, number of the step
whose first half is done."""
MOVED = returns(reads(1), reads(1), writes(1), reads(1), reads(1))
"""Types of the arrays that the next step depends on: MuJoCo's `qpos`, `qvel`, `ctrl`, `qfrc_applied` and
`xfrc_applied`, row after row."""
ENGINE = returns(int64, int64)
"""Types of the addresses of MuJoCo's model and data."""
KEPT = returns(writes(1), writes(1), writes(1, int64))
"""Types of the arrays that a step keeps for the next: MuJoCo's warm start, what the step taken in advance
depended on, and the integers."""
SERVOS = returns(writes(2), reads(2, int64), reads(2))
"""Types of the servos' arrays: states and indices of those that move, commands of all."""
FINGER = returns(writes(1), writes(2))
"""Types of the finger's state and of its trace."""
JOINT, VELOCITY, MOTOR = range(3)
"""Rows of the measurements of all servos (3, n)."""


def find_library(folder: Path, version: str) -> Path:
    """Finds MuJoCo's library for its module's version: another release may have left one in the folder.

    Raises ImportError if it is missing.
    """
    for name in (f"libmujoco.so.{version}", f"libmujoco.{version}.dylib", "mujoco.dll"):
        if (folder / name).exists():
            return folder / name
    raise ImportError(f"no library of MuJoCo {version} in {folder}; install mujoco-core again, or mujoco")


_LIBRARY = ctypes.CDLL(str(find_library(Path(mujoco.__file__).parent, mujoco.__version__)))


def _bring(name: str) -> Any:
    """Makes a function of MuJoCo callable in compiled loops."""
    address = ctypes.cast(getattr(_LIBRARY, name), ctypes.c_void_p).value
    binding.add_symbol(name, address)
    return types.ExternalFunction(name, types.void(types.intp, types.intp))


_step, _step1, _step2 = _bring("mj_step"), _bring("mj_step1"), _bring("mj_step2")
_actuate, _accelerate = _bring("mj_fwdActuation"), _bring("mj_fwdAcceleration")
_constrain, _sense = _bring("mj_fwdConstraint"), _bring("mj_sensorAcc")
_check, _integrate = _bring("mj_checkAcc"), _bring("mj_implicit")


@inlined
def _follow(servos: Array, places: Array, asked: Array) -> None:
    """Moves the servos' set-points by one step."""
    for i in range(servos.shape[1]):
        left = asked[TARGET, places[SERVO, i]] * servos[RATIO, i] + servos[SHIFT, i] - servos[SETPOINT, i]
        servos[ADVANCE, i] = min(max(left, -servos[STRIDE, i]), servos[STRIDE, i])
        servos[SETPOINT, i] += servos[ADVANCE, i]


@inlined
def _drive(qpos: Array, ctrl: Array, servos: Array, places: Array, asked: Array, ahead: float) -> None:
    """Writes the inputs of the servos, for set-points that go on for `ahead` steps at their present speed."""
    for i in range(servos.shape[1]):
        lag, advance = servos[LAG, i], servos[ADVANCE, i]
        here = qpos[places[ADDRESS, i]]
        error = servos[SETPOINT, i] + ahead * advance - here
        if places[LOOSE, i]:
            ctrl[places[ACTUATOR, i]] = asked[TORQUE, places[SERVO, i]] * servos[RATIO, i]
        else:
            seen = error if places[YIELDING, i] else min(max(error, -lag), lag)
            ctrl[places[ACTUATOR, i]] = here + seen + servos[LEAD, i] * advance


@inlined
def _push(time: float, ctrl: Array, finger: Array, whole: Array) -> None:
    """Moves the finger's base by one step."""
    wanted = finger[SPEED] * (time - finger[BEGIN])
    finger[PATH] = max(finger[PATH], min(wanted, finger[END]))
    # The damper lies between base and tip, so it needs the base's speed as well.
    speed = finger[SPEED] if wanted < finger[END] else 0.0
    ctrl[whole[TIP]] = finger[PATH] + finger[LEADS] * speed


@inlined
def _note(time: float, sensors: Array, finger: Array, whole: Array, trace: Array) -> None:
    """Records the tip's contact in a step that began at `time` [s]."""
    at = whole[TIP_SENSOR]
    force = (sensors[at] ** 2 + sensors[at + 1] ** 2 + sensors[at + 2] ** 2) ** 0.5
    if force > 0.0:
        if finger[FIRST] != finger[FIRST]:
            finger[FIRST] = time
            finger[END] = finger[PATH] + finger[DEPTH]
            # A finger that waited at the end of its path continues from there.
            finger[BEGIN] = max(finger[BEGIN], time - finger[PATH] / finger[SPEED])
        finger[LOST] = float("nan")
        finger[PEAK] = max(finger[PEAK], force)
    elif finger[FORCE] > 0.0:
        finger[LOST] = time
    finger[FORCE] = force
    row = trace[whole[TRACED] % len(trace)]
    row[0], row[1], row[2] = time, force, finger[PATH]
    whole[TRACED] += 1


@inlined
def _keep(values: Array, here: Array, at: int) -> int:
    for i in range(len(values)):
        here[at + i] = values[i]
    return at + len(values)


@inlined
def _look_ahead(
    model: int, data: int, number: int, moved: Arrays, warm: Array, here: Array, whole: Array
) -> None:
    """Updates contacts and sensors to the current joints: does all of the next step except the motion."""
    qpos, qvel, ctrl, applied, pushed = moved
    _step1(model, data)
    at = _keep(qpos, here, 0)
    at = _keep(qvel, here, at)
    at = _keep(ctrl, here, at)
    at = _keep(applied, here, at)
    at = _keep(pushed, here, at)
    _keep(warm, here, at)
    _actuate(model, data)
    _accelerate(model, data)
    _constrain(model, data)
    _sense(model, data)
    # The solver starts from its last result, which is restored so that later steps are not affected.
    for i in range(len(warm)):
        warm[i] = here[at + i]
    whole[AHEAD] = number


@inlined
def _differs(values: Array, here: Array, at: int) -> bool:
    differs = False
    for i in range(len(values)):
        differs |= values[i] != here[at + i]
    return bool(differs)


@inlined
def _take_step(model: int, data: int, number: int, moved: Arrays, here: Array, whole: Array) -> None:
    """Does `mj_step`, or only the rest of it if joints and inputs are unchanged since `_look_ahead`."""
    qpos, qvel, ctrl, applied, pushed = moved
    n, m, k = len(qpos), len(qvel), len(ctrl)
    if whole[AHEAD] != number or _differs(qpos, here, 0) or _differs(qvel, here, n):
        _step(model, data)
    elif (
        _differs(ctrl, here, n + m)
        or _differs(applied, here, n + m + k)
        or _differs(pushed, here, n + 2 * m + k)
    ):
        _step2(model, data)
    else:
        _check(model, data)
        _integrate(model, data)


@compiled(int64(ENGINE, int64, int64, float64, MOVED, KEPT, SERVOS, FINGER, SKIN))
def march(
    engine: tuple[int, int],
    begin: int,
    end: int,
    step: float,
    moved: Arrays,
    kept: Arrays,
    servos: Arrays,
    finger: Arrays,
    skin: Arrays,
) -> int:
    """Takes steps number `begin` to `end`, each of `step` [s], and the skin frames that become due.

    Returns the number of the last step: it ends early if a patch has more contacts than slots.
    """
    model, data = engine
    warm, here, whole = kept
    states, places, asked = servos
    tool, trace = finger
    qpos, _, ctrl, _, _ = moved
    sensors, patches = skin[0], skin[3]
    due = begin
    for number in range(begin, end):
        time = number * step
        _follow(states, places, asked)
        _drive(qpos, ctrl, states, places, asked, 0.0)
        if tool[ACTIVE]:
            _push(time, ctrl, tool, whole)
        _take_step(model, data, number, moved, here, whole)
        if tool[ACTIVE]:
            _note(time, sensors, tool, whole, trace)
        if number + 1 < min(due, end):
            continue
        # Torques and forces on the skin depend on the servos' inputs. Those of the step before would brake a
        # stiff servo in motion, so they are read with the inputs with which it goes on.
        _drive(qpos, ctrl, states, places, asked, 1.0)
        if tool[ACTIVE]:
            _push((number + 1) * step, ctrl, tool, whole)
        if number + 1 < due:
            continue
        due, full = end + 1, False
        for patch in range(len(patches)):
            if number + 1 >= patches[patch, DUE]:
                if whole[AHEAD] != number + 1:
                    _look_ahead(model, data, number + 1, moved, warm, here, whole)
                full |= sample(patch, number + 1, skin) > SLOTS
            due = min(due, patches[patch, DUE])
        if full:
            return number + 1
    return end


@compiled(int64(reads(1), reads(1), reads(1), reads(2, int64), reads(2), reads(2), writes(2)))
def measure(
    qpos: Array, qvel: Array, forces: Array, places: Array, asked: Array, servos: Array, found: Array
) -> int:
    """Writes angles [rad], velocities and motor torques of all servos (3, n); the angle of a servo without a
    joint is its target, and that of one with several joints comes from the first."""
    for i in range(found.shape[1]):
        found[JOINT, i] = asked[TARGET, i]
        found[VELOCITY, i] = found[MOTOR, i] = 0.0
    for i in range(places.shape[1] - 1, -1, -1):
        servo, ratio = places[SERVO, i], servos[RATIO, i]
        found[JOINT, servo] = (qpos[places[ADDRESS, i]] - servos[SHIFT, i]) / ratio
        found[VELOCITY, servo] = qvel[places[DOF, i]] / ratio
        found[MOTOR, servo] += forces[places[ACTUATOR, i]] * ratio
    return int(places.shape[1])


@compiled(int64(views(1, int64), views(1), int64))
def fault_of(servos: Array, values: Array, count: int) -> int:
    """Checks `values` (k,) for `servos` (k,) out of `count`: returns 1 for an invalid servo, 2 for a value
    that is not finite, else 0."""
    for i in range(len(servos)):
        if not 0 <= servos[i] < count:
            return 1
    for i in range(len(values)):
        if not abs(values[i]) < float("inf"):
            return 2
    return 0


@compiled(int64(views(1, int64), views(1), reads(1), float64, reads(2, int64), writes(2), writes(2)))
def aim(
    servos: Array, angles: Array, top: Array, steps: float, places: Array, asked: Array, state: Array
) -> int:
    """Sets targets `angles` (k,) [rad] of `servos` (k,), to be reached in `steps` steps, each of at most
    `top` (moving,) [rad]."""
    for i in range(len(servos)):
        asked[TARGET, servos[i]] = angles[i]
    for i in range(state.shape[1]):
        target = asked[TARGET, places[SERVO, i]] * state[RATIO, i] + state[SHIFT, i]
        left = abs(target - state[SETPOINT, i])
        state[STRIDE, i] = min(left / steps, top[i])
    return len(servos)
