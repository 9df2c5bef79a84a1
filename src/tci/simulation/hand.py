"""A person's hand in the simulation: a palm and five finger tips on soft pads, carried by a soft arm.

MuJoCo moves a mass on three springs (the arm), on which six capsules slide on springs of their own (the
pads), all together sideways on two more. What the hand is to do is a `HandPath`; `hand_control` moves the
springs' ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, TciError, UnknownNameError
from tci.messages.frames import Array, read_only, transform
from tci.robot.collisions import PERSON
from tci.robot.neutral import neutral
from tci.simulation.hand_control import (
    AWAY,
    DOFS,
    HAND,
    MOMENT,
    NOTED,
    RING,
    SEEN,
    SLOTS,
    TRACE,
    WINDOW,
)
from tci.simulation.hand_path import PADS, Ballistics, HandPath, Moments, plan_of, turns_of
from tci.simulation.physics import Physics, exclusive
from tci.simulation.touch import FINGER_PRIORITY, FRICTION, skin_geom, stiff
from tci.skin.surfaces import Surface
from tci.support.engine import mujoco

PERSON_PRIORITY = FINGER_PRIORITY + 3
"""The contact's settings are those of the person, whatever the robot's model says of its own geoms."""
SOFT = [0.0, 0.95, 5e-4, 0.5, 2.0]
"""MuJoCo's `solimp`: skin gives way by some tenths of a millimetre. With the usual 0.9 for a shallow contact,
a light pad lies so near the surface that single steps of a lasting contact are missed."""
MARGIN = 5e-4
"""Distance [m] at which a contact begins. Assumed: a firm touch is less deep, and outside of a body distances
are exact."""
SKIN_GEOM = skin_geom("")
SIDES = "left", "right"
PAD_MASS = 0.015
"""Mass [kg] of a pad. Assumed: light, so that the blow is that of the hand behind it."""
FLESH_MASS = 0.01
"""Mass [kg] of what lies between the hand's bones and its pads, which gives way sideways: else the edge of a
link that comes from the side would strike 0.6 kg rigidly, with hundreds of newtons. Assumed: light."""
PAD_DAMPING, ARM_DAMPING = 0.5, 0.7
"""Damping ratios. Assumed."""
_PALM, _TIP = (0.014, 0.025), (0.007, 0.012)
"""Radius and half length [m] of the palm's capsule, which lies across the fingers, and of a finger's, whose
tip points at the skin. Assumed: an adult's."""
_COLOUR = (0.85, 0.55, 0.45, 1.0)
_ON_SKIN = 0.02
"""Distance [m] from a taxel up to which a place counts as on skin. Assumed: above every skin's pitch."""
_RUN_UPS = 1.0, 0.5, 0.25
"""Run-ups that are tried, as fractions of the usual one: between arm and trunk there is little room."""
_INSIDE = 5e-4
"""Depth [m] in a body at which a hand may not start."""


@dataclass(frozen=True, kw_only=True)
class PersonModel:
    """A person who touches. Raises CommandError for a number out of range."""

    name: str = "person"
    mass: float = 0.6
    """Of a hand [kg]."""
    pad: float = 1500.0
    """Stiffness [N/m] of a pad, and of all together sideways; people's are 1000 to 2000."""
    arm: float = 500.0
    """Stiffness of the arm at the hand [N/m]; people's are 200 to 800."""
    delay: float = 0.15
    """From what is seen and felt to the muscle [s]."""
    bandwidth: float = 3.0
    """Of what is corrected [Hz]."""
    hands: Sequence[str] = SIDES
    """Some of `SIDES`: each hand makes the simulation slower, also while it waits."""

    def __post_init__(self) -> None:
        ranges = {"mass": (0.05, 5.0), "pad": (200.0, 5000.0), "arm": (50.0, 5000.0), "delay": (0.0, 0.5),
                  "bandwidth": (0.1, 3.0)}  # fmt: skip
        if not self.hands or not set(self.hands) <= set(SIDES) or len(set(self.hands)) < len(self.hands):
            raise CommandError(f"hands {self.hands} of {self.name}; valid: some of {', '.join(SIDES)}")
        for name, (low, high) in ranges.items():
            if not low <= (value := getattr(self, name)) <= high:
                raise CommandError(f"{name} {value} of {self.name}; valid: {low:g} to {high:g}")


