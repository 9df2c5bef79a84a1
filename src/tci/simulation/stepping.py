"""Steps a world in one compiled loop.

Servos, finger and physics are computed without Python between the steps. The loop calls MuJoCo's own
`mj_step` by its address in the library that MuJoCo's Python module has loaded.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding
from numba import float64, from_dtype, int64, types
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.simulation.hand_control import HANDS, guide, note
from tci.simulation.sampling import SKIN, SLOTS, Arrays, sample
from tci.support.compiled import compiled, inlined, reads, returns, views, writes
from tci.support.engine import mujoco

_F, _I = np.float64, np.int64
DRIVE = np.dtype([
    ("setpoint", _F), ("stride", _F), ("lag", _F), ("lead", _F), ("ratio", _F), ("shift", _F),
    ("advance", _F),
    ("servo", _I), ("address", _I), ("dof", _I), ("actuator", _I), ("loose", _I), ("yielding", _I),
    ("limp", _I),
])  # fmt: skip
"""Control of one joint that a servo moves:

- `setpoint`, `stride`: set-point [rad], and its largest change per step.
- `lag`: value [rad] at which the servo clips its position error (not in impedance mode), which limits its
  speed.
- `lead`: in impedance mode damping / (stiffness x step), with which the damping acts on the velocity error;
  otherwise 0.
- `ratio`, `shift`: angle of the joint per angle of its servo, and angle [rad] of the joint at its servo's
  zero.
- `advance`: change [rad] of the set-point in the latest step.
- `servo`, `address`, `dof`, `actuator`: indices of its servo, and of the joint in MuJoCo's `qpos`, `qvel` and
  `ctrl`.
- `loose`, `yielding`, `limp`: 1 if the servo is in torque mode, 1 if it is in impedance mode, and 1 if it
  holds no weight."""
ASKED = np.dtype([("target", _F), ("torque", _F)])
"""Command to one servo: target angle [rad], and torque [N m]."""
POKE = np.dtype([
    ("active", _I), ("actuator", _I), ("sensor", _I), ("traced", _I),
    ("begin", _F), ("speed", _F), ("depth", _F), ("leads", _F), ("path", _F), ("end", _F),
    ("force", _F), ("peak", _F), ("first", _F), ("lost", _F),
])  # fmt: skip
"""State of the simulated finger that pokes the skin:

- `active`: 1 if the finger is present.
- `actuator`, `sensor`: indices of its actuator, and of the first value of its sensor.
- `traced`: number of steps in the finger's record.
- `begin`, `speed`, `depth`: start time [s], speed [m/s] and depth [m] of the poke.
- `leads`: damping of the finger's spring divided by its stiffness [s].
- `path`, `end`: distance [m] that the finger's base has moved so far, and distance at which the base stops.
- `force`, `peak`: contact force [N] in the latest step, and largest contact force [N] of the poke.
- `first`, `lost`: times [s] of the first contact and of the latest loss of contact; NaN if there was none,
  and `lost` also during a contact."""
MOVED = returns(reads(1), writes(1), reads(1), writes(1))
"""MuJoCo's `qpos`, `ctrl`, `qfrc_gravcomp` and `qfrc_applied`; the last two are empty if a robot on a fixed
base has no weight."""
ENGINE = returns(int64, int64)
"""Numba types of the addresses of MuJoCo's model and data."""
KEPT = returns(writes(1), writes(1))
"""The result of MuJoCo's solver, from which its next step starts, and room for a copy of it."""
DRIVES, COMMANDS = from_dtype(DRIVE), from_dtype(ASKED)
SERVOS = returns(writes(1, DRIVES), reads(1, COMMANDS))
"""Numba types of the `DRIVE`s (k,) of all joints that servos move, and of the commands (n,) to all servos."""
FINGER = returns(writes(1, from_dtype(POKE)), writes(2))
"""Numba types of the finger's state (1,), and of the record (steps, 3) of its past steps: time [s], contact
force [N] and distance [m] of each step."""
Records = NDArray[np.void]


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
def follow(drives: Records, asked: Records) -> None:
    """Moves the set-points of all moving joints towards the targets of their servos, by the motion of one
    step."""
    for i in range(len(drives)):
        one = drives[i]
        left = asked[one.servo].target * one.ratio + one.shift - one.setpoint
        one.advance = min(max(left, -one.stride), one.stride)
        one.setpoint += one.advance


@inlined
def drive(qpos: Array, ctrl: Array, drives: Records, asked: Records, ahead: float) -> None:
    """Writes the inputs of the servos' actuators into MuJoCo's `ctrl`, for set-points that have moved on by
    `ahead` further steps at the present speed. `qpos` contains MuJoCo's joint angles."""
    for i in range(len(drives)):
        one = drives[i]
        here = qpos[one.address]
        error = one.setpoint + ahead * one.advance - here
        if one.loose:
            ctrl[one.actuator] = asked[one.servo].torque * one.ratio
        else:
            seen = error if one.yielding else min(max(error, -one.lag), one.lag)
            ctrl[one.actuator] = here + seen + one.lead * one.advance


@inlined
def _let_hang(carried: Array, applied: Array, drives: Records) -> None:
    """MuJoCo carries the weight of all links (`carried`), as servos with an integral action do. What hangs on
    joints whose servos do not hold it pulls (`applied`)."""
    for i in range(len(drives)):
        dof = drives[i].dof
        applied[dof] = -carried[dof] if drives[i].limp else 0.0


