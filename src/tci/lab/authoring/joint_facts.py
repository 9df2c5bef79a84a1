"""Limits and couplings of joints in a model file, and the limits proposed from these values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from tci.lab.authoring.joint_tree import Joint, ancestors
from tci.messages.frames import Array
from tci.robot.description import Limits, Model, Servo
from tci.robot.xml.document import parse, read_bytes
from tci.robot.xml.model import MAX_MODEL_BYTES
from tci.support.engine import mujoco

# All values below are assumed.
SPEED = float(np.deg2rad(120.0))
"""Speed limit [rad/s] of a joint for which the file gives no limit or a placeholder."""
FASTEST = 50.0
"""A speed limit [rad/s] in the file that is at least this value counts as a placeholder."""
ACCELERATION = np.deg2rad((700.0, 2400.0))
"""Range [rad/s2] of proposed acceleration limits. Within this range, the proposed limit is the acceleration
that a quarter of the joint's torque limit gives to the largest inertia that the joint carries. From 700
degrees/s2 on, a servo that follows 10 ms late has moved by 0.05 degrees within the 23 ms that a reflex has
beside the skin's frame; with 400 it takes 24 ms or more, whatever the jerk."""
MOST_TORQUE = 0.35
"""Largest fraction of a joint's torque that the proposed acceleration limit may need. More than a quarter of
the torque is used only if a quarter gives less than the least of `ACCELERATION`. The rest moves the motor
itself and what other joints accelerate: with 0.46 the first joint of TIAGo's arm no longer follows."""
SLOWEST = float(np.deg2rad(30.0))
"""Least acceleration [rad/s2] that an arm's joint must reach with its full torque, while it moves its largest
inertia. Real arms reach more than 10 rad/s2. If a joint does not reach SLOWEST, a value in the file has a
wrong unit or is a placeholder."""
LOST = 1.0 / 3.0
"""Largest fraction of a joint's torque that damping may use at full speed. The remaining torque moves the
limb and carries its weight."""
JERK = 100.0
"""Ratio [1/s] of the proposed jerk limit to the acceleration that the joint's full torque gives, or to the
largest of `ACCELERATION`: a motor has its full torque after 10 ms at the earliest. Electric motors need 1 to
3 ms; how much of its torque a motion uses changes nothing about that."""
TORQUE, FINGER_TORQUE = (40.0, 1e4), (1.0, 10.0)
"""Torque [N m] that a joint gets if the file has none, and the limit from which the file's is a placeholder:
of any joint, and of a finger's joint, whose motor reaches about 1 N m. With 40 N m, the fingers of an Allegro
hand pressed on a ball with 11 N before their skin reported the touch; with the 10 N m of Unitree's URDF, a
finger of an Inspire hand with 19 N."""
JAW_TORQUE = 2.0, 50.0
"""As `FINGER_TORQUE`, of a jaw. Assumed: jaws of 5 to 10 cm press with 20 to 200 N."""

RADIANS = 'in an MJCF with ranges in radians --radians, or <compiler angle="radian"/> in the file'
"""What to do about a range that is too small to be meant in degrees."""


@dataclass(frozen=True, slots=True)
class JointFacts:
    """Values of a joint in a model file. A value that is missing in the file is 0."""

    lower: float = 0.0
    upper: float = 0.0
    """Upper limit [rad]; equal to `lower` if the file contains no range."""
    velocity: float = 0.0
    """Largest speed [rad/s]."""
    torque: float = 0.0
    """Largest torque [N m]."""
    follows: str | None = None
    """Name of the leading joint, if this joint follows another joint by a fixed ratio (mimic, equality)."""
    multiplier: float = 1.0
    """Change of this joint's angle per change of the angle of the joint that it `follows`."""
    offset: float = 0.0
    """Angle [rad] of this joint while the joint that it `follows` is at 0."""
    stuck: bool = False
    """True for a joint whose range is a single angle."""
    friction: float = 0.0
    """Torque [N m] of dry friction."""
    assumed: tuple[str, ...] = ()
    """Fields of `Limits` for which these figures are not the file's own, but mended or those of the other
    side."""
    damping: float = 0.0
    """Viscous damping [N m s/rad]: torque against the motion, divided by speed."""


