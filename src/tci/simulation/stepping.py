"""Steps a world in one compiled loop.

Servos, finger and physics are computed without Python between the steps. The loop calls MuJoCo's own
`mj_step` by its address in the library that MuJoCo's Python module has loaded.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from llvmlite import binding
from numba import float64, int64, types

from tci.messages.frames import Array
from tci.simulation.hand_control import HANDS, guide, note
from tci.simulation.sampling import DUE, SKIN, SLOTS, Arrays, sample
from tci.support.compiled import compiled, inlined, reads, returns, views, writes
from tci.support.engine import mujoco

SETPOINT, STRIDE, LAG, LEAD, RATIO, SHIFT, ADVANCE = range(7)
"""Rows of an array (7, k) with the state of the k joints that servos move:

- `SETPOINT`, `STRIDE`: set-point [rad], and its largest change per step.
- `LAG`: value [rad] at which the servo clips its position error (not in impedance mode), which limits its
  speed.
- `LEAD`: in impedance mode damping / (stiffness x step), with which the damping acts on the velocity error;
  otherwise 0.
- `RATIO`, `SHIFT`: angle of the joint per angle of its servo, and angle [rad] of the joint at its servo's
  zero.
- `ADVANCE`: change [rad] of the set-point in the latest step."""
SERVO, ADDRESS, DOF, ACTUATOR, LOOSE, YIELDING, LIMP = range(7)
"""Rows of an array of integers (7, k) for the k joints that servos move. The first four rows are indices: of
the joint's servo, and of the joint in MuJoCo's `qpos`, `qvel` and `ctrl`. The last three rows are flags: 1 if
the servo is in torque mode, 1 if it is in impedance mode, and 1 if it holds no weight."""
TARGET, TORQUE = range(2)
"""Rows of the commands to all servos (2, n): target angles [rad], and torques [N m]."""
ACTIVE, BEGIN, SPEED, DEPTH, LEADS, PATH, END, FORCE, FIRST, LOST, PEAK = range(11)
"""Indices of the values in the state (11,) of the simulated finger that pokes the skin:

- `ACTIVE`: 1 if the finger is present.
- `BEGIN`, `SPEED`, `DEPTH`: start time [s], speed [m/s] and depth [m] of the poke.
- `LEADS`: damping of the finger's spring divided by its stiffness [s].
- `PATH`, `END`: distance [m] that the finger's base has moved so far, and distance at which the base stops.
- `FORCE`, `PEAK`: contact force [N] in the latest step, and largest contact force [N] of the poke.
- `FIRST`, `LOST`: times [s] of the first contact and of the latest loss of contact; NaN if there was none,
  and `LOST` also during a contact."""
TIP, TIP_SENSOR, TRACED = range(3)
"""Indices of the values in the array of integers `Physics.whole`: index of the finger's actuator, index of
the first value of the finger's sensor, and number of steps in the finger's record."""
MOVED = returns(reads(1), writes(1), reads(1), writes(1))
"""MuJoCo's `qpos`, `ctrl`, `qfrc_gravcomp` and `qfrc_applied`; the last two are empty if a robot on a fixed
base has no weight."""
ENGINE = returns(int64, int64)
"""Numba types of the addresses of MuJoCo's model and data."""
KEPT = returns(writes(1), writes(1), writes(1, int64))
"""The result of MuJoCo's solver, from which its next step starts, room for a copy of it, and the integers
`Physics.whole` (see `TIP`)."""
SERVOS = returns(writes(2), reads(2, int64), reads(2))
"""Numba types of the three arrays of the servos: states (see `SETPOINT`) and indices (see `SERVO`) of the
moving joints, and commands to all servos (see `TARGET`)."""
FINGER = returns(writes(1), writes(2))
"""Numba types of the finger's state (11,), and of the record (steps, 3) of its past steps: time [s], contact
force [N] and distance [m] of each step."""
JOINT, VELOCITY, MOTOR = range(3)
"""Rows of the measurements of all servos (3, n): angles [rad], velocities [rad/s] and motor torques [N m]."""


