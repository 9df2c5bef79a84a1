"""Trials of touch without skin: pushes on a moving arm, and motion without any."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from joint_touch.bare import bare_body, random_push
from joint_touch.plant import PERIOD, Plant, Push
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.frames import Array
from tci.gate.gate import Gate
from tci.messages import Contact, Reading

NEWTON = 15.0
BEGIN, LOOKED_AT, END = 0.3, 0.5, 0.6
"""Times [s] at which the push begins, the estimate is judged, and the push ends."""
ANSWERED, AWAY = 0.5, 0.01
"""Time [s] after a push in which the arm must have moved, and the least displacement [m] along the push."""


@dataclass(frozen=True)
class Felt:
    """A push, and the contact that was felt 0.2 s after its begin."""

    patch: str
    """Patch that was pushed."""
    push: Push
    contact: Contact | None
    """Contact that was felt; None for none."""

    @property
    def right(self) -> bool:
        """True if it was felt on the segment that was pushed."""
        return self.contact is not None and self.contact.patch == self.patch

    @property
    def error(self) -> float:
        """Distance [m] of the estimated from the true place; infinite on another segment or if not felt."""
        if self.contact is None or not self.right:
            return float("inf")
        return float(np.linalg.norm(self.contact.p_L - self.push.point))

    @property
    def force_error(self) -> float:
        """Relative error of the force; 1 if it was not felt."""
        return 1.0 if self.contact is None else abs(self.contact.force / NEWTON - 1.0)

    @property
    def certainty(self) -> float:
        """Certainty of the contact; 0 if it was not felt."""
        return 0.0 if self.contact is None else self.contact.certainty


def pushed(patch: str, seed: int) -> Felt:
    """Pushes a random place of a moving arm with `NEWTON`."""
    body = bare_body()
    plant, perceiver = Plant(body.robot, seed), Perceiver(body)
    push = random_push(patch, np.random.default_rng([seed, 1]), newton=NEWTON, begin=BEGIN, end=END)
    while True:
        joints = plant.step(push)
        found = perceiver.step(Reading(joints, ()), joints.stamp).contacts
        if plant.time >= LOOKED_AT:
            return Felt(patch, push, found[0] if found else None)


def untouched(seed: int, seconds: float) -> tuple[int, float]:
    """Moves an arm that nobody touches.

    Returns the number of contacts, and the time [s] within which 99 % of the perceptions were made.
    """
    body = bare_body()
    random = np.random.default_rng([seed, 2])
    plant = Plant(body.robot, seed, amplitude=random.uniform(0.3, 0.6), hertz=random.uniform(0.2, 0.6))
    perceiver, seen, took = Perceiver(body), set[int](), []
    for _ in range(round(seconds / PERIOD)):
        joints = plant.step()
        begin = time.perf_counter()
        perception = perceiver.step(Reading(joints, ()), joints.stamp)
        took.append(time.perf_counter() - begin)
        seen |= set(perception.contacts.identity.tolist())
    return len(seen), float(np.percentile(took, 99.0))


def withdrawn(patch: str, seed: int) -> tuple[bool, bool]:
    """Pushes a moving arm under the withdrawal reflex, whose commands pass the gate.

    Returns whether it answered, and whether the place that was pushed moved away along the push: by `AWAY`
    more than on an arm that stops when the reflex answers, which the same push displaces too.
    """
    body = bare_body()
    random = np.random.default_rng([seed, 3])
    push = random_push(patch, random, newton=NEWTON, begin=BEGIN, end=BEGIN + ANSWERED)
    answered, moved = _displaced(body, seed, push, withdraws=True)
    _, yielded = _displaced(body, seed, push, withdraws=False)
    return answered, moved - yielded > AWAY


def _displaced(body: GenericBody, seed: int, push: Push, *, withdraws: bool) -> tuple[bool, float]:
    """Returns whether the reflex gave a command, and the displacement [m] along the push in `ANSWERED`."""
    plant, perceiver = Plant(body.robot, seed), Perceiver(body)
    gate = Gate(body.robot, period=PERIOD, stale_after=0.05)
    reflex = WithdrawalReflex()
    memory = reflex.init(body)
    target: Array | None = None
    answered, start, along = False, np.zeros(3), np.zeros(3)
    while plant.time < push.end:
        joints = plant.step(push, target=target)
        perception = perceiver.step(Reading(joints, ()), joints.stamp)
        pose = body.skin.link_pose(push.link, joints)
        here = pose[:3, :3] @ push.point + pose[:3, 3]
        if plant.time <= push.begin:
            start, along = here, pose[:3, :3] @ push.force / np.linalg.norm(push.force)
        else:
            commands, memory = reflex.step(memory, perception, body)
            orders, _ = body.to_platform(commands, joints)
            safe = gate.step(orders, joints, joints.stamp)
            answered |= bool(commands)
            if answered and not withdraws:
                target = plant.target
            elif answered:
                wanted = plant.home.copy()
                wanted[plant.servos] = plant.target
                wanted[safe.servos] = safe.position
                target = wanted[plant.servos]
    return answered, float(along @ (here - start))
