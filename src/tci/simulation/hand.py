"""A person's hand in the simulation: a palm and five finger tips on soft pads, carried by a soft arm.

`hand_model` has its bodies and springs. What it is to do is a `HandPath`, how it gets there plans
`hand_planner`, and `hand_control` moves the springs' ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, TciError, UnknownNameError
from tci.messages.frames import Array, transform
from tci.simulation import hand_control as at
from tci.simulation.hand_control import AWAY, DOFS, HAND, MOMENT, NOTED, RING, SEEN, TRACE, WINDOW
from tci.simulation.hand_model import ARM_DAMPING, PersonModel
from tci.simulation.hand_path import PADS, HandPath, Moments
from tci.simulation.hand_planner import HandPlanner
from tci.simulation.physics import Physics, exclusive
from tci.skin.surfaces import Surface
from tci.support.engine import mujoco

FLAT = 5.0
"""Force [N] from which a soft pad lies flat on the skin. Assumed: so the contact of a fingertip at 1 N is
1 cm2 large, as people's."""


class Hands:
    """All hands of a world, in the arrays of the compiled loop."""

    def __init__(self, physics: Physics, people: dict[str, PersonModel]) -> None:
        """`people` has one entry for each hand, by the name of its body."""
        self.physics, model, data = physics, physics.model, physics.data
        self.names = tuple(people)
        count = len(people)
        self.states = np.zeros(count, HAND)
        self.pads = np.zeros((count, 3))
        """What skin needs to know of each hand, see `hand_control.WIDTH`."""
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
        self.pads[:, at.SENSOR] = self.states["sensor"]
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
        self._planner = HandPlanner(self._physics, self.name, person, surfaces)
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
    def leads(self) -> str:
        """The pad that presses most in this touch."""
        return PADS[int(np.argmax(self._hands.plans[self._number]["share"].max(axis=0)))]

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
        return self._planner.height(link, pad, point, normal)

    def turn(self, link: str, normal: ArrayLike) -> Array:
        """Orientation (4,) of a pad that touches against an outward normal, in the link's frame."""
        return self._planner.turn(link, normal)

    # ------------------------------------------------------------------ how it begins

    def _begin(self, path: HandPath) -> None:
        physics, model = self._physics, self._physics.model
        physics.refresh()
        link = model.body(path.link).id
        plan = self._planner.plan(path, link)
        self._hands.plans[self._number] = plan
        self._hands.renew()
        self._clear()
        self._hands.pads[self._number, at.WIDTH :] = path.spread, FLAT * len(path.pads)
        state, steps = self._state, physics.steps
        state["link"], state["start"], state["guided"], state["active"] = link, steps, steps - 1, 1
        self._watch(link)
        target = self._pose(plan[0], link)
        dof, joint = state["dof"], state["joint"]
        physics.qpos[joint : joint + DOFS] = physics.qvel[dof : dof + DOFS] = 0.0
        physics.qpos[joint : joint + 3], physics.qvel[dof : dof + 3] = target, self._velocity(link, target)
        state["target"] = physics.ctrl[state["actuator"] :][:3] = target
        physics.touch()

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