def find_library(folder: Path, version: str) -> Path:
    """Returns the path of MuJoCo's library in `folder`, for the release `version` of MuJoCo.

    Raises ImportError if the folder has no library of this release.
    """
    for name in (f"libmujoco.so.{version}", f"libmujoco.{version}.dylib", "mujoco.dll"):
        if (folder / name).exists():
            return folder / name
    raise ImportError(f"no library of MuJoCo {version} in {folder}; install mujoco-core again, or mujoco")


_LIBRARY = ctypes.CDLL(str(find_library(Path(mujoco.__file__).parent, mujoco.__version__)))


def _bring(name: str) -> Any:
    """Returns a function of MuJoCo's library, by its name, in a form that compiled loops can call."""
    address = ctypes.cast(getattr(_LIBRARY, name), ctypes.c_void_p).value
    binding.add_symbol(name, address)
    return types.ExternalFunction(name, types.void(types.intp, types.intp))


_step, _forward = _bring("mj_step"), _bring("mj_forward")


@inlined
def _follow(servos: Array, places: Array, asked: Array) -> None:
    """Moves the set-points of all moving joints towards the targets of their servos, by the motion of one
    step. The arrays are explained at `SERVOS`."""
    for i in range(servos.shape[1]):
        left = asked[TARGET, places[SERVO, i]] * servos[RATIO, i] + servos[SHIFT, i] - servos[SETPOINT, i]
        servos[ADVANCE, i] = min(max(left, -servos[STRIDE, i]), servos[STRIDE, i])
        servos[SETPOINT, i] += servos[ADVANCE, i]


@inlined
def _drive(qpos: Array, ctrl: Array, servos: Array, places: Array, asked: Array, ahead: float) -> None:
    """Writes the inputs of the servos' actuators into MuJoCo's `ctrl`.

    The inputs are those for set-points that have moved on by `ahead` further steps at the present speed.
    `qpos` contains MuJoCo's joint angles; the other arrays are explained at `SERVOS`.
    """
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
def _let_hang(carried: Array, applied: Array, places: Array) -> None:
    """MuJoCo carries the weight of all links (`carried`), as servos with an integral action do. What hangs on
    joints whose servos do not hold it pulls (`applied`)."""
    for i in range(places.shape[1]):
        dof = places[DOF, i]
        applied[dof] = -carried[dof] if places[LIMP, i] else 0.0


@inlined
def _push(time: float, ctrl: Array, finger: Array, whole: Array) -> None:
    """Moves the base of the finger along its path, by the motion of the step that begins at `time` [s].
    Writes the input of the finger's actuator into MuJoCo's `ctrl`."""
    wanted = finger[SPEED] * (time - finger[BEGIN])
    finger[PATH] = max(finger[PATH], min(wanted, finger[END]))
    # The damper lies between base and tip, so it needs the base's speed as well.
    speed = finger[SPEED] if wanted < finger[END] else 0.0
    ctrl[whole[TIP]] = finger[PATH] + finger[LEADS] * speed


@inlined
def _note(time: float, sensors: Array, finger: Array, whole: Array, trace: Array) -> None:
    """Records the contact of the finger's tip in a step that began at `time` [s]: updates the state `finger`
    (see `ACTIVE`), and writes time [s], contact force [N] and distance [m] into the next row of `trace`."""
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
def _look_ahead(model: int, data: int, warm: Array, spare: Array) -> None:
    """Updates contacts and sensors to the current joint angles and inputs, without a motion. The solver's
    last result is put back, so that later steps are not affected."""
    for i in range(len(warm)):
        spare[i] = warm[i]
    _forward(model, data)
    for i in range(len(warm)):
        warm[i] = spare[i]