def read_facts(model: Model, compiled: mujoco.MjModel) -> dict[str, JointFacts]:
    """Returns the limits, coupling and friction of each joint in a model file, by joint name."""
    given = _from_mjcf(compiled) if model.format == "mjcf" else _from_urdf(model)
    found = {}
    for name, facts in given.items():
        joint = mujoco.mj_name2id(compiled, mujoco.mjtObj.mjOBJ_JOINT, name)
        found[name] = facts
        if joint >= 0:
            dof = int(compiled.jnt_dofadr[joint])
            losses = (float(compiled.dof_frictionloss[dof]), float(compiled.dof_damping[dof]))
            found[name] = replace(facts, friction=losses[0], damping=losses[1])
    return found


def driven(joints: Sequence[Joint], facts: Mapping[str, JointFacts], needed: set[int]) -> set[int]:
    """Returns the indices of the joints that count as servos.

    A joint at the end of a chain is left out if its range is a single angle (`stuck`), unless `needed`
    contains the joint. If a joint follows another joint by a fixed ratio, only the leading joint is a servo.
    There is one exception: the follower is the servo if `needed` contains only the follower, and if the
    leading joint carries no further joint (a gear at the motor).
    """
    index = {joint.name: place for place, joint in enumerate(joints)}
    parents = {joint.parent for joint in joints}
    servos = set(range(len(joints)))
    for place, joint in enumerate(joints):
        leader = index.get(facts[joint.name].follows or "")
        if facts[joint.name].stuck and place not in parents | needed:
            servos.discard(place)
        elif leader is not None:
            servos.discard(leader if place in needed and leader not in parents | needed else place)
        elif facts[joint.name].follows is not None:
            servos.discard(place)
    return servos


def proposed_limits(given: JointFacts, inertia: float, *, motor: tuple[float, float] = TORQUE) -> Limits:
    """Returns the proposed limits of a joint.

    Assumed values replace missing values and placeholders in the file. `inertia` [kg m2] is the largest
    inertia that the joint carries. `motor` is `TORQUE`, or that of a finger or jaw.
    """
    assumed = ["acceleration", "jerk", *given.assumed]
    lower, upper = given.lower, given.upper
    if not lower < upper or max(-lower, upper) > 2.0 * np.pi:
        lower, upper = -np.pi, np.pi
        assumed += ["lower", "upper"]
    velocity, torque, (usual, placeholder) = given.velocity, given.torque, motor
    if not 0.0 < velocity < FASTEST:
        velocity = SPEED
        assumed.append("velocity")
    if not 0.0 < torque < placeholder:
        torque = usual
        assumed.append("torque")
    if given.damping * velocity > (left := LOST * (torque - given.friction)) > 0.0:
        velocity = left / given.damping
        assumed.append("velocity")
    # rounded in degrees, so that the description is readable
    velocity = float(np.deg2rad(round(np.rad2deg(velocity), 2)))
    able = torque / max(inertia, 1e-6)
    acceleration = float(np.clip(0.25 * able, min(ACCELERATION[0], MOST_TORQUE * able), ACCELERATION[1]))
    acceleration = _rounded(acceleration)
    jerk = JERK * max(min(able, ACCELERATION[1]), acceleration)
    jerk = float(np.deg2rad(round(np.rad2deg(jerk), -1)))
    return Limits(
        lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, jerk=jerk,
        torque=torque, assumed=tuple(dict.fromkeys(assumed)),
    )  # fmt: skip