def add_hand(spec: mujoco.MjSpec, name: str, person: PersonModel, *, step: float, bit: int) -> None:
    """Adds a hand with its own collision `bit` (`collisions.HANDS`), out of reach."""
    plain = neutral(spec)
    axes, slide = np.eye(3), mujoco.mjtJoint.mjJNT_SLIDE
    hand = spec.worldbody.add_body(
        name=name, gravcomp=1.0, mass=person.mass, inertia=[1e-3] * 3, explicitinertial=True
    )
    damping = 2.0 * ARM_DAMPING * np.sqrt(person.arm * person.mass)
    for axis, direction in zip("xyz", axes, strict=True):
        hand.add_joint(plain, name=f"{name}_{axis}", type=slide, axis=direction)
        arm = spec.add_actuator(
            plain, name=f"{name}_{axis}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{name}_{axis}"
        )
        arm.set_to_position(kp=person.arm, kv=damping)
    flesh = hand.add_body(name=f"{name}_flesh", gravcomp=1.0, mass=FLESH_MASS, inertia=[1e-6] * 3,
                          explicitinertial=True)  # fmt: skip
    sideways = 2.0 * PAD_DAMPING * np.sqrt(person.pad * (FLESH_MASS + len(PADS) * PAD_MASS))
    for axis, direction in zip("xy", axes, strict=False):
        flesh.add_joint(
            plain, name=f"{name}_flesh_{axis}", type=slide, axis=direction, stiffness=[person.pad, 0.0, 0.0],
            damping=[sideways, 0.0, 0.0],
        )  # fmt: skip
    soft = 2.0 * PAD_DAMPING * np.sqrt(person.pad * PAD_MASS)
    for pad in PADS:
        body = flesh.add_body(name=f"{name}_{pad}", gravcomp=1.0)
        body.add_joint(
            plain, name=f"{name}_{pad}", type=slide, axis=[0.0, 0.0, 1.0], stiffness=[person.pad, 0.0, 0.0],
            damping=[soft, 0.0, 0.0],
        )  # fmt: skip
        radius, half = _PALM if pad == "palm" else _TIP
        across = (-half, half) if pad == "palm" else (-2.0 * half, 0.0)
        ends = [[0.0, end, -radius] if pad == "palm" else [0.0, 0.0, end - radius] for end in across]
        body.add_geom(
            plain, name=f"{name}_{pad}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 0.0, 0.0],
            fromto=np.ravel(ends), mass=PAD_MASS, rgba=_COLOUR, group=2, **contact_of(step, bit),
        )  # fmt: skip
    fields = (mujoco.mjtConDataField.mjCONDATA_FOUND, mujoco.mjtConDataField.mjCONDATA_FORCE,
              mujoco.mjtConDataField.mjCONDATA_POS)  # fmt: skip
    spec.add_sensor(
        name=name, type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_XBODY, objname=name,
        intprm=[sum(1 << int(field) for field in fields), 2, SLOTS],
    )  # fmt: skip


def contact_of(step: float, bit: int = PERSON) -> dict[str, object]:
    """Settings of the contacts of people and things with a robot."""
    return {
        "contype": bit, "conaffinity": 0, "condim": 3, "friction": [FRICTION, 0.005, 1e-4],
        "priority": PERSON_PRIORITY, "solref": stiff(step), "solimp": SOFT,
        "margin": MARGIN, "gap": 0.0,
    }  # fmt: skip