@compiled(int64(ENGINE, int64, int64, float64, MOVED, KEPT, SERVOS, FINGER, SKIN, HANDS))
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
    hands: Arrays,
) -> int:
    """Executes the steps of the simulation with the numbers `begin` to `end` - 1, each of `step` [s].

    Also computes the skin frames that become due. Returns the number of the next step, which is below `end`
    if the loop ended early: a patch then has more contacts than its sensor can report (`SLOTS`). The arrays
    are explained at `MOVED`, `KEPT`, `SERVOS`, `FINGER`, `SKIN` and `HANDS`.
    """
    model, data = engine
    warm, spare, whole = kept
    states, places, asked = servos
    tool, trace = finger
    qpos, ctrl, carried, applied = moved
    sensors, patches = skin[0], skin[3]
    due = begin
    for number in range(begin, end):
        time = number * step
        _follow(states, places, asked)
        _drive(qpos, ctrl, states, places, asked, 0.0)
        if tool[ACTIVE]:
            _push(time, ctrl, tool, whole)
        if len(carried):
            _let_hang(carried, applied, places)
        guide(number, step, ctrl, hands)
        _step(model, data)
        if tool[ACTIVE]:
            _note(time, sensors, tool, whole, trace)
        note(number, step, sensors, hands)
        if number + 1 < min(due, end):
            continue
        # Torques and forces on the skin depend on the servos' inputs. The inputs of the previous step would
        # brake a stiff servo in motion. So torques and forces are computed with the inputs of the next step.
        _drive(qpos, ctrl, states, places, asked, 1.0)
        if tool[ACTIVE]:
            _push((number + 1) * step, ctrl, tool, whole)
        if number + 1 < due:
            continue
        due, full, looked = end + 1, False, False
        for patch in range(len(patches)):
            if number + 1 >= patches[patch, DUE]:
                if not looked:
                    _look_ahead(model, data, warm, spare)
                    looked = True
                full |= sample(patch, number + 1, skin) > SLOTS
            due = min(due, patches[patch, DUE])
        if full:
            return number + 1
    return end


@compiled(int64(reads(1), reads(1), reads(1), reads(2, int64), reads(2), reads(2), writes(2)))
def measure(
    qpos: Array, qvel: Array, forces: Array, places: Array, asked: Array, servos: Array, found: Array
) -> int:
    """Writes the angles [rad], velocities [rad/s] and motor torques [N m] of all servos into the rows of
    `found` (3, n).

    For a servo without a joint, the angle is its target, and velocity and torque are 0. For a servo with
    several joints, angle and velocity come from the first joint. `qpos`, `qvel` and `forces` are MuJoCo's;
    the other arguments are explained at `SERVOS`.
    """
    for i in range(found.shape[1]):
        found[JOINT, i] = asked[TARGET, i]
        found[VELOCITY, i] = found[MOTOR, i] = 0.0
    for i in range(places.shape[1] - 1, -1, -1):
        servo, ratio = places[SERVO, i], servos[RATIO, i]
        found[JOINT, servo] = (qpos[places[ADDRESS, i]] - servos[SHIFT, i]) / ratio
        found[VELOCITY, servo] = qvel[places[DOF, i]] / ratio
        found[MOTOR, servo] += forces[places[ACTUATOR, i]] * ratio
    return int(places.shape[1])


@inlined
def _fault(servos: Array, values: Array, count: int) -> int:
    for i in range(len(servos)):
        if not 0 <= servos[i] < count:
            return 1
    for i in range(len(values)):
        if not abs(values[i]) < float("inf"):
            return 2
    return 0


@compiled(int64(views(1, int64), views(1), int64))
def fault_of(servos: Array, values: Array, count: int) -> int:
    """Checks a command to servos: the indices `servos` (k,) must be 0 to `count` - 1, and the `values` (k,)
    must be finite.

    Returns 1 for an invalid index, 2 for a value that is not finite, and 0 if all are valid.
    """
    return int(_fault(servos, values, count))


@compiled(int64(views(1, int64), views(1), reads(1), float64, reads(2, int64), writes(2), writes(2)))
def aim(
    servos: Array, angles: Array, top: Array, steps: float, places: Array, asked: Array, state: Array
) -> int:
    """Sets the targets `angles` (k,) [rad] of the servos with the indices `servos` (k,).

    The set-point of each moving joint then reaches its target in `steps` steps, or in more steps if the joint
    would otherwise be faster than its limit in `top` [rad per step]. `state`, `places` and `asked` are the
    arrays of `SERVOS`. Returns 0, or 1 for an invalid servo and 2 for an angle that is not finite; in these
    two cases nothing is set.
    """
    fault = _fault(servos, angles, asked.shape[1])
    if fault:
        return int(fault)
    for i in range(len(servos)):
        asked[TARGET, servos[i]] = angles[i]
    for i in range(state.shape[1]):
        target = asked[TARGET, places[SERVO, i]] * state[RATIO, i] + state[SHIFT, i]
        left = abs(target - state[SETPOINT, i])
        state[STRIDE, i] = min(left / steps, top[i])
    return 0