def borne(servos: Sequence[Servo], joints: Sequence[Joint], reactions: Array) -> tuple[Servo, ...]:
    """Returns the servos of one arm or hand alone with accelerations that take at most `MOST_TORQUE` of each
    motor that carries them. `reactions` (k, k) of the `joints` are those of `LinkPoints`.

    Fetch's elbow took 87 % of the torque of its pan, which no longer followed. Two arms are compared with
    each other instead: one with too little torque is refused with that of the other side.
    """
    place, own = {joint.name: one for one, joint in enumerate(joints)}, {one.joint: one for one in servos}
    found = []
    for servo in servos:
        line = ancestors(joints, place[str(servo.joint)])
        most = [
            MOST_TORQUE * (own[joints[one].name].limits.torque or np.inf) / reactions[one, line[0]]
            for one in line[1:] if joints[one].name in own and reactions[one, line[0]] > 0.0
        ]  # fmt: skip
        if most and servo.limits.acceleration is not None and min(most) < servo.limits.acceleration:
            update = {"acceleration": _rounded(min(most))}
            servo = servo.model_copy(update={"limits": servo.limits.model_copy(update=update)})
        found.append(servo)
    return tuple(found)


def _rounded(acceleration: float) -> float:
    """An acceleration [rad/s2], rounded down in degrees."""
    step = 10.0 if acceleration >= np.deg2rad(10.0) else 0.1
    return float(np.deg2rad(step * max(1.0, np.floor(np.rad2deg(acceleration) / step + 1e-9))))


def _from_urdf(model: Model) -> dict[str, JointFacts]:
    root = parse(read_bytes(Path(model.path), limit=MAX_MODEL_BYTES), model.path)
    return {str(joint.get("name")): _described(joint) for joint in root.iterfind("joint")}


def _described(joint: etree._Element) -> JointFacts:
    limit, mimic = joint.find("limit"), joint.find("mimic")
    led: dict[str, Any] = {}
    if mimic is not None:
        led = {"follows": str(mimic.get("joint"))}
        led |= {key: float(mimic.get(key, usual)) for key, usual in (("multiplier", 1.0), ("offset", 0.0))}
    if limit is None:
        return JointFacts(**led)
    lower, upper, velocity, torque = (
        float(limit.get(key, 0.0)) for key in ("lower", "upper", "velocity", "effort")
    )
    stuck = joint.get("type") == "revolute" and lower == upper
    if joint.get("type") == "continuous":
        lower = upper = 0.0
    return JointFacts(lower, upper, velocity, torque, stuck=stuck, **led)


def _from_mjcf(compiled: mujoco.MjModel) -> dict[str, JointFacts]:
    found = {}
    for joint in range(compiled.njnt):
        lower, upper = compiled.jnt_range[joint] if compiled.jnt_limited[joint] else (0.0, 0.0)
        led: dict[str, Any] = {}
        for equality in range(compiled.neq):
            if (
                compiled.eq_type[equality] == mujoco.mjtEq.mjEQ_JOINT
                and compiled.eq_obj1id[equality] == joint
            ):
                leader = int(compiled.eq_obj2id[equality])
                offset, multiplier = compiled.eq_data[equality][:2].tolist()
                led = {"follows": compiled.joint(leader).name if leader >= 0 else "", "offset": offset,
                       "multiplier": multiplier}  # fmt: skip
        torque = _actuated(compiled, joint)
        found[compiled.joint(joint).name] = JointFacts(float(lower), float(upper), 0.0, torque, **led)
    return found


def _actuated(compiled: mujoco.MjModel, joint: int) -> float:
    """Returns the largest torque [N m] of a joint's actuators; 0 if the file does not limit the torque."""
    if compiled.jnt_actfrclimited[joint]:
        return float(np.abs(compiled.jnt_actfrcrange[joint]).max())
    most = 0.0
    for actuator in range(compiled.nu):
        on_joint = compiled.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if not on_joint or int(compiled.actuator_trnid[actuator, 0]) != joint:
            continue
        gear = abs(float(compiled.actuator_gear[actuator, 0]))
        if compiled.actuator_forcelimited[actuator]:
            most += gear * float(np.abs(compiled.actuator_forcerange[actuator]).max())
        elif (
            compiled.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
            and (compiled.actuator_ctrllimited[actuator])
        ):
            gain = abs(float(compiled.actuator_gainprm[actuator, 0]))
            most += gear * gain * float(np.abs(compiled.actuator_ctrlrange[actuator]).max())
    return most