class Hands:
    """All hands of a world, in the arrays of the compiled loop."""

    def __init__(self, physics: Physics, people: dict[str, PersonModel]) -> None:
        """`people` has one entry for each hand, by the name of its body."""
        self.physics, model, data = physics, physics.model, physics.data
        self.names = tuple(people)
        count = len(people)
        self.states = np.zeros(count, HAND)
        self.plans: list[Moments] = [np.zeros(0, MOMENT)] * count
        self.memories, self.traces = np.zeros((count, RING), SEEN), np.zeros((count, TRACE), NOTED)
        for state, (name, person) in zip(self.states, people.items(), strict=True):
            joint = model.joint(f"{name}_x")
            state["joint"], state["dof"] = joint.qposadr[0], joint.dofadr[0]
            state["actuator"], state["sensor"] = model.actuator(f"{name}_x").id, model.sensor(name).adr[0]
            state["pads"] = model.body(f"{name}_palm").id
            state["delay"] = max(1, round(person.delay / physics.step))
            if round((person.delay + WINDOW) / physics.step) >= RING:
                raise CommandError(
                    f"step {physics.step} is too short for people; valid: from {0.55 / RING:.1g} s on"
                )
            state["stiffness"], state["pad"] = person.arm, person.pad
            state["damping"] = 2.0 * ARM_DAMPING * np.sqrt(person.arm * person.mass)
            state["omega"] = 2.0 * np.pi * person.bandwidth
        self._others = data.xpos, data.xquat, model.body_pos, model.body_quat, data.qpos, data.qvel
        self.arrays: tuple[Any, ...] = ()
        """Arguments of the compiled loop, as `hand_control.HANDS` says."""
        self.renew()

    def renew(self) -> None:
        """Puts the plans of all hands into one array."""
        lengths = [len(plan) for plan in self.plans]
        self.states["first"], self.states["count"] = np.cumsum([0, *lengths])[:-1], lengths
        plans = np.concatenate([np.zeros(0, MOMENT), *self.plans])
        self.arrays = self.states, plans, self.memories, self.traces, *self._others