@inlined
def push(time: float, ctrl: Array, finger: Any) -> None:
    """Moves the base of the finger along its path, by the motion of the step that begins at `time` [s].
    Writes the input of the finger's actuator into MuJoCo's `ctrl`."""
    wanted = finger.speed * (time - finger.begin)
    finger.path = max(finger.path, min(wanted, finger.end))
    # The damper lies between base and tip, so it needs the base's speed as well.
    speed = finger.speed if wanted < finger.end else 0.0
    ctrl[finger.actuator] = finger.path + finger.leads * speed


@inlined
def note_tip(time: float, sensors: Array, finger: Any, trace: Array) -> None:
    """Records the contact of the finger's tip in a step that began at `time` [s]: updates the state `finger`
    (`POKE`), and writes time [s], contact force [N] and distance [m] into the next row of `trace`."""
    at = finger.sensor
    force = (sensors[at] ** 2 + sensors[at + 1] ** 2 + sensors[at + 2] ** 2) ** 0.5
    if force > 0.0:
        if finger.first != finger.first:
            finger.first = time
            finger.end = finger.path + finger.depth
            # A finger that waited at the end of its path continues from there.
            finger.begin = max(finger.begin, time - finger.path / finger.speed)
        finger.lost = float("nan")
        finger.peak = max(finger.peak, force)
    elif finger.force > 0.0:
        finger.lost = time
    finger.force = force
    row = trace[finger.traced % len(trace)]
    row[0], row[1], row[2] = time, force, finger.path
    finger.traced += 1


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
    warm, spare = kept
    drives, asked = servos
    tool, trace = finger[0][0], finger[1]
    qpos, ctrl, carried, applied = moved
    sensors, patches = skin[0], skin[3]
    due = begin
    for number in range(begin, end):
        time = number * step
        follow(drives, asked)
        drive(qpos, ctrl, drives, asked, 0.0)
        if tool.active:
            push(time, ctrl, tool)
        if len(carried):
            _let_hang(carried, applied, drives)
        guide(number, step, ctrl, hands)
        _step(model, data)
        if tool.active:
            note_tip(time, sensors, tool, trace)
        note(number, step, sensors, hands)
        if number + 1 < min(due, end):
            continue
        # Torques and forces on the skin depend on the inputs of servos, finger and hands. Those of the
        # previous step would brake a stiff servo in motion, and leave the pads of a hand behind its base. So
        # torques and forces are computed with the inputs of the next step.
        drive(qpos, ctrl, drives, asked, 1.0)
        if tool.active:
            push((number + 1) * step, ctrl, tool)
        guide(number + 1, step, ctrl, hands)
        if number + 1 < due:
            continue
        due, full, looked = end + 1, False, False
        for patch in range(len(patches)):
            if number + 1 >= patches[patch].due:
                if not looked:
                    _look_ahead(model, data, warm, spare)
                    looked = True
                full |= sample(patch, number + 1, skin) > SLOTS
            due = min(due, patches[patch].due)
        if full:
            return number + 1
    return end


@compiled(
    int64(reads(1), reads(1), reads(1), reads(1, DRIVES), reads(1, COMMANDS), writes(1), writes(1), writes(1))
)
def measure(
    qpos: Array,
    qvel: Array,
    forces: Array,
    drives: Records,
    asked: Records,
    angles: Array,
    velocities: Array,
    torques: Array,
) -> int:
    """Writes the `angles` [rad], `velocities` [rad/s] and motor `torques` [N m] (n,) of all servos.

    For a servo without a joint, the angle is its target, and velocity and torque are 0. For a servo with
    several joints, angle and velocity come from the first joint. `qpos`, `qvel` and `forces` are MuJoCo's.
    """
    for i in range(len(angles)):
        angles[i] = asked[i].target
        velocities[i] = torques[i] = 0.0
    for i in range(len(drives) - 1, -1, -1):
        one = drives[i]
        angles[one.servo] = (qpos[one.address] - one.shift) / one.ratio
        velocities[one.servo] = qvel[one.dof] / one.ratio
        torques[one.servo] += forces[one.actuator] * one.ratio
    return len(drives)


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


@compiled(int64(views(1, int64), views(1), reads(1), float64, writes(1, DRIVES), writes(1, COMMANDS)))
def aim(servos: Array, angles: Array, top: Array, steps: float, drives: Records, asked: Records) -> int:
    """Sets the targets `angles` (k,) [rad] of the servos with the indices `servos` (k,).

    The set-point of each moving joint then reaches its target in `steps` steps, or in more steps if the joint
    would otherwise be faster than its limit in `top` [rad per step]. Returns 0, or 1 for an invalid servo and
    2 for an angle that is not finite; in these two cases nothing is set.
    """
    fault = _fault(servos, angles, len(asked))
    if fault:
        return int(fault)
    for i in range(len(servos)):
        asked[servos[i]].target = angles[i]
    for i in range(len(drives)):
        one = drives[i]
        target = asked[one.servo].target * one.ratio + one.shift
        left = abs(target - one.setpoint)
        one.stride = min(left / steps, top[i])
    return 0