class Hand:
    """One hand of a person."""

    def __init__(
        self, hands: Hands, number: int, person: PersonModel, surfaces: Mapping[str, Surface]
    ) -> None:
        self._hands, self._number, self._physics = hands, number, hands.physics
        self._state = hands.states[number]
        self.name, self.person = hands.names[number], person
        model = self._physics.model
        self._geoms = [model.geom(f"{self.name}_{pad}").id for pad in PADS]
        self._scratch = mujoco.MjData(model)
        self._solid = np.flatnonzero(model.geom_conaffinity & PERSON).tolist()
        names = {geom: str(model.geom(geom).name) for geom in self._solid}
        self._hard = [geom for geom in self._solid if not names[geom].startswith(SKIN_GEOM)]
        self._skins = [
            (geom, surfaces[name.removeprefix(SKIN_GEOM)].positions)
            for geom, name in names.items() if name.startswith(SKIN_GEOM)
        ]  # fmt: skip
        damping = 2.0 * PAD_DAMPING * float(np.sqrt(person.pad * PAD_MASS))
        self._ballistics = Ballistics(person.mass, person.pad, damping, FRICTION)
        self.waiting: list[tuple[float, HandPath]] = []
        """Start times [s] and paths of touches that have not begun."""
        self.missed: list[tuple[float, str]] = []
        """Times [s] of touches that could not begin as planned, and why."""
        self.retire()

    # ------------------------------------------------------------------ what it does

    @exclusive
    def touch(self, path: HandPath, start: float | None = None) -> None:
        """Begins a touch now, or at the time `start` [s] of the world: its first contact is a quarter of a
        second later (`APPROACH`). The hand appears beside the body, follows the path, and goes away.

        Raises UnknownNameError for a link that the robot lacks, CommandError for a start in the past or while
        the hand does something else, and TciError if the hand has no room: it never starts inside a body. A
        touch that has no room when its `start` comes is noted in `missed`.
        """
        names = [self._physics.model.body(k).name for k in range(1, self._physics.model.nbody)]
        if path.link not in names:
            raise UnknownNameError("link", path.link, [one for one in names if not one.startswith("tci_")])
        now = self._physics.time
        if start is not None and start > now + 0.5 * self._physics.step:
            self.waiting = sorted([*self.waiting, (start, path)], key=lambda one: one[0])
            return
        if start is not None and start < now - 0.5 * self._physics.step:
            raise CommandError(f"start {start:g} s; valid: now ({now:g} s) or later")
        if self.busy:
            raise CommandError(f"{self.name} is touching; valid: a start after the touch, or retire()")
        self._begin(path)

    @exclusive
    def retire(self) -> None:
        """Takes the hand away at once, and forgets what it was to do and its measurements."""
        self._state["active"] = 0
        self.waiting.clear()
        self.missed.clear()
        self._park()
        self._clear()

    def begin_waiting(self) -> None:
        """Begins the touch whose time has come."""
        while self.waiting and self.waiting[0][0] <= self._physics.time + 0.5 * self._physics.step:
            _, path = self.waiting.pop(0)
            try:
                if self.busy:
                    raise CommandError("the hand was still at work")
                self._begin(path)
            except TciError as error:
                self.missed.append((self._physics.time, str(error)))

    @property
    def due(self) -> float:
        """Time [s] of the next touch that waits; infinite if there is none."""
        return self.waiting[0][0] if self.waiting else np.inf

    # ------------------------------------------------------------------ what is true

    @property
    def busy(self) -> bool:
        """True from the start of a touch until the hand has gone away."""
        return bool(self._state["active"])

    @property
    def force(self) -> float:
        """Sum of the normal forces [N] on the hand in the latest step."""
        return float(self._state["force"])

    @property
    def peak_force(self) -> float:
        """Largest `force` [N] of the touch."""
        return float(self._state["peak"])

    @property
    def first_contact(self) -> float | None:
        """Time [s]; None before it."""
        return float(self._state["begun"]) if self._state["hit"] else None

    @property
    def contact_lost(self) -> float | None:
        """Time [s] of the latest loss of contact; None during a contact and before the first one."""
        lost = float(self._state["lost"])
        return None if np.isnan(lost) else lost

    @property
    def trace(self) -> Array:
        """(steps, 10) of the touch: time [s], asked force, contact force, friction [N], centre of the contact
        (3) and place of the hand (3) in the link's frame [m]. The centre is NaN without contact. The last
        40 s at the default step."""
        count, kept = int(self._state["traced"]), self._hands.traces[self._number].view(float)
        rows: Array = kept.reshape(TRACE, -1)
        return rows[:count].copy() if count <= TRACE else np.roll(rows, -count, axis=0)

    @property
    def asked(self) -> float:
        """Force [N] that the hand was to press with in the latest step; 0 without a touch."""
        traced = int(self._state["traced"])
        if not (self.busy and traced):
            return 0.0
        return float(self._hands.traces[self._number, (traced - 1) % TRACE]["asked"])

    @property
    def physics(self) -> Physics:
        return self._physics

    def tip(self, pad: str = "index") -> Array:
        """Pose (4, 4) of a pad in the world: its tip, with z into the skin."""
        data, body = self._physics.data, int(self._state["pads"]) + PADS.index(pad)
        return transform(data.xmat[body].reshape(3, 3), np.array(data.xpos[body]))

    # ------------------------------------------------------------------ what it does from moment to moment

    @exclusive
    def replan(self, moments: Moments) -> None:
        """What to do from the next step on. Then the hand goes away."""
        state, plan = self._state, self._hands.plans[self._number]
        now = min(max(int(state["guided"] - state["start"]), 0), len(plan) - 1)
        self._hands.plans[self._number] = np.concatenate([plan[now : now + 1], moments])
        self._hands.renew()
        state["start"] = state["guided"]

    @exclusive
    def height(self, link: str, pad: str, point: ArrayLike, normal: ArrayLike) -> float:
        """Height [m] above a point of a link at which a pad first touches it; all in the link's frame."""
        self._physics.refresh()
        model, data, source = self._physics.model, self._scratch, self._physics.data
        data.geom_xpos[:], data.geom_xmat[:] = source.geom_xpos, source.geom_xmat
        body = model.body(link).id
        R, p, local = source.xmat[body].reshape(3, 3), source.xpos[body], np.empty(9)
        out = np.asarray(normal) / np.linalg.norm(normal)
        mujoco.mju_quat2Mat(local, self.turn(link, out))
        near = [geom for geom in self._solid if model.geom_bodyid[geom] == body]
        geom = self._geoms[PADS.index(pad)]
        return self._height(geom, near, p + R @ np.asarray(point), R @ out, R @ local.reshape(3, 3))

    def turn(self, link: str, normal: ArrayLike) -> Array:
        """Orientation (4,) of a pad that touches against an outward normal, in the link's frame."""
        model = self._physics.model
        unit = np.reshape(normal, (1, 1, 3)) / np.linalg.norm(normal)
        turn: Array = turns_of(unit, _long_axis(model, model.body(link).id))[0, 0]
        return turn

    # ------------------------------------------------------------------ how it begins

    def _begin(self, path: HandPath) -> None:
        physics, model = self._physics, self._physics.model
        physics.refresh()
        link = model.body(path.link).id
        self._open(path, link)
        turns = turns_of(np.array(path.normals), _long_axis(model, link))
        heights = self._heights(path, turns, link)
        for run_up in _RUN_UPS:
            plan, flight = plan_of(path, heights, turns, physics.step, self._ballistics, run_up)
            blocked = self._blocked(path, plan, flight, link)
            if not blocked:
                break
        else:
            raise TciError(f"no room for {self.name}: {blocked}")
        self._hands.plans[self._number] = plan
        self._hands.renew()
        self._clear()
        state, steps = self._state, physics.steps
        state["link"], state["start"], state["guided"], state["active"] = link, steps, steps - 1, 1
        self._watch(link)
        target = self._pose(plan[0], link)
        dof, joint = state["dof"], state["joint"]
        physics.qpos[joint : joint + DOFS] = physics.qvel[dof : dof + DOFS] = 0.0
        physics.qpos[joint : joint + 3], physics.qvel[dof : dof + 3] = target, self._velocity(link, target)
        state["target"] = physics.ctrl[state["actuator"] :][:3] = target
        physics.touch()

    def _open(self, path: HandPath, link: int) -> None:
        """A path on skin leads through the bare hulls of its link and of the links beside it. They are rough,
        and stick out of the skin of some robots by up to two centimetres, where the robot itself has none; a
        pad that slides into the notch between skin and hull is wedged with thousands of newtons."""
        model, bit = self._physics.model, int(self._physics.model.geom_contype[self._geoms[0]])
        model.geom_conaffinity[self._hard] |= bit
        parent = model.body_parentid
        bodies = {geom: model.geom_bodyid[geom] for geom in self._hard}
        near = [geom for geom, body in bodies.items() if link in (body, parent[body]) or body == parent[link]]
        skins = [mesh for geom, mesh in self._skins if model.geom_bodyid[geom] == link]
        points = np.array(path.points).reshape(-1, 3)
        points = points[:: max(1, len(points) // 20)]
        if skins:
            taxels = np.concatenate(skins)
            apart = np.linalg.norm(points[:, None] - taxels[None], axis=2).min(axis=1)
            if (apart < _ON_SKIN).all():
                model.geom_conaffinity[near] &= ~bit
        self._solid = np.flatnonzero(model.geom_conaffinity & bit).tolist()

    def _watch(self, link: int) -> None:
        """The person has watched the link before: it moved as it does now."""
        data, step, now = self._physics.data, self._physics.step, self._physics.steps
        p, q, twist = data.xpos[link], data.xquat[link], np.zeros(6)
        mujoco.mj_objectVelocity(self._physics.model, data, mujoco.mjtObj.mjOBJ_XBODY, link, twist, 0)
        w, v = twist[:3], twist[3:]
        memory = self._hands.memories[self._number]
        memory["felt"] = memory["wanted"] = 0.0
        speed, a, j = max(float(np.linalg.norm(w)), 1e-12), np.cross(w, v), np.cross(w, np.cross(w, v))
        steps = np.arange(1, int(self._state["delay"]) + round(WINDOW / step) + 2)
        ages = (steps * step)[:, None]
        back = np.column_stack([np.cos(0.5 * speed * ages), -np.sin(0.5 * speed * ages) * (w / speed)])
        # rows: the quaternion products of 1, i, j and k with q
        spin = np.array(
            [q, [-q[1], q[0], -q[3], q[2]], [-q[2], q[3], q[0], -q[1]], [-q[3], -q[2], q[1], q[0]]]
        )
        memory["place"][(now - steps) % RING] = p - ages * (v - ages / 2.0 * (a - ages / 3.0 * j))
        memory["turn"][(now - steps) % RING] = back @ spin
        self._state["place"], self._state["turn"] = p, q
        self._state["spin"], self._state["drift"] = w, v - np.cross(w, p)

    def _velocity(self, link: int, point: Array) -> Array:
        data, twist = self._physics.data, np.zeros(6)
        mujoco.mj_objectVelocity(self._physics.model, data, mujoco.mjtObj.mjOBJ_XBODY, link, twist, 0)
        result: Array = twist[3:] + np.cross(twist[:3], point - data.xpos[link])
        return result

    def _pose(self, moment: Any, link: int) -> Array:
        """Puts the pads where a plan has them, and returns the place (3,) of the hand in the world."""
        model, data = self._physics.model, self._physics.data
        R = data.xmat[link].reshape(3, 3)
        base: Array = data.xpos[link] + R @ moment["base"]
        first, back = int(self._state["pads"]), np.empty(9)
        turn_back, in_world = np.empty((2, 4))
        flesh = model.body_quat[first - 1]
        mujoco.mju_mulQuat(flesh, data.xquat[link], moment["turn"][0])
        mujoco.mju_negQuat(turn_back, flesh)
        mujoco.mju_quat2Mat(back, turn_back)
        for k, (place, turn) in enumerate(zip(moment["place"], moment["turn"], strict=True)):
            model.body_pos[first + k] = back.reshape(3, 3) @ (data.xpos[link] + R @ place - base)
            mujoco.mju_mulQuat(in_world, data.xquat[link], turn)
            mujoco.mju_mulQuat(model.body_quat[first + k], turn_back, in_world)
        hand: Array = base + R @ moment["ahead"]
        return hand

    def _heights(self, path: HandPath, turns: Array, link: int) -> Array:
        """Heights (n, k) [m] above a path's points at which each pad first touches a body, of those that lie
        near: a person sees where the surface is."""
        model, data = self._physics.model, self._scratch
        source = self._physics.data
        data.geom_xpos[:], data.geom_xmat[:] = source.geom_xpos, source.geom_xmat
        data.xpos[:], data.xmat[:] = source.xpos, source.xmat
        R, p = source.xmat[link].reshape(3, 3), source.xpos[link]
        points, normals = np.array(path.points), np.array(path.normals)
        near = [geom for geom in self._solid if model.geom_bodyid[geom] == link]
        if not near:
            raise TciError(f"{path.link} has no surface that can be touched")
        heights, local = np.zeros(points.shape[:2]), np.empty(9)
        rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), 40)).round().astype(int))
        for k, name in enumerate(path.pads):
            geom = self._geoms[PADS.index(name)]
            found = {}
            for n in rows.tolist():
                key = (*points[n, k], *normals[n, k])
                if key not in found:
                    mujoco.mju_quat2Mat(local, turns[n, k])
                    place, normal = p + R @ points[n, k], R @ normals[n, k]
                    turn = R @ local.reshape(3, 3)
                    found[key] = self._height(geom, near, place, normal, turn)
                heights[n, k] = found[key]
            heights[:, k] = np.interp(np.arange(len(points)), rows, heights[rows, k])
        return heights

    def _height(self, geom: int, near: list[int], point: Array, normal: Array, turn: Array) -> float:
        model, data = self._physics.model, self._scratch
        height = 0.05
        for _ in range(8):
            self._put(geom, point + height * normal, turn)
            room = min(mujoco.mj_geomDistance(model, data, geom, other, 0.06, None) for other in near)
            height -= room - MARGIN
            if abs(room - MARGIN) < 2e-5:
                break
        return height

    def _put(self, geom: int, place: Array, turn: Array) -> None:
        """Places a pad (a geom) and turns it (3, 3), on paper."""
        model, data, own = self._physics.model, self._scratch, np.empty(9)
        mujoco.mju_quat2Mat(own, model.geom_quat[geom])
        data.geom_xmat[geom] = (turn @ own.reshape(3, 3)).ravel()
        data.geom_xpos[geom] = place + turn @ model.geom_pos[geom]

    def _blocked(self, path: HandPath, plan: Moments, flight: int, link: int) -> str:
        """Says which pad would meet a body on its way to the skin, or another body than the link later: the
        hand would start in it, or touch what it should not."""
        model, source, turn = self._physics.model, self._physics.data, np.empty(9)
        R, p = source.xmat[link].reshape(3, 3), source.xpos[link]
        solid, used = np.array(self._solid), [self._geoms[PADS.index(name)] for name in path.pads]
        middles, radii = self._scratch.geom_xpos[solid], model.geom_rbound[solid]
        on_link = model.geom_bodyid[solid] == link
        way = np.linspace(0, flight, 4).astype(int).tolist()
        for row in (*way, *np.linspace(flight, len(plan) - 1 - flight, 5).astype(int).tolist()[1:]):
            for k, geom in enumerate(self._geoms):
                mujoco.mju_quat2Mat(turn, plan["turn"][row, k])
                self._put(geom, p + R @ plan["place"][row, k], R @ turn.reshape(3, 3))
                apart = middles - self._scratch.geom_xpos[geom]
                near = np.einsum("ij,ij->i", apart, apart) < (radii + model.geom_rbound[geom]) ** 2
                if row > flight and geom in used:
                    near &= ~on_link
                for other in solid[near].tolist():
                    room = mujoco.mj_geomDistance(model, self._scratch, geom, other, 1e-3, None)
                    if room < -_INSIDE:
                        return f"its {PADS[k]} would be {-room:.4f} m inside {_of(model, other)}"
        return ""

    def _park(self) -> None:
        physics = self._physics
        joint, dof, actuator = (int(self._state[name]) for name in ("joint", "dof", "actuator"))
        physics.qpos[joint : joint + DOFS] = physics.qvel[dof : dof + DOFS] = 0.0
        physics.ctrl[actuator : actuator + 3] = 0.0
        physics.qpos[joint + 2] = physics.ctrl[actuator + 2] = AWAY
        physics.touch()

    def _clear(self) -> None:
        for name in ("force", "peak", "trim", "trim_rate", "traced", "hit"):
            self._state[name] = 0
        self._state["begun"] = self._state["lost"] = np.nan


class Person:
    """A person beside the robot, with the hands that the `PersonModel` has."""

    def __init__(self, model: PersonModel, hands: Mapping[str, Hand]) -> None:
        self.model, self._hands = model, dict(hands)

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def hands(self) -> tuple[Hand, ...]:
        return tuple(self._hands.values())

    @property
    def left(self) -> Hand:
        """Raises CommandError if the model of this person has no left hand."""
        return self._hand("left")

    @property
    def right(self) -> Hand:
        """Raises CommandError if the model of this person has no right hand."""
        return self._hand("right")

    def _hand(self, side: str) -> Hand:
        if side not in self._hands:
            raise CommandError(f"{self.name} has no {side} hand here; valid: {', '.join(self._hands)}")
        return self._hands[side]


def _of(model: mujoco.MjModel, geom: int) -> str:
    """Name of a geom, or of its body."""
    return str(model.geom(geom).name or model.body(int(model.geom_bodyid[geom])).name)


def _long_axis(model: mujoco.MjModel, body: int) -> Array:
    """Direction (3,) of a link's length, in its frame: the axis of its least moment of inertia."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axis: Array = rotation.reshape(3, 3)[:, int(np.argmin(model.body_inertia[body]))]
    return read_only(axis)
